"""Choice of the recorded arithmetic of a mechanism, and its inputs."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Container, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, reduce
from math import inf
from typing import Any, cast
from weakref import WeakKeyDictionary

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.chain import Chain
from cartstiff.core.mechanisms.closures import ReferencePosture
from cartstiff.core.mechanisms.contract import Mechanism
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.mechanisms.platform import Platform
from cartstiff.core.numerics.threads import process_lock
from cartstiff.core.potentials.beams import Beam
from cartstiff.core.potentials.contract import Potential
from cartstiff.core.potentials.line_springs import LineSprings
from cartstiff.core.potentials.loads import DeadForce
from cartstiff.core.potentials.springs import SpringLaw
from cartstiff.core.stiffness.applied_load import DEAD_AT_ORIGIN, Axes, LoadKind
from cartstiff.files.struts.flexure_struts import FlexureStruts
from cartstiff.recorded.algebra import CASE_INPUTS, SHARED, acting
from cartstiff.recorded.chains import (
    ChainCase,
    Line,
    chain_arrays,
    is_recorded,
)
from cartstiff.recorded.closed_chains import (
    closed_arrays,
    closed_case,
    closing_arrays,
    settles,
    settling_arrays,
)
from cartstiff.recorded.own_outputs import OwnOutputs
from cartstiff.recorded.platforms import PlatformCase, platform_arrays
from cartstiff.recorded.readings import Readings, read
from cartstiff.recorded.tape import Program, Tape, larger, uncollected
from cartstiff.recorded.twists import ForceField, TreeConstants, numbers, read_chain
from cartstiff.recorded.untraced import UntracedTerms

Case = ChainCase | PlatformCase
#: Outputs of the programs for steps towards closure, and towards rest of links under a
#: load.
CLOSING, SETTLING = ("next", "left"), ("settled", "moved")


@dataclass(frozen=True)
class TracedModel:
    """A case of the recorded arithmetic with its inputs.

    Attributes
    ----------
    case : ChainCase or PlatformCase
        Key of the program.
    shared : dict of str to ndarray, shape (1, ...)
        Inputs that are the same for all postures.
    regular : str
        State of the postures that the program computes.
    untraced : UntracedTerms
        Energies whose derivatives are inputs of the program.
    home : ReferencePosture, optional
        Posture of a closed chain from which others are reached.
    """

    case: Case
    shared: dict[str, Array]
    regular: str
    untraced: UntracedTerms
    home: ReferencePosture | None = None

    @property
    def is_closed(self) -> bool:
        """Whether the mechanism is a closed chain, which is closed first."""
        return self.case.is_closed

    @property
    def settles(self) -> bool:
        """Whether links are deflected first by the load."""
        return bool(self.case.settled)

    def under(self, load: LoadKind, axes: Axes) -> TracedModel:
        """The same under another kind of load, with a wrench along the axes of M or F."""
        if load == DEAD_AT_ORIGIN and axes == "body":
            return self
        untraced, shared = replace(self.untraced, load=load, axes=axes), self.shared
        if "load_at" in shared:
            shared = {**shared, "load_at": np.array([load.at])}
        case = replace(self.case, load=load, axes=axes)
        return replace(self, case=case, untraced=untraced, shared=shared)


def plan_with(
    elastic: ElasticMechanism, is_loaded: bool, inputs: Collection[str]
) -> TracedModel | str:
    """`plan` with some of `algebra.CASE_INPUTS` as inputs.

    A payload is the last of the constant forces, of one kilogram at M's origin as
    planned.
    """
    own, base = tuple(sorted({*inputs} & {*CASE_INPUTS})), elastic
    if "payload" in own and elastic.gravity is not None:
        kilogram = elastic.with_payload(1.0)
        force = _weight(kilogram, elastic.gravity) - _weight(elastic, elastic.gravity)
        base = elastic.with_potential(DeadForce(force, np.zeros(3)))
    taken = plan(base, is_loaded)
    if isinstance(taken, str):
        return taken
    if "tcp" in own and taken.untraced:
        return "terms outside of the recorded arithmetic know no other tool"
    if inputs and taken.untraced.has_drives:
        return "drives outside of the recorded arithmetic keep their numbers"
    if not own:
        return taken
    case, shared = replace(taken.case, inputs=own), dict(taken.shared)
    shared["load_at"] = np.array([taken.case.load.at])
    if "payload" in own:
        if isinstance(case, ChainCase):
            case = replace(case, fields=case.fields[:-1])
        else:
            case = replace(case, points_of_forces=case.points_of_forces[:-1])
        shared["payload"] = np.zeros((1, 4))
    if "tcp" in own:
        shared["tcp"] = np.zeros((1, 6))
    return replace(taken, case=case, shared=shared)


def _weight(elastic: ElasticMechanism, gravity: Array) -> Array:
    """Weight (3,) of a mechanism's bodies in its unit of force."""
    mechanism = elastic.mechanism
    if isinstance(mechanism, Platform):
        return mechanism.weight(gravity)
    weight: Array = cast(Chain, mechanism).tree.masses()[0].sum() * gravity
    return weight


