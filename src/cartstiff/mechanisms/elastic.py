"""Mechanisms with their springs, gravity and other potentials.

Every report takes the masses on which gravity acts from here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.arrays import (
    checked_input,
    checked_number,
    checked_reach,
    checked_vector,
    fixed,
    real_array,
)
from cartstiff.errors import InputError, UnknownNameError, checked_kind
from cartstiff.geometry.se3 import Array
from cartstiff.lazily import cached_property
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.contract import (
    EARTH,
    Mechanism,
    MechanismPosture,
    Units,
    checked_gravity,
    engineering,
    named_values,
    own_stiffness,
    rest_of_turns,
)
from cartstiff.mechanisms.identified import Identified
from cartstiff.notebook import ShownInLines, html_table
from cartstiff.notes import Note, still_assumed
from cartstiff.potentials.beams import evaluate_together
from cartstiff.potentials.contract import Evaluation, Potential
from cartstiff.potentials.coupled_joints import CoupledJointSprings, least_forces
from cartstiff.potentials.gravity import Gravity
from cartstiff.potentials.line_springs import LineSprings
from cartstiff.potentials.loads import DeadForce, Load, Scaled
from cartstiff.potentials.springs import JointSprings, TabulatedLaw


def with_values(
    springs: JointSprings | LineSprings,
    names: tuple[str, ...],
    stiffness: float | Mapping[str, float] | ArrayLike | None,
    rest: float | Mapping[str, float] | ArrayLike | None,
    undriven: frozenset[int] = frozenset(),
) -> JointSprings | LineSprings:
    """Return the springs with other stiffness and rest, see `ElasticMechanism.with_springs`.

    A single stiffness for all joints does not apply to `undriven` coordinates without a spring.
    """
    k, passive = springs.stiffness, []
    if isinstance(springs, JointSprings) and stiffness is not None:
        passive = np.flatnonzero(springs.is_passive).tolist()
        k = k.copy()
        k[list(springs.rigid)] = np.inf
        if not isinstance(stiffness, (Mapping, list, tuple)) and np.ndim(stiffness) == 0:
            undriven = undriven - set(np.flatnonzero(k).tolist()) - set(springs.laws)
            each: dict[str, Any] = {
                n: stiffness for j, n in enumerate(names) if j not in undriven
            }
            if not each:
                raise InputError(
                    "no joint is actuated or has a spring, so one stiffness is for none",
                    where="stiffness",
                    expected="name=value for the actuated joints, or their names under "
                    "'actuated' in the file",
                    got=", ".join(names),
                )
            stiffness = each
        # A number for a joint replaces its nonlinear law as well.
        named = set(stiffness) if isinstance(stiffness, Mapping) else set(names)
        laws = {j: law for j, law in springs.laws.items() if names[j] not in named}
        springs = replace(springs, laws=laws, rigid=frozenset())
    if stiffness is not None:
        k = named_values(stiffness, names, k, "stiffness", infinite=True)
        if np.any(k < 0):
            raise InputError("stiffness must not be negative", got=k.tolist())
    rests = springs.rest
    if rest is not None:
        rests = named_values(rest, names, rests, "rest")
        if isinstance(springs, LineSprings) and np.any(rests < 0.0):
            raise InputError(
                "rest length is negative",
                expected="zero or more",
                got=float(np.nanmin(rests)),
            )
        for j in springs.rigid if isinstance(springs, JointSprings) else ():
            if not isinstance(rest, Mapping) or names[j] in rest:
                raise InputError(
                    f"joint {names[j]!r} is rigid and has no rest position",
                    expected="rest positions by name, of the others",
                )
    # Joints that were passive or rigid have no rest position yet.
    rests = np.where(np.isinf(k), np.nan, rests)
    if rest is None or isinstance(rest, Mapping):
        fresh = [
            j for j in passive if 0.0 < k[j] < np.inf and names[j] not in (rest or {})
        ]
        rests[fresh] = np.nan
    return springs.replaced(k, rests)


def spring_torques(
    elastic: ElasticMechanism,
    springs: JointSprings,
    posture: MechanismPosture,
    gradient: Array,
    every: bool,
    size: float,
) -> Array:
    """Return the spring torques that balance a gradient together with closure forces.

    Closures carry the part that joints with a known torque (passive, or with a rest position) do
    not carry. A remaining part is refused if a wrench has to be balanced (`every`; `size` is that
    of its generalised forces), and left unbalanced otherwise.
    """
    chosen = springs.rest_is_free(every)
    if chosen.all():
        return gradient
    known = ~chosen
    missing = np.where(known, gradient - springs.torque(posture.q), 0.0)
    if not missing.any():
        return gradient
    if posture.closure is not None:
        sizes = posture.coordinate_lengths
        _, values, Vt = np.linalg.svd(posture.closure.jacobian * sizes)
        V, N = np.split(Vt.T, [numerics.rank(values)], axis=1)
        # The small singular values of V[known] and N[chosen] are the same: one threshold, relative
        # to the largest of N[chosen], decides on both.
        largest = [
            numerics.singular_values(m).max(initial=0.0) for m in (N[chosen], V[known])
        ]
        smallest = numerics.RANK * float(largest[0] / max(largest[1], numerics.TINY))
        forces = np.linalg.lstsq(V[known], (missing * sizes)[known], rcond=smallest)[0]
        carried = V @ forces / sizes
        gradient = gradient - carried
        missing = np.where(known, missing - carried, 0.0)
    worst = int(np.argmax(np.abs(missing)))
    size = max(size, float(np.abs(gradient).max()))
    if (
        every
        and abs(missing[worst]) > numerics.BALANCE_TOLERANCE * size + numerics.ROUNDOFF
    ):
        raise _unheld(elastic, posture, worst, float(abs(missing[worst])))
    return gradient


def _unheld(
    elastic: ElasticMechanism, posture: MechanismPosture, j: int, torque: float
) -> InputError:
    """Refusal of a wrench that needs a torque at coordinate j, where no rest can be chosen."""
    unit = elastic.units.effort(elastic.mechanism.coordinates[j].is_length)
    needed = f"but the wrench needs {engineering(torque, unit)} from it"
    others = {
        type(term).__name__
        for term in elastic.parted_terms()[0]
        if term is not elastic.springs and term.evaluate(posture).hessian[j].any()
    }
    if not others:
        return InputError(
            f"{elastic.names[j]} has no spring, {needed}",
            expected="a stiffness above zero there, or a wrench that does not load it",
        )
    words = ", ".join(sorted(others))
    return InputError(
        f"{elastic.names[j]} has no spring whose rest position could be chosen, {needed}; "
        f"the energy that acts there ({words}) keeps its own rest",
        expected="equilibrium (cartstiff equilibrium), which deflects it, or springs whose rest "
        "may be chosen: springs or coupled_springs in the file",
    )


# How the springs take the weight before any load, in words.
_BEFORE_LOAD = {
    "balanced": "before the load the springs balance it at the posture",
    "given": "before the load it acts on the springs' given rest positions",
    "partly": "before the load springs without a rest position balance it at the posture",
}


@dataclass(frozen=True)
class GravityLoads:
    """Gravity, and the masses on which it acts.

    Attributes
    ----------
    acceleration : tuple of float or None
        Acceleration of the uniform field, in F; None without gravity.
    bodies : mapping of str to float
        Mass [kg] that each joint carries, by the name of its (first) link; the payload of the
        mechanism's file under "payload". Empty without gravity.
    massless : tuple of str
        Moving links without mass, if there is gravity.
    payload, weight : float
        Mass [kg] of the payloads among the loads, and their weight, which the loads contain.
    unit : str
        The mechanism's unit of force.
    before : {"balanced", "given", "partly"} or None
        State before any load, see `ElasticMechanism.before_load`.
    """

    acceleration: tuple[float, ...] | None
    bodies: Mapping[str, float]
    massless: tuple[str, ...]
    payload: float
    weight: float
    unit: str
    before: Literal["balanced", "given", "partly"] | None = None

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON: keys "gravity", "weighed" and "before_load"."""
        parts = [{"name": name, "mass": mass} for name, mass in self.bodies.items()]
        if self.payload:
            parts.append({"name": "payload among the loads", "mass": self.payload})
        return {
            "gravity": None if self.acceleration is None else list(self.acceleration),
            "weighed": parts,
            "before_load": self.before,
        }

    @property
    def text(self) -> str:
        """One line of text for people."""
        if self.acceleration is None:
            words = "Gravity: none"
        else:
            field = ", ".join(f"{a:g}" for a in self.acceleration)
            each = ", ".join(f"{name} {mass:.6g}" for name, mass in self.bodies.items())
            total = sum(self.bodies.values())
            words = f"Gravity: ({field}) on {total:.6g} kg" + (
                f" ({each})" if each else ""
            )
            words += f"; {_BEFORE_LOAD[self.before]}" if self.before and total else ""
        if self.payload:
            words += (
                f"; load: payload of {self.payload:.6g} kg, {self.weight:.6g} {self.unit}"
            )
        return words

    @property
    def notes(self) -> list[Note]:
        """Note on links without mass, where gravity acts."""
        if not self.massless:
            return []
        words = f"gravity acts, and these have no mass: {', '.join(self.massless)}"
        return [Note("massless", words, {"links": list(self.massless)})]


