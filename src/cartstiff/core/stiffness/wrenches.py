r"""The wrenches in joints, loop closures, compliant links and lines at a posture.

With all joints cut (`cartstiff.core.mechanisms.cut_joints`) each body k has the wrench
e_k of its weight, of the load, of line springs and of the closures, whose forces are
those of the reduction. A joint carries what all bodies beyond it need,

    x_i = -sum_{k beyond i} e_k,

on the body that it moves: every body is in balance, and the part of x_i along the joint's
axis is the torque that springs, gears and couplings exert there. Where closures repeat
each other between rigid links, those with the least forces are said, and are marked.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.contract import MechanismPosture
from cartstiff.core.mechanisms.cut_joints import CutPosture
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.potentials.contract import Potential
from cartstiff.core.stiffness.motions import decomposed

Kind = Literal["joint", "closure", "link", "line"]


class CarriedWrench(NamedTuple):
    """A wrench that one part of a mechanism exerts on another.

    Attributes
    ----------
    name : str
        Joint, closure, compliant link, leg or line.
    kind : {"joint", "closure", "link", "line"}
        Of a joint on the body that it moves; of a closure on its second frame; of what is
        beyond a section of a link on that section, so that tension is positive; of a line
        on its end.
    frame : str
        Where: the frame of the joint, "near" or "far" end of a link, ...
    pose : ndarray (4, 4)
        ``T_F_b`` of that frame.
    wrench : ndarray (6,)
        Moment about its origin, and force, along its axes.
    is_determined : bool
        False where redundant closures between rigid links leave it open.
    stress : float or None
        Greatest equivalent stress of a beam's section there, if its outline is given.
    """

    name: str
    kind: Kind
    frame: str
    pose: Array
    wrench: Array
    is_determined: bool = True
    stress: float | None = None

    @property
    def in_room(self) -> Array:
        """The same along the axes of F, the moment about the same point (6,)."""
        return np.ravel(self.wrench.reshape(2, 3) @ self.pose[:3, :3].T)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        more = {"point": self.pose[:3, 3].tolist(), "in_room": self.in_room.tolist()}
        own = self._asdict() | {"wrench": self.wrench.tolist()} | more
        del own["pose"]
        return own


def wrenches_at(
    elastic: ElasticMechanism, posture: MechanismPosture, W: Array, lam: Array
) -> tuple[CarriedWrench, ...]:
    """All wrenches at a posture in balance.

    Parameters
    ----------
    elastic, posture
        The mechanism with its final rest positions and all loads, and its posture.
    W : ndarray (6,)
        Wrench of the environment on M, in its components.
    lam : ndarray (m,)
        Forces of the closures, in the order of the posture's residual.
    """
    found = list[CarriedWrench]()
    if (cut := posture.cut()) is not None:
        found += _Joints(elastic, cut, lam).wrenches(W)
    every = elastic.labelled()
    if elastic.springs is not None:
        every.insert(0, (elastic.springs, elastic.spring_names))
    for term, names in every:
        found += _of_lines(elastic, posture, term, names)
    return tuple(found)


def _of_lines(
    elastic: ElasticMechanism,
    posture: MechanismPosture,
    term: Potential,
    names: Sequence[str],
) -> Iterator[CarriedWrench]:
    """What legs and lines exert at their ends, along the axes of the frame there."""
    if (exerted := term.exerted(posture)) is None:
        return
    frame, points = term.attachments()[-1]
    T_F_b, weights = posture.pose_of_frame(frame), None
    if term is elastic.springs and elastic.gravity is not None:
        weights = posture.weights_of_lines(elastic.gravity)
    for k, (name, point, wrench) in enumerate(zip(names, points, exerted, strict=True)):
        T_b_end = se3.pose(translation=point)
        wrench = se3.adjoint(T_b_end).T @ wrench
        if weights is not None:
            wrench[3:] += weights[k]
        where = f"end on {frame}"
        yield CarriedWrench(name, "line", where, T_F_b @ T_b_end, wrench)


class _Joints:
    """A chain whose joints are cut, and what acts on its bodies."""

    def __init__(self, elastic: ElasticMechanism, cut: CutPosture, lam: Array) -> None:
        self.elastic, self.cut, self.lam = elastic, cut, lam
        self.chain, self.posture = cut.chain, cut.posture
        self.parents = self.chain.tree.model.parents.tolist()

    def wrenches(self, W: Array) -> Iterator[CarriedWrench]:
        """Those of joints, closures and links."""
        acting = self.cut.on_bodies(W, self.chain.body) + self.by_closures(self.lam)
        for term in self.elastic.terms(springs=False):
            gradient = term.evaluate(self.cut).gradient
            if gradient.size == acting.size:  # else it acts in the joints
                acting = acting - gradient.reshape(-1, 6)
        carried = self.beyond(acting)
        is_open = self.undetermined(numerics.largest(carried))
        virtual = {self.chain.names[j] for j in self.chain.virtual}
        links = self.chain.tree.links()
        for i, name in enumerate(list(self.chain.tree.model.names)[1:], start=1):
            if name not in virtual:
                T = self.posture.joint_poses([i])[0]
                frame = links.get(i, name), T, carried[i - 1], not is_open[i - 1]
                yield self.entry(name, "joint", *frame)
        ends = self.by_closure(self.lam)
        for closure, (place, wrench) in zip(self.chain.closures, ends, strict=True):
            name = f"{closure.frame_a} - {closure.frame_b}"
            yield CarriedWrench(
                name,
                "closure",
                closure.frame_b,
                self.posture.pose_at(place),
                wrench,
                not self.lost.any(),
            )
        yield from self.sections(carried, is_open)

    def entry(
        self, name: str, kind: Kind, frame: str, T: Array, x: Array, known: bool
    ) -> CarriedWrench:
        """A wrench x (6,) about F's origin, in a frame."""
        return CarriedWrench(name, kind, frame, T, se3.adjoint(T).T @ x, bool(known))

    def beyond(self, acting: Array) -> Array:
        """What each joint carries (N, 6) of wrenches on the bodies (N, 6)."""
        carried = -acting
        for i in range(len(carried), 0, -1):
            if parent := self.parents[i]:
                carried[parent - 1] += carried[i - 1]
        return carried

    def by_closure(self, lam: Array) -> Iterator[tuple[Any, Array]]:
        """Place of the second frame of each closure, and its wrench on that."""
        start = 0
        for closure in self.chain.closures:
            rows, wrench = closure.rows, np.zeros(6)
            count = rows.stop - rows.start
            wrench[rows] = -lam[start : start + count]
            start += count
            yield self.chain.placement(closure.frame_b), wrench

    def by_closures(self, lam: Array) -> Array:
        """The wrenches (N, 6) of all closures on both of their bodies."""
        acting = np.zeros((len(self.parents) - 1, 6))
        for closure, (b, wrench) in zip(
            self.chain.closures, self.by_closure(lam), strict=True
        ):
            a = self.chain.placement(closure.frame_a)
            T = se3.inverse(self.posture.pose_at(b)) @ self.posture.pose_at(a)
            acting += self.cut.on_bodies(wrench, b)
            acting -= self.cut.on_bodies(se3.adjoint(T).T @ wrench, a)
        return acting

    @property
    def lost(self) -> Array:
        """Forces (m, k) of the closures that balance each other."""
        closure = self.posture.closure
        if closure is None or not self.chain.closures:
            return np.zeros((0, 0))
        lost = decomposed(closure, self.posture.coordinate_lengths).lost
        return lost if closure.sizes is None else lost / closure.sizes[:, None]

    def undetermined(self, largest: float) -> Array:
        """Which joints (N,) carry what such forces change."""
        open_ = np.zeros(len(self.parents) - 1, bool)
        for nu in self.lost.T:
            change = np.abs(self.beyond(self.by_closures(nu))).max(axis=1)
            open_ |= change > numerics.NEGLIGIBLE_SHARE * change.max(initial=0.0)
        return open_ & (largest > 0.0)

    def sections(self, carried: Array, is_open: Array) -> Iterator[CarriedWrench]:
        """Both ends of each compliant link, along the axes of its section."""
        names = list(self.chain.tree.model.names)
        for term, _ in self.elastic.labelled():
            if not (term.link and term.members):
                continue
            first, last = (
                names.index(self.chain.names[term.members[k]]) for k in (0, -1)
            )
            T_near = self.chain.tree.placements()[first - 1]
            if parent := self.parents[first]:
                T_near = self.posture.joint_poses([parent])[0] @ T_near
            ends = {"near": (first, T_near)}
            ends["far"] = last, self.posture.joint_poses([last])[0]
            for side, (i, T) in ends.items():
                at = f"{side} end", T, -carried[i - 1], not is_open[i - 1]
                one = self.entry(term.link, "link", *at)
                yield one._replace(stress=term.stress(one.wrench))