def recorded_arrays(tape: Tape, case: Case, needed: tuple[str, ...]) -> dict[str, Array]:
    """Outputs of a case that exist, among them all that are needed, the "verdict", and
    "lengths": which columns of the Jacobian are of distances, those of legs are.
    """
    if not isinstance(case, ChainCase):
        return platform_arrays(tape, case, needed) | {"lengths": np.ones(6, bool)}
    arrays = (closed_arrays if case.is_closed else chain_arrays)(tape, case, needed)
    return arrays | {"lengths": np.array(case.constants.is_length)}


@lru_cache(maxsize=64)
@uncollected()
def program_for(
    case: Case,
    outputs: tuple[str, ...],
    readings: Readings | None = None,
    own: OwnOutputs | None = None,
    stored: tuple[str, ...] | None = None,
) -> Program:
    """Program of the existing outputs of a case and of the verdict on the posture;
    cached.

    Parameters
    ----------
    case : ChainCase or PlatformCase
    outputs : tuple of str
        Those that the verdict is on.
    readings : Readings, optional
        Quantities that are outputs as well, if all that they need exists.
    own : OwnOutputs, optional
        A user's outputs.
    stored : tuple of str, optional
        Those of the outputs that the program stores beside readings and own ones;
        default all.
    """
    tape = Tape()
    if isinstance(case, ChainCase) and outputs == CLOSING:
        return tape.program(closing_arrays(tape, case))
    if isinstance(case, ChainCase) and outputs == SETTLING:
        return tape.program(settling_arrays(tape, case), SHARED)
    needed = outputs if readings is None else (*outputs, *readings.needs)
    if own:
        needed = (*needed, "length")
    arrays = recorded_arrays(tape, case, needed)
    kept = [n for n in (outputs if stored is None else stored) if n in arrays]
    doubts = [arrays["verdict"][0]]
    if readings is not None and readings.exist_beside(arrays):
        values, doubt = read(arrays, readings, acting(tape, case))
        doubts.append(doubt)
        arrays |= {name: values[i : i + 1] for i, name in enumerate(readings.names)}
        kept += readings.names
    if own is not None and (own := own.beside(arrays)):
        length = arrays["length"][0] if "length" in arrays else case.length
        found, doubt = own.record(arrays, length)
        doubts.append(doubt)
        arrays |= found
        kept += own.names
    arrays["verdict"][0] = reduce(larger, doubts)
    # Outputs that nobody reads are dropped.
    stay = {name: arrays[name] for name in (*kept, "verdict")}
    return tape.program(stay, SHARED)


#: The last plans with their mechanisms, which do not change, and whether they are loaded.
_plans: deque[tuple[ElasticMechanism, bool, TracedModel | str]] = deque(maxlen=8)


def plan(elastic: ElasticMechanism, is_loaded: bool = False) -> TracedModel | str:
    """The recorded arithmetic of a mechanism, under a wrench for each posture if it
    `is_loaded`, or the reason why it has none; the last are cached.
    """
    for known, loaded, found in tuple(_plans):
        if known is elastic and loaded == is_loaded:
            return found
    planned = _planned(elastic, is_loaded)
    if elastic.gravity is None or not elastic.gravity.flags.writeable:
        _plans.append((elastic, is_loaded, planned))
    return planned


