"""Mechanisms with their springs, gravity and other potentials."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core.arrays import (
    Array,
    checked_number,
    checked_reach,
    checked_vector,
    fixed,
    named_values,
    real_array,
)
from cartstiff.core.errors import (
    InputError,
    UnknownNameError,
    check_name,
    checked_kind,
)
from cartstiff.core.lazily import cached_property
from cartstiff.core.mechanisms.contract import Mechanism, MechanismPosture
from cartstiff.core.mechanisms.given_springs import (
    in_own_units,
    rest_of_turns,
    with_values,
)
from cartstiff.core.notebook import ShownInLines, html_table
from cartstiff.core.notes import Note, still_assumed
from cartstiff.core.potentials.contract import (
    Evaluation,
    Number,
    Parts,
    Potential,
    Sums,
    evaluate_together,
    nothing,
    summed,
)
from cartstiff.core.potentials.gravity import Gravity
from cartstiff.core.potentials.springs import Springs
from cartstiff.core.units import Units, checked_gravity, engineering

if TYPE_CHECKING:
    from cartstiff.core.mechanisms.identified import Identified


@dataclass(frozen=True, eq=False, repr=False)
class ElasticMechanism(ShownInLines):
    """A mechanism and its potential energy, with a default posture.

    `==` asks for the same object: what two mechanisms answer is compared by
    `cartstiff.compare`.

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
        Dampers beside the springs: (n,) of the joints, moment (force) per rate, or (m,)
        of the lines, force per velocity; None where there are none. Seconds in all units.
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
    efforts : mapping of str to (float, float)
        Least and largest torque (force) of the drives of joints on the links that they
        move.

    Raises
    ------
    InputError
        If `mechanism` is of another kind, or `q` no array of numbers.
    """

    name: str
    mechanism: Mechanism
    q: Array
    springs: Springs | None = None
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
    efforts: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        checked_kind(
            self.mechanism,
            Mechanism,
            "mechanism",
            "a Mechanism; cartstiff.load reads one",
        )
        object.__setattr__(self, "q", fixed(real_array(self.q)))
        rigid = frozenset() if self.springs is None else self.springs.rigid
        if rigid != self.mechanism.rigid:
            object.__setattr__(self, "mechanism", self.mechanism.with_rigid(rigid))

    def _lines(self) -> list[str]:
        m = self.mechanism
        lines = [
            f"{self.name} ({m.kind}) to {m.frame}, in {m.units.force} and "
            f"{m.units.length}",
            f"  coordinates {', '.join(m.names)}",
            "  potentials  "
            f"{', '.join(type(p).__name__ for p in self._acting()) or 'none'}",
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
            own, k = self.spring_names, self.springs.stiffness.tolist()
            shown = zip(own, k, self.slides, strict=True)
            springs = [
                (f"{n} [{self.units.spring(s)}]", "rigid" if i in rigid else f"{k:.6g}")
                for i, (n, k, s) in enumerate(shown)
            ]
            tables += html_table([("stiffness of the springs", 2)], springs)
        return tables

    def _acting(self) -> list[object]:
        return [p for p in (self.springs, *self.potentials) if p is not None]

    @cached_property
    def is_illustrative(self) -> bool:
        """Whether the file says that its springs are illustrative,
        and not all were replaced.
        """
        if "illustrative" not in self.source.lower():
            return False
        if self.springs is None or len(self.parted_terms()[0]) > 1:
            return True
        return bool(self.illustrative)

    @cached_property
    def illustrative(self) -> frozenset[str]:
        """Names of the springs that the file calls illustrative,
        and that were not replaced.
        """
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
                *(name for p in found.patterns for name, _ in p.keys),
            }
        return frozenset(name for name, has_spring in sprung if has_spring) - known

    @cached_property
    def assumed_springs(self) -> frozenset[str]:
        """Names of the springs whose stiffness was assumed, as none was given."""
        return frozenset(
            name
            for note in self.notes
            if note.code == "stiffness-assumed"
            for name in note.values.get("joints", ())  # type: ignore[attr-defined]
        )

    @cached_property
    def springs_in_doubt(self) -> str:
        """Which springs nobody measured, in words for a picture; "" if there are none."""
        assumed = self.assumed_springs
        others, words = self.illustrative - assumed, "illustrative, not measured"
        found, count = list[str](), 0
        if self.springs is not None:
            count = int(np.count_nonzero(self.springs.rest_is_free(every=True)))
        for names, kind in ((assumed, "assumed"), (others, words)):
            if names:
                if len(names) < count:
                    some = f"{len(names)} of {count} springs"
                else:
                    some = "Springs"
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
        """Lower and upper limit of each joint (rad, lengths),
        or of each leg of a platform.
        """
        return self.mechanism.bounds

    @cached_property
    def force_limits(self) -> dict[str, tuple[float, float]]:
        """Least and largest torque (force) of the drives of joints, and tension of legs,
        where they are known.
        """
        legs = self.mechanism.tension_limits
        pairs = [] if legs is None else [(low, high) for low, high in legs.tolist()]
        return {**dict(zip(self.spring_names, pairs, strict=False)), **self.efforts}

    @cached_property
    def held_either_way(self) -> Array:
        """Size (m,) of a force of each of `spring_names` that its drive holds, whatever
        its sign; zero for a cable that must be taut.
        """
        none = (-np.inf, np.inf)
        pairs = [self.force_limits.get(name, none) for name in self.spring_names]
        each = [min(-low, high) for low, high in pairs]
        if not set(self.force_limits) <= set(self.spring_names):
            each = [0.0 for _ in each]
        return np.maximum(each, 0.0)

    @property
    def masses(self) -> dict[str, float]:
        """Masses [kg] of what the joints carry, by the first link,
        and of the "payload".
        """
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
        """The mechanism in another uniform field, with a note where it acts on no mass.

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
        acts = np.zeros(3) if gravity is None else gravity
        potentials = tuple(term.under_gravity(acts) for term in self.potentials)
        return replace(self, gravity=gravity, potentials=potentials, notes=tuple(notes))

    def about(self) -> dict[str, Any]:
        """For JSON: name, kind and coordinates, frames, units."""
        mechanism = self.mechanism
        about = {"name": self.name, "kind": mechanism.kind, "joints": list(self.names)}
        frames = mechanism.frames_as_dict()
        return {"mechanism": about, **frames, "units": self.units.to_dict()}

    @property
    def names_with_units(self) -> list[str]:
        """Names of the coordinates as heads of a table in their own units:
        "elbow [rad]".
        """
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
            Coordinates in joint order or by name; default the mechanism's posture.
            Coordinates that are named stay where they are if the others can close the
            mechanism; a note says which of them moved.
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
        is_own = values.tolist() == self.q.tolist()
        elastic = self if is_own else self._with_given(values, named)
        return elastic.with_notes(*mechanism.adjusted(values, posture.q, named)), posture

    def _with_given(self, values: Array, named: Sequence[int] | None) -> ElasticMechanism:
        """Limit the note on the default posture to the joints without a
        given position.
        """
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
            One number for all joints, one per joint, shape (n,), or a mapping from joint
            names for some of them; None changes nothing. A single stiffness is for the
            joints that are actuated or have a spring: passive joints stay free. A
            stiffness may be a text with its unit, such as "392 N m/arcmin".

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
        undriven = self.mechanism.undriven
        slides = dict(zip(self.spring_names, self.slides, strict=True))
        given = in_own_units(stiffness, slides, undriven, self.units)
        springs = with_values(self.springs, self.spring_names, given, rest, undriven)
        notes, identified, known = self.notes, self.identified, self.given
        if stiffness is not None:
            # Measurements do not apply to springs that are replaced.
            identified, notes = None, still_assumed(notes, stiffness)
            replaced = given if isinstance(given, Mapping) else self.spring_names
            known = known.union(replaced)
        if rest is not None and not all(self.slides):
            kept = [note for note in notes if note.code != "rest-of-turns"]
            notes = (*kept, *rest_of_turns(self.mechanism.coordinates, springs.rest))
        return replace(
            self, springs=springs, notes=notes, identified=identified, given=known
        )

    @cached_property
    def spring_names(self) -> tuple[str, ...]:
        """Names of the springs: the coordinates', or leg1, leg2, ... for lines."""
        if self.springs is None:
            return self.names
        return self.springs.names_in(self.mechanism.coordinates)

    @cached_property
    def slides(self) -> list[bool]:
        """Whether each of `spring_names` deflects by a distance."""
        coordinates, springs = self.mechanism.coordinates, self.springs
        own = [c.is_length for c in coordinates]
        return own if springs is None else springs.slides_in(coordinates)

    def labelled(self) -> list[tuple[Potential, Sequence[str]]]:
        """Return the potentials beside the springs, with the names of their parts."""
        found, count = list[tuple[Potential, Sequence[str]]](), Counter[str]()
        for term in self.potentials:
            names = term.labels(count[term.stem])
            count[term.stem] += len(names)
            found.append((term, names))
        return found

    def parts(self, posture: MechanismPosture) -> list[Parts]:
        """Return what deflects in springs and potentials, in their order."""
        every = self._named
        coordinates = self.mechanism.coordinates
        each = (term.parts(posture, coordinates, names) for term, names in every)
        return [parts for parts in each if parts is not None]

    @cached_property
    def _named(self) -> list[tuple[Potential, Sequence[str]]]:
        """Springs and potentials with the names of their parts."""
        springs = self.springs
        own = [] if springs is None else [(springs, self.spring_names)]
        return [*own, *self.labelled()]

    def numbers(self) -> dict[str, Number]:
        """Return the numbers that `with_numbers` changes, by name.

        "stiffness.SPRING", "rest.SPRING", a factor "stiffness.LINK (link)", and those of
        the mechanism: "mass.LINK", "placement.JOINT.x", "base.leg1.x"; see
        `Mechanism.numbers`.
        """
        found, springs = dict[str, Number](), self.springs
        if springs is not None:
            found |= springs.numbers(self.spring_names, self.slides)
        for term, names in self.labelled():
            found |= term.numbers(names)
        return found | self.mechanism.numbers()

    def with_numbers(self, values: Mapping[str, float]) -> ElasticMechanism:
        """The mechanism with some of `numbers` changed; other names are ignored."""
        springs, mechanism = self.springs, self.mechanism.with_numbers(values)
        if springs is not None:
            springs = springs.with_numbers(values, self.spring_names)
            if mechanism.points is not self.mechanism.points:
                springs = springs.at_points(mechanism.anchors, mechanism.points)
        terms = tuple(term.with_numbers(values, names) for term, names in self.labelled())
        return replace(self, mechanism=mechanism, springs=springs, potentials=terms)

    @cached_property
    def _deflecting(self) -> list[tuple[Potential, Sequence[str], Sequence[bool]]]:
        """Springs and potentials, with the names of what deflects in them and whether
        that is a distance.
        """
        slides = self.mechanism.is_length.tolist()
        found = list[tuple[Potential, Sequence[str], Sequence[bool]]]()
        for term, names in self._named:
            if at := term.members:
                names = [self.names[j] for j in at]
                found.append((term, names, [slides[j] for j in at]))
            else:
                own = self.slides if term is self.springs else [True] * len(names)
                found.append((term, names, own))
        return found

    @cached_property
    def compliances(self) -> dict[str, Number]:
        """The compliances that measurements find, by name; see
        `cartstiff.core.potentials.contract.Potential.compliances`.
        """
        each = (t.compliances(names, slides) for t, names, slides in self._deflecting)
        return {name: number for found in each for name, number in found.items()}

    def with_compliances(self, values: Mapping[str, float]) -> ElasticMechanism:
        """The mechanism with some of `compliances` changed; other names are ignored."""
        if not values:
            return self
        each = [
            term.with_compliances(values, names) for term, names, _ in self._deflecting
        ]
        springs = None if self.springs is None else cast(Springs, each.pop(0))
        return replace(self, springs=springs, potentials=tuple(each))

    def softened(
        self,
        key: str,
        start: MechanismPosture | None = None,
        forces: Array | None = None,
    ) -> tuple[Potential, Potential, float]:
        """`Potential.softened` of what has one of `compliances`.

        Springs have the `forces` (m,) at the start, where these are not NaN: rest
        positions that were chosen there follow.

        Raises
        ------
        InputError
            For another `key` than those of `compliances`.
        """
        check_name("compliance", key, self.compliances)
        term, names = self._owners[key]
        more, less, factor = term.softened(key, names)
        if term is self.springs and start is not None and forces is not None:
            more, less = (x.with_forces(start, forces) for x in (more, less))
        return more, less, factor

    def chosen_forces(
        self, balanced: ElasticMechanism, posture: MechanismPosture
    ) -> Array | None:
        """Forces (m,) at a posture of springs whose open rest positions were chosen
        there, in the mechanism `balanced`, NaN for the others; for `softened`.
        """
        given, chosen = self.springs, balanced.springs
        if given is None or chosen is None:
            return None
        return np.where(given.rest_is_free(), chosen.pull(posture), np.nan)

    @cached_property
    def _owners(self) -> dict[str, tuple[Potential, Sequence[str]]]:
        return {
            key: (term, names)
            for term, names, slides in self._deflecting
            for key in term.compliances(names, slides)
        }

    @property
    def commanded(self) -> list[int]:
        """Coordinates of drives: the motors of a closed chain,
        else all but those of links.

        A closed chain without named motors has those with a spring, if there are any.
        """
        mechanism, springs = self.mechanism, self.springs
        if mechanism.closures and mechanism.actuated is not None:
            return list(mechanism.actuated)
        own = [j for j in range(len(self.names)) if j not in mechanism.virtual]
        if not mechanism.closures or springs is None:
            return own
        sprung = springs.has_coordinate(len(self.names))
        return [j for j in own if sprung[j]] or own

    @property
    def stiffnesses(self) -> list[float]:
        """Stiffness of each of `spring_names`.

        Infinite for rigid joints, not used with a law.
        """
        if self.springs is None:
            own = []
        else:
            own = np.asarray(self.springs.stiffness, float).tolist()
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

        Those of M's link, for chains. What is fixed to M itself would move with it: then
        there are no others.
        """
        mechanism = self.mechanism
        return [mechanism.frame] if self.acts_on_body else mechanism.frames_of_body

    @property
    def acts_on_body(self) -> bool:
        """Whether a spring, a load or a closure is fixed to M itself."""
        every = (*self._acting(), *self.mechanism.closures)
        return any(
            getattr(one, side, "") == "body"
            for one in every
            for side in ("frame_a", "frame_b")
        )

    def with_frame(self, name: str) -> ElasticMechanism:
        """Return the mechanism with M at another frame of `frames_of_body`.

        Nothing but M moves: springs, masses, the payload and loads stay where they are.

        Raises
        ------
        UnknownNameError
            For any other name.
        """
        if name not in (known := self.frames_of_body):
            raise UnknownNameError("frame", name, known)
        notes = tuple(
            n for n in self.notes if n.code not in ("default-frame", "ambiguous-frame")
        )
        return replace(self, mechanism=self.mechanism.with_frame(name), notes=notes)

    def with_payload(
        self, mass: float, point: ArrayLike = (0.0, 0.0, 0.0)
    ) -> ElasticMechanism:
        """Return the mechanism with a point mass [kg] fixed to a point (3,) of M.

        If the mechanism has gravity, springs without a rest position carry its weight,
        too. For the deflection under it use `cartstiff.payload` as a load of
        `equilibrium`.

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

    @property
    def has_open_rest(self) -> bool:
        """Whether the rest position of a spring is to be chosen."""
        is_open = self.springs is not None and not self.springs.is_complete
        return is_open or any(term.rest_is_free().any() for term in self.coupled_springs)

    @cached_property
    def coupled_springs(self) -> tuple[Potential, ...]:
        """Springs that couple joints, in the order of the potentials."""
        return tuple(term for term in self.potentials if term.sums is not None)

    @cached_property
    def sums(self) -> tuple[Sums, ...]:
        """Sums of coordinates on which `coupled_springs` act."""
        return tuple(own for term in self.potentials if (own := term.sums) is not None)

    def at_rest(self, q: Array) -> ElasticMechanism:
        """The mechanism with all springs of its joints at rest at coordinates q (n,)."""
        springs = self.springs
        return replace(self, springs=None if springs is None else springs.at_rest(q))

    def terms(self, springs: bool = True) -> tuple[Potential, ...]:
        """Return all potentials that act, with other `springs` if these are given."""
        terms: list[Potential] = list(self.potentials)
        if springs and self.springs is not None:
            terms.insert(0, self.springs)
        if self.gravity is not None:
            terms.append(Gravity(self.gravity))
        return tuple(terms)

    @cached_property
    def may_be_loaded(self) -> bool:
        """Whether the environment may have to hold a load although none is given.

        Open rest positions are chosen so that it need not, unless a preload is to be
        held.
        """
        if self.springs is None:
            return True
        if not all(term.rest_is_free().all() for term in self.coupled_springs):
            return True
        if self.springs.holding().any():
            return True
        return bool(np.any((self.springs.stiffness > 0.0) & ~np.isnan(self.springs.rest)))

    @property
    def before_load(self) -> Literal["balanced", "given", "partly"] | None:
        """What the mechanism carries before any load, the same for every question.

        That is its own weight and the payload, of the file or of an option. Springs
        without a rest position balance both at the posture ("balanced"), as after a
        program was taught there. Rest positions that are given, and a preload that is
        held, decide themselves where it comes to rest ("given"); "partly" is both. None
        without springs.
        """
        if (
            self.springs is None
            or not (may := self.springs.rest_is_free(every=True)).any()
        ):
            return None
        free = (self.springs.rest_is_free() & ~self.springs.holding())[may]
        return "balanced" if free.all() else "partly" if free.any() else "given"

    def parted_terms(self) -> tuple[list[Potential], list[Potential]]:
        """Return the potentials of the mechanism's own parts, and gravity and loads."""
        terms = self.terms()
        inner = [term for term in terms if not term.is_external]
        return inner, [term for term in terms if term.is_external]

    def diagnostics(self, posture: MechanismPosture) -> list[Note]:
        """Return notes on limits of the answer: slack cables, corners of springs,
        bent beams.
        """
        own = [note for term in self.terms() for note in term.diagnostics(posture)]
        return [*own, *self._corners(posture.q)]

    def _corners(self, q: Array) -> list[Note]:
        """Return a note on each spring that is at a corner of its table."""
        springs, notes = self.springs, list[Note]()
        if springs is None:
            return notes
        for j, law in springs.laws.items():
            x = float(q[j] - springs.rest[j])
            if (corner := law.corner_at(x)) is None:
                continue
            c, name = self.mechanism.coordinates[j], self.spring_names[j]
            unit = self.units.length if c.is_length else "rad"
            below, above, used = (
                engineering(k, self.units.spring(c.is_length), 4)
                for k in (corner.below, corner.above, law.evaluate(x)[2])
            )
            words = (
                f"the spring of {name} is at a corner of its table, at a deflection of "
                f"{engineering(corner.deflection, unit, 4)}: its stiffness is {below} "
                "for smaller "
                f"deflections and {above} for larger ones; the answer is with {used}"
            )
            values = {"joint": name, **corner._asdict()}
            notes.append(Note("spring-corner", words, values))
        return notes

    def evaluate(self, posture: MechanismPosture, springs: bool = True) -> Evaluation:
        """Return energy, gradient and Hessian of all potentials at a posture, with other
        `springs` if these are given.
        """
        others = evaluate_together(self.terms(springs=False), posture)
        acting = [summed(others)] if others else []
        if springs and self.springs is not None:
            acting.insert(0, self.springs.evaluate(posture))
        return summed(acting or [nothing(posture.motion.jacobian.shape[1])])


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