def without_mass(mechanism: Mechanism, masses: Mapping[str, float]) -> tuple[str, ...]:
    """Links without mass; ends of the joints that closures and contacts have are no links."""
    parts = [c.name.rpartition(".") for c in mechanism.coordinates]
    joints = {frame for frame, _, axis in parts if axis in ("x", "y", "z")}
    return tuple(
        name for name, mass in masses.items() if not mass > 0.0 and name not in joints
    )


def gravity_loads(
    elastic: ElasticMechanism, loads: Sequence[Potential] = ()
) -> GravityLoads:
    """Return the masses on which gravity acts in a mechanism, and the payloads among its loads."""
    acting = (*elastic.potentials, *loads)
    # A load's mass, as its weight, is in the unit of force.
    hung = [load for load in acting if isinstance(load, DeadForce) and load.mass]
    payload = sum(load.mass for load in hung) * elastic.units.newtons
    weight = float(np.linalg.norm(sum((load.force for load in hung), np.zeros(3))))
    field = None if elastic.gravity is None else tuple(map(float, elastic.gravity))
    masses = {} if field is None else elastic.mechanism.masses()
    bodies = {name: mass for name, mass in masses.items() if mass > 0.0}
    massless = without_mass(elastic.mechanism, masses)
    unit = elastic.units.force
    return GravityLoads(
        field, bodies, massless, payload, weight, unit, elastic.before_load
    )