def _planned(elastic: ElasticMechanism, is_loaded: bool) -> TracedModel | str:
    mechanism = elastic.mechanism
    for kind, planner in _PLANNERS.items():
        if kind in type(mechanism).__mro__:
            return planner(elastic, mechanism, is_loaded)
    return f"no arithmetic for mechanisms of kind {mechanism.kind}"


_constants: WeakKeyDictionary[Mechanism, TreeConstants | str] = WeakKeyDictionary()
_lock = process_lock()


def chain_constants(chain: Chain) -> TreeConstants | str:
    """`read_chain`, cached as long as the chain exists."""
    with _lock:
        if chain not in _constants:
            _constants[chain] = read_chain(chain)
        return _constants[chain]


def _chain_plan(
    elastic: ElasticMechanism, chain: Chain, is_loaded: bool
) -> TracedModel | str:
    springs, n = elastic.springs, len(chain.is_length)
    if elastic.coupled_springs:
        return "springs that couple joints are balanced posture by posture"
    # Stiffnesses and rest positions are zero where there are none.
    shared = {"stiffness": np.zeros((1, n)), "rest": np.zeros((1, n))}
    laws: Mapping[int, SpringLaw] = {}
    is_open = np.zeros(n, bool)
    if springs is not None and springs.attachments():
        return "line springs of a chain have no arithmetic of their own"
    if springs is not None:
        is_open, laws = springs.rest_is_free(is_loaded), springs.laws
        if any(is_open[j] and not is_recorded(law, True) for j, law in laws.items()):
            return "the rest position of such a spring is found posture by posture"
        shared["stiffness"][:], shared["rest"][:] = (
            springs.stiffness,
            np.nan_to_num(springs.rest),
        )
        shared["stiffness"][:, list(laws)] = 0.0
    answer = (closed_case if chain.closures else _open_case)(
        elastic, chain, is_loaded, is_open
    )
    if isinstance(answer, str):
        return answer
    case, others = answer
    return _with_fields(elastic, chain, case, others, shared, laws)


def _open_case(
    elastic: ElasticMechanism, chain: Chain, is_loaded: bool, is_open: Array
) -> tuple[ChainCase, tuple[Potential, ...]] | str:
    """Case of an open chain and its potentials, or the reason why there is none."""
    constants = chain_constants(chain)
    if isinstance(constants, str):
        return constants
    n, rigid = len(constants.is_length), tuple(sorted(chain.rigid))
    if len(rigid) == n:
        return "no joint gives"
    if rigid and chain.virtual:
        return "links that give beside rigid joints are looked at posture by posture"
    if elastic.gravity is not None and len(constants.screws) < 6 * chain.tree.model.nv:
        return "bodies beside the way to the frame have weight"
    case = ChainCase(constants, is_loaded, rigid=rigid, has_chart=n == 6 and not rigid)
    if elastic.springs is not None:
        passive = np.flatnonzero(elastic.springs.is_passive).tolist()
        if is_loaded and {*passive}.difference(rigid, chain.virtual):
            return (
                "whether joints without a spring feel the wrench is seen posture by "
                "posture"
            )
        settled = settles(elastic, is_loaded)
        case = replace(
            case,
            springs=tuple(a for a in case.moving if a not in settled),
            chosen=tuple(a for a in case.moving if is_open[a]),
            is_balancing=bool(is_open[case.moving].all()),
            settled=settled,
        )
    return case, elastic.potentials


def _efforts(
    elastic: ElasticMechanism, case: ChainCase, unrecorded: Container[int]
) -> tuple[tuple[int, float, float], ...]:
    """`ChainCase.efforts` of the coordinates that have a spring."""
    found = list[tuple[int, float, float]]()
    for j in case.springs:
        limits = elastic.efforts.get(elastic.names[j])
        if limits is not None:
            least, most = (inf, -inf) if j in unrecorded else limits
            found.append((j, least, most))
    return tuple(found)


