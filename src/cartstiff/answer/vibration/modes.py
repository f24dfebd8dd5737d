"""Natural frequencies and modes of small undamped motions about a rest state,
under its load.

On the motions that keep the closures

    K_q phi = omega^2 M phi,    phi^T M phi = 1

is the textbook equation of small motions. K_q is the second derivative of all energies
with the load's part, the matrix that decides the stability of `cartstiff.equilibrium`,
and M the mass matrix. A load changes the frequencies as it changes the stiffness: modes
belong to one load, which every result names.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.answer.analysis.screws import Screw, screw_of_twist
from cartstiff.core import numerics
from cartstiff.core.arrays import Array, Result, checked_input, fixed, plain
from cartstiff.core.checked_call import checked
from cartstiff.core.described import described
from cartstiff.core.errors import InputError, UndefinedError, checked_kind
from cartstiff.core.figures import new_axes
from cartstiff.core.mechanisms.chain import Chain
from cartstiff.core.mechanisms.contract import MechanismPosture
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.mechanisms.gravity_loads import without_mass
from cartstiff.core.mechanisms.platform import Platform
from cartstiff.core.notes import Note
from cartstiff.core.potentials.beams import Beam
from cartstiff.core.results import LabelledResult
from cartstiff.core.statics.rest import Equilibrium
from cartstiff.core.statics.small_motions import Spectrum, kinetic_matrix, spectrum_of
from cartstiff.core.stiffness.applied_load import (
    Axes,
    Behaviour,
    LoadKind,
    checked_load,
    wrench_in_body,
)
from cartstiff.core.stiffness.balance import with_rest_balancing
from cartstiff.core.stiffness.compute import PostureStiffness, analyse
from cartstiff.core.stiffness.tensor import codes_of
from cartstiff.core.units import LENGTHS

# Bounds of the mass [kg] over the cube of the summed lengths of the links [m]. Robot arms
# are between 1 and 200, a solid block of steel is 7850; beyond these bounds a unit is
# mistaken (grams, millimetres).
_MAX_DENSITY, _MIN_DENSITY = 2000.0, 0.01


def masses_that_move(elastic: ElasticMechanism) -> dict[str, float]:
    """The masses [kg] of links, payload, legs, and payloads among the loads, by name."""
    masses = {
        name: mass for name, mass in elastic.mechanism.masses().items() if mass > 0.0
    }
    hung = sum(own.mass for p in elastic.potentials if (own := p.dead) is not None)
    if hung > 0.0:
        masses["payload among the loads"] = hung * elastic.units.newtons
    return masses


def notes_on_masses(elastic: ElasticMechanism) -> Iterator[Note]:
    """Notes on missing and implausible masses, with names and numbers."""
    mechanism = elastic.mechanism
    if isinstance(mechanism, Platform):
        if mechanism.struts is None:
            words = "the legs have no mass (legs.mass): real frequencies are lower"
            yield Note("massless-struts", words, {"legs": len(mechanism.points)})
        if mechanism.mass > 0.0 and not np.diag(mechanism.body_inertia)[:3].any():
            words = (
                f"{mechanism.frame} is a point mass of {mechanism.mass:g} kg "
                "without "
                "inertia"
            )
            yield Note("inertia-missing", words, {"links": [mechanism.frame]})
    if not isinstance(mechanism, Chain):
        return
    model = mechanism.tree.model
    links = mechanism.tree.links()
    bodies = {links[j]: model.inertias[j] for j in sorted(links)}
    bare = list(
        without_mass(mechanism, {name: body.mass for name, body in bodies.items()})
    )
    if bare:
        words = f"these links move and have no mass: {', '.join(bare)}"
        yield Note("massless-links", words, {"links": bare})
    points = [
        name
        for name, body in bodies.items()
        if body.mass > 0.0 and not np.any(body.inertia)
    ]
    if points:
        words = (
            "these links are point masses, without moments of inertia: "
            f"{', '.join(points)}"
        )
        yield Note("inertia-missing", words, {"links": points})
    for potential in elastic.potentials:
        if isinstance(potential, Beam):
            yield _beam_note(potential)
    yield from _implausible_masses(mechanism, bodies, LENGTHS[elastic.units.length])


def _beam_note(beam: Beam) -> Note:
    values = {"link": beam.link, "mass": beam.mass, "segments": len(beam.indices)}
    if beam.mass > 0.0:
        words = (
            f"the beam {beam.link!r} has its {beam.mass:.4g} kg lumped as rigid half "
            "segments at "
            f"the nodes of {len(beam.indices)} segment(s): the error of a frequency goes "
            "with the "
            "square of a segment's length"
        )
        return Note("beam-lumped", words, values)
    words = (
        f"the beam {beam.link!r} has no mass of its own (density): the mass of its link "
        "sits "
        "rigidly at its near end"
    )
    return Note("beam-massless", words, values)


def _implausible_masses(
    chain: Chain, bodies: dict[str, Any], metres: float
) -> Iterator[Note]:
    """Notes on masses and inertias that no such machine has.

    `metres` is its unit of length.
    """
    model = chain.tree.model
    # Mass of the whole robot against its size.
    steps = [numerics.norm(T.translation) for T in list(model.jointPlacements)[1:]]
    size = metres * (sum(steps) + numerics.norm(chain.body.T_j_f[:3, 3]))
    total = sum(float(body.mass) for body in list(model.inertias)[1:])
    if not (size > 0.0 and total > 0.0):
        return
    if not _MIN_DENSITY < total / size**3 < _MAX_DENSITY:
        words = (
            f"{total:.4g} kg on links of {size:.4g} m in all are implausible: robots "
            "carry 1 to "
            "200 kg per cubic metre of that length (grams, or millimetres, in the file?)"
        )
        heavy = max(bodies, key=lambda name: bodies[name].mass)
        values = {"mass": total, "length": size, "heaviest": heavy}
        yield Note("implausible-mass", words, values)
    # Inertias that no body of that mass and size has.
    for name, body in bodies.items():
        mass = float(body.mass)
        if not mass > 0.0:
            continue
        moments = np.linalg.eigvalsh(np.array(body.inertia))
        values = {"link": name, "mass": mass, "moments": moments.tolist()}
        radius = metres * float(np.sqrt(max(moments[2], 0.0) / mass))
        if radius > size:
            words = (
                f"the inertia of {name!r} belongs to a body of {radius:.4g} m, larger "
                "than the "
                f"robot's {size:.4g} m"
            )
            yield Note("inertia-absurd", words, values)
        elif (
            moments[0] < 0.0
            or moments[0] + moments[1] < (1 - numerics.NEGLIGIBLE_DISTANCE) * moments[2]
        ):
            words = (
                f"no body has the moments of inertia of {name!r}: one is negative or "
                "larger than "
                "the other two together"
            )
            yield Note("inertia-absurd", words, values)


def notes_on_states(
    squares: Array,
    shapes: Array,
    groups: Sequence[Sequence[int]],
    basis: Array,
    spectrum: Spectrum,
) -> Iterator[Note]:
    """Notes on free, unstable, repeated and massless motions.

    Parameters
    ----------
    squares : ndarray (k,)
        omega^2 in 1/s^2.
    shapes : ndarray (n, k)
        Coordinate rates of the modes.
    groups : sequence of sequences of int
        Numbers of the modes, those with one frequency together.
    basis : ndarray (n, f)
        Basis of the spectrum's motions.
    spectrum : Spectrum
        The solutions.
    """
    # Motions by the sign of their squared frequencies: free, fluttering, leaving.
    zero = np.flatnonzero(squares == 0.0)
    if zero.size:
        words = f"{zero.size} motion(s) cost no energy: free motions, of frequency 0"
        values = {"modes": (zero + 1).tolist(), "shapes": shapes[:, zero].real.T.tolist()}
        yield Note("free-motion", words, values)
    if np.iscomplexobj(squares):
        pairs = np.flatnonzero(np.abs(squares.imag) > 0.0)
        words = (
            "motions meet and grow as they swing (flutter): the rest state is unstable"
        )
        swing = np.sqrt(squares[pairs]).real / (2 * np.pi)
        values = {"modes": (pairs + 1).tolist(), "frequencies": swing.tolist()}
        yield Note("flutter", words, values)
    negative = np.flatnonzero((squares.real < 0.0) & (np.abs(squares.imag) == 0.0))
    if negative.size:
        words = "the rest state is unstable: the mechanism leaves it along these motions"
        values = {
            "modes": (negative + 1).tolist(),
            "growth": np.sqrt(-squares.real[negative]).tolist(),
            "shapes": shapes[:, negative].real.T.tolist(),
        }
        yield Note("unstable", words, values)
    # Equal frequencies: single shapes of the group mean nothing.
    for group in groups:
        if len(group) > 1 and squares[group[0]] != 0.0:
            numbers = ", ".join(str(i + 1) for i in group)
            words = (
                f"modes {numbers} have one frequency: they are a subspace, and any "
                "motion in "
                "it is a mode"
            )
            yield Note("repeated-modes", words, {"modes": [i + 1 for i in group]})
    # Motions that have no frequency, since they have no mass.
    if spectrum.following.shape[1]:
        words = (
            f"{spectrum.following.shape[1]} motion(s) have stiffness and no mass: they "
            "follow the "
            "others at once and have no frequency of their own"
        )
        values = {"shapes": (basis @ spectrum.following).T.tolist()}
        yield Note("massless-motion", words, values)
    if spectrum.loose.shape[1]:
        words = (
            f"{spectrum.loose.shape[1]} motion(s) have neither mass nor stiffness: "
            "nothing says "
            "how they move, and they are left out"
        )
        values = {"shapes": (basis @ spectrum.loose).T.tolist()}
        yield Note("massless-free-motion", words, values)


@dataclass(frozen=True, eq=False, repr=False)
class Modes(Result, LabelledResult):
    """Small vibrations about a rest state.

    Attributes
    ----------
    elastic : ElasticMechanism
        The mechanism with the rest positions that were used.
    posture : MechanismPosture
        Posture of the rest state.
    basis : ndarray (n, f)
        Motions that satisfy the constraints, as coordinate rates; spectrum and matrices
        are in this basis.
    stiffness, mass : ndarray (f, f)
        K and M on the basis.
    spectrum : Spectrum
        Solutions of the eigenvalue problem, in the mechanism's units.
    state : Equilibrium or None
        The equilibrium, for modes of a mechanism that came to rest by itself.
    """

    command: ClassVar = "modes"

    elastic: ElasticMechanism
    posture: MechanismPosture
    basis: Array
    stiffness: Array
    mass: Array
    spectrum: Spectrum
    _held: PostureStiffness | Callable[[], PostureStiffness] | None = None
    state: Equilibrium | None = None

    def _lines(self) -> list[str]:
        shown = ", ".join(
            "unstable" if f is None else f"{f:.4g}" for f in plain(self.frequencies)
        )
        return [
            f"Modes of {self.elastic.name} at {self.elastic.mechanism.frame}, "
            f"{self.load['words']}",
            f"  frequencies  {shown} Hz",
            f"  notes        {codes_of(self.notes)}",
        ]

    def plot(self, ax: Any = None) -> Any:
        """Draw the natural frequencies of the modes.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Whose place the picture takes; default a figure of its own.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        MissingDependencyError
            Without matplotlib.
        """
        figure, axes = new_axes(self.elastic.springs_in_doubt, ax=ax)
        axes.barh(range(1, len(self.frequencies) + 1), self.frequencies)
        axes.set(xlabel="natural frequency [Hz]", ylabel="mode", title=self.elastic.name)
        axes.locator_params(axis="y", integer=True)
        axes.invert_yaxis()
        return figure

    @cached_property
    def result(self) -> PostureStiffness | None:
        """Analysis of a held posture; None for an equilibrium."""
        return self._held() if callable(self._held) else self._held

    @property
    def held(self) -> PostureStiffness:
        """`result` of a held posture; raises UndefinedError for an equilibrium."""
        if self.result is None:
            raise UndefinedError(
                "the modes are those of no held posture", code="no-posture"
            )
        return self.result

    @cached_property
    def _load_with_notes(self) -> tuple[Mapping[str, Any], tuple[Note, ...]]:
        """Load and notes of the rest state, computed when first used."""
        if self.result is None:
            return _load_at_rest(self.state)
        return _load_of_posture(self.result)

    @property
    def load(self) -> Mapping[str, Any]:
        """The load: kind, point, wrench in the body frame, and words."""
        return self._load_with_notes[0]

    # -- frequencies and shapes
    # -------------------------------------------------------------

    @property
    def q(self) -> Array:
        """Coordinates (n,) of the rest state."""
        return self.posture.q

    @cached_property
    def squares(self) -> Array:
        """omega^2 (k,) [1/s^2] by increasing real part.

        Complex where motions flutter.
        """
        return fixed(
            self.spectrum.squares / self.elastic.units.kilogram
        )  # F L over kg L^2

    @cached_property
    def frequencies(self) -> Array:
        """Frequencies in Hz (k,); 0 for a motion without stiffness,
        NaN for one that grows.
        """
        squares = self.squares
        with np.errstate(invalid="ignore"):
            if np.iscomplexobj(squares):
                return fixed(
                    np.where(np.abs(squares.imag) > 0.0, np.nan, np.sqrt(squares.real))
                    / (2 * np.pi)
                )
            return fixed(np.sqrt(squares) / (2 * np.pi))

    @cached_property
    def shapes(self) -> Array:
        """Coordinate rates (n, k) of the modes, as columns; ``phi^T M phi = 1``."""
        vectors = self.basis @ self.spectrum.vectors
        if np.iscomplexobj(vectors):
            return vectors
        largest = np.argmax(np.abs(vectors) / self._sizes[:, None], axis=0)
        return fixed(
            vectors * np.where(np.take_along_axis(vectors, largest[None], 0) < 0, -1, 1)
        )

    @cached_property
    def twists(self) -> Array:
        """Body twists (6, k) of M, (angular, linear), of the shapes."""
        return self.posture.motion.jacobian @ self.shapes

    @cached_property
    def _sizes(self) -> Array:
        return self.posture.coordinate_lengths

    @cached_property
    def groups(self) -> list[list[int]]:
        """Numbers (from 0) of the modes, those with the same frequency together."""
        squares = self.squares
        size = numerics.largest(squares)
        groups: list[list[int]] = []
        for i, x in enumerate(squares):
            near = numerics.REPEATED_FREQUENCY * abs(x) + numerics.ZERO_SHARE * size
            if groups and abs(x - squares[groups[-1][-1]]) <= near:
                groups[-1].append(i)
            else:
                groups.append([i])
        return groups

    @cached_property
    def nodal_axes(self) -> list[Screw]:
        """Axis and pitch of each mode's twist, in M.

        The axes of repeated modes depend on the basis of their subspace.
        """
        return [screw_of_twist(t, self.posture.length) for t in self.twists.real.T]

    # -- masses
    # -----------------------------------------------------------------------------

    @cached_property
    def _momentum(self) -> tuple[Array, float] | None:
        return self.posture.momentum()

    @cached_property
    def effective_masses(self) -> Array | None:
        """Mass [kg] (k, 3) that each mode moves along x, y, z of F; None without masses.

        ``(A_d phi)^2`` with the momentum A per rate, as for excitation by the base. Their
        sum over all modes is the moving mass, without masses that only turn or are held.
        """
        if self._momentum is None or self.spectrum.is_complex:
            return None
        A = self._momentum[0]
        if self.spectrum.left is self.spectrum.vectors:
            return fixed((A @ self.shapes).T ** 2)
        left = self.basis @ self.spectrum.left
        return fixed(((A @ left) * (A @ self.basis @ self.spectrum.vectors)).T)

    @cached_property
    def participation(self) -> Array:
        """Share (k, n) of each coordinate in the kinetic energy of each mode;
        rows sum to 1.
        """
        moved = self.full_mass @ self.shapes
        shares = (np.conj(self.shapes) * moved).real
        with numerics.silent():
            return fixed((shares / shares.sum(axis=0)).T)

    @cached_property
    def full_mass(self) -> Array:
        """Mass matrix (n, n) on all coordinates, in kg and the mechanism's
        unit of length.
        """
        full = kinetic_matrix(self.posture, self.elastic.terms(), self.elastic.units)
        n = self.posture.coordinate_lengths.size
        return np.zeros((n, n)) if full is None else full

    # -- notes and output
    # --------------------------------------------------------------------

    @cached_property
    def notes(self) -> tuple[Note, ...]:
        """Notes on assumptions, masses and states of the modes."""
        return (
            *self._load_with_notes[1],
            *notes_on_masses(self.elastic),
            *notes_on_states(
                self.squares, self.shapes, self.groups, self.basis, self.spectrum
            ),
        )

    def to_dict(self) -> dict[str, Any]:
        """The object of ``cartstiff modes --json``.

        Complex numbers as [real, imaginary].
        """
        elastic = self.elastic
        total = None if self._momentum is None else self._momentum[1]
        own = {
            "eigenvalues": self.squares,
            "modes": self.shapes.T,
            "twists": self.twists.T,
            "nodal_axes": [_screw_dict(s) for s in self.nodal_axes],
            "repeated": [[i + 1 for i in g] for g in self.groups if len(g) > 1],
            "moving_mass": total,
            "mass_matrix": self.full_mass,
            "stiffness_matrix": self.stiffness,
            "load": {k: v for k, v in self.load.items() if k != "words"},
            "weighed": [
                {"name": name, "mass": mass}
                for name, mass in masses_that_move(elastic).items()
            ],
        }
        return described("modes", own, elastic.about(), self)


def _screw_dict(screw: Screw) -> dict[str, Any]:
    """Direction, point and pitch; None where a translation or no motion has none."""
    turns = bool(np.isfinite(screw.pitch))
    moves = bool(np.isfinite(screw.direction).all())
    return {
        "direction": screw.direction if moves else None,
        "point": screw.point if turns else None,
        "pitch": screw.pitch if turns else None,
    }


def _load_at_rest(
    state: Equilibrium | None,
) -> tuple[Mapping[str, Any], tuple[Note, ...]]:
    """Return the load of an equilibrium, and its notes."""
    if state is None:
        return {}, ()
    load = {
        "kind": "potentials",
        "at": None,
        "wrench": None,
        "given": bool(state.loads),
        "meaning": "the loads of the equilibrium, each as it is",
        "words": "at rest under its loads" if state.loads else "at rest, no load",
    }
    return load, tuple(
        n for n in state.notes if n.code not in ("unstable", "flutter", "divergence")
    )


def _load_of_posture(
    result: PostureStiffness,
) -> tuple[Mapping[str, Any], tuple[Note, ...]]:
    """Return the load of a held posture, and the notes of its analysis."""
    W = np.zeros(6) if result.wrench is None else result.wrench
    loaded = result.is_loaded
    load = {
        "kind": result.load.kind,
        "at": list(result.load.at),
        "wrench": W.tolist() if loaded else [0.0] * 6,
        "given": result._load_is_given,
        "meaning": result.load.words,
        "words": f"under its {result.load.kind} load" if loaded else "unloaded",
    }
    notes = list(result.notes_on_posture)
    notes = [
        n for n in notes if n.code not in ("fewer-than-six-freedoms", "near-singular")
    ]
    if loaded and not result._load_is_given:
        if result.elastic.gravity is None:
            what = "the springs exert"
        else:
            what = "springs and weight exert"
        notes.append(
            Note(
                "load-from-springs",
                f"no load was given: the wrench that {what} here is taken for a "
                f"{result.load.kind} load that holds the posture",
                {"wrench": W.tolist()},
            )
        )
    return load, tuple(notes)


@checked
def modes(
    subject: ElasticMechanism | PostureStiffness | Equilibrium,
    q: ArrayLike | Mapping[str, float] | None = None,
    *,
    wrench: ArrayLike | None = None,
    load_kind: Behaviour = "dead",
    load_at: ArrayLike = (0.0, 0.0, 0.0),
    load_axes: Axes = "body",
) -> Modes:
    r"""Natural frequencies and modes of small motions about a rest state, under its load.

    ``K_q phi = omega^2 M phi`` on the motions that keep the closures.

    Parameters
    ----------
    subject : ElasticMechanism, PostureStiffness or Equilibrium
        A mechanism from `cartstiff.load`, which is held at q by rest positions as in
        `cartstiff.analyse`; or the result of `analyse`, or of `equilibrium`, where it
        came to rest.
    q, wrench, load_kind, load_at, load_axes
        As in `cartstiff.analyse`; for a mechanism only.

    Returns
    -------
    Modes
        Frequencies, shapes, twists, effective masses, nodal axes, notes.

    Raises
    ------
    InputError
        For q or a load beside a result, or what `analyse` refuses.
    UndefinedError
        If the posture is no rest state, no mass moves, or a motion without mass and
        stiffness takes part in the forces of others.

    Examples
    --------
    >>> import cartstiff
    >>> modes = cartstiff.modes(cartstiff.load("stewart-simscape"))
    >>> [round(float(f), 1) for f in modes.frequencies]
    [780.6, 780.6, 903.9, 1061.4, 1061.4, 1269.7]
    """
    if isinstance(subject, ElasticMechanism):
        is_loaded = wrench is not None
        own = not is_loaded and subject.may_be_loaded
        kind = checked_load(load_kind, load_at, load_axes, is_loaded, own)
        load: dict[str, Any] = {
            "wrench": wrench,
            "load_kind": load_kind,
            "load_axes": load_axes,
            "load_at": load_at,
        }
        if is_plain(subject):
            return _modes_of_open_chain(subject, q, load, kind)
        subject = analyse(subject, q, **load)
    else:
        expected = "a mechanism, or what analyse or equilibrium answers"
        checked_kind(subject, (PostureStiffness, Equilibrium), "posture", expected)
        if q is not None or wrench is not None:
            raise InputError(
                "a result has its posture and its load",
                expected="no q and no wrench",
                got="q" if q is not None else "wrench",
            )
        checked_load(load_kind, load_at, load_axes, given=False)
    if isinstance(subject, Equilibrium):
        return _modes_of_equilibrium(subject)
    return _modes_of_posture(subject)


def _modes_of_equilibrium(state: Equilibrium) -> Modes:
    """Return the modes at an equilibrium, with its contacts unchanged."""
    balance, posture = state._solution.balance, state.posture
    columns = posture.coordinate_lengths
    basis = np.diag(columns) if balance.free is None else columns[:, None] * balance.free
    sizes = np.abs(balance.stiffness) + np.diag(balance.stiffness_scale)
    elastic = state.elastic.with_potential(*state.loads)
    return _solved(elastic, posture, basis, balance.stiffness, sizes, state=state)


def _modes_of_posture(result: PostureStiffness) -> Modes:
    """Return the modes of a posture that springs hold under a load."""
    reduction, posture = result.reduction, result.posture
    if result.wrench is None:
        raise reduction.undefined()
    columns = posture.coordinate_lengths
    H, terms = stiffness_under_load(result)
    basis = np.diag(columns)
    if posture.closure is not None and reduction.motions is not None:
        stiff = np.abs(H * np.outer(columns, columns)).max(axis=0, initial=0.0)
        basis = (
            columns[:, None]
            * numerics.stiffness_scaled_basis(reduction.motions, stiff)[0]
        )
    terms = terms + _force_roundoff(result) / np.outer(columns, columns)
    K, size = basis.T @ H @ basis, np.abs(basis).T @ terms @ np.abs(basis)
    if not np.isnan(result.energy) and _is_symmetric(result.change_by_load):
        K = 0.5 * (K + K.T)
    return _solved(result.elastic, posture, basis, K, size, held=result)


def is_plain(elastic: ElasticMechanism) -> bool:
    """Whether only linear springs in all joints of an open chain hold it.

    Then they carry any load, and the modes need no stiffness at the body.
    """
    springs, chain = elastic.springs, elastic.mechanism
    return (
        springs is not None
        and chain.is_open_tree
        and not (chain.rigid or springs.laws or elastic.potentials)
        and elastic.gravity is None
        and bool(np.isnan(springs.rest).all())
        and bool((springs.of_coordinates(len(chain.coordinates)) > 0.0).all())
    )


def _modes_of_open_chain(
    elastic: ElasticMechanism,
    q: ArrayLike | Mapping[str, float] | None,
    load: dict[str, Any],
    kind: LoadKind,
) -> Modes:
    """Return the modes where `is_plain`: ``K_q = diag(k) - S_W + J^T D J``,
    D the load's part.
    """
    elastic, posture = elastic.placed(q)
    columns, springs = posture.coordinate_lengths, elastic.springs
    k = columns * np.nan if springs is None else springs.of_coordinates(len(columns))
    later = partial(analyse, elastic, posture.q, **load)
    rested, K = elastic.at_rest(posture.q.copy()), np.diag(k)
    noise = 0.0
    terms = K
    if load["wrench"] is not None:
        W = checked_input(load["wrench"], (6,), "wrench")
        W = wrench_in_body(W, posture.pose, kind.at, load["load_axes"])
        if W.any():
            D = kind.change(W)
            K, terms = _under_load(K, K, posture, W, D)
            K = 0.5 * (K + K.T) if _is_symmetric(D) else K
            force = np.abs(posture.motion.jacobian.T @ W) * columns
            noise = _stiffness_roundoff(force, k * columns * columns, W, posture)
            rested = with_rest_balancing(elastic, posture, W)
    pairs = np.outer(columns, columns)
    return _solved(
        rested, posture, np.diag(columns), K * pairs, terms * pairs + noise, held=later
    )


def _under_load(
    H: Array, terms: Array, posture: MechanismPosture, W: Array, D: Array
) -> tuple[Array, Array]:
    """Return ``H - S_W + J^T D J``, D the load's part, and the sizes of its terms."""
    J, curvature = posture.motion.jacobian, posture.motion.curvature(W)
    sizes = np.abs(curvature) + np.abs(J.T) @ np.abs(D) @ np.abs(J)
    return H - curvature + J.T @ D @ J, terms + sizes


