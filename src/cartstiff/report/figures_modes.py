"""Pictures of responses over frequency, and of stability lobes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.figures import new_figure
from cartstiff.vibration.chatter import Lobes
from cartstiff.vibration.mode_set import Modes
from cartstiff.vibration.response import FrequencyResponse


def draw_response(
    response: FrequencyResponse, direction: ArrayLike | None = None, modes: Modes | None = None
) -> Any:
    """Bode diagram: size and phase of each curve, frequencies of the modes as thin lines.

    Parameters
    ----------
    response : FrequencyResponse
        What is drawn.
    direction : array_like (3,), optional
        One curve along it; default x, y and z.
    modes : Modes, optional
        Whose frequencies are marked.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    MissingDependencyError
        Without matplotlib.
    """
    figure = new_figure(7.0, 5.0)
    size, phase = figure.subplots(2, 1, sharex=True, height_ratios=[2, 1])
    for name, values in response.curves(direction).items():
        shown = np.where(np.abs(values) > 0.0, np.abs(values), np.nan)
        if np.isfinite(shown).any():
            size.semilogy(response.frequencies, shown, label=name)
            phase.plot(response.frequencies, np.degrees(np.angle(values)))
    for f in [] if modes is None else modes.frequencies:
        if response.frequencies[0] <= f <= response.frequencies[-1]:
            for axis in (size, phase):
                axis.axvline(f, color="0.8", linewidth=0.8, zorder=0)
    if response.frequencies[0] > 0.0:
        size.set_xscale("log")
        phase.xaxis.set_major_formatter("{x:g}")
        phase.xaxis.set_minor_formatter("{x:g}" if _is_narrow(response.frequencies) else "")
    size.yaxis.set_major_formatter("{x:.0e}")
    size.set(ylabel=f"{response.kind} [{response.unit}]")
    phase.set(
        xlabel="frequency [Hz]",
        ylabel="phase [deg]",
        ylim=(-190, 190),
        yticks=[-180, -90, 0, 90, 180],
    )
    if size.get_legend_handles_labels()[0]:
        size.legend()
    return figure


def draw_lobes(curve: Lobes, unit: str) -> Any:
    """Limiting depth over the spindle's speed and the depth that is stable at every speed.

    Parameters
    ----------
    curve : Lobes
        By the zeroth-order theory.
    unit : str
        Unit of the depths.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    MissingDependencyError
        Without matplotlib.
    """
    figure = new_figure(7.0, 4.0)
    axis = figure.subplots()
    depths = np.where(np.isfinite(curve.depths), curve.depths, np.nan)
    axis.plot(curve.speeds, depths, label="zeroth order")
    if np.isfinite(curve.least):
        axis.axhline(curve.least, color="0.6", linestyle="--", label="stable at every speed")
    axis.set(xlabel="speed [rev/min]", ylabel=f"limiting depth [{unit}]")
    axis.set_ylim(bottom=0.0)
    axis.legend()
    return figure


def _is_narrow(frequencies: np.ndarray) -> bool:
    """Whether a logarithmic axis would have one or two numbers on it."""
    return bool(frequencies[-1] < 10.0 * frequencies[0])