def _with_fields(
    elastic: ElasticMechanism,
    chain: Chain,
    case: ChainCase,
    others: Sequence[Potential],
    shared: dict[str, Array],
    laws: Mapping[int, SpringLaw],
) -> TracedModel:
    """The plan of a chain with gravity and other potentials,
    recorded as far as possible.
    """
    fields, forces, loose, beams = [], [], [], list[Beam]()
    lines, known = list[Line](), list[Array]()
    joints = len(case.constants.parents)
    # Gravity, forces, lines and coupled springs are recorded; `loose` terms are evaluated
    # outside.
    if elastic.gravity is not None:
        masses, centres = chain.tree.masses()
        fields.append(ForceField(numbers(masses), tuple(map(numbers, centres)), True))
        forces.append(elastic.gravity)
    for potential in others:
        dead, K = potential.dead, potential.own_stiffness
        if dead is not None and 0 < chain.placement(dead.frame).joint <= joints:
            at = chain.placement(dead.frame)
            point = se3.placed(at.T_j_f, dead.point)
            weights, points = np.zeros(joints), np.zeros((joints, 3))
            weights[at.joint - 1], points[at.joint - 1] = 1.0, point
            fields.append(ForceField(numbers(weights), tuple(map(numbers, points))))
            forces.append(dead.force)
        elif (own := _lines_of(chain, potential, joints)) is not None:
            lines += own[0]
            known.append(own[1])
        elif potential.is_scaled:
            beams.append(cast(Beam, potential))
        elif K is not None and potential.members:
            coupled = (potential.members, numbers(K))
            case = replace(case, coupled=(*case.coupled, coupled))
        else:
            loose.append(potential)
    # Numbers of the recorded terms are inputs of the program.
    if forces:
        shared["forces"] = np.concatenate(forces)[None]
    if lines:
        shared["lines"] = np.concatenate(known).reshape(1, -1)
        case = replace(case, stretched=tuple(lines))
    rest = shared["rest"][0]
    recorded = tuple((j, law) for j, law in laws.items() if is_recorded(law))
    laws = {j: law for j, law in laws.items() if not is_recorded(law)}
    case = replace(case, laws=recorded, efforts=_efforts(elastic, case, laws))
    untraced = UntracedTerms(chain, tuple(loose), laws, rest, tuple(beams))
    case = replace(
        case,
        fields=tuple(fields),
        derivatives=untraced.is_dense,
        segments=untraced.segments,
    )
    state = "fewer-than-six-freedoms" if case.freedoms < 6 else "regular"
    return TracedModel(case, shared, state, untraced, chain.home)


def _lines_of(
    chain: Chain, potential: Potential, joints: int
) -> tuple[list[Line], Array] | None:
    """Line springs between F and bodies on the path, their stiffnesses and rest
    lengths (m, 2).

    None for any other potential, and if a rest length is not known.
    """
    if type(potential) is not LineSprings or not potential.is_complete:
        return None
    frames, given = (
        (potential.frame_a, potential.frame_b),
        (potential.anchors, potential.points),
    )
    a, b = map(chain.placement, frames)
    if max(a.joint, b.joint) > joints:
        return None
    starts, ends = (
        map(numbers, se3.placed(at.T_j_f, points))
        for at, points in zip((a, b), given, strict=True)
    )
    each = zip(starts, ends, potential.cables.tolist(), strict=True)
    lines = [Line((a.joint, b.joint), (start, end), slack) for start, end, slack in each]
    return lines, np.column_stack([potential.stiffness, potential.rest_length])


