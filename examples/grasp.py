"""Two fingers hold an object: the squeezing force changes the stiffness.

Point contacts cannot resist a spin about the line that joins them. The other two rotational
stiffnesses fall as the fingers squeeze harder: the load on each finger enters K, although the
object as a whole is unloaded.
"""

from pathlib import Path

import numpy as np

import cartstiff

SHARES = np.linspace(0.0, 4.0, 9)


def main(picture: Path | None = None) -> dict[str, float]:
    """Rotational stiffness (N m/rad) and stiffness along the contacts' line against squeezing."""
    hand = cartstiff.load("grasp")
    given = {
        name: rest
        for name, rest, idle in zip(
            hand.names, hand.springs.rest, hand.springs.is_passive, strict=True
        )
        if np.isfinite(rest) and not idle
    }
    rows = []
    for share in SHARES:
        # Rest positions further behind the posture squeeze more.
        at = dict(zip(hand.names, hand.q, strict=True))
        rest = {name: at[name] - share * (at[name] - r) for name, r in given.items()}
        squeezing = hand.with_springs(rest=rest)
        rows.append(np.diag(cartstiff.analyse(squeezing).matrices["B"]))
    values = np.array(rows)
    if picture is not None:
        draw(values, picture)
    as_in_file = 2  # share 1
    return {
        "spin about the contacts' line": float(abs(values[as_in_file, 1])),
        "rotation about x, no squeeze": float(values[0, 0]),
        "rotation about x, as in the file": float(values[as_in_file, 0]),
        "rotation about x, four times": float(values[-1, 0]),
        "rotation about z, no squeeze": float(values[0, 2]),
        "rotation about z, as in the file": float(values[as_in_file, 2]),
        "rotation about z, four times": float(values[-1, 2]),
    }


def draw(values: np.ndarray, picture: Path) -> None:
    """Rotational stiffnesses against squeezing."""
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(6, 3.4), layout="constrained")
    for i, name in enumerate("xyz"):
        axis.plot(SHARES, values[:, i], "o-", label=f"about {name}")
    axis.set(xlabel="squeeze against the file's", ylabel="rotational stiffness [N m/rad]")
    axis.legend()
    figure.savefig(picture, dpi=80)
