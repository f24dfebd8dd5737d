"""Segments of beams as recorded numbers: the formulas of `cartstiff.potentials.beams`.

The axial force is found by a fixed number of Newton steps from zero. Segments that turn further, or
carry more, than the series of the recorded formulas reach are evaluated as the engine does.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from cartstiff import numerics
from cartstiff.geometry.se3 import Array
from cartstiff.many.algebra import in_pairs, largest
from cartstiff.many.arithmetic import ENGINE, PLAIN
from cartstiff.many.machine_code.stacked_program import (
    StackedProgram,
    from_triangles,
    lower_triangle,
)
from cartstiff.many.tape import Scalar, Tape, absolute, larger, pick
from cartstiff.potentials.beams import SERIES, Beam, Section, alike

#: Turns (rad) up to which all series of the shapes are exact to rounding.
_TURN = 0.42
_NEWTON_STEPS = 5
#: What the last of them may have changed, as a share: its square is left.
_CHANGED = numerics.LAST_DIGITS**0.5


def _segment(tape: Tape, beam: Beam) -> dict[str, Array]:
    """Energy, gradient, lower triangle of the Hessian, and the verdict."""
    x = tape.vector("x", 6)
    shapes = beam.shapes(x[None])
    _, stretch, turns = shapes
    squares, softness = turns.value * turns.value, beam.length / beam.section.axial
    verdict: Scalar = pick(largest(x[[0, 1, 4, 5]]), _TURN, PLAIN, ENGINE)
    N = np.zeros(1, object)
    step: Scalar = 0.0
    for _ in range(_NEWTON_STEPS):
        _, s1, s2 = beam.rotational(N)
        missing = stretch.value - N * softness + (s1 * squares).sum(axis=-1)
        step = (missing / (softness - (s2 * squares).sum(axis=-1)))[0]
        N = N + step
    known = absolute(N[0]) + absolute(stretch.value[0]) * (1.0 / softness)
    verdict = larger(verdict, pick(known * _CHANGED, absolute(step), ENGINE, PLAIN))
    low, high = beam.bounds
    verdict = larger(verdict, pick(N[0], 0.5 * low, ENGINE, PLAIN))
    if np.isfinite(high):
        verdict = larger(verdict, pick(0.5 * high, N[0], ENGINE, PLAIN))
    for EI in beam.section.bending:
        bent = absolute(N[0]) * (beam.length**2 / EI)
        verdict = larger(verdict, pick(bent, 0.5 * SERIES, PLAIN, ENGINE))
    energy, gradient, hessian = beam.terms(shapes, N, beam.rotational(N), np.ones(1))
    return {
        "energy": in_pairs(energy),
        "gradient": gradient[0],
        "hessian": in_pairs(lower_triangle(hessian[0])),
        "verdict": in_pairs(np.array([verdict], object)),
    }


@lru_cache(maxsize=16)
def _program(length: float, section: Section, compiled: bool) -> StackedProgram:
    tape, beam = Tape(), Beam(np.arange(6), length, section)
    return StackedProgram(tape.program(_segment(tape, beam), []), compiled)


def segments_of_many(beams: Sequence[Beam], q: Array, compiled: bool) -> tuple[Array, Array, Array]:
    """Segments of beams at many coordinates q (N, n), in the order of the beams' own.

    Returns
    -------
    energies : ndarray (N,)
        Of all segments together.
    gradients : ndarray (N, s, 6)
    hessians : ndarray (N, s, 6, 6)
    """
    starts = np.cumsum([0, *(len(beam.indices) for beam in beams)])
    energies = np.zeros(len(q))
    gradients, hessians = np.empty((len(q), starts[-1], 6)), np.empty((len(q), starts[-1], 6, 6))
    for group in alike(beams):
        own = np.concatenate([np.arange(len(b.indices)) + starts[beams.index(b)] for b in group])
        x = q[:, np.concatenate([beam.indices for beam in group])]
        energy, gradient, hessian = _evaluated(group[0], x.reshape(-1, 6), compiled)
        energies += energy.reshape(len(q), -1).sum(axis=1)
        gradients[:, own] = gradient.reshape(x.shape)
        hessians[:, own] = hessian.reshape(*x.shape, 6)
    return energies, gradients, hessians


def _evaluated(beam: Beam, x: Array, compiled: bool) -> tuple[Array, Array, Array]:
    """Energies (m,), gradients (m, 6), Hessians (m, 6, 6) of segments that are alike."""
    outputs = _program(beam.length, beam.section, compiled)({"x": x})
    energies, gradients = outputs["energy"][:, 0].copy(), outputs["gradient"]
    hessians = from_triangles(outputs["hessian"])
    doubtful = np.flatnonzero(~(outputs["verdict"][:, 0] == PLAIN))
    if doubtful.size:
        energies[doubtful], gradients[doubtful], hessians[doubtful] = beam.segments(x[doubtful])
    return energies, gradients, hessians
