"""Notes on modes: free, unstable, fluttering, repeated and massless motions; implausible masses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cartstiff import numerics
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.contract import Units, convert_length
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.platform import Platform
from cartstiff.notes import Note
from cartstiff.potentials.beams import Beam
from cartstiff.potentials.loads import DeadForce
from cartstiff.statics.small_motions import Spectrum

# kg over the cube of the summed lengths of the links [m]: arms of robots are between 1 and 200, a
# solid block of steel is 7850. Beyond these a unit is mistaken (grams, millimetres).
_HEAVIEST, _LIGHTEST = 2000.0, 0.01


def masses_that_move(elastic: ElasticMechanism) -> dict[str, float]:
    """Masses [kg] by link, of the payload, the legs, and the payloads among the loads."""
    masses = {name: mass for name, mass in elastic.mechanism.masses().items() if mass > 0.0}
    hung = sum(p.mass for p in elastic.potentials if isinstance(p, DeadForce))
    if hung > 0.0:
        masses["payload among the loads"] = hung * elastic.units.newtons
    return masses


def notes_on_masses(elastic: ElasticMechanism) -> list[Note]:
    """What is missing or cannot be meant among the masses, with names and numbers."""
    mechanism = elastic.mechanism
    notes: list[Note] = []
    if isinstance(mechanism, Platform):
        if mechanism.struts is None:
            words = "the legs have no mass (legs.mass): real frequencies are lower"
            notes.append(Note("massless-struts", words, {"legs": len(mechanism.points)}))
        if mechanism.mass > 0.0 and not np.diag(mechanism.body_inertia)[:3].any():
            words = f"{mechanism.frame} is a point mass of {mechanism.mass:g} kg without inertia"
            notes.append(Note("inertia-missing", words, {"links": [mechanism.frame]}))
        return notes
    if not isinstance(mechanism, Chain):
        return notes
    model = mechanism.tree.model
    links = mechanism.tree.links()
    bodies = {links[j]: model.inertias[j] for j in sorted(links)}
    bare = [name for name, body in bodies.items() if not body.mass > 0.0]
    if bare:
        words = f"these links move and have no mass: {', '.join(bare)}"
        notes.append(Note("massless-links", words, {"links": bare}))
    points = [name for name, body in bodies.items() if body.mass > 0.0 and not np.any(body.inertia)]
    if points:
        words = f"these links are point masses, without moments of inertia: {', '.join(points)}"
        notes.append(Note("inertia-missing", words, {"links": points}))
    for potential in elastic.potentials:
        if isinstance(potential, Beam):
            notes.append(_on_beam(potential))
    return notes + _absurd(mechanism, bodies, 1.0 / convert_length(Units(), elastic.units)[0])


def _on_beam(beam: Beam) -> Note:
    values = {"link": beam.link, "mass": beam.mass, "segments": len(beam.indices)}
    if beam.mass > 0.0:
        words = (
            f"the beam {beam.link!r} has its {beam.mass:.4g} kg lumped as rigid half segments at "
            f"the nodes of {len(beam.indices)} segment(s): the error of a frequency goes with the "
            "square of a segment's length"
        )
        return Note("beam-lumped", words, values)
    words = (
        f"the beam {beam.link!r} has no mass of its own (density): the mass of its link sits "
        "rigidly at its near end"
    )
    return Note("beam-massless", words, values)


def _absurd(chain: Chain, bodies: dict[str, object], metres: float) -> list[Note]:
    """Masses and inertias that no such machine has; its unit of length is so many metres."""
    model = chain.tree.model
    steps = [float(np.linalg.norm(T.translation)) for T in list(model.jointPlacements)[1:]]
    size = metres * (sum(steps) + float(np.linalg.norm(chain.body.T_j_f[:3, 3])))
    total = sum(float(body.mass) for body in list(model.inertias)[1:])
    if not (size > 0.0 and total > 0.0):
        return []
    notes = []
    if not _LIGHTEST < total / size**3 < _HEAVIEST:
        words = (
            f"{total:.4g} kg on links of {size:.4g} m in all are hardly meant: robots carry 1 to "
            "200 kg per cubic metre of that length (grams, or millimetres, in the file?)"
        )
        heavy = max(bodies, key=lambda name: bodies[name].mass)  # type: ignore[attr-defined]
        values = {"mass": total, "length": size, "heaviest": heavy}
        notes.append(Note("implausible-mass", words, values))
    for name, body in bodies.items():
        mass = float(body.mass)  # type: ignore[attr-defined]
        if not mass > 0.0:
            continue
        moments = np.linalg.eigvalsh(np.array(body.inertia))  # type: ignore[attr-defined]
        values = {"link": name, "mass": mass, "moments": moments.tolist()}
        radius = metres * float(np.sqrt(max(moments[2], 0.0) / mass))
        if radius > size:
            words = (
                f"the inertia of {name!r} belongs to a body of {radius:.4g} m, larger than the "
                f"robot's {size:.4g} m"
            )
            notes.append(Note("inertia-absurd", words, values))
        elif moments[0] < 0.0 or moments[0] + moments[1] < (1 - numerics.NEARBY) * moments[2]:
            words = (
                f"no body has the moments of inertia of {name!r}: one is negative or larger than "
                "the other two together"
            )
            notes.append(Note("inertia-absurd", words, values))
    return notes


def notes_on_states(
    squares: Array, shapes: Array, groups: Sequence[Sequence[int]], basis: Array, spectrum: Spectrum
) -> list[Note]:
    """What is to be known of modes beside their frequencies.

    Parameters
    ----------
    squares : ndarray (k,)
        omega^2 in 1/s^2.
    shapes : ndarray (n, k)
        Coordinate rates of the modes.
    groups : sequence of sequences of int
        Numbers of the modes, those with one frequency together.
    basis : ndarray (n, f)
        What the spectrum's motions are written in.
    spectrum : Spectrum
        The solutions.
    """
    notes: list[Note] = []
    zero = np.flatnonzero(squares == 0.0)
    if zero.size:
        words = f"{zero.size} motion(s) cost no energy: free motions, of frequency 0"
        values = {"modes": (zero + 1).tolist(), "shapes": shapes[:, zero].real.T.tolist()}
        notes.append(Note("free-motion", words, values))
    if np.iscomplexobj(squares):
        pairs = np.flatnonzero(np.abs(squares.imag) > 0.0)
        words = "motions meet and grow as they swing (flutter): the rest state is unstable"
        swing = np.sqrt(squares[pairs]).real / (2 * np.pi)
        notes.append(
            Note("flutter", words, {"modes": (pairs + 1).tolist(), "frequencies": swing.tolist()})
        )
    negative = np.flatnonzero((squares.real < 0.0) & (np.abs(squares.imag) == 0.0))
    if negative.size:
        words = "the rest state is unstable: the mechanism leaves it along these motions"
        values = {
            "modes": (negative + 1).tolist(),
            "growth": np.sqrt(-squares.real[negative]).tolist(),
            "shapes": shapes[:, negative].real.T.tolist(),
        }
        notes.append(Note("unstable", words, values))
    for group in groups:
        if len(group) > 1 and squares[group[0]] != 0.0:
            numbers = ", ".join(str(i + 1) for i in group)
            words = (
                f"modes {numbers} have one frequency: they are a subspace, and any motion in "
                "it is a mode"
            )
            notes.append(Note("repeated-modes", words, {"modes": [i + 1 for i in group]}))
    if spectrum.following.shape[1]:
        words = (
            f"{spectrum.following.shape[1]} motion(s) have stiffness and no mass: they follow the "
            "others at once and have no frequency of their own"
        )
        values = {"shapes": (basis @ spectrum.following).T.tolist()}
        notes.append(Note("massless-motion", words, values))
    if spectrum.loose.shape[1]:
        words = (
            f"{spectrum.loose.shape[1]} motion(s) have neither mass nor stiffness: nothing says "
            "how they move, and they are left out"
        )
        values = {"shapes": (basis @ spectrum.loose).T.tolist()}
        notes.append(Note("massless-free-motion", words, values))
    return notes
