"""What a posture costs on a path: a named quantity of its stiffness, as something to keep small."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

import numpy as np

from cartstiff import numerics
from cartstiff.errors import InputError
from cartstiff.geometry.se3 import Array
from cartstiff.many.postures import analyse_many
from cartstiff.maps.quantities import QUANTITIES, Quantity, Settings, choose_quantities, evaluate
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.platform import Platform
from cartstiff.potentials.line_springs import line_geometry
from cartstiff.stiffness.applied_load import LoadKind, wrench_in_body
from cartstiff.toolpaths.tool_path import ToolPath
from cartstiff.vibration.chatter import Milling
from cartstiff.vibration.many_modes import ManyModes
from cartstiff.vibration.response import Damping


class Judged(NamedTuple):
    """N postures judged.

    Attributes
    ----------
    value : ndarray (N,)
        The quantity, NaN where it does not exist.
    cost : ndarray (N,)
        The value, or one over it where larger is better; infinite where there is none.
    ratio : ndarray (N,)
        Smallest over largest singular value of the length-scaled Jacobian (of a platform's lines),
        of as many as the mechanism has at most postures.
    side : ndarray (N,)
        Sign of the Jacobian's determinant, which changes only through a singularity; 0 where the
        Jacobian is not square (or not on the motions that the mechanism has).
    """

    value: Array
    cost: Array
    ratio: Array
    side: Array


def criteria() -> dict[str, Quantity]:
    """The quantities that can be a criterion, by name: those of which one end is the better."""
    return {name: q for name, q in QUANTITIES.items() if q.better is not None}


def ready(elastic: ElasticMechanism) -> ElasticMechanism:
    """The same mechanism with all rest positions open: a controller commands them at each point.

    Raises
    ------
    InputError
        If there are no springs whose rest positions could be commanded.
    """
    if elastic.springs is None:
        raise InputError(f"{elastic.name} has no springs whose rest positions could be commanded")
    springs = elastic.springs
    if isinstance(elastic.mechanism, Platform) and len(springs.stiffness) != 6:
        return elastic  # preload is a property of the file there, and not the load's alone
    return replace(elastic, springs=springs.replaced(springs.stiffness, springs.rest * np.nan))


@dataclass(frozen=True, eq=False)
class PathCost:
    """The criterion of a path.

    Attributes
    ----------
    elastic : ElasticMechanism
        From `ready`.
    path : ToolPath
        With wrenches or directions, as the quantity asks.
    quantity : Quantity
        One of `criteria`.
    connection : {"A", "B", "K", "F", "load"}
        The stiffness that is read.
    loaded : bool
        Whether that stiffness is the one under the path's wrenches, balanced by the springs.
    load : LoadKind
        What these do while the body moves, and the point of the body at which they act.
    length : float
        Characteristic length.
    rank : int
        Rank of the Jacobian at most postures.
    movable : ndarray of bool
        Columns of the Jacobian that are joints to be moved, and not a link that gives.
    damping : Damping
        What damps the vibrations.
    milling : Milling, optional
        The cutter of a limiting depth.
    """

    elastic: ElasticMechanism
    path: ToolPath
    quantity: Quantity
    connection: str
    loaded: bool
    load: LoadKind
    length: float
    rank: int
    movable: Array
    damping: Damping = field(default_factory=Damping)
    milling: Milling | None = None

    def __post_init__(self) -> None:
        if self.quantity.better is None:
            raise InputError(
                f"{self.quantity.name} is not a criterion: neither end is better",
                expected=", ".join(criteria()),
            )
        if self.loaded and self.path.wrenches is None:
            raise InputError("a stiffness under load needs the path's wrenches")
        choose_quantities([self.quantity.name], self._settings(0), self.elastic)

    def _settings(self, point: int) -> Settings:
        direction, wrench = self.path.direction(point), self.path.wrench(point)
        return Settings(
            connection=self.connection,
            length=self.length,
            direction=None if direction is None else tuple(direction.tolist()),
            deflect=None if wrench is None else tuple(wrench.tolist()),
            world=not self.path.turns_with_body,
            load=self.load,
            deflect_at=self.load.at,
            damping=self.damping,
            milling=self.milling,
        )

    def __call__(self, q: Array, points: Array, poses: Array) -> Judged:
        """Judge postures (N, n) at points (N,) of the path, their poses (N, 4, 4) known."""
        count = len(q)
        value, ratio = np.full(count, np.nan), np.full(count, np.nan)
        if not count:
            return Judged(value, value, ratio, ratio)
        outputs = tuple(dict.fromkeys((*self.quantity.outputs(self._settings(0)), "jacobian")))
        load = self._loads(points, poses) if self.loaded else None
        answers = analyse_many(
            self.elastic,
            q,
            wrench=load,
            load_kind=self.load.kind,
            load_at=self.load.at,
            outputs=outputs,
        )
        lengths = np.array([c.is_length for c in self.elastic.mechanism.coordinates])
        for point in np.unique(points):
            rows = points == point
            arrays = {name: answers[name][rows] for name in outputs}
            settings = self._settings(int(point))
            acting = {"load_kind": self.load.kind, "load_at": self.load.at}
            swing = ManyModes(self.elastic, q[rows], None if load is None else load[rows], acting)
            value[rows] = evaluate([self.quantity], arrays, settings, lengths, swing)[
                self.quantity.name
            ]
        jacobian = answers["jacobian"]
        platform = self.elastic.mechanism
        if isinstance(platform, Platform) and len(platform.points) != 6:  # no square one
            lines = [line_geometry(T, platform.anchors, platform.points).lines for T in poses]
            jacobian = np.linalg.pinv(np.array(lines))
        ratio, side = self._regularity(jacobian, lengths)
        smaller = self.quantity.better == "smaller"
        with np.errstate(divide="ignore", invalid="ignore"):
            cost = value if smaller else np.where(value > 0, 1.0 / value, np.inf)
        cost = np.where(np.isfinite(cost) & (value >= 0), cost, np.inf)
        return Judged(value, cost, ratio, side)

    def _loads(self, points: Array, poses: Array) -> Array:
        """Wrenches (N, 6) in body components, about the point at which they act."""
        wrenches = np.array([self.path.wrench(i) for i in range(len(self.path))])[points]
        axes: Literal["body", "world"] = "body" if self.path.turns_with_body else "world"
        return wrench_in_body(wrenches, poses, (0.0, 0.0, 0.0), axes)

    def _regularity(self, jacobian: Array, lengths: Array) -> tuple[Array, Array]:
        scaled = jacobian * np.repeat([1.0, 1.0 / self.length], 3)[:, None]
        if isinstance(self.elastic.mechanism, Platform):
            lengths = np.ones(jacobian.shape[2], bool)  # its columns are the legs'
        scaled = (scaled * np.where(lengths, self.length, 1.0))[:, :, self.movable]
        finite = np.isfinite(scaled).all(axis=(1, 2))
        scaled = np.where(finite[:, None, None], scaled, 0.0)
        values = np.linalg.svd(scaled, compute_uv=False)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(finite, values[:, self.rank - 1] / values[:, 0], 0.0)
        side, basis = np.zeros(len(ratio)), None
        if scaled.shape[2] == self.rank:
            basis = self._motions(scaled)
        if basis is not None:
            side = np.sign(np.linalg.det(basis.T @ scaled))
        return ratio, side

    def _motions(self, scaled: Array) -> Array | None:
        """Basis (6, rank) of the body's motions, if they are the same at all postures.

        Its signs are those of the first axes that it has, so that it is the same every time.
        """
        if self.rank == 6:
            return np.eye(6)
        values, vectors = np.linalg.eigh(np.einsum("nij,nkj->ik", scaled, scaled))
        if not values[-self.rank - 1] < numerics.ROUNDING * values[-1]:
            return None
        onto = vectors[:, -self.rank :] @ vectors[:, -self.rank :].T
        basis: list[Array] = []
        for column in onto.T:
            rest = column - sum((b * (b @ column) for b in basis), np.zeros(6))
            if np.linalg.norm(rest) > numerics.NEARBY and len(basis) < self.rank:
                basis.append(rest / np.linalg.norm(rest))
        return np.array(basis).T
