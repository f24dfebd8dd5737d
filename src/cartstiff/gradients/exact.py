r"""Derivatives by the recorded arithmetic of a mechanism at a held posture.

Coordinates and load stay, and rest positions follow. In a closed chain the coordinates D
that are not held move with a parameter p, so that the closures c stay met: theory.md, eq.
closedgradient,

    dy/dp = y_p - y_q S (C_D S)^+ c_p,      C_D = dc/dq_D,

S being the natural sizes of the coordinates.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from cartstiff import numerics
from cartstiff.arrays import Array
from cartstiff.batch.chains import ChainCase
from cartstiff.batch.gradient import Slopes
from cartstiff.batch.plans import TracedModel, plan
from cartstiff.batch.platforms import PlatformCase
from cartstiff.batch.readings import with_masses
from cartstiff.batch.twists import Varied
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.platform import Platform
from cartstiff.stiffness.applied_load import DEAD_AT_ORIGIN, Axes, LoadKind
from cartstiff.stiffness.compute import PostureStiffness

#: Component of each named parameter in an input array, by array.
Names = dict[str, dict[str, int]]
#: Components of a load, and of a placement.
LOAD = ("mx", "my", "mz", "fx", "fy", "fz")
_XYZ, _RXYZ = ("x", "y", "z"), ("rx", "ry", "rz")


class Recorded:
    """The recorded arithmetic of a posture, with its parameters as inputs.

    Attributes
    ----------
    case : ChainCase or PlatformCase
    given : dict of str to ndarray (1, ...)
        Input arrays at the posture.
    names : dict
        Parameters by input array, with their components.
    """

    def __init__(
        self,
        result: PostureStiffness,
        own: Mapping[str, float],
        taken: TracedModel,
        wrench: Array | None,
    ) -> None:
        self.result, self._own = result, own
        self.elastic = result.elastic_as_given
        self.mechanism = self.elastic.mechanism
        self.names = self._of_every_mechanism()
        taken = self._varied(taken)
        self.case = taken.case
        self.given = {name: np.atleast_2d(row) for name, row in taken.shared.items()}
        self.given["q"] = result.q[None]
        if wrench is not None:
            self.given["wrench"] = np.asarray(wrench, float)[None]

    @classmethod
    def of(
        cls,
        result: PostureStiffness,
        own: Mapping[str, float],
        wrench: Array | None,
        load: LoadKind = DEAD_AT_ORIGIN,
        axes: Axes = "body",
        with_inertia: bool = False,
    ) -> Recorded | str:
        """The arithmetic, or the reason why there is none.

        Parameters
        ----------
        result : PostureStiffness
            The posture.
        own : mapping of str to float
            Parameters of springs, masses and geometry by name.
        wrench : ndarray (6,), optional
            The given load; without it the wrench that given rest positions hold is kept.
        load, axes : LoadKind and {"body", "world"}
            Behaviour, point and axes of the given load.
        with_inertia : bool
            Whether the mass matrix is among the outputs.
        """
        if wrench is None and rests_are_given(result):
            wrench, load, axes = result.wrench, DEAD_AT_ORIGIN, "body"
        elastic = result.elastic_as_given
        taken = plan(elastic, "none" if wrench is None else "each")
        if isinstance(taken, str):
            return taken
        if taken.untraced or taken.settles:
            return "energies act whose derivatives are computed outside of it"
        if with_inertia:
            case = with_masses(elastic, taken.case)
            if case is None:
                return "some masses are not recorded"
            taken = replace(taken, case=case)
        return cls(result, own, taken.under(load, axes), wrench)

    def named(self, found: Slopes) -> dict[str, Array]:
        """Derivatives (m,) by parameter, the closures kept."""
        by = dict(found.by) if found.closing is None else self._closed(found)
        if "points" in by:
            # Points are given in P, the recorded ones in M.
            in_M = by["points"].reshape(len(by["points"]), -1, 3)
            in_P = in_M @ self.mechanism.frame_offset[:3, :3].T
            by["points"] = in_P.reshape(len(in_P), -1)
        return {
            name: by[array][:, i]
            for array, components in self.names.items()
            if array in by
            for name, i in components.items()
        }

    def _of_every_mechanism(self) -> Names:
        springs = enumerate(self.elastic.spring_names)
        return {
            "q": {f"q.{self.elastic.names[j]}": j for j in free_coordinates(self.result)},
            "wrench": {f"load.{x}": i for i, x in enumerate(LOAD)},
            "stiffness": {
                name: i for i, x in springs if (name := f"stiffness.{x}") in self._own
            },
        }

    def _varied(self, taken: TracedModel) -> TracedModel:
        """The arithmetic with the geometry as inputs.

        Adds the names of their components.
        """
        case, shared = taken.case, dict(taken.shared)
        if isinstance(case, PlatformCase) and isinstance(self.mechanism, Platform):
            platform = self.mechanism
            if not case.lines:
                m = len(platform.anchors)
                case = replace(case, anchors=(), points=(), length=1.0, lines=m)
                shared["anchors"] = platform.anchors.reshape(1, -1)
                shared["points"] = platform.points.reshape(1, -1)
                shared["length"] = np.array([[float(platform.length)]])
            forces = self.result.tensions
            if case.rest == "given" and forces is not None:
                # More lines than six keep their forces but for what the load asks.
                case = replace(case, rest="preload")
                shared["preload"] = forces[None]
            for body, array in (("base", "anchors"), ("platform", "points")):
                self.names[array] = {
                    f"{body}.leg{i // 3 + 1}.{_XYZ[i % 3]}": i
                    for i in range(3 * case.lines)
                }
        elif isinstance(case, ChainCase) and isinstance(self.mechanism, Chain):
            case, more = _varied_chain(self.mechanism, case, self._own)
            places = len(case.varied.links) + len(case.varied.ends)
            shared["placements"] = np.zeros((1, 6 * places))
            if case.varied.masses:
                own = (
                    case.fields[0].weights if case.bodies is None else case.bodies.masses
                )
                shared["masses"] = np.array([own])
            self.names |= more
        return replace(taken, case=case, shared=shared)

    def _closed(self, found: Slopes) -> dict[str, Array]:
        """Derivatives with the coordinates that are not held moving to keep
        the closures.
        """
        chain, closing = self.mechanism, found.closing
        if not isinstance(chain, Chain) or closing is None:
            raise TypeError(chain)
        sizes = self.result.posture.coordinate_lengths
        moving = [j for j in range(len(sizes)) if j not in chain.rigid]
        D = [j for j in moving if j not in chain.held]
        # Closures may be redundant: their combinations that move nothing stay met.
        (U, values, Vt), needed = (
            _decomposed(closing["q"] * sizes, js) for js in (D, moving)
        )
        if len(values) < len(needed[1]):
            # The held coordinates do not leave enough: all of them move.
            (U, values, Vt), D = needed, moving
        weight = (found.by["q"][:, D] * sizes[D]) @ Vt.T / values
        return {
            name: slope - weight @ (U.T @ closing[name])
            for name, slope in found.by.items()
        }


def rests_are_given(result: PostureStiffness) -> bool:
    """Whether rest positions of the springs are given: they hold the posture with
    some wrench.
    """
    springs = result.elastic_as_given.springs
    return springs is not None and not np.isnan(springs.rest).all()


def free_coordinates(result: PostureStiffness) -> list[int]:
    """Coordinates that can be chosen: of a closed chain those that are held."""
    chain = result.elastic.mechanism
    if isinstance(chain, Chain) and chain.closures:
        return sorted(chain.held)
    return [j for j in range(result.q.size) if j not in chain.virtual]


def _varied_chain(
    chain: Chain, case: ChainCase, own: Mapping[str, float]
) -> tuple[ChainCase, Names]:
    """A chain's arithmetic with placements and masses as inputs, and their names."""
    tree, names = chain.tree, Names()
    path = list(range(tree.model.njoints - 1))
    if not chain.closures:
        path = [int(j) for j in tree.path(0, chain.body.joint).order]
    places = [f"placement.{tree.model.names[j + 1]}" for j in path] + ["frame"]
    links = tuple(i for i, name in enumerate(places) if f"{name}.x" in own)
    found = [places[i] for i in links]
    ends = list[tuple[int, int]]()
    for tie, closure in enumerate(chain.closures):
        for side, frame in enumerate((closure.frame_a, closure.frame_b)):
            if f"closure.{frame}.x" in own:
                ends.append((tie, side))
                found.append(f"closure.{frame}")
    names["placements"] = {
        f"{name}.{axis}": 6 * i + k
        for i, name in enumerate(found)
        for k, axis in enumerate((*_XYZ, *_RXYZ))
        if f"{name}.{axis}" in own
    }
    has_weight = bool(case.fields) and case.fields[0].has_mass
    has_masses = has_weight or case.bodies is not None
    if has_masses:
        at = {j: i for i, j in enumerate(path)}
        names["masses"] = {
            f"mass.{name}": at[j - 1]
            for j, name in tree.links().items()
            if j - 1 in at and f"mass.{name}" in own
        }
    varied = Varied(links, tuple(ends), has_masses)
    return replace(case, varied=varied), names


def _decomposed(C: Array, columns: list[int]) -> tuple[Array, Array, Array]:
    """Singular value decomposition of columns of a matrix, without what is zero."""
    U, values, Vt = np.linalg.svd(C[:, columns], full_matrices=False)
    rank = int((values > numerics.RANK * values[0]).sum())
    return U[:, :rank], values[:rank], Vt[:rank]
