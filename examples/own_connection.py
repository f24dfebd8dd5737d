"""Your own connection: three more stiffness matrices of the same loaded platform.

The Levi-Civita connection of a body's inertia, a family between Cartan's two connections, and a
connection that is neither symmetric nor known by name.
"""

from pathlib import Path

import numpy as np

import cartstiff
from cartstiff.geometry import KINEMATIC, Connection, from_bilinear_map, levi_civita, se3


def between(share: float) -> Connection:
    """nabla_X Y = share [X, Y]: A at 0, B at 1/2, Cartan plus at 1."""
    return from_bilinear_map(lambda x, y: share * se3.bracket(x, y), f"{share:g} [X, Y]")


def main(picture: Path | None = None) -> dict[str, object]:
    """What each connection makes of the paper's platform."""
    K = cartstiff.analyse(cartstiff.load("stewart-gough")).B

    # A ball of unit mass at the origin of M gives the kinematic connection; a plate does not.
    ball = levi_civita(np.diag([0.4, 0.4, 0.4, 1, 1, 1]), "ball")
    plate = levi_civita(np.diag([1.0, 2.0, 3.0, 1, 1, 1]), "plate")
    odd = from_bilinear_map(lambda x, y: np.concatenate([np.cross(x[:3], y[:3]), y[3:] * 0]), "odd")

    shares = np.linspace(0, 1, 21)
    asymmetry = [np.abs(K.to_connection(between(s)).asymmetry).max() for s in shares]
    if picture is not None:
        draw(shares, asymmetry, picture)
    under_plate, under_odd = K.to_connection(plate), K.to_connection(odd)
    return {
        "ball is the kinematic connection": bool(np.allclose(ball.symbols, KINEMATIC.symbols)),
        "plate is symmetric": plate.is_symmetric,
        "plate is bi-invariant": plate.is_bi_invariant,
        "plate against K^K, N cm/rad": float(
            np.abs(under_plate.matrix - K.to_connection("K").matrix).max()
        ),
        "odd: asymmetry, N": float(np.abs(under_odd.asymmetry).max()),
        "odd: error of the prediction, N": float(
            np.abs(under_odd.asymmetry - under_odd.predicted_asymmetry).max()
        ),
        "asymmetry at share 1/2": float(asymmetry[10]),
    }


def draw(shares: np.ndarray, asymmetry: list[float], picture: Path) -> None:
    """Asymmetry between the two Cartan connections."""
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(6, 3.2), layout="constrained")
    axis.plot(shares, asymmetry, "o-")
    axis.set(xlabel="share s in ∇_X Y = s [X, Y]", ylabel="largest entry of $|K - K^T|$ [N cm]")
    figure.savefig(picture, dpi=80)
