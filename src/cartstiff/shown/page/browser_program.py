"""The program of a page that computes in the browser: recorded formulas as JavaScript,
and words.

`cartstiff.recorded` records the formulas of arms, closed chains and bodies on straight
legs. Printed as JavaScript they compute pose, Jacobian, load and stiffness of any
posture, under any load and with any springs, without a server, and the steps that close a
closed chain. ``static/program.js`` derives all other numbers from these. It refuses a
posture that the recorded formulas do not cover.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from cartstiff.answer.analysis.metrics import characteristic_length
from cartstiff.answer.doubts import WEIGHTS
from cartstiff.answer.verdict import RULES
from cartstiff.core.arrays import plain
from cartstiff.core.choices import LOAD_KINDS
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.mechanisms.gravity_loads import gravity_loads
from cartstiff.core.mechanisms.limits import (
    MAX_RELATIVE_DEFLECTION,
    MAX_WIND_UP,
    Limits,
    stretch_is_doubted,
)
from cartstiff.core.mechanisms.preload import preload_notes
from cartstiff.core.notes import assumed_stiffness
from cartstiff.core.stiffness.applied_load import LoadKind
from cartstiff.core.stiffness.compute import PostureStiffness
from cartstiff.core.stiffness.settled_links import LAST, ROUNDED
from cartstiff.recorded.chains import ChainCase
from cartstiff.recorded.closed_chains import MAX_SETTLING_STEPS
from cartstiff.recorded.execution import HELPERS, javascript
from cartstiff.recorded.plans import SETTLING, TracedModel, program_for
from cartstiff.recorded.recording import Recording
from cartstiff.recorded.source_steps import Before
from cartstiff.recorded.sources import javascript_function
from cartstiff.shown.page.shown import is_upright
from cartstiff.shown.report.sentences import ADVICE, VERDICTS

_NAMES = (
    "pose",
    "jacobian",
    "wrench",
    "energy",
    "stiffness_B",
    "stiffness_F",
    "hessian",
    "lagrangian",
    "length",
    "frames",
    "tensions",
    "torques",
    "motions",
    "actuation",
    "leg_lengths",
)


@dataclass(frozen=True)
class BrowserProgram:
    """The arithmetic of one mechanism as JavaScript.

    Attributes
    ----------
    script : str
        Sets ``globalThis.cartstiffProgram``: a function without a given load, one with,
        and those that take a step towards closure.
    data : dict
        Numbers and words that ``static/program.js`` needs beside the functions.
    """

    script: str
    data: dict[str, Any]


def browser_program(
    elastic: ElasticMechanism, result: PostureStiffness
) -> BrowserProgram | str:
    """Return the formulas of a mechanism as JavaScript, or the reason why there are none.

    Parameters
    ----------
    elastic : ElasticMechanism
        The mechanism.
    result : PostureStiffness
        Any posture of it; only what all postures share is used.
    """
    if (reason := _unsupported(elastic)) is not None:
        return reason
    bare, pushed = (Recording(elastic, _NAMES, is_loaded=each) for each in (False, True))
    if not (bare.taken and bare.tape and pushed.taken and pushed.tape):
        return bare.reason or pushed.reason
    free, loaded = bare.taken, pushed.taken
    if (reason := _left_out(free)) is not None:
        return reason
    programs, steps = {"free": bare.tape}, dict[str, str]()
    if free.is_closed:
        bending, no_load = _link_deflection(loaded, elastic.names)
    else:
        bending, no_load = None, _left_out(loaded)
    if bending is not None:
        programs["settling"] = program_for(loaded.case, SETTLING)
        steps["bent"] = _steps(loaded, len(elastic.q), "bent")
        no_load = None
    if no_load is None:
        programs["loaded"] = pushed.tape
    elif not free.is_closed:
        return no_load
    closing = None
    if isinstance(free.case, ChainCase) and free.is_closed:
        ways = [replace(free, case=way) for way in free.case.ways]
        # Only with its drives held a chain is led from its reference posture.
        ways[1:] = [replace(way, home=None) for way in ways[1:]]
        names = [f"way{i}" for i in range(len(ways))]
        for name, way in zip(names, ways, strict=True):
            steps[name] = _steps(way, len(elastic.q), name)
        closing = _chain_closure(free.case, names)
    written = {name: javascript(program) for name, program in programs.items()}
    parts = [f"{name}:{source}" for name, (source, _) in written.items()]
    parts += [f"{name}:{name}_close" for name in steps if name != "bent"]
    parts += ["terms:bent_terms"] * ("bent" in steps)
    # In braces: a page may load it again, for another frame.
    own = "".join(steps.values())
    script = f"{{{HELPERS}{own}globalThis.cartstiffProgram={{{','.join(parts)}}};}}"
    data = {
        "places": {name: places for name, (_, places) in written.items()},
        "shared": {
            n: rows[0].tolist() for n, rows in {**free.shared, **loaded.shared}.items()
        },
        "words": _shared_words(),
        # K^X - K^B of each kind of load at M's origin, (36, 6): follower is K^A,
        # conservative K^K.
        "changes": {
            kind: LoadKind(kind).change(np.eye(6)).reshape(6, 36).T  # type: ignore[arg-type]
            for kind in LOAD_KINDS
        },
        "closing": closing,
        "no_load": no_load,
        "bending": bending,
        **_description(elastic, result),
    }
    return BrowserProgram(script, plain(data))


def _left_out(chosen: TracedModel) -> str | None:
    """What the recorded formulas of a plan leave out; None if they are complete."""
    if getattr(chosen.case, "laws", ()):
        return "its nonlinear springs have no stiffness that could be set here"
    if chosen.settles:
        return "a load bends its links"
    if chosen.untraced:
        return "some of its potentials are evaluated posture by posture"
    if getattr(chosen.case, "stretched", ()):
        return "lines between its bodies are drawn posture by posture"
    if isinstance(chosen.case, ChainCase) and chosen.case.still and chosen.case.fields:
        return "its weight bends its links"
    return None


def _link_deflection(
    chosen: TracedModel, names: tuple[str, ...]
) -> tuple[dict[str, Any] | None, str | None]:
    """Return data and programs that deflect compliant links,
    or why the browser cannot do so.
    """
    terms, case = chosen.untraced, chosen.case
    bends = chosen.settles and terms.beams and not terms.is_dense
    if not (bends and isinstance(case, ChainCase) and case.is_closed) or case.coupled:
        return None, _left_out(chosen)
    return {
        "beams": [
            {
                "label": beam.link or names[beam.indices[0, 0]],
                "segments": beam.indices.tolist(),
            }
            for beam in terms.beams
        ],
        "terms": list(Before.of(chosen, len(names)).terms),
        "last": LAST,
        "rounded": ROUNDED,
        "steps": MAX_SETTLING_STEPS,
    }, None


def _steps(chosen: TracedModel, n: int, name: str) -> str:
    """Functions of a source's steps towards n coordinates, which begin with a name."""
    before = Before.of(chosen, n)
    if name == "bent":  # the wrench may turn with the body: the page takes these steps
        before = before._replace(closing=None, settling=None)
    write = partial(javascript_function, {})
    return "\n".join(before.text("javascript", name, {"q": n}, write))