def with_default_gravity(elastic: ElasticMechanism, hung: float) -> ElasticMechanism:
    """Return the mechanism with gravity for a payload of `hung` kg that was added to it.

    Without any gravity that of the earth is assumed, along -z of F, and a note says so.
    """
    if elastic.gravity is None:
        words = f"a payload was given and no gravity: (0, 0, -{EARTH:g}) m/s^2 acts"
        note = Note("gravity-assumed", words, {"gravity": [0.0, 0.0, -EARTH]})
        elastic = elastic.with_notes(note).with_gravity()
    notes = [note for note in elastic.notes if note.code != "weightless" or not hung]
    return replace(elastic, notes=tuple(notes))


@dataclass(frozen=True, repr=False)
class ElasticMechanism(ShownInLines):
    """A mechanism and its potential energy, with a default posture.

    Attributes
    ----------
    name : str
        Name for people.
    mechanism : Mechanism
        Its coordinates and poses.
    q : ndarray (n,)
        Default posture.
    springs : JointSprings or LineSprings or None
        Springs in the joints, or in the legs of a platform.
    potentials : tuple of Potential
        Everything else that stores energy.
    gravity : ndarray (3,) or None
        Acceleration of the uniform field in F, in m/s^2 whatever the units.
    notes : tuple of Note
        Notes on what was assumed in loading.
    damping : ndarray or None
        Dampers beside the springs: (n,) of the joints, moment (force) per rate, or (m,) of the
        lines, force per velocity; None where there are none. Seconds in all units.
    identified : Identified or None
        Uncertainty of the stiffnesses, where they were measured.
    source : str
        Source of the numbers, for readers; empty where it is not known.
    given : frozenset of str
        Names of the springs whose stiffness was given in place of the file's.
    parameters : mapping of str to float
        Values of the parameters of the mechanism's file, in its units; empty without any.
    files : tuple of (str, str)
        Name and SHA-256 of everything that was read; empty for what was made in Python.
    beyond : tuple of str
        Joints of an arm that do not move the frame, in the order of its file.
    """

    name: str
    mechanism: Mechanism
    q: Array
    springs: JointSprings | LineSprings | None = None
    potentials: tuple[Potential, ...] = ()
    gravity: Array | None = None
    notes: tuple[Note, ...] = ()
    damping: Array | None = None
    identified: Identified | None = None
    source: str = ""
    given: frozenset[str] = frozenset()
    parameters: Mapping[str, float] = field(default_factory=dict)
    files: tuple[tuple[str, str], ...] = ()
    beyond: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        checked_kind(
            self.mechanism,
            Mechanism,
            "mechanism",
            "a Mechanism; cartstiff.load reads one",
        )
        object.__setattr__(self, "q", fixed(real_array(self.q)))
        rigid = (
            self.springs.rigid if isinstance(self.springs, JointSprings) else frozenset()
        )
        if rigid != self.mechanism.rigid:
            object.__setattr__(self, "mechanism", self.mechanism.with_rigid(rigid))

    def _lines(self) -> list[str]:
        m = self.mechanism
        lines = [
            f"{self.name} ({m.kind}) to {m.frame}, in {m.units.force} and {m.units.length}",
            f"  coordinates {', '.join(m.names)}",
            f"  potentials  {', '.join(type(p).__name__ for p in self._acting()) or 'none'}",
        ]
        if self.gravity is not None:
            lines.append(f"  gravity     {self.gravity.tolist()}")
        return lines

    def _tables(self) -> str:
        rows = [
            (n, f"{x:.6g}") for n, x in zip(self.names_with_units, self.q, strict=True)
        ]
        tables = html_table([("posture", 2)], rows)
        if self.springs is not None:
            rigid = self.mechanism.rigid
            slides = [c.is_length for c in self.mechanism.coordinates]
            if isinstance(self.springs, LineSprings):
                slides = [True] * len(self.spring_names)
            shown = zip(
                self.spring_names, self.springs.stiffness.tolist(), slides, strict=True
            )
            springs = [
                (f"{n} [{self.units.spring(s)}]", "rigid" if i in rigid else f"{k:.6g}")
                for i, (n, k, s) in enumerate(shown)
            ]
            tables += html_table([("stiffness of the springs", 2)], springs)
        return tables

    def _acting(self) -> list[object]:
        return [p for p in (self.springs, *self.potentials) if p is not None]

    @property
    def is_illustrative(self) -> bool:
        """Whether the file says that its springs are illustrative, and not all were replaced."""
        if "illustrative" not in self.source.lower():
            return False
        if self.springs is None or len(self.parted_terms()[0]) > 1:
            return True
        return bool(self.illustrative)

    @property
    def illustrative(self) -> frozenset[str]:
        """Names of the springs that the file calls illustrative, and that were not replaced."""
        if "illustrative" not in self.source.lower() or self.springs is None:
            return frozenset()
        sprung = zip(
            self.spring_names, self.springs.rest_is_free(every=True), strict=True
        )
        known: set[str] = set(self.given)
        if (
            found := self.identified
        ) is not None:  # a note names those that are not determined
            known |= {
                *found.undetermined,
                *(a for p in found.patterns for a, _, _ in p.entries),
            }
        return frozenset(name for name, has_spring in sprung if has_spring) - known

    @property
    def assumed_springs(self) -> frozenset[str]:
        """Names of the springs whose stiffness was assumed, as none was given."""
        return frozenset(
            name
            for note in self.notes
            if note.code == "stiffness-assumed"
            for name in note.values.get("joints", ())  # type: ignore[attr-defined]
        )

    @property
    def springs_in_doubt(self) -> str:
        """Which springs nobody measured, in words for a picture; "" if there are none."""
        assumed = self.assumed_springs
        others, words = self.illustrative - assumed, "illustrative, not measured"
        found, count = list[str](), 0
        if self.springs is not None:
            count = int(np.count_nonzero(self.springs.rest_is_free(every=True)))
        for names, kind in ((assumed, "assumed"), (others, words)):
            if names:
                some = (
                    f"{len(names)} of {count} springs"
                    if len(names) < count
                    else "Springs"
                )
                found.append(f"{some} {kind}")
        if self.is_illustrative and not self.illustrative:
            found.append(f"Springs {words}")
        return "; ".join(found)

    @property
    def units(self) -> Units:
        """Units of every number."""
        return self.mechanism.units

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        return self.mechanism.names

    @property
    def limits(self) -> dict[str, tuple[float, float]]:
        """Lower and upper limit of each joint (rad, lengths), or of each leg of a platform."""
        return self.mechanism.bounds

    @property
    def masses(self) -> dict[str, float]:
        """Masses [kg] of what the joints carry, by the first link, and of the "payload"."""
        return self.mechanism.masses()

    @property
    def frames(self) -> tuple[str, ...]:
        """Names of the frames that loads and springs can act on."""
        return self.mechanism.frames

    def with_gravity(
        self,
        acceleration: ArrayLike | None = (0.0, 0.0, -9.81),
        *,
        where: str | None = None,
    ) -> ElasticMechanism:
        """Return the mechanism in another uniform field, with a note where it acts on no mass.

        Parameters
        ----------
        acceleration : array_like (3,), optional
            In F, in m/s^2 whatever the units of the mechanism; None: no gravity.
        where : str, optional
            For messages: where it was given.

        Raises
        ------
        InputError
            For a field that is meant in other units, or too strong to be meant.
        """
        gravity = checked_gravity(acceleration, self.units, where)
        notes = [note for note in self.notes if note.code != "weightless"]
        if gravity is not None and not sum(self.masses.values()) > 0:
            words = (
                "gravity acts on no mass: no moving link has one, and there is no payload"
            )
            notes.append(Note("weightless", words, {"gravity": gravity.tolist()}))
        potentials = tuple(
            replace(
                term, force=-term.lifted * (np.zeros(3) if gravity is None else gravity)
            )
            if isinstance(term, DeadForce) and term.lifted
            else term
            for term in self.potentials
        )
        return replace(self, gravity=gravity, potentials=potentials, notes=tuple(notes))

    def about(self) -> dict[str, Any]:
        """For JSON: name, kind and coordinates, frames, units."""
        mechanism = self.mechanism
        about = {"name": self.name, "kind": mechanism.kind, "joints": list(self.names)}
        frames = mechanism.frames_as_dict()
        return {"mechanism": about, **frames, "units": self.units.to_dict()}

    @property
    def names_with_units(self) -> list[str]:
        """Names of the coordinates as heads of a table in their own units: "elbow [rad]"."""
        units = self.units
        return [
            f"{c.name} [{units.coordinate(c.is_length)}]"
            for c in self.mechanism.coordinates
        ]

    def placed(
        self, q: ArrayLike | Mapping[str, float] | None = None, what: str = "q"
    ) -> tuple[ElasticMechanism, MechanismPosture]:
        """Close the mechanism at a given posture; return it with notes, and the posture.

        Parameters
        ----------
        q : array_like (n,) or mapping, optional
            Coordinates in joint order or by name; default the mechanism's posture. Coordinates that
            are named stay where they are if the others can close the mechanism; a note says which
            of them moved.
        what : str
            Name of q in messages.

        Raises
        ------
        InputError
            For a wrong count, an unknown name, or numbers that are not finite.
        ConvergenceError
            If the mechanism cannot be closed near q.
        """
        mechanism, named = self.mechanism, None
        if isinstance(q, Mapping):
            values = named_values(q, self.names, self.q, what)
            named = [j for j, name in enumerate(self.names) if name in q]
        else:
            values = self.q if q is None else mechanism.checked(q, what)
        posture = mechanism.closed(values, named=named)
        elastic = (
            self if np.array_equal(values, self.q) else self._with_given(values, named)
        )
        return elastic.with_notes(*adjusted(mechanism, values, posture.q, named)), posture

    def _with_given(self, values: Array, named: Sequence[int] | None) -> ElasticMechanism:
        """Limit the note on the default posture to the joints without a given position."""
        if not any(note.code == "default-posture" for note in self.notes):
            return self
        notes = [note for note in self.notes if note.code != "default-posture"]
        taken = (
            {} if named is None else dict(zip(self.names, values.tolist(), strict=True))
        )
        for j in named or ():
            del taken[self.names[j]]
        if taken:
            shown = ", ".join(f"{name} {x:.4g}" for name, x in taken.items())
            words = (
                "no position was given for some joints: "
                f"the default posture's are taken, {shown}"
            )
            notes.append(
                Note("default-posture", words, {"q": values.tolist(), "taken": taken})
            )
        return replace(self, notes=tuple(notes))

    def with_springs(
        self,
        stiffness: float | str | Mapping[str, float | str] | ArrayLike | None = None,
        rest: float | Mapping[str, float] | ArrayLike | None = None,
    ) -> ElasticMechanism:
        """Return the mechanism with other joint springs.

        Parameters
        ----------
        stiffness, rest
            One number for all joints, one per joint, or a mapping from joint names for some of
            them; None changes nothing. A single stiffness is for the joints that are actuated or
            have a spring: passive joints stay free. A stiffness may be a text with its unit, such
            as "392 N m/arcmin".

        Raises
        ------
        InputError
            If the mechanism has no joint springs, or for bad values.
        """
        if stiffness is None and rest is None:
            return self
        if self.springs is None:
            raise InputError(
                f"{self.name} has no joint springs",
                expected="legs or line springs in its file",
            )
        undriven, given = self.mechanism.undriven, self._own_stiffness(stiffness)
        springs = with_values(self.springs, self.spring_names, given, rest, undriven)
        notes = self.notes if stiffness is None else still_assumed(self.notes, stiffness)
        if rest is not None and isinstance(springs, JointSprings):
            kept = [note for note in notes if note.code != "rest-of-turns"]
            notes = (*kept, *rest_of_turns(self.mechanism.coordinates, springs.rest))
        if (
            stiffness is not None
        ):  # measurements do not apply to springs that are replaced
            replaced = given if isinstance(given, Mapping) else self.spring_names
            return replace(
                self,
                springs=springs,
                notes=notes,
                identified=None,
                given=self.given.union(replaced),
            )
        return replace(self, springs=springs, notes=notes)

    def _own_stiffness(self, given: Any) -> Any:
        """Stiffnesses, some with units, as numbers in the mechanism's own units."""
        slides = dict.fromkeys(self.spring_names, True)
        if not isinstance(self.springs, LineSprings):
            slides = {c.name: c.is_length for c in self.mechanism.coordinates}
        if isinstance(given, Mapping):
            return {
                n: own_stiffness(
                    k, self.units, slides.get(n, False), f"stiffness of {n!r}"
                )
                for n, k in given.items()
            }
        if isinstance(given, (list, tuple)) and len(given) == len(slides):
            return [
                own_stiffness(k, self.units, s, f"stiffness of {n!r}")
                for k, (n, s) in zip(given, slides.items(), strict=True)
            ]
        driven = {
            s for j, s in enumerate(slides.values()) if j not in self.mechanism.undriven
        }
        plain = given
        for is_length in driven or set(slides.values()):
            plain = own_stiffness(
                given, self.units, is_length, "stiffness of every joint"
            )
        return plain

    @property
    def spring_names(self) -> tuple[str, ...]:
        """Names of the springs: the coordinates', or leg1, leg2, ... for lines."""
        if isinstance(self.springs, LineSprings):
            return tuple(f"leg{i + 1}" for i in range(len(self.springs.stiffness)))
        return self.names

    @property
    def commanded(self) -> list[int]:
        """Coordinates of drives: the motors of a closed chain, else all but those of links.

        A closed chain without named motors has those with a spring, if there are any.
        """
        mechanism, springs = self.mechanism, self.springs
        if mechanism.closures and mechanism.actuated is not None:
            return list(mechanism.actuated)
        own = [j for j in range(len(self.names)) if j not in mechanism.virtual]
        if not mechanism.closures or not isinstance(springs, JointSprings):
            return own
        return [j for j in own if not springs.is_passive[j]] or own

    @property
    def stiffnesses(self) -> list[float]:
        """Stiffness of each of `spring_names`; infinite for rigid joints, not used with a law."""
        own = (
            []
            if self.springs is None
            else np.asarray(self.springs.stiffness, float).tolist()
        )
        return [np.inf if j in self.mechanism.rigid else k for j, k in enumerate(own)]

    def with_potential(self, *potentials: Potential) -> ElasticMechanism:
        """Return the mechanism with more potentials."""
        return replace(self, potentials=(*self.potentials, *potentials))

    def with_notes(self, *notes: Note) -> ElasticMechanism:
        """Return the mechanism with more notes."""
        return replace(self, notes=(*self.notes, *notes)) if notes else self

    @property
    def frames_of_body(self) -> list[str]:
        """Names of the frames that may take the place of M, the present one among them.

        Those of M's link, for chains. A spring or a load that is fixed to M itself would move with
        it: then there are no others.
        """
        mechanism = self.mechanism
        fixed_to = {
            getattr(p, side, "")
            for p in self._acting()
            for side in ("frame_a", "frame_b")
        }
        if isinstance(mechanism, Chain) and mechanism.kind in ("serial", "closed-chain"):
            fixed_to |= {
                frame for c in mechanism.closures for frame in (c.frame_a, c.frame_b)
            }
            if "body" not in fixed_to:
                return mechanism.frames_of_body
        return [mechanism.frame]

    def with_frame(self, name: str) -> ElasticMechanism:
        """Return the mechanism with M at another frame of `frames_of_body`.

        Nothing but M moves: springs, masses, the payload and loads stay where they are.

        Raises
        ------
        UnknownNameError
            For any other name.
        """
        if name not in (known := self.frames_of_body) or not isinstance(
            self.mechanism, Chain
        ):
            raise UnknownNameError("frame", name, known)
        notes = tuple(
            n for n in self.notes if n.code not in ("default-frame", "ambiguous-frame")
        )
        return replace(self, mechanism=self.mechanism.with_frame(name), notes=notes)

    def with_payload(
        self, mass: float, point: ArrayLike = (0.0, 0.0, 0.0)
    ) -> ElasticMechanism:
        """Return the mechanism with a point mass [kg] fixed to a point (3,) of M.

        If the mechanism has gravity, springs without a rest position carry its weight, too. For
        the deflection under it use `cartstiff.payload` as a load of `equilibrium`.

        Raises
        ------
        InputError
            For a negative mass or a point that is not three finite numbers.
        """
        mass = checked_number(mass, "payload mass")
        if mass < 0.0:
            raise InputError(
                "payload mass cannot be used", expected="a number from zero", got=mass
            )
        centre = checked_vector(point, 3, "mass centre")
        checked_reach(centre, "mass centre")
        notes = tuple(
            note for note in self.notes if note.code != "weightless" or not mass
        )
        return replace(
            self, mechanism=self.mechanism.with_mass(mass, centre), notes=notes
        )

    def with_rest_balancing(
        self, at: ArrayLike | MechanismPosture, wrench: ArrayLike | None = None
    ) -> ElasticMechanism:
        """Choose open rest positions so that a posture is an equilibrium.

        Without `wrench`, springs that have no rest position carry gravity and the other
        potentials, and the end-effector is unloaded. With it, all rest positions are chosen so
        that the springs balance it.
        """
        if not self.has_open_rest and wrench is None:
            return self
        posture = at if isinstance(at, MechanismPosture) else self.mechanism.at(at)
        load = None if wrench is None else checked_input(wrench, (6,), "wrench")
        elastic = self._with_coupled_balancing(posture, load)
        springs, _ = elastic._balanced_springs(
            posture, load, elastic._evaluate_others(posture)
        )
        return (
            elastic if springs is elastic.springs else replace(elastic, springs=springs)
        )

    @property
    def has_open_rest(self) -> bool:
        """Whether the rest position of a spring is to be chosen."""
        is_open = self.springs is not None and not self.springs.is_complete
        return is_open or any(term.rest_is_free().any() for term in self.coupled_springs)

    @cached_property
    def coupled_springs(self) -> tuple[CoupledJointSprings, ...]:
        """Springs that couple joints, in the order of the potentials."""
        return tuple(
            term for term in self.potentials if isinstance(term, CoupledJointSprings)
        )

    def _with_coupled_balancing(
        self, posture: MechanismPosture, wrench: Array | None
    ) -> ElasticMechanism:
        """Choose the rest positions of springs that couple joints, as `with_rest_balancing`."""
        every = wrench is not None
        if not any(term.rest_is_free(every).any() for term in self.coupled_springs):
            return self
        J, sizes = posture.motion.jacobian, posture.coordinate_lengths
        wanted = np.zeros(J.shape[1]) if wrench is None else J.T.dot(wrench)
        rest = [
            term for term in self.terms(springs=False) if term not in self.coupled_springs
        ]
        parts = evaluate_together(rest, posture)
        own = np.zeros(len(wanted))
        if isinstance(self.springs, JointSprings):
            chosen = self.springs.rest_is_free(every)
            k = np.diag(self.springs.evaluate(posture).hessian)
            own = np.where(chosen, np.where(k > 0.0, k, 1.0), 0.0)
            wanted = wanted - np.where(chosen, 0.0, self.springs.torque(posture.q))
        wanted = wanted - sum((part.gradient for part in parts), np.zeros(len(wanted)))
        free = [term.rest_is_free(every) for term in self.coupled_springs]
        for term, is_free in zip(self.coupled_springs, free, strict=True):
            x = term.factors @ posture.q - term.rest
            wanted = wanted - term.factors.T @ np.where(is_free, 0.0, term.stiffness * x)
        pairs = list(zip(self.coupled_springs, free, strict=True))
        closure = posture.closure
        forces = least_forces(
            np.concatenate([term.factors[is_free] for term, is_free in pairs]),
            np.concatenate([term.stiffness[is_free] for term, is_free in pairs]),
            wanted,
            own,
            np.zeros((len(wanted), 0)) if closure is None else closure.jacobian.T,
            sizes,
        )
        potentials, start = list(self.potentials), 0
        for term, is_free in pairs:
            each = np.full(len(is_free), np.nan)
            each[is_free] = forces[start : start + is_free.sum()]
            start += int(is_free.sum())
            potentials[potentials.index(term)] = term.with_forces(posture, each)
        return replace(self, potentials=tuple(potentials))

    def at_rest(self, q: Array) -> ElasticMechanism:
        """Return the mechanism with all springs of its joints at rest at coordinates q (n,)."""
        springs = self.springs
        if isinstance(springs, JointSprings):
            springs = replace(springs, rest=q)
        return replace(self, springs=springs)

    def _balanced_springs(
        self, posture: MechanismPosture, wrench: Array | None, others: Evaluation | None
    ) -> tuple[JointSprings | LineSprings | None, Array | None]:
        """Springs that carry the other potentials and, if there is one, a wrench.

        Also the torques (n,) that the springs of joints must have, NaN where these are not chosen.
        """
        springs, every = self.springs, wrench is not None
        if springs is None or (springs.is_complete and not every):
            return springs, None
        J = posture.motion.jacobian
        carried = np.zeros(J.shape[1]) if wrench is None else J.T.dot(wrench)
        gradient = carried if others is None else carried - others.gradient
        if not isinstance(springs, JointSprings):
            return springs.with_rest_balancing(posture, gradient, every=every), None
        exerted = gradient
        if not springs.rest_is_free(every).all():
            size = float(np.abs(carried).max(initial=0.0))
            gradient = spring_torques(self, springs, posture, gradient, every, size)
            exerted = np.where(springs.rest_is_free(every), gradient, np.nan)
        return springs.with_rest_balancing(posture, gradient, every=every), exerted

    def _balanced_with_evaluation(
        self, posture: MechanismPosture, wrench: Array | None
    ) -> tuple[ElasticMechanism, Evaluation]:
        """`with_rest_balancing` and its `evaluate`; the other potentials are evaluated once."""
        elastic = self._with_coupled_balancing(posture, wrench)
        others = elastic._evaluate_others(posture)
        springs, exerted = elastic._balanced_springs(posture, wrench, others)
        elastic = (
            elastic if springs is elastic.springs else replace(elastic, springs=springs)
        )
        if exerted is None or springs is None:
            return elastic, elastic._with_springs_added(posture, others)
        # The chosen torque is exact; computed from a stiff spring's rest position it is rounded.
        energy, torque, hessian = springs.evaluate(posture)
        own = Evaluation(energy, np.where(exerted == exerted, exerted, torque), hessian)
        return elastic, own if others is None else _sum(own, others)

    def terms(self, springs: bool = True) -> tuple[Potential, ...]:
        """Return all potentials that act."""
        terms: list[Potential] = list(self.potentials)
        if springs and self.springs is not None:
            terms.insert(0, self.springs)
        if self.gravity is not None:
            terms.append(Gravity(self.gravity))
        return tuple(terms)

    @cached_property
    def may_be_loaded(self) -> bool:
        """Whether the environment may have to hold a load although none is given.

        Open rest positions are chosen so that it need not, unless a preload is to be held.
        """
        if self.springs is None:
            return True
        if not all(term.rest_is_free().all() for term in self.coupled_springs):
            return True
        if isinstance(self.springs, LineSprings) and self.springs.holding().any():
            return True
        return bool(np.any((self.springs.stiffness > 0.0) & ~np.isnan(self.springs.rest)))

    @property
    def before_load(self) -> Literal["balanced", "given", "partly"] | None:
        """What the mechanism carries before any load, the same for every question.

        That is its own weight and the payload, of the file or of an option. Springs without a rest
        position balance both at the posture ("balanced"), as after a program was taught there. Rest
        positions that are given, and a preload that is held, decide themselves where it comes to
        rest ("given"); "partly" is both. None without springs.
        """
        if (
            self.springs is None
            or not (may := self.springs.rest_is_free(every=True)).any()
        ):
            return None
        free = self.springs.rest_is_free()
        if isinstance(self.springs, LineSprings):
            free &= ~self.springs.holding()
        free = free[may]
        return "balanced" if free.all() else "partly" if free.any() else "given"

    def parted_terms(self) -> tuple[list[Potential], list[Potential]]:
        """Return the potentials of the mechanism's own parts, and gravity and loads."""
        terms = self.terms()
        inner = [term for term in terms if not _is_external(term)]
        return inner, [term for term in terms if _is_external(term)]

    def diagnostics(self, posture: MechanismPosture) -> list[Note]:
        """Return notes on limits of the answer: slack cables, corners of springs, bent beams."""
        own = [note for term in self.terms() for note in term.diagnostics(posture)]
        return [*own, *self._corners(posture.q)]

    def _corners(self, q: Array) -> list[Note]:
        """Return a note on each spring that is at a corner of its table."""
        springs, notes = self.springs, list[Note]()
        if not isinstance(springs, JointSprings):
            return notes
        for j, law in springs.laws.items():
            x = float(q[j] - springs.rest[j])
            if not isinstance(law, TabulatedLaw) or (corner := law.corner_at(x)) is None:
                continue
            c, name = self.mechanism.coordinates[j], self.spring_names[j]
            unit = self.units.length if c.is_length else "rad"
            below, above, used = (
                engineering(k, self.units.spring(c.is_length), 4)
                for k in (corner.below, corner.above, law.evaluate(x)[2])
            )
            words = (
                f"the spring of {name} is at a corner of its table, at a deflection of "
                f"{engineering(corner.deflection, unit, 4)}: its stiffness is {below} for smaller "
                f"deflections and {above} for larger ones; the answer is with {used}"
            )
            values = {"joint": name, **corner._asdict()}
            notes.append(Note("spring-corner", words, values))
        return notes

    def evaluate(self, posture: MechanismPosture) -> Evaluation:
        """Return energy, gradient and Hessian of all potentials at a posture."""
        return self._with_springs_added(posture, self._evaluate_others(posture))

    def _evaluate_others(self, posture: MechanismPosture) -> Evaluation | None:
        """Sum of all potentials but the springs; None without any."""
        terms = self.terms(springs=False)
        return reduce(_sum, evaluate_together(terms, posture)) if terms else None

    def line_springs_and_rest(
        self, posture: MechanismPosture
    ) -> tuple[Array, Array, Array] | None:
        """Return lines g (m, 6) from ground to body, their k (m,), and the rest of the Hessian.

        None where the coordinates are not the body's pose, or no lines hold it.
        """
        if not posture.coordinates_are_pose:
            return None
        lines, k, rest = list[Array](), list[Array](), np.zeros((6, 6))
        for term in self.terms():
            held = type(term) is LineSprings and (term.frame_a, term.frame_b)
            if isinstance(term, LineSprings) and held == ("world", "body"):
                g, stiffness, turning = term.lines_and_rest(posture)
                lines.append(g)
                k.append(stiffness)
                rest = rest + turning
            else:
                rest = rest + term.evaluate(posture).hessian
        return (np.concatenate(lines), np.concatenate(k), rest) if lines else None

    def _with_springs_added(
        self, posture: MechanismPosture, others: Evaluation | None
    ) -> Evaluation:
        if self.springs is not None:
            own = self.springs.evaluate(posture)
            return own if others is None else _sum(own, others)
        if others is not None:
            return others
        n = posture.motion.jacobian.shape[1]
        return Evaluation(0.0, np.zeros(n), np.zeros((n, n)))


