"""Chatter in milling: how deep a cut may be before the tool regenerates its own waves.

The cutter, with N teeth, cuts from the entry to the exit angle. A tooth at angle phi meets the chip
``h = dx sin phi + dy cos phi`` made by its motion since the tooth before, with a tangential force
``K_t a h`` and a radial one K_r times that; x is the feed, y the normal to it, angles count from y.
So ``F = 1/2 a K_t A(t) (r(t) - r(t - tau))`` with the directional coefficients A [AltintasBudak]_.

*Zeroth order*: A is replaced by its mean ``N/(2 pi) alpha``. With the receptance G (2 x 2) at the
tool the limit at a chatter frequency is, mu an eigenvalue of ``alpha G`` and ``Lambda = -1/mu``,

    a = -2 pi Re Lambda / (N K_t) (1 + (Im Lambda / Re Lambda)^2)

The mean does not see the second family of lobes (period doubling) of small immersions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.arrays import (
    Array,
    Result,
    checked_array,
    checked_number,
    checked_unit,
    checked_vector,
    fixed,
)
from cartstiff.errors import CartstiffError, InputError, one_line
from cartstiff.figures import new_axes
from cartstiff.loading.tables import read_response
from cartstiff.mechanisms.contract import SI, Units, convert_length
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.potentials.beams import Beam
from cartstiff.potentials.springs import CoupledSprings
from cartstiff.results import LabelledResult
from cartstiff.vibration.modes import Modes, modes
from cartstiff.vibration.response import Damping, motion_at, transfer

#: Decimals to which pi may be rounded in an exit angle.
_PI_DECIMALS = 4


@dataclass(frozen=True)
class Milling:
    """A cutter and its force law.

    Attributes
    ----------
    tangential : float
        K_t, force per area.
    radial : float
        K_r: radial over tangential force.
    teeth : int
        N.
    entry, exit : float
        Angles [rad] at which a tooth enters and leaves, from the normal in the direction of the
        cutter's turn, ``0 <= entry < exit <= pi``. Half immersion: 0 to pi/2 up-milling, pi/2 to pi
        down-milling; a slot: 0 to pi, which may be typed as 3.1416.
    feed : tuple of float
        Direction of the feed, in M; default x.
    normal : tuple of float
        Normal to the feed, in M; default y.
    at : tuple of float
        Tip of the tool, in M; default its origin.

    Raises
    ------
    InputError
        For numbers that cannot be used.
    """

    tangential: float
    radial: float
    teeth: int
    entry: float
    exit: float
    feed: tuple[float, float, float] = (1.0, 0.0, 0.0)
    normal: tuple[float, float, float] = (0.0, 1.0, 0.0)
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if not checked_number(self.tangential, "cutting coefficient") > 0.0:
            raise InputError(
                "cutting coefficient cannot be used", expected="above zero", got=self.tangential
            )
        checked_number(self.radial, "radial coefficient")
        if not (self.teeth == int(self.teeth) and self.teeth >= 1):
            raise InputError(
                "number of teeth cannot be used", expected="a whole number from 1", got=self.teeth
            )
        if np.pi < self.exit <= round(np.pi, _PI_DECIMALS):
            object.__setattr__(self, "exit", np.pi)
        if not 0.0 <= self.entry < self.exit <= np.pi:
            raise InputError(
                "immersion cannot be used",
                expected="0 <= entry < exit <= pi",
                got=[self.entry, self.exit],
            )
        u, v = checked_unit(self.feed, "feed"), checked_unit(self.normal, "normal")
        if abs(u @ v) > numerics.NEGLIGIBLE_DISTANCE:
            raise InputError("feed and normal are not at right angles", got=float(u @ v))
        checked_vector(self.at, 3, "tool's tip")

    @property
    def directions(self) -> Array:
        """Feed and normal as rows (2, 3)."""
        return np.stack([checked_unit(self.feed), checked_unit(self.normal)])

    @property
    def mean(self) -> Array:
        """Alpha (2, 2), which ``N / (2 pi)`` makes the mean of A."""
        r = self.radial

        def at(p: float) -> Array:
            s, c = np.sin(2 * p), np.cos(2 * p)
            return 0.5 * np.array(
                [
                    [c - 2 * r * p + r * s, -s - 2 * p + r * c],
                    [-s + 2 * p + r * c, -c - 2 * r * p - r * s],
                ]
            )

        return at(self.exit) - at(self.entry)


# Range of the search for chatter, as shares of the lowest and of the highest frequency, and number
# of frequencies in it.
_LOWEST_SHARE, _HIGHEST_SHARE, _COUNT = 0.5, 1.8, 4000


@dataclass(frozen=True, eq=False)
class MeasuredReceptance:
    """Receptance at the tool as measured, in place of the modes of a mechanism.

    Attributes
    ----------
    frequencies : ndarray (N,)
        Hz, ascending.
    matrices : complex ndarray (N, 2, 2)
        Displacement per force, along feed and normal: ``r = G F``.
    """

    frequencies: Array
    matrices: Array

    def __post_init__(self) -> None:
        hertz = checked_array(self.frequencies, ("n",), "measured frequencies")
        parts = np.asarray(self.matrices, complex)
        for part in (parts.real, parts.imag):
            checked_array(part, (hertz.size, 2, 2), "measured receptance")
        if hertz.size < 2 or not (np.diff(hertz) > 0.0).all() or hertz[0] <= 0.0:
            raise InputError(
                "measured frequencies cannot be used",
                expected="two or more above zero, ascending",
                got=hertz.tolist()[:3],
            )
        object.__setattr__(self, "frequencies", fixed(hertz))
        object.__setattr__(self, "matrices", fixed(parts))

    @classmethod
    def read(cls, feed: Path, normal: Path | None = None, units: Units = SI) -> MeasuredReceptance:
        """From files of three columns, see `cartstiff.loading.tables.read_response`.

        Parameters
        ----------
        feed, normal : Path
            Response along feed and normal to a force along the same; without the second both are
            alike. What one does to the other is left out.
        units : Units
            Units of the displacement per force.

        Raises
        ------
        InputError
            If the two have other frequencies, or a file cannot be read.
        """
        length, force = convert_length(SI, units)
        (hertz, G), *more = [
            read_response(Path(path)) for path in (feed, normal) if path is not None
        ]
        for other, _ in more:
            if other.shape != hertz.shape or not np.allclose(
                other, hertz, rtol=numerics.NEGLIGIBLE_DISTANCE
            ):
                raise InputError(
                    "the responses along feed and normal have other frequencies",
                    where=one_line(str(normal)),
                    expected=f"{len(hertz)} from {hertz[0]:g} to {hertz[-1]:g} Hz",
                    got=f"{len(other)} from {other[0]:g} to {other[-1]:g} Hz",
                )
        parts = np.zeros((len(hertz), 2, 2), complex)
        parts[:, 0, 0], parts[:, 1, 1] = G, more[0][1] if more else G
        return cls(hertz, parts * (length / force))


@dataclass(frozen=True, eq=False, repr=False)
class Lobes(Result, LabelledResult):
    """Limits of stability over the spindle's speed.

    Attributes
    ----------
    speeds : ndarray (N,)
        Revolutions per minute.
    depths : ndarray (N,)
        Largest stable depth of cut.
    chatter : ndarray (N,)
        Frequency [Hz] of the chatter beyond that depth.
    least : float
        Depth that is stable at every speed.
    assumed : str
        Assumptions about the parts that hold the tool.
    """

    speeds: Array
    depths: Array
    chatter: Array
    least: float
    assumed: str = ""

    def plot(self, unit: str = "") -> Any:
        """Draw the limiting depth over the spindle's speed, and the depth stable at every speed.

        Parameters
        ----------
        unit : str
            Unit of the depths, for the label of their axis.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        MissingDependencyError
            Without matplotlib.
        """
        figure, axis = new_axes(7.0, 4.0)
        depths = np.where(np.isfinite(self.depths), self.depths, np.nan)
        axis.plot(self.speeds, depths, label="zeroth order")
        if np.isfinite(self.least):
            axis.axhline(self.least, color="0.6", linestyle="--", label="stable at every speed")
        axis.set(
            xlabel="speed [rev/min]",
            ylabel=f"limiting depth [{unit}]" if unit else "limiting depth",
        )
        axis.set_ylim(bottom=0.0)
        axis.legend()
        return figure


def _limits(
    modes: Modes | MeasuredReceptance,
    milling: Milling,
    damping: Damping | float,
    frequencies: ArrayLike | None,
) -> tuple[Array, Array, Array]:
    """Chatter frequencies, depths and phases of all eigenvalues with a limit, flat."""
    hertz, G = _receptance(modes, milling, damping, frequencies)
    mu = _eigenvalues(milling.mean @ np.nan_to_num(G, nan=0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        L = -1.0 / mu
        kappa = L.imag / L.real
        depths = -2 * np.pi * L.real / (milling.teeth * milling.tangential) * (1 + kappa**2)
    depths = np.where((depths > 0.0) & np.isfinite(depths), depths, np.nan)
    phases = np.pi - 2 * np.arctan(np.nan_to_num(kappa))
    every = np.broadcast_to(hertz[:, None], mu.shape)
    return every, depths, phases


def _receptance(
    modes: Modes | MeasuredReceptance,
    milling: Milling,
    damping: Damping | float,
    frequencies: ArrayLike | None,
) -> tuple[Array, Array]:
    """Frequencies (N,) and receptance (N, 2, 2) of the tip along feed and normal."""
    if isinstance(modes, MeasuredReceptance):
        if frequencies is not None or damping != 0.0:
            raise InputError(
                "a measured receptance has its own frequencies and damping", got="another"
            )
        return modes.frequencies, modes.matrices
    if frequencies is None:
        f = modes.frequencies[np.isfinite(modes.frequencies) & (modes.frequencies > 0.0)]
        if f.size == 0:
            raise InputError(
                "no motion vibrates: there is no chatter", got=modes.frequencies.tolist()
            )
        # Dense about every mode, as deep as the damping is narrow.
        near = (f[:, None] * (1 + np.geomspace(1e-4, 1.0, 200))).ravel()
        below = (f[:, None] * (1 - np.geomspace(1e-4, _LOWEST_SHARE, 50))).ravel()
        wide = np.geomspace(_LOWEST_SHARE * f[0], _HIGHEST_SHARE * f[-1], _COUNT)
        hertz = np.unique(np.concatenate([near, below, wide]))
    else:
        hertz = checked_array(frequencies, ("n",), "frequencies")
    how = damping if isinstance(damping, Damping) else Damping(damping)
    J = milling.directions @ motion_at(modes, milling.at)[3:]
    return hertz, transfer(modes, hertz, how, J, J.T)


def _eigenvalues(matrices: Array) -> Array:
    """Return both eigenvalues (N, 2) of 2x2 matrices in a row, without cancellation.

    Each column has the nearest neighbours: by size, equal ones would change places by round-off.
    """
    (a, b), (c, d) = np.moveaxis(matrices, 0, -1)
    half, root = 0.5 * (a + d), np.sqrt((0.5 * (a - d)) ** 2 + b * c)
    large = half + np.where(np.abs(half + root) >= np.abs(half - root), root, -root)
    with np.errstate(divide="ignore", invalid="ignore"):
        small = np.where(large == 0.0, 0.0, (a * d - b * c) / large)
    both = np.stack([large, small], axis=1)
    straight, crossed = (
        np.abs(both[1:] - other).sum(axis=1) for other in (both[:-1], both[:-1, ::-1])
    )
    swapped = np.cumsum(np.append(False, crossed < straight)) % 2 == 1
    both[swapped] = both[swapped, ::-1]
    return both


def limiting_depth(
    modes: Modes | MeasuredReceptance,
    milling: Milling,
    damping: Damping | float = 0.0,
    frequencies: ArrayLike | None = None,
) -> float:
    """Return the depth of cut that is stable at every speed, by the zeroth-order theory.

    It is infinite if no frequency has a limit.
    """
    _, depths, _ = _limits(modes, milling, damping, frequencies)
    return float(np.nanmin(depths)) if np.isfinite(depths).any() else float("inf")


def lobes(
    modes: Modes | MeasuredReceptance,
    milling: Milling,
    speeds: ArrayLike,
    damping: Damping | float = 0.0,
    frequencies: ArrayLike | None = None,
) -> Lobes:
    """Stability lobes by the zeroth-order theory.

    Parameters
    ----------
    modes : Modes or MeasuredReceptance
        Modes of the mechanism that holds the tool (or the workpiece), at a posture, under its load;
        or what was measured at the tool.
    milling : Milling
        Cutter and force law.
    speeds : array_like (N,)
        Revolutions per minute, above zero.
    damping : Damping or float
        As for `cartstiff.vibration.response.frequency_response`.
    frequencies : array_like, optional
        Frequencies [Hz] of the search for chatter; default around all modes.

    Raises
    ------
    InputError
        For speeds that are not above zero.
    """
    n = checked_array(speeds, ("n",), "speeds")
    if not (n > 0.0).all():
        raise InputError("speeds cannot be used", expected="above zero", got=n.min())
    hertz, depths, phases = _limits(modes, milling, damping, frequencies)
    best, chatter = np.full(n.size, np.inf), np.full(n.size, np.nan)
    period = 60.0 / (n * milling.teeth)
    for column in range(depths.shape[1]):
        f, a, w = hertz[:, column], depths[:, column], (phases[:, column] / (2 * np.pi)) % 1.0
        whole = np.isfinite(a[1:]) & np.isfinite(a[:-1]) & (np.abs(np.diff(w)) < 0.5)
        # Waves between teeth, f tau = k + w, with whole numbers k between neighbouring frequencies.
        for i in np.flatnonzero(whole):
            low, high = f[i] * period - w[i], f[i + 1] * period - w[i + 1]
            first = np.ceil(np.minimum(low, high))
            share = np.where(high != low, (first - low) / np.where(high != low, high - low, 1), 0.0)
            depth = a[i] + share * (a[i + 1] - a[i])
            better = (first <= np.maximum(low, high)) & (first >= 0.0) & (depth < best)
            best = np.where(better, depth, best)
            chatter = np.where(better, f[i] + share * (f[i + 1] - f[i]), chatter)
    least = float(np.nanmin(depths)) if np.isfinite(depths).any() else float("inf")
    return Lobes(n, best, chatter, least, _assumed(modes))


def _assumed(modes: Modes | MeasuredReceptance) -> str:
    """State which parts are compliant and which are taken as rigid."""
    if isinstance(modes, MeasuredReceptance):
        across = modes.matrices[:, [0, 1], [1, 0]].any()
        alike = np.array_equal(modes.matrices[:, 0, 0], modes.matrices[:, 1, 1])
        words = "response measured at the tool"
        words += "; the same along feed and normal" if alike else ""
        return words + ("" if across else "; nothing of one along the other")
    links = any(isinstance(p, (Beam, CoupledSprings)) for p in modes.elastic.potentials)
    return (
        (
            "joints and the compliant links of the file give way"
            if links
            else "joints alone give way"
        )
        + "; spindle, holder and tool are rigid, and their modes, which often limit the depth, are "
        "missing: a response measured at the tool takes their place"
    )


def limiting_depths(
    elastic: ElasticMechanism,
    postures: Sequence[ArrayLike],
    milling: Milling,
    damping: Damping | float = 0.0,
    **load: Any,
) -> Array:
    """`limiting_depth` at each posture of a path; NaN where a posture has no modes.

    Parameters
    ----------
    elastic : ElasticMechanism
        The mechanism.
    postures : sequence of array_like (n,)
        Coordinates.
    milling, damping
        As in `lobes`.
    **load
        As for `cartstiff.modes`.
    """
    answers = []
    for q in postures:
        try:
            answers.append(limiting_depth(modes(elastic, q, **load), milling, damping))
        except InputError:
            raise
        except CartstiffError:
            answers.append(float("nan"))
    return np.array(answers)