def _chain_closure(case: ChainCase, ways: list[str]) -> dict[str, Any]:
    """Return what closes a chain, one after the other, and what moves then."""
    lengths = case.constants.is_length
    return {
        "ways": ways,
        "freedoms": case.freedoms,
        "independent": list(case.independent),
        "distances": [lengths[j] for j in case.independent] or [False] * case.freedoms,
    }


def _unsupported(elastic: ElasticMechanism) -> str | None:
    """Return why the browser cannot compute this mechanism; None if it can."""
    springs, mechanism = elastic.springs, elastic.mechanism
    if mechanism.closures and mechanism.actuated is None:
        return "a closed chain whose drives have no names is assembled posture by posture"
    if mechanism.rigid:
        return "a rigid joint has no stiffness that could be set here"
    if elastic.identified is not None:
        return "intervals of measured springs come from the library"
    if springs is not None and springs.unilateral:
        return "its cables may be slack"
    if mechanism.coordinates_are_pose and mechanism.quantities():
        return "its legs have limits besides their lengths and forces"
    if springs is None:
        return "it has no springs of its own"
    return None


def _shared_words() -> dict[str, Any]:
    return {
        "rules": [
            {
                "needs": sorted(rule.needs),
                "level": rule.level,
                "code": rule.code,
                "title": VERDICTS[rule.code],
            }
            for rule in RULES
        ],
        "advice": ADVICE,
        "weights": list(WEIGHTS),
        "kinds": dict(LOAD_KINDS),
        "lengths": {
            "natural": characteristic_length(np.eye(6)).reason,
            "unit": characteristic_length(-np.eye(6)).reason,
        },
    }


