r"""Natural frequencies of many postures: from recorded mass and stiffness, or one by one.

With H the Lagrangian Hessian on the motions x, J their twists and D = K^load - K^B,

    K_q = H + J^T D J,    1 / omega^2: eigenvalues of K_q^-1/2 M K_q^-1/2,

where K_q is positive. `cartstiff.modes` computes all other postures.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cartstiff.answer.vibration.modes import Modes, modes
from cartstiff.answer.vibration.response import Damping, poles
from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.errors import ConvergenceError, InputError, UndefinedError
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.stiffness.applied_load import DEAD_AT_ORIGIN, Axes, LoadKind
from cartstiff.core.units import Units, convert_length
from cartstiff.recorded.arguments import OF_VIBRATIONS
from cartstiff.recorded.known_numbers import keywords
from cartstiff.recorded.tape import Arrays

# Postures at a time, so that their matrices stay in the cache.
_ROWS = 2048
#: Number of the lowest modes.
_LOWEST = 6


@dataclass(frozen=True, eq=False)
class ManyModes:
    """Small vibrations at many postures.

    Attributes
    ----------
    elastic : ElasticMechanism
        The mechanism.
    q : ndarray (N, n)
        Postures, closed.
    wrenches : ndarray (6,) or (N, 6), optional
        Load, as in `cartstiff.modes`.
    load, axes
        Its behaviour and point, and its axes.
    """

    elastic: ElasticMechanism
    q: Array
    wrenches: Array | None = None
    load: LoadKind = DEAD_AT_ORIGIN
    axes: Axes = "body"

    def frequencies(self, arrays: Arrays) -> Array:
        """Lowest frequencies [Hz], (N, 6).

        NaN where a motion is unstable, where a posture has no modes or cannot carry the
        load, and beyond the last mode.

        Parameters
        ----------
        arrays : mapping of str to ndarray
            The wrench and `OF_VIBRATIONS`, NaN or without entries where they are not
            recorded; with a pose that is NaN where a posture is not decided.
        """
        frequencies, known = self._of_matrices(arrays)
        if "pose" in arrays:
            known |= ~np.isfinite(arrays["pose"]).all(axis=(1, 2))
        rows = np.flatnonzero(~known)
        frequencies[rows] = self._each(lambda modes: modes.frequencies, rows)
        return frequencies

    def damping_ratios(self, damping: Damping) -> Array:
        """Damping ratios (N, 6) of the modes, the slowest first.

        With dampers, of the poles.
        """
        if not (damping.dampers and self.elastic.damping is not None):
            return self._each(damping.of_modes)
        return self._each(lambda modes: poles(modes, damping)[1])

    def _each(
        self, answer: Callable[[Modes], ArrayLike], which: Array | None = None
    ) -> Array:
        """Numbers from the modes of some postures, computed one after the other."""
        every = np.arange(len(self.q)) if which is None else which
        loads, rows = self.wrenches, np.full((len(every), _LOWEST), np.nan)
        for row, i in zip(rows, every, strict=True):
            wrench = None if loads is None else loads if loads.ndim == 1 else loads[i]
            given = keywords(self.elastic, wrench, self.load, self.axes)
            try:
                found = modes(self.elastic, self.q[i], **given)
            except (ConvergenceError, InputError, UndefinedError):
                continue  # the input has been checked: the load cannot be carried here
            try:
                values = np.asarray(answer(found))[:_LOWEST]
            except UndefinedError:
                continue
            row[: values.size] = values
        return rows

    def _of_matrices(self, arrays: Arrays) -> tuple[Array, NDArray[np.bool_]]:
        """Frequencies (N, 6) from recorded matrices, and where these are valid."""
        length, force = convert_length(Units(), self.elastic.units)
        names, n = ("wrench", *OF_VIBRATIONS), 0
        if all(name in arrays for name in names):
            n = arrays["kinetic"].shape[1]
        known = np.full(len(self.q), n > 0)
        for name in names if n else ():
            rest = tuple(range(1, arrays[name].ndim))
            known &= np.isfinite(arrays[name]).all(axis=rest)
        frequencies = np.full((len(known), max(_LOWEST, n)), np.nan)
        for start in range(0, len(known), _ROWS):
            part = slice(start, start + _ROWS)
            rows = start + np.flatnonzero(known[part])
            if not rows.size:
                continue
            W, M, H, J = (arrays[name][rows] for name in names)
            D = self.load.change(W)
            added = J.swapaxes(1, 2) @ D @ J
            K = H + 0.5 * (added + added.swapaxes(1, 2))
            # Rows that are not positive have no frequencies here, nor large numbers.
            diagonal = K.diagonal(axis1=1, axis2=2)
            K = K * (diagonal > 0.0).all(axis=1)[:, None, None]
            sizes = np.sqrt(np.maximum(diagonal, numerics.TINY))[:, :, None]
            pairs = sizes * sizes.swapaxes(1, 2)
            values, axes = np.linalg.eigh(K / pairs)
            is_plain = values[:, 0] > numerics.LOST_ERROR * values[:, -1]
            axes = axes * is_plain[:, None, None]
            root = axes / sizes / np.sqrt(np.maximum(values, numerics.TINY))[:, None]
            inverse = np.linalg.eigvalsh(root.swapaxes(1, 2) @ M @ root)[:, ::-1]
            inverse = inverse * (force / length)
            # Motions without mass are last, and have no frequency.
            least = numerics.EPSILON * n * inverse[:, :1]
            with numerics.silent():
                hertz = 1.0 / (2.0 * np.pi * np.sqrt(inverse))
            frequencies[rows, :n] = np.where(inverse > least, hertz, np.nan)
            skew = np.abs(added - added.swapaxes(1, 2)) / pairs
            known[rows] = is_plain & (skew.max(axis=(1, 2)) <= numerics.ROUNDOFF)
        return frequencies[:, :_LOWEST], known
