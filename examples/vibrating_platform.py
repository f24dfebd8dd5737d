"""Vibrations of a platform under a load: the frequencies belong to it.

The Stewart platform of the stewart-simscape simulator, with the masses of platform and struts.
The picture is the motion of a point 50 mm over the platform per force at it, without a load and
under 60 kN downwards.
"""

from pathlib import Path

import numpy as np

import cartstiff
from cartstiff.vibration import FrequencyResponse, frequency_response

TIP = (0.0, 0.0, 0.05)  # m, in the body frame
RATIO = 0.02  # of critical damping, of every mode


def main(picture: Path | None = None) -> dict[str, object]:
    """Frequencies (Hz) and static compliance (um/kN)."""
    platform = cartstiff.load("stewart-simscape")
    free = cartstiff.modes(platform)
    loaded = cartstiff.modes(platform, wrench=[0, 0, 0, 0, 0, -60e3], load_axes="world")
    hertz = np.geomspace(300.0, 2000.0, 600)
    responses = [frequency_response(found, hertz, RATIO, at=TIP) for found in (free, loaded)]
    at_rest = frequency_response(free, [0.0], RATIO, at=TIP).along([1, 0, 0])[0]
    if picture is not None:
        draw(responses, picture)
    return {
        "first frequency, Hz": float(free.frequencies[0]),
        "last frequency, Hz": float(free.frequencies[-1]),
        "first frequency under 60 kN, Hz": float(loaded.frequencies[0]),
        "static compliance along x, um/kN": 1e9 * float(at_rest.real),
    }


def draw(responses: list[FrequencyResponse], picture: Path) -> None:
    """Receptance over frequency."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(6, 3.2), layout="constrained")
    for response, words, style in zip(responses, ("no load", "60 kN"), ("-", "--"), strict=True):
        for axis, colour in zip(np.eye(3)[[0, 2]], ("C0", "C1"), strict=True):
            name = "x" if axis[0] else "z"
            size = 1e9 * np.abs(response.along(axis))
            axes.loglog(response.frequencies, size, style, color=colour, label=f"{name}, {words}")
    axes.set(xlabel="frequency [Hz]", ylabel="receptance [um/kN]")
    axes.legend(fontsize="small")
    figure.savefig(picture, dpi=80)