def _drives(elastic: ElasticMechanism, result: PostureStiffness) -> list[dict[str, Any]]:
    """The drives of joints, legs and lines, whose forces the formulas have at their
    coordinates, with limits and words.
    """
    order = {name: i for i, name in enumerate(elastic.spring_names)}
    return [
        {
            "name": one.name,
            "is_length": one.is_length,
            "coordinate": order[one.name],
            "least": plain(one.least),
            "most": plain(one.most),
            "called": one.called,
            "unit": elastic.units.effort(one.is_length),
        }
        for one in sorted(result.forces, key=lambda one: order.get(one.name, -1))
        if one.name in order
    ]


def _description(elastic: ElasticMechanism, result: PostureStiffness) -> dict[str, Any]:
    mechanism = elastic.mechanism
    limits = Limits(mechanism)
    chart = [note for note in result.notes if note.code == "kf-undefined"]
    # What a page as a file does not compute must not stay that of this posture. It finds
    # legs of platforms, forces of joints and legs, and the stiffness in the task axes of
    # this posture.
    base = result.to_dict()
    if not mechanism.coordinates_are_pose:
        base.pop("legs", None)
    drives = _drives(elastic, result)
    if len(drives) < len(result.forces):
        base.pop("forces", None)
    described = {
        "platform": mechanism.coordinates_are_pose,
        "may_be_loaded": elastic.may_be_loaded,
        "names": list(elastic.spring_names),
        "are_lengths": mechanism.is_length.tolist(),
        "actuated": list(mechanism.actuated or ()),
        "virtual": sorted(mechanism.virtual),
        "length_unit": elastic.units.length,
        "upright": is_upright(elastic),
        "limits": {
            "names": list(limits.names),
            "columns": limits.columns.tolist(),
            "lower": plain(limits.lower.tolist()),
            "upper": plain(limits.upper.tolist()),
        },
        "notes": [note.to_dict() for note in elastic.notes],
        "drives": drives,
        "some_assumed": _some_assumed(elastic),
        "illustrative": {
            "springs": sorted(elastic.illustrative),
            "always": _always_illustrative(elastic),
        },
        "last_notes": [
            note.to_dict()
            for note in (
                *([] if elastic.gravity is None else gravity_loads(elastic).notes),
                *chart,
            )
        ],
        "base": base,
    }
    for key, is_loaded in (("rest_notes", False), ("loaded_rest_notes", True)):
        described[key] = [note.to_dict() for note in preload_notes(elastic, is_loaded)]
    described |= {"reach": result.posture.length, "doubted": _doubted(elastic)}
    if mechanism.coordinates_are_pose:
        bounds = [list(pair) for pair in mechanism.bounds.values()]
        described |= {
            "anchors": mechanism.anchors.tolist(),
            "points": mechanism.points.tolist(),
            "length": float(result.posture.length),
            "T_P_M": mechanism.frame_offset.tolist(),
            "leg_limits": bounds or None,
        }
    return described


def _some_assumed(elastic: ElasticMechanism) -> str | None:
    """The words of a note on springs of which only those named at {} are assumed."""
    for note in elastic.notes:
        if note.code == "stiffness-assumed":
            values: Any = note.values
            return assumed_stiffness(values["stiffness"], ["{}"], ["{}", ""]).message
    return None


def _always_illustrative(elastic: ElasticMechanism) -> bool:
    """Whether springs of the file remain illustrative, whichever of the page's
    are replaced.
    """
    others = len(elastic.parted_terms()[0]) > 1 or not elastic.illustrative
    return elastic.is_illustrative and others


def _doubted(elastic: ElasticMechanism) -> dict[str, Any]:
    """What `core.mechanisms.limits.deflection_notes` doubts, with units: joints that
    wind up, and tips that move, or legs that stretch by a share of their length.
    """
    springs: Any = elastic.springs
    mechanism, units = elastic.mechanism, elastic.units
    doubted = {
        "share": MAX_RELATIVE_DEFLECTION,
        "names": list(elastic.spring_names),
        "force": units.force,
        "moment": units.moment,
        "springs": [units.spring(False), units.spring(True)],
    }
    if not mechanism.coordinates_are_pose:
        undriven, reach = sorted(mechanism.undriven), mechanism.reach or 0.0
        return doubted | {"turn": MAX_WIND_UP, "undriven": undriven, "reach": reach}
    legs = np.flatnonzero(stretch_is_doubted(mechanism, springs)).tolist()
    rest_is_open = bool(np.isnan(springs.rest).any())
    return doubted | {"legs": legs, "rest_is_open": rest_is_open}
