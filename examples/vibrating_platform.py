"""Vibrations of a platform, and the largest depth of cut of a mill on it.

The Stewart platform of the stewart-simscape simulator, with the masses of platform and struts.
Above, the motion of a point 50 mm over the platform per force at it, without a load and under 60 kN
downwards: the frequencies belong to a load. Below, the stability lobes of a mill with three teeth
at half immersion.
"""

from math import pi
from pathlib import Path

import numpy as np

import cartstiff
from cartstiff.vibration.chatter import Lobes, Milling, lobes
from cartstiff.vibration.response import FrequencyResponse, frequency_response

TIP = (0.0, 0.0, 0.05)  # m, in the body frame
RATIO = 0.02  # of critical damping, of every mode
MILL = Milling(tangential=6e8, radial=0.3, teeth=3, entry=0.0, exit=pi / 2, at=TIP)  # N/m^2
SPEEDS = np.linspace(9000.0, 20000.0, 300)  # revolutions per minute


def main(picture: Path | None = None) -> dict[str, object]:
    """Frequencies (Hz), static compliance (um/kN) and depths of cut (mm)."""
    platform = cartstiff.load("stewart-simscape")
    free = cartstiff.modes(platform)
    loaded = cartstiff.modes(platform, wrench=[0, 0, 0, 0, 0, -60e3], load_axes="world")
    hertz = np.geomspace(300.0, 2000.0, 600)
    responses = [frequency_response(found, hertz, RATIO, at=TIP) for found in (free, loaded)]
    at_rest = frequency_response(free, [0.0], RATIO, at=TIP).along([1, 0, 0])[0]
    curve = lobes(free, MILL, SPEEDS, RATIO)
    if picture is not None:
        draw(responses, curve, picture)
    return {
        "first frequency, Hz": float(free.frequencies[0]),
        "last frequency, Hz": float(free.frequencies[-1]),
        "first frequency under 60 kN, Hz": float(loaded.frequencies[0]),
        "static compliance along x, um/kN": 1e9 * float(at_rest.real),
        "depth that is stable at every speed, mm": 1e3 * curve.least,
        "deepest between the speeds, mm": 1e3 * float(curve.depths.max()),
    }


def draw(responses: list[FrequencyResponse], curve: Lobes, picture: Path) -> None:
    """Receptance over frequency; depth of cut over speed."""
    import matplotlib.pyplot as plt

    figure, (above, below) = plt.subplots(2, 1, figsize=(6, 5.6), layout="constrained")
    for response, words, style in zip(responses, ("no load", "60 kN"), ("-", "--"), strict=True):
        for axis, colour in zip(np.eye(3)[[0, 2]], ("C0", "C1"), strict=True):
            name = "x" if axis[0] else "z"
            size = 1e9 * np.abs(response.along(axis))
            above.loglog(response.frequencies, size, style, color=colour, label=f"{name}, {words}")
    above.set(xlabel="frequency [Hz]", ylabel="receptance [um/kN]")
    above.legend(fontsize="small")
    below.plot(curve.speeds, 1e3 * curve.depths, label="limit")
    below.axhline(1e3 * curve.least, color="0.5", linestyle=":")
    below.set(xlabel="speed [rev/min]", ylabel="depth of cut [mm]", ylim=(0, None))
    below.legend(fontsize="small")
    figure.savefig(picture, dpi=80)