def _platform_plan(
    elastic: ElasticMechanism, platform: Platform, is_loaded: bool
) -> TracedModel | str:
    springs = elastic.springs
    if springs is None or not springs.attachments():
        return "a platform without line springs has no arithmetic of its own"
    if springs.gives_aside:
        return _strut_plan(elastic, platform, cast(FlexureStruts, springs), is_loaded)
    springs = cast(LineSprings, springs)
    # The lines must be the legs themselves, at their anchors and points.
    m = len(springs.stiffness)
    same = (springs.frame_a, springs.frame_b) == ("world", "body")
    if not (
        same
        and np.array_equal(springs.anchors, platform.anchors)
        and np.array_equal(springs.points, platform.points)
    ):
        return "the springs are not the platform's own lines"
    # Rest lengths: all given, all found by the load, or all held with a preload.
    is_open, preload = springs.rest_is_free(), springs.preload
    has_preload = np.zeros(m, bool) if preload is None else is_open & ~np.isnan(preload)
    if len({*zip(is_open.tolist(), has_preload.tolist(), strict=True)}) > 1:
        return "some rest lengths are given and others are found posture by posture"
    if is_loaded and not is_open.all() and isinstance(springs.driven, tuple):
        return "which springs keep their rest lengths is found posture by posture"
    is_cable_driven = has_preload.any() and springs.cables.all()
    # What else acts on the body, and whether the lines may not carry it.
    forces, points, loose = _forces(elastic, platform)
    legs = None if elastic.gravity is None else platform.struts
    carries = forces or loose or legs is not None
    if m < 6 and (
        is_loaded or is_cable_driven or (is_open.any() and carries and preload is None)
    ):
        return "whether fewer than six lines carry a load is seen posture by posture"
    # What the program depends on, and apart from it the numbers that may change.
    rest = "preload" if has_preload.any() else "open" if is_open.any() else "given"
    acting = rest, is_loaded, springs.unilateral
    case = _platform_case(platform, *acting, tuple(points), bool(loose))
    bounds = springs.bounds(np.zeros((1, m)), np.ones(m, bool))
    given = np.zeros(m) if preload is None else preload
    shared = {
        "stiffness": springs.stiffness[None],
        "rest": np.nan_to_num(springs.rest_length)[None],
        "preload": np.nan_to_num(given)[None],
        # Infinite numbers have no place in a page.
        "least": np.clip(bounds.least, -1.0 / numerics.TINY, None),
        "most": np.clip(bounds.most, None, 1.0 / numerics.TINY),
    }
    # Weight, of the body and of the legs.
    if forces:
        shared["forces"] = np.concatenate(forces)[None]
    if legs is not None and elastic.gravity is not None:
        case = replace(case, legs=legs, has_weight=True)
        shared["weight"] = (elastic.gravity / platform.units.newtons)[None]
    # Designs vary the geometry, so that it is an input.
    if platform.is_one_of_many:
        case = replace(case, anchors=(), points=(), length=1.0, lines=m)
        shared |= {
            "anchors": platform.anchors.reshape(1, -1),
            "points": platform.points.reshape(1, -1),
            "length": np.array([[float(platform.length)]]),
        }
    return TracedModel(case, shared, "regular", UntracedTerms(platform, tuple(loose)))


# Which function plans a kind of mechanism.
_PLANNERS: dict[type, Any] = {Chain: _chain_plan, Platform: _platform_plan}


def _platform_case(platform: Platform, *acting: Any, **more: Any) -> PlatformCase:
    """A case with the geometry of a platform."""
    ends = numbers(platform.anchors), numbers(platform.points)
    place = numbers(platform.T_P_M), float(platform.length)
    return PlatformCase(*ends, *place, *acting, **more)


def _forces(
    elastic: ElasticMechanism, platform: Platform
) -> tuple[list[Array], list[tuple[float, ...]], list[Potential]]:
    """Constant forces on the body, their points, and the other potentials."""
    forces: list[Array] = []
    points: list[tuple[float, ...]] = []
    loose: list[Potential] = []
    if elastic.gravity is not None and platform.mass:
        forces.append(platform.weight(elastic.gravity))
        points.append(numbers(platform.mass_centre))
    for potential in elastic.potentials:
        if (dead := potential.dead) is not None and dead.frame == "body":
            forces.append(dead.force)
            points.append(numbers(dead.point))
        else:
            loose.append(potential)
    return forces, points, loose


def _strut_plan(
    elastic: ElasticMechanism, platform: Platform, struts: FlexureStruts, is_loaded: bool
) -> TracedModel | str:
    """Struts, whose derivatives are inputs; the platform's lines carry no force."""
    if (struts.frame_a, struts.frame_b) != ("world", "body"):
        return "the struts are not the platform's own"
    if elastic.gravity is not None and platform.struts is not None:
        return "struts between flexures that weigh are put together posture by posture"
    forces, points, loose = _forces(elastic, platform)
    m = len(struts.stiffness)
    # The struts' rest lengths balance the wrench; the program reads it from their
    # gradient.
    case = _platform_case(platform, points_of_forces=tuple(points), derivatives=True)
    shared = {"stiffness": np.zeros((1, m)), "rest": np.zeros((1, m))}
    if forces:
        shared["forces"] = np.concatenate(forces)[None]
    untraced = UntracedTerms(
        platform,
        tuple(loose),
        struts=struts,
        forces=tuple(forces),
        points=tuple(map(np.array, points)),
        is_loaded=is_loaded,
    )
    return TracedModel(case, shared, "regular", untraced)