def stiffness_under_load(result: PostureStiffness) -> tuple[Array, Array]:
    """Return K_q (n, n) on all coordinates with load and closures,
    and the sizes of its terms.

    ``Hess Phi - S_W + J^T (K^load - K^B) J + sum lam_k c_k''``.
    """
    posture, W = result.posture, result.wrench
    H, terms = result.evaluation.hessian, np.abs(result.evaluation.hessian)
    if W is not None and np.any(W):
        H, terms = _under_load(H, terms, posture, W, result.change_by_load)
    if posture.closure is not None and result.reduction.multipliers.any():
        curvature = posture.closure.curvature(result.reduction.multipliers)
        H, terms = H + curvature, terms + np.abs(curvature)
    return H, terms


def _force_roundoff(result: PostureStiffness) -> float:
    """Stiffness in natural units, over `FREE_MOTION_STIFFNESS`,
    that round-off of forces may cause.

    It counts the closures' forces and the load, and what springs exert beyond a rounding
    error.
    """
    columns, reduction = result.posture.coordinate_lengths, result.reduction
    g = np.abs(result.evaluation.gradient * columns)
    stiff = np.abs(result.evaluation.hessian * np.outer(columns, columns)).max(
        axis=0, initial=0.0
    )
    forces = reduction.multipliers
    if reduction.force is not None:
        forces = np.append(forces, reduction.force)
    return _stiffness_roundoff(g, stiff, forces, result.posture)


