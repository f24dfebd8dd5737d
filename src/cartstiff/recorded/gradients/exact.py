r"""Derivatives by the recorded arithmetic of a mechanism, at a posture or at rest.

Some of the coordinates q follow a number p of the mechanism, so that for an output y

    dy/dp = y_p + y_q dq/dp.

*At this posture* the coordinates D of a closed chain that are not held keep the closures
c met: theory.md, eq. closedgradient, with the natural sizes S of the coordinates

    dq_D/dp = - S (C_D S)^+ c_p,      C_D = dc/dq_D.

What *comes to rest again* keeps the forces f of `cartstiff.recorded.gradient.Forces` zero
on all motions N that the closures leave: eq. restgradient,

    dq/dp = e - N H_N^-1 N^T (f_p + H e),    H = df/dq,  H_N = N^T H N,  e = - C^+ c_p.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, cast

import numpy as np

from cartstiff.answer.analysis.parameters import LOAD, PAYLOAD, Parameters
from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.errors import UndefinedError
from cartstiff.core.mechanisms.chain import Chain
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.mechanisms.platform import Platform
from cartstiff.core.statics.equilibrium import again
from cartstiff.core.statics.rest import Equilibrium
from cartstiff.core.stiffness.applied_load import DEAD_AT_ORIGIN, Axes, LoadKind
from cartstiff.core.stiffness.balance import with_rest_balancing
from cartstiff.core.stiffness.compute import PostureStiffness
from cartstiff.recorded.chains import ChainCase
from cartstiff.recorded.gradient import Differentiated, Slopes
from cartstiff.recorded.plans import Case, TracedModel, plan_with
from cartstiff.recorded.platforms import PlatformCase
from cartstiff.recorded.readings import with_masses
from cartstiff.recorded.twists import Varied

#: Component of each named parameter in an input array, by array.
Names = dict[str, dict[str, int]]
#: Shapes of outputs other than (6, 6); -1 is the number of motions.
_SHAPES = {
    "wrench": (6,),
    "pose": (4, 4),
    "lagrangian": (-1, -1),
    "kinetic": (-1, -1),
    "motion": (6, -1),
}
_XYZ = "x", "y", "z"
_SHIFTS_AND_TURNS = *_XYZ, "rx", "ry", "rz"


@dataclass(frozen=True, eq=False)
class _Load:
    """A load as the arithmetic has it.

    Attributes
    ----------
    wrench : ndarray (6,), optional
    kind, axes : LoadKind and {"body", "world"}
    by_given : ndarray (6, 6)
        Derivative of the wrench by the components that were given.
    """

    wrench: Array | None = None
    kind: LoadKind = DEAD_AT_ORIGIN
    axes: Axes = "body"
    by_given: Array | None = None

    @classmethod
    def on_held(cls, parameters: Parameters) -> _Load:
        """That of a held posture."""
        if (load := parameters.load) is None or load["wrench"] is None:
            return cls(parameters.held_wrench)
        wrench = np.asarray(load["wrench"], float)
        return cls(wrench, parameters.result.load, load["load_axes"])

    @classmethod
    def on_resting(cls, parameters: Parameters, state: Equilibrium) -> _Load | str:
        """That of a state of rest, or the reason why it is not recorded."""
        if not state.loads:
            return cls()
        (load, *others) = state.loads
        if load.given is None or others:
            return "other loads than one wrench on the body act"
        kind, wrench, point, axes = load.given
        own, by_given = LoadKind(kind, point), None  # type: ignore[arg-type]
        if (given := parameters.load) is not None:
            asked, pose = LoadKind(given["load_kind"], given["load_at"]), state.start.pose
            each = [asked.acting(e, pose, given["load_axes"]) for e in np.eye(6)]
            columns = [x.given[1] for x in each if x.given is not None]
            by_given = np.column_stack(columns)
        return cls(wrench, own, axes, by_given)  # type: ignore[arg-type]


def parameters_of(
    subject: PostureStiffness | Equilibrium,
    reread: Callable[[Mapping[str, float]], ElasticMechanism] | None = None,
    load: Mapping[str, Any] | None = None,
) -> Parameters:
    """The numbers of a held posture, or of what comes to rest again.

    Raises
    ------
    UndefinedError
        Where it may rest anywhere.
    """
    if isinstance(subject, PostureStiffness):
        return Parameters(subject, reread, load)
    state = subject
    if state.has_free_motion:
        raise UndefinedError(
            "where it rests is not decided, as a motion of the body costs nothing: "
            "what is there has no derivatives",
            code="neutral",
        )

    def rest_again(elastic: ElasticMechanism, wrench: Array | None) -> Equilibrium:
        if elastic.has_open_rest:
            chosen = parameters.posture_of(elastic, state.start.q)
            elastic = with_rest_balancing(elastic, elastic.mechanism.closed(chosen))
        loads = state.loads
        if load is not None and wrench is not None:
            kind = LoadKind(load["load_kind"], load["load_at"])
            loads = (kind.acting(wrench, state.start.pose, load["load_axes"]),)
        return again(state, elastic, loads)

    parameters = Parameters(state.elastic_stiffness, reread, load, rest_again)
    return parameters


class Recorded:
    """The recorded arithmetic of a posture or a state of rest, with its parameters as
    inputs.

    Attributes
    ----------
    case : ChainCase or PlatformCase
    given : dict of str to ndarray (1, ...)
        Input arrays at the posture.
    names : dict
        Parameters by input array, with their components.
    """

    def __init__(self, parameters: Parameters, taken: TracedModel, load: _Load) -> None:
        self.result: PostureStiffness = parameters.result
        self.elastic, self._own = parameters.asked, parameters.nominal
        self.mechanism, self._load = self.elastic.mechanism, load
        springs = enumerate(self.elastic.spring_names)
        by_spring = [(name, i) for i, name in springs]
        chosen = enumerate(self.elastic.names)
        self.names: Names = {
            "q": {f"q.{name}": j for j, name in chosen},
            "wrench": {f"load.{x}": i for i, x in enumerate(LOAD)},
            "stiffness": self._known({f"stiffness.{x}": i for x, i in by_spring}),
            "rest": self._known({f"rest.{x}": i for x, i in by_spring}),
            "preload": self._known({f"preload.{x}": i for x, i in by_spring}),
            PAYLOAD: {PAYLOAD: 0},
        }
        taken = self._varied(taken)
        self.case = taken.case
        self.given = {name: np.atleast_2d(row) for name, row in taken.shared.items()}
        self.given["q"] = self.result.q[None]
        if self.case.is_loaded:
            W = np.zeros(6) if load.wrench is None else load.wrench
            self.given["wrench"] = np.asarray(W, float)[None]

    @classmethod
    def of(
        cls,
        parameters: Parameters,
        state: Equilibrium | None = None,
        with_inertia: bool = False,
        with_payload: bool = False,
    ) -> Recorded | str:
        """The arithmetic, or the reason why there is none.

        Parameters
        ----------
        parameters : Parameters
            Of the posture.
        state : Equilibrium, optional
            What comes to rest again.
        with_inertia : bool
            Whether the mass matrix is among the outputs.
        with_payload : bool
            Whether a payload is a parameter.
        """
        if state is None:
            load: _Load | str = _Load.on_held(parameters)
        elif state._solution.contacts or state.reactions.held:
            return "a limit or a prescribed displacement holds it"
        else:
            load = _Load.on_resting(parameters, state)
        if isinstance(load, str):
            return load
        elastic = parameters.asked
        is_loaded = load.wrench is not None and state is None
        hung = {PAYLOAD} if with_payload and elastic.gravity is not None else set()
        taken = plan_with(elastic, is_loaded, hung)
        if isinstance(taken, str):
            return taken
        if taken.untraced or taken.settles:
            return "energies act whose derivatives are computed outside of it"
        if with_inertia:
            case = with_masses(elastic, taken.case)
            if case is None:
                return "some masses are not recorded"
            taken = replace(taken, case=case)
        if state is not None:
            # Rest positions stay, whatever acts.
            case = replace(taken.case, is_loaded=True)
            if isinstance(case, PlatformCase):
                case = replace(case, rest="kept")
            taken = replace(taken, case=case)
        return cls(parameters, taken.under(load.kind, load.axes), load)

    def named(self, found: Slopes) -> dict[str, Array] | None:
        """Derivatives (m,) by parameter, with what follows it.

        None where the state of rest is not regular.
        """
        following = self._following(found)
        if following is None:
            return None
        by = {}
        for name, slope in found.by.items():
            by[name] = slope + found.by["q"] @ following.get(
                name, 0.0 * self.given["q"].T
            )
        if "points" in by:
            # Points are given in P, the recorded ones in M.
            in_M = by["points"].reshape(len(by["points"]), -1, 3)
            in_P = in_M @ self.mechanism.frame_offset[:3, :3].T
            by["points"] = in_P.reshape(len(in_P), -1)
        if "wrench" in by and self._load.by_given is not None:
            by["wrench"] = by["wrench"] @ self._load.by_given
        # Links that a number bends are no longer those that the arithmetic knows.
        still = self.case.still if isinstance(self.case, ChainCase) else ()
        straight = [j for own, _ in still for j in own]
        bends = {a: np.atleast_1d(rows[straight].any(0)) for a, rows in following.items()}
        named = {
            name: by[array][:, i]
            for array, components in self.names.items()
            if array in by
            for name, i in components.items()
            if array not in bends or not bends[array][i]
        }
        return self._of_measured(named) | named

    def slopes(
        self,
        outputs: tuple[str, ...],
        names: Sequence[str],
        comes_to_rest: bool = False,
        motions: int = 6,
    ) -> tuple[list[str], dict[str, Array], dict[str, Array]] | None:
        """Those of the parameters that have derivatives; by output the derivatives
        (p, ...) and the values.

        None where an output does not exist, and where the posture or the state of rest is
        not regular.
        """
        program = differentiated(self.case, outputs, comes_to_rest)
        found = None if program is None else program.at(self.given)
        by = None if found is None else self.named(found)
        if found is None or by is None:
            return None
        # The program gives flat rows; they are cut as the outputs lie in them.
        shapes = [_SHAPES.get(name, (6, 6)) for name in outputs]
        sizes = [tuple(motions if n < 0 else n for n in shape) for shape in shapes]
        ends = np.cumsum([np.prod(size) for size in sizes])[:-1]

        def split(flat: Array) -> dict[str, Array]:
            parts = zip(outputs, np.split(flat, ends, axis=-1), sizes, strict=True)
            return {name: x.reshape(*x.shape[:-1], *size) for name, x, size in parts}

        kept = [name for name in names if name in by]
        slopes = np.reshape([by[name] for name in kept], (len(kept), len(found.values)))
        return kept, split(slopes), split(found.values)

    def _of_measured(self, named: Mapping[str, Array]) -> dict[str, Array]:
        """Derivatives by compliances of measured springs, each of one or more springs."""
        known, own = self.elastic.identified, self._own
        if known is None:
            return {}
        found = dict[str, Array]()
        for pattern in known.patterns:
            each = [(f"stiffness.{key}", weight) for key, weight in pattern.keys]
            if all(k in named for k, _ in each):
                parts = [-weight * own[k] ** 2 * named[k] for k, weight in each]
                found[pattern.label] = np.sum(parts, axis=0)
        return found

    def _known(self, components: Mapping[str, int]) -> dict[str, int]:
        return {name: i for name, i in components.items() if name in self._own}

    def _varied(self, taken: TracedModel) -> TracedModel:
        """The arithmetic with the geometry as inputs.

        Adds the names of their components.
        """
        case, shared = taken.case, dict(taken.shared)
        if isinstance(case, PlatformCase):
            platform = cast(Platform, self.mechanism)
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
        else:
            chain = cast(Chain, self.mechanism)
            case, more = _varied_chain(chain, case, self._own)
            places = len(case.varied.links) + len(case.varied.ends)
            shared["placements"] = np.zeros((1, 6 * places))
            if case.coupled or case.still:
                case, more["factors"] = self._with_factors(case)
                shared["factors"] = np.ones((1, len(more["factors"])))
            if case.varied.masses:
                own = (
                    case.fields[0].weights if case.bodies is None else case.bodies.masses
                )
                shared["masses"] = np.array([own])
            self.names |= more
        return replace(taken, case=case, shared=shared)

    def _with_factors(self, case: ChainCase) -> tuple[ChainCase, dict[str, int]]:
        """A chain's arithmetic with factors on links' stiffness, and their names."""
        known, names, which = self.elastic.labelled(), dict[str, int](), list[int]()
        for at, _ in (*case.coupled, *case.still):
            (own,) = (each for each in known if at[0] in each[0].members)
            name = next(iter(own[0].numbers(own[1])), "")
            which.append(names.setdefault(name, len(names)))
        varied = replace(case.varied, factors=tuple(which))
        return replace(case, varied=varied), names

    @cached_property
    def _moving(self) -> list[int]:
        return [j for j in range(self.result.q.size) if j not in self.mechanism.rigid]

    def _following(self, found: Slopes) -> dict[str, Array] | None:
        """Derivatives (n, ...) of the coordinates by the components of each array."""
        n, sizes = self.result.q.size, self.result.posture.coordinate_lengths
        closing, forces = found.closing, found.forces
        following = dict[str, Array]()
        moving, N = self._moving, np.eye(n)[:, self._moving]
        if closing is not None:
            D = moving
            if forces is None:
                D = [j for j in moving if j not in self.mechanism.held]
            # Closures may be redundant: their combinations that move nothing stay met.
            (U, values, Vt), needed = (
                _decomposed(closing["q"] * sizes, js) for js in (D, moving)
            )
            if len(values) < len(needed[1]):
                # The held coordinates do not leave enough: all of them move.
                (U, values, Vt), D = needed, moving
            back = np.zeros((n, len(U)))
            back[D] = -sizes[D, None] * (Vt.T / values) @ U.T
            following = {name: back @ slope for name, slope in closing.items()}
            N = N @ np.linalg.svd(needed[2])[2][len(needed[2]) :].T
        if forces is None:
            return following
        N, H = N * sizes[:, None], forces["q"]
        inverse = numerics.invert(N.T @ H @ N)
        if inverse is None or inverse.error > numerics.REPORTED_ERROR:
            return None
        for name in (name for name in found.by if name != "q"):
            e = following.get(name, np.zeros((n, found.by[name].shape[1])))
            f_p = forces.get(name, np.zeros_like(e)) + H @ e
            following[name] = e - N @ (inverse.matrix @ (N.T @ f_p))
        following.pop("q", None)
        return following


def slopes_of_matrices(
    parameters: Parameters, names: Sequence[str]
) -> dict[str, Array] | None:
    """Derivatives (p, ...) of K^B, K^F (where it exists) and the wrench of a held
    posture by parameters; None where not all of them are exact.
    """
    result, recorded = parameters.result, Recorded.of(parameters)
    needed = tuple(
        name
        for name, K in (("stiffness_B", "B"), ("stiffness_F", "F"), ("wrench", ""))
        if not K or result.matrices[K] is not None
    )
    if isinstance(recorded, str) or "stiffness_B" not in needed:
        return None
    found = recorded.slopes(needed, names)
    if found is None or len(found[0]) < len(names):
        return None
    return found[1]


@lru_cache(maxsize=8)
def differentiated(
    case: Case, names: tuple[str, ...], comes_to_rest: bool = False
) -> Differentiated | None:
    """Arrays of an answer with their derivatives, recorded once.

    None if they do not exist.
    """

    def objective(arrays: Mapping[str, Array]) -> tuple[list[Any], Any]:
        return [x for name in names for x in np.ravel(arrays[name])], 0.0

    try:
        return Differentiated(case, names, objective, comes_to_rest)
    except KeyError:
        return None


def _varied_chain(
    chain: Chain, case: ChainCase, own: Mapping[str, float]
) -> tuple[ChainCase, Names]:
    """A chain's arithmetic with placements and masses as inputs, and their names."""
    tree, names = chain.tree, Names()
    # Joints whose placements move the body; with closures every joint does.
    path = list(range(tree.model.njoints - 1))
    if not chain.closures:
        path = [int(j) for j in tree.path(0, chain.body.joint).order]
    # Each link and each end of a closure that a parameter moves is one input of six
    # numbers.
    places = [f"placement.{tree.model.names[j + 1]}" for j in path] + ["frame"]
    varying = {name.rpartition(".")[0] for name in own}
    links = tuple(i for i, name in enumerate(places) if name in varying)
    found = [places[i] for i in links]
    # A frame may close several loops.
    ends = dict[str, list[tuple[int, int]]]()
    for tie, closure in enumerate(chain.closures):
        for side, frame in enumerate((closure.frame_a, closure.frame_b)):
            if f"closure.{frame}" in varying:
                ends.setdefault(f"closure.{frame}", []).append((tie, side))
    found += ends
    names["placements"] = {
        f"{name}.{axis}": 6 * i + k
        for i, name in enumerate(found)
        for k, axis in enumerate(_SHIFTS_AND_TURNS)
        if f"{name}.{axis}" in own
    }
    # A mass matters where there is weight, or where the masses swing.
    has_weight = bool(case.fields) and case.fields[0].has_mass
    has_masses = has_weight or case.bodies is not None
    if has_masses:
        at = {j: i for i, j in enumerate(path)}
        names["masses"] = {
            f"mass.{name}": at[j - 1]
            for j, name in tree.links().items()
            if j - 1 in at and f"mass.{name}" in own
        }
    varied = Varied(links, tuple(map(tuple, ends.values())), has_masses)
    return replace(case, varied=varied), names


def _decomposed(C: Array, columns: list[int]) -> tuple[Array, Array, Array]:
    """Singular value decomposition of columns of a matrix, without what is zero."""
    U, values, Vt = np.linalg.svd(C[:, columns], full_matrices=False)
    rank = int((values > numerics.RANK * values[0]).sum())
    return U[:, :rank], values[:rank], Vt[:rank]
