"""Frequencies of many postures: over arrays where springs alone hold, else one by one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cartstiff import numerics
from cartstiff.arrays import Array
from cartstiff.errors import UndefinedError
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import SWAP
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.contract import Units, convert_length
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.platform import Platform
from cartstiff.potentials.line_springs import LineGeometry, LineSprings, lines_of_many
from cartstiff.potentials.loads import DeadForce, Scaled
from cartstiff.potentials.springs import JointSprings
from cartstiff.vibration.chatter import Milling, limiting_depth
from cartstiff.vibration.modes import Modes, is_plain, modes
from cartstiff.vibration.response import Damping, poles

# Postures at once: their matrices stay in the cache.
_ROWS = 2048


@dataclass(frozen=True, eq=False)
class ManyModes:
    """Small vibrations at many postures.

    Attributes
    ----------
    elastic : ElasticMechanism
        The mechanism.
    q : ndarray (N, n)
        Postures; closures are met.
    wrenches : ndarray (6,) or (N, 6), optional
        Load, as in `cartstiff.modes`.
    load : mapping
        `load_kind`, `load_at`, `load_axes` of it.
    compliances : ndarray (N, 6, 6), optional
        ``C^B`` at the postures where the body carries nothing, NaN elsewhere; for mechanisms that
        `moves_as_body` tells.
    one_by_one : int, optional
        At most so many postures are looked at one by one, the others have no number.
    """

    elastic: ElasticMechanism
    q: Array
    wrenches: Array | None = None
    load: Mapping[str, Any] = field(default_factory=dict)
    compliances: Array | None = None
    one_by_one: int | None = None

    def frequencies(self, count: int = 6) -> Array:
        """The lowest ones [Hz], (N, count).

        NaN where a motion grows, where a posture has no modes, and beyond the last mode.
        """
        if self._is_plain:
            return _plain(self.elastic, self.q, count)
        C = self.compliances
        if C is None and _on_open_lines(self.elastic):
            C = _of_lines(self.elastic, self.q)
        if self._loads is not None or C is None:
            return self._each(lambda modes: modes.frequencies, count)
        frequencies, known = _of_body(self.elastic, self.q, C, count)
        rows = np.flatnonzero(~known)[: self.one_by_one]
        left = replace(self, q=self.q[rows], wrenches=None)
        frequencies[rows] = left._each(lambda modes: modes.frequencies, count)
        return frequencies

    def damping_ratios(self, damping: Damping, count: int = 6) -> Array:
        """Ratio (N, count) of each mode, the slowest first; with dampers those of the poles."""
        if not (damping.dampers and self.elastic.damping is not None):
            return self._each(lambda modes: damping.of_modes(modes), count)
        return self._each(lambda modes: poles(modes, damping)[1], count)

    def limiting_depths(self, milling: Milling, damping: Damping) -> Array:
        """Depth of cut (N,) that is stable at every speed, by the zeroth-order theory."""
        return self._each(lambda modes: [limiting_depth(modes, milling, damping)], 1)[:, 0]

    @property
    def _loads(self) -> Array | None:
        return self.wrenches if self.wrenches is not None and np.any(self.wrenches) else None

    @property
    def _is_plain(self) -> bool:
        return self._loads is None and is_plain(self.elastic)

    def _each(self, answer: Callable[[Modes], ArrayLike], count: int) -> Array:
        loads, rows = self._loads, np.full((len(self.q), count), np.nan)
        for i, posture in enumerate(self.q):
            wrench = None if loads is None else loads if loads.ndim == 1 else loads[i]
            load = {} if wrench is None else self.load
            try:
                values = np.asarray(answer(modes(self.elastic, posture, wrench=wrench, **load)))
            except UndefinedError:
                continue
            rows[i, : values.size] = values[:count]
        return rows


def _on_open_lines(elastic: ElasticMechanism) -> bool:
    """Whether a body hangs on lines that carry nothing, and nothing else acts."""
    springs = elastic.springs
    return (
        isinstance(elastic.mechanism, Platform)
        and type(springs) is LineSprings
        and not (springs.unilateral or elastic.potentials)
        and elastic.gravity is None
        and bool(np.isnan(springs.rest_length).all())
    )


def _of_lines(elastic: ElasticMechanism, q: Array) -> Array:
    """``C^B`` of a body on lines that carry nothing; NaN where a motion costs nothing."""
    platform, springs = elastic.mechanism, elastic.springs
    if not (isinstance(platform, Platform) and isinstance(springs, LineSprings)):
        raise TypeError("a platform on lines")
    lines = _platform_masses(platform, q)[0].lines
    return numerics.invert_each((lines.swapaxes(1, 2) * springs.stiffness) @ lines)[0]


def _platform_masses(platform: Platform, q: Array) -> tuple[LineGeometry, Array]:
    """Lines of the legs, and masses' matrices (N, 6, 6) on body twists."""
    poses = se3.from_roll_pitch_yaw(q[:, :3], q[:, 3:]) @ platform.T_P_M
    lines = lines_of_many(poses, platform.anchors, platform.points)
    mass = np.broadcast_to(platform.body_inertia, (len(q), 6, 6))
    if platform.struts is not None:
        mass = mass + platform.struts.mass_matrix(lines, platform.points)
    return lines, mass