def adjusted(
    mechanism: Mechanism, given: Array, q: Array, named: Sequence[int] | None = None
) -> tuple[Note, ...]:
    """Return a note on coordinates that closures moved from given values (n,) to q (n,).

    Only coordinates that were named or are actuated are considered; without any, those that differ
    from the mechanism's reference posture.
    """
    if not isinstance(mechanism, Chain) or not mechanism.closures:
        return ()
    meant = set(mechanism.actuated or ()) | set(named or ())
    if mechanism.actuated is None and named is None and mechanism.home is not None:
        meant = set(np.flatnonzero(given != mechanism.home.q).tolist())
    moved = [
        (
            c.name,
            float(given[j]),
            float(q[j]),
            mechanism.units.length if c.is_length else "rad",
        )
        for j, c in enumerate(mechanism.coordinates)
        if j in meant and abs(q[j] - given[j]) > numerics.NEGLIGIBLE_DIFFERENCE
    ]
    if not moved:
        return ()
    words = ", ".join(f"{name} {a:g} -> {b:g} {unit}" for name, a, b, unit in moved)
    return (
        Note(
            "actuators-adjusted",
            f"the chain does not close with its joints as given, and they moved: {words}",
            {name: b - a for name, a, b, _ in moved},
        ),
    )


def checked_elastic(source: object) -> ElasticMechanism:
    """Return an elastic mechanism itself; refuse names and models, with what to do."""
    if isinstance(source, ElasticMechanism):
        return source
    shown = repr(source) if isinstance(source, (str, Path)) else "a name, file or model"
    raise InputError(
        "not a mechanism with springs",
        expected=f"cartstiff.load({shown})",
        got=type(source).__name__,
    )


def _is_external(term: Potential) -> bool:
    """Whether a potential is that of gravity or of a load."""
    while isinstance(term, Scaled):
        term = term.potential
    return isinstance(term, Gravity | Load)


def _sum(a: Evaluation, b: Evaluation) -> Evaluation:
    return Evaluation(a.energy + b.energy, a.gradient + b.gradient, a.hessian + b.hessian)
