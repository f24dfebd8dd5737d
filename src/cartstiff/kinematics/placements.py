"""The geometry of a chain as numbers: its joints, its body frame, its closures' frames.

A placement is six numbers: three coordinates, and three rotations about its own axes, nominally
zero. Those of joints are against their predecessors; virtual joints are within a link and have
none. Of frames that share a point in a closure the rotations do not matter.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cartstiff import numerics
from cartstiff.arrays import Array
from cartstiff.geometry import se3
from cartstiff.mechanisms.chain import Chain, ChainPosture
from cartstiff.mechanisms.tree import FixedFrame

#: Begin the names of placements.
PLACED = ("placement", "frame", "closure")
_XYZ, _RXYZ = ("x", "y", "z"), ("rx", "ry", "rz")


@dataclass(frozen=True, eq=False)
class Placements:
    """Placements of a chain near a posture.

    Attributes
    ----------
    chain : Chain
        Never modified.
    posture : ChainPosture
        Its posture.
    is_on_base : bool
        Whether the place of the base matters.
    """

    chain: Chain
    posture: ChainPosture
    is_on_base: bool

    @cached_property
    def numbers(self) -> dict[str, float]:
        """Names and values, without `misfits`.

        "placement.<joint>.x" to ".rz", "frame.x" to ".rz", "closure.<frame>.x" to ".rz".
        """
        return {name: x for name, x in self._all.items() if name not in self.misfits}

    @staticmethod
    def is_angle(name: str) -> bool:
        """Whether a number is an angle."""
        return name.partition(".")[0] in PLACED and name.rpartition(".")[2] in _RXYZ

    @cached_property
    def misfits(self) -> tuple[str, ...]:
        """Numbers without derivatives: if one is changed, no nearby posture closes.

        To first order: coordinates cannot undo its change of the closures' residual. Empty unless
        the closures are redundant.
        """
        closure, length = self.posture.closure, self.posture.length
        if closure is None:
            return ()
        U, values, _ = np.linalg.svd(closure.jacobian * self.posture.coordinate_lengths)
        held = U[:, int((values > numerics.RANK * values[0]).sum()) :].T
        if not len(held):
            return ()
        names = []
        for name, x in self._all.items():
            step = numerics.DIFFERENCE_STEP * (1.0 if self.is_angle(name) else length)
            more, less = (
                held @ self.with_parameters({name: x + s}).at(self.posture.q).residual
                for s in (step, -step)
            )
            gap = np.abs(more - less).max() / (2.0 * numerics.DIFFERENCE_STEP)
            if gap > numerics.NEGLIGIBLE_STEP * max(1.0, length):
                names.append(name)
        return tuple(names)

    @property
    def words(self) -> str | None:
        """Message on `misfits`; None without any."""
        if not self.misfits:
            return None
        return (
            f"{len(self.misfits)} of {len(self._all)} numbers of the geometry have no derivative: "
            "the closures hold more than they need, and with such a number changed no posture "
            f"closes. They are {', '.join(self.misfits)}"
        )

    def with_parameters(self, values: Mapping[str, float]) -> Chain:
        """The chain with other numbers; names that are not its own are ignored."""
        poses = {}
        for name in dict.fromkeys(
            key.rpartition(".")[0] for key in values if key in self._all
        ):
            T = self._places[name]
            turn = [values.get(f"{name}.{axis}", 0.0) for axis in _RXYZ]
            at = [
                values.get(f"{name}.{axis}", x)
                for axis, x in zip(_XYZ, T[:3, 3], strict=True)
            ]
            R = se3.exp(np.array([*turn, 0.0, 0.0, 0.0]))[:3, :3]
            poses[name] = se3.pose(T[:3, :3] @ R, np.array(at))
        frame = poses.pop("frame", self.chain.body.T_j_f)
        ends = {
            name.removeprefix("closure."): FixedFrame(at.joint, poses.pop(name))
            for name, at in self._ends.items()
            if name in poses
        }
        joints = {self._joints[name]: T for name, T in poses.items()}
        return self.chain.with_placements(joints, frame, ends)

    @cached_property
    def _all(self) -> dict[str, float]:
        return {
            f"{name}.{axis}": float(x)
            for name, T in self._places.items()
            for axis, x in zip((*_XYZ, *_RXYZ), (*T[:3, 3], 0.0, 0.0, 0.0), strict=True)
            if axis in _XYZ or name not in self._points
        }

    @cached_property
    def _joints(self) -> dict[str, int]:
        """Joints whose placement matters."""
        chain, tree = self.chain, self.chain.tree
        joints = list(range(1, tree.model.njoints))
        if not chain.closures:
            joints = tree.support(chain.body.joint)[0 if self.is_on_base else 1 :]
        within = {chain.coordinates[i].name for i in chain.virtual}
        names = tree.model.names
        return {f"placement.{names[j]}": j for j in joints if names[j] not in within}

    @cached_property
    def _ends(self) -> dict[str, FixedFrame]:
        """Frames of the closures."""
        names = (name for c in self.chain.closures for name in (c.frame_a, c.frame_b))
        return {
            f"closure.{name}": self.chain.placement(name)
            for name in names
            if name not in ("body", "world")
        }

    @cached_property
    def _points(self) -> set[str]:
        closures = self.chain.closures
        points, welds = (
            {
                f"closure.{n}"
                for c in closures
                if c.type == kind
                for n in (c.frame_a, c.frame_b)
            }
            for kind in ("point", "weld")
        )
        return points - welds

    @cached_property
    def _places(self) -> dict[str, Array]:
        placements = self.chain.tree.placements()
        joints = {name: placements[j - 1] for name, j in self._joints.items()}
        ends = {name: np.asarray(at.T_j_f) for name, at in self._ends.items()}
        return {**joints, "frame": np.asarray(self.chain.body.T_j_f), **ends}