def moves_as_body(elastic: ElasticMechanism) -> bool:
    """Whether all that has mass moves with the body: then its compliance tells the vibrations."""
    mechanism = elastic.mechanism
    if elastic.gravity is not None or elastic.springs is None:
        return False
    if any(isinstance(p, (DeadForce, Scaled)) for p in elastic.potentials):
        return False
    if isinstance(mechanism, Platform):
        return bool(mechanism.body_inertia.any()) or mechanism.struts is not None
    if not (isinstance(mechanism, Chain) and mechanism.closures) or mechanism.rigid:
        return False
    if mechanism.tree.mimic is not None:
        return False
    return np.flatnonzero(mechanism.tree.masses()[0]).tolist() == [mechanism.body.joint - 1]


def unloaded_compliances(arrays: Mapping[str, Array]) -> Array | None:
    """``C^B`` of arrays of `analyse_many`, NaN where W deflects the body by more than rounding."""
    if not {"compliance_B", "wrench"} <= arrays.keys():  # nobody asked for frequencies
        return None
    C = arrays["compliance_B"]
    moves = np.abs(C @ arrays["wrench"][:, :, None]).max(axis=1) > numerics.ROUNDING
    return np.where(moves[:, None], np.nan, C)


def _of_body(
    elastic: ElasticMechanism, q: Array, compliances: Array, count: int
) -> tuple[Array, NDArray[np.bool_]]:
    """``1/omega^2`` of ``G^T C G``, ``G G^T = M`` of the body; and in which rows they are known.

    What has no mass follows at once: that is what a compliance is. Motions without mass, or that
    the mechanism does not have, stand last and have no frequency.
    """
    mechanism = elastic.mechanism
    length, force = convert_length(Units(), elastic.units)
    sizes = np.repeat([mechanism.at(elastic.q).length, 1.0], 3)
    frequencies = np.full((len(q), max(count, 6)), np.nan)
    known: NDArray[np.bool_] = np.asarray(np.isfinite(compliances).all(axis=(1, 2)))
    for start in range(0, len(q), _ROWS):
        rows = slice(start, start + _ROWS)
        if isinstance(mechanism, Platform):
            mass = _platform_masses(mechanism, q[rows])[1]
        elif isinstance(mechanism, Chain):
            joint, T = mechanism.body.joint, mechanism.body.T_j_f
            own = np.array(mechanism.tree.model.inertias[joint].matrix())[np.ix_(SWAP, SWAP)]
            mass = (se3.adjoint(T).T @ own @ se3.adjoint(T))[None]
        else:
            raise TypeError("a body that carries all mass")
        inertias, axes = np.linalg.eigh(mass / np.outer(sizes, sizes))
        least = numerics.RANK * inertias[:, -1:]
        G = axes * np.sqrt(np.where(inertias > least, inertias, 0.0))[:, None] * sizes[:, None]
        C = np.where(known[rows, None, None], compliances[rows], 0.0)
        inverse = np.linalg.eigvalsh(G.swapaxes(1, 2) @ C @ G)[:, ::-1] * (force / length)
        lost = 6 * numerics.EPSILON * np.abs(inverse).max(axis=1, keepdims=True)
        known[rows] &= (inverse[:, -1:] >= -lost)[:, 0]  # else a motion grows
        with np.errstate(divide="ignore", invalid="ignore"):
            hertz = 1.0 / (2.0 * np.pi * np.sqrt(inverse))
        frequencies[rows, :6] = np.where((inverse > lost) & known[rows, None], hertz, np.nan)
    return frequencies[:, :count], known


def _plain(elastic: ElasticMechanism, q: Array, count: int) -> Array:
    """``k phi = omega^2 M phi`` over arrays, by ``1/omega^2`` of ``k^-1/2 M k^-1/2``."""
    springs, chain = elastic.springs, elastic.mechanism
    if not (isinstance(springs, JointSprings) and isinstance(chain, Chain)):
        raise TypeError("an arm on joint springs")
    n = q.shape[1]
    per = 1.0 / np.sqrt(springs.stiffness)
    frequencies = np.full((len(q), max(count, n)), np.nan)
    for start in range(0, len(q), _ROWS):
        part = q[start : start + _ROWS]
        mass = chain.tree.mass_matrices(part)
        inverse = np.linalg.eigvalsh(mass * np.outer(per, per), UPLO="U")[:, ::-1]
        # Motions without mass stand last, and have no frequency.
        least = numerics.EPSILON * n * inverse[:, :1]
        with np.errstate(divide="ignore", invalid="ignore"):
            hertz = 1.0 / (2 * np.pi * np.sqrt(inverse))
        frequencies[start : start + len(part), :n] = np.where(inverse > least, hertz, np.nan)
    return frequencies[:, :count]