def _stiffness_roundoff(
    exerted: Array, stiff: Array, forces: Array, posture: MechanismPosture
) -> float:
    least = float(np.minimum(exerted, numerics.ROUNDOFF * stiff).sum())
    carried = numerics.EPSILON * float(np.abs(forces).sum()) * max(1.0, posture.length)
    return (least + carried) / numerics.FREE_MOTION_STIFFNESS


def _is_symmetric(D: Array) -> bool:
    return bool(np.abs(D - D.T).max() <= numerics.ROUNDOFF * numerics.largest(D))


def _solved(
    elastic: ElasticMechanism,
    posture: MechanismPosture,
    basis: Array,
    stiffness: Array,
    terms: Array,
    held: PostureStiffness | partial[PostureStiffness] | None = None,
    state: Equilibrium | None = None,
) -> Modes:
    full = kinetic_matrix(posture, elastic.terms(), elastic.units)
    mass = None if full is None else basis.T @ full @ basis
    if mass is None or full is None or not np.diag(mass).any():
        raise UndefinedError(
            f"nothing that moves in {elastic.name} has a mass: it has no frequencies "
            "(give inertias in the robot's file, body and legs.mass, or a payload)",
            code="no-mass",
            values={"links": list(elastic.mechanism.masses())},
        )
    size = np.abs(basis).T @ np.abs(full) @ np.abs(basis)
    spectrum = spectrum_of(stiffness, 0.5 * (mass + mass.T), terms, size)
    if spectrum.coupled:
        raise UndefinedError(
            "a motion with neither mass nor stiffness takes part in the forces of the "
            "others: "
            "there are no modes",
            code="massless-free-motion",
            values={"shapes": (basis @ spectrum.loose).T.tolist()},
        )
    return Modes(elastic, posture, basis, stiffness, mass, spectrum, held, state)
