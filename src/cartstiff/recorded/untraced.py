r"""Potentials outside the program of a mechanism, whose derivatives are inputs of
that program.

Segments of beams and struts between flexures have recorded programs of their own; all
other potentials are evaluated over arrays, or one posture after the other.

Segments of beams have the formulas of `cartstiff.core.potentials.beams`. The axial force
takes a fixed number of Newton steps from zero. Segments whose turns or axial forces are
outside the range of the series are evaluated by `Beam` itself.

Struts between flexures take the steps of `potentials.flexure_struts`. A row is one strut.
With H = diag k - S_W, C = J H^-1 J^T, the residual r of the springs' balance and x of the
end's pose, a Newton step is

    dW = C^-1 (x - J H^-1 r),    dq = H^-1 (r + J^T dW),

and the same with r = k_s e_s, x = 0 is the response to a longer rest length. Where rest
lengths are open, a second program finds their changes with which all struts together
exert a gradient. Struts with large bending, and steps that do not converge, are left to
`FlexureStruts`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.contract import Mechanism
from cartstiff.core.potentials.beams import SERIES, Beam, Section
from cartstiff.core.potentials.contract import Potential, alike
from cartstiff.core.potentials.springs import SpringLaw
from cartstiff.core.stiffness.applied_load import (
    DEAD_AT_ORIGIN,
    Axes,
    LoadKind,
    wrench_in_body,
)
from cartstiff.files.struts.flexure_struts import (
    ROUNDINGS,
    SLIDE,
    FlexureStruts,
    StrutStates,
    strut_end,
)
from cartstiff.recorded.algebra import (
    FALLBACK,
    JACOBIAN_CONDITION,
    PLAIN,
    UNBALANCED,
    above,
    below,
    congruence,
    cross,
    inverse,
    largest,
    limited,
    positive_factor,
    require_pivots,
    rotation_vector,
    solution_with_condition,
    zeros,
)
from cartstiff.recorded.chains import curvature_of
from cartstiff.recorded.closed_chains import cotangent_series
from cartstiff.recorded.execution import (
    CompiledKernel,
    Kernel,
    PortableKernel,
    from_triangles,
    lower_triangle,
)
from cartstiff.recorded.tape import (
    Program,
    Scalar,
    Tape,
    absolute,
    larger,
    pick,
    square_root,
)

#: Largest turn [rad] for which all series of the shapes are exact to round-off.
_LARGEST_TURN = 0.42
_NEWTON_STEPS = 5
#: Largest relative change by the last of them: the remaining error is its square.
_MAX_LAST_CHANGE = numerics.ROUNDOFF_OF_SUMS**0.5


def segment_program(length: float, section: Section) -> Program:
    """Energy, gradient, lower triangle of the Hessian and verdict of one
    segment at x (6,).
    """
    tape, beam = Tape(), Beam(np.arange(6), length, section)
    x = tape.vector("x", 6)
    shapes = beam.shapes(x[None])
    _, stretch, turns = shapes
    squares, softness = turns.value * turns.value, beam.length / beam.section.axial
    # The axial force by a fixed number of Newton steps, from none.
    verdict: Scalar = limited(largest(x[[0, 1, 4, 5]]), _LARGEST_TURN)
    N = np.zeros(1, object)
    step: Scalar = 0.0
    for _ in range(_NEWTON_STEPS):
        _, s1, s2 = beam.rotational(N)
        missing = stretch.value - N * softness + (s1 * squares).sum(axis=-1)
        step = (missing / (softness - (s2 * squares).sum(axis=-1)))[0]
        N = N + step
    # They count where the last one changed nothing, and far from buckling and from where
    # the series ends.
    known = absolute(N[0]) + absolute(stretch.value[0]) * (1.0 / softness)
    verdict = larger(
        verdict, pick(known * _MAX_LAST_CHANGE, absolute(step), FALLBACK, PLAIN)
    )
    low, high = beam.bounds
    verdict = larger(verdict, pick(N[0], 0.5 * low, FALLBACK, PLAIN))
    if np.isfinite(high):
        verdict = larger(verdict, pick(0.5 * high, N[0], FALLBACK, PLAIN))
    for EI in beam.section.bending:
        bent = absolute(N[0]) * (beam.length**2 / EI)
        verdict = larger(verdict, limited(bent, 0.5 * SERIES))
    # Everything else follows from the force.
    energy, gradient, hessian = beam.terms(shapes, N, beam.rotational(N), np.ones(1))
    return tape.program(
        {
            "energy": energy,
            "gradient": gradient[0],
            "hessian": lower_triangle(hessian[0]),
            "verdict": verdict,
        }
    )


@lru_cache(maxsize=16)
def _segment_kernel(length: float, section: Section, compiled: bool) -> Kernel:
    make = CompiledKernel if compiled else PortableKernel
    return make(segment_program(length, section))


def segments_of_many(
    beams: Sequence[Beam], q: Array, compiled: bool
) -> tuple[Array, Array, Array]:
    """Segments of beams at many coordinates q (N, n), in the order of the beams.

    Returns
    -------
    energies : ndarray (N,)
        Sum over all segments.
    gradients : ndarray (N, s, 6)
    hessians : ndarray (N, s, 6, 6)
    """
    starts = np.cumsum([0, *(len(beam.indices) for beam in beams)])
    energies = np.zeros(len(q))
    gradients, hessians = (
        np.empty((len(q), starts[-1], 6)),
        np.empty((len(q), starts[-1], 6, 6)),
    )
    for group in alike(beams):
        own = np.concatenate(
            [np.arange(len(b.indices)) + starts[beams.index(b)] for b in group]
        )
        x = q[:, np.concatenate([beam.indices for beam in group])]
        energy, gradient, hessian = _evaluated(group[0], x.reshape(-1, 6), compiled)
        energies += energy.reshape(len(q), -1).sum(axis=1)
        gradients[:, own] = gradient.reshape(x.shape)
        hessians[:, own] = hessian.reshape(*x.shape, 6)
    return energies, gradients, hessians


def _evaluated(beam: Beam, x: Array, compiled: bool) -> tuple[Array, Array, Array]:
    """Energies (m,), gradients (m, 6), Hessians (m, 6, 6) of equal segments."""
    outputs = _segment_kernel(beam.length, beam.section, compiled)({"x": x})
    energies, gradients = outputs["energy"][:, 0].copy(), outputs["gradient"]
    hessians = from_triangles(outputs["hessian"])
    doubtful = np.flatnonzero(~(outputs["verdict"][:, 0] == PLAIN))
    if doubtful.size:
        energies[doubtful], gradients[doubtful], hessians[doubtful] = beam.segments(
            x[doubtful]
        )
    return energies, gradients, hessians


#: Number of steps after which `FlexureStruts` searches from the start.
_MAX_STEPS = 40
#: Largest turn of a hinge [rad] of the shape near the straight strut, which rest lengths
#: determine.
_LARGEST_HINGE_TURN = 0.4
#: Least pivot of H, as a share of the spring's stiffness: two digits are lost.
_LEAST_PIVOT_SHARE = 0.01
#: Arrays that determine a strut in equilibrium.
_BALANCE = ("numbers", "q", "W", "rest")
#: Numbers of a strut: pose of its end (12), length between flexures, spring of the slide,
#: length as made.
_NUMBERS = 15


@dataclass(frozen=True)
class _Alike:
    """Numbers common to the struts of a platform.

    Attributes
    ----------
    springs : stiffnesses of the 13 coordinates, infinite if rigid; the slide's an input.
    mean : mean length of the struts as made, for sizes.
    whole : root of the first one's energy, for sizes.
    ends : poses in M of their ends, flat.
    """

    springs: tuple[float, ...]
    mean: float
    whole: float
    ends: tuple[float, ...]

    @staticmethod
    def of(struts: FlexureStruts) -> _Alike:
        """The common numbers of struts."""
        springs = struts.springs[0].tolist()
        springs[SLIDE] = 1.0
        whole = float(np.sqrt(struts.slides[0]) * struts.made[0])
        ends = tuple(struts.ends.ravel().tolist())
        return _Alike(tuple(springs), float(struts.made.mean()), whole, ends)

    @property
    def free(self) -> list[int]:
        """Coordinates that are not rigid."""
        return [i for i, k in enumerate(self.springs) if np.isfinite(k)]


def _gap(R: Array, p: Array, wanted: Array) -> tuple[Array, Scalar]:
    """Logarithm (6,) of the wanted end seen from the end, and the verdict on it."""
    there = wanted[:9].reshape(3, 3)
    w, verdict = rotation_vector(R.T @ there)
    d = R.T @ (wanted[9:12] - p)
    across = cross(w, d)
    return np.concatenate(
        [w, d - across * 0.5 + cross(w, across) * cotangent_series(w @ w)]
    ), verdict


class _Strut:
    """One strut at recorded coordinates under a recorded wrench."""

    def __init__(self, tape: Tape, alike: _Alike, stepped: bool) -> None:
        self.free = alike.free
        numbers = tape.vector("numbers", _NUMBERS)
        slide, made = numbers[13], numbers[14]
        n = len(self.free)
        before = {name: tape.vector(name, size) for name, size in _state(n).items()}
        self.x, self.W, self.rest = before["q"], before["W"], before["rest"][0]
        if stepped:  # the step before, and the response to the change of the rest length
            by = tape.input("shift", 0)
            self.x = self.x + before["dq"] + before["more_q"] * by
            self.W = self.W + before["dW"] + before["more_W"] * by
            self.rest = self.rest + by
        q = zeros(13)
        q[self.free] = self.x
        R, p, J = strut_end(q, numbers[12])
        self.J = J[:, self.free]
        k = np.array(alike.springs, object)
        k[SLIDE] = slide
        self.k = k[self.free]
        self.at = self.free.index(SLIDE)
        stretched = self.x.copy()
        stretched[self.at] = stretched[self.at] - self.rest
        self.stretched = stretched
        turning = curvature_of(self.J, self.W)
        self.H = np.diag(self.k) - turning
        self.missing = self.J.T @ self.W - self.k * stretched
        self.gap, self.verdict = _gap(R, p, numbers)
        self.L, self.inverses, pivots = positive_factor(self.H)
        self.reached = below(self.L, self.J.T)
        self.C = congruence(self.reached, np.diag(self.inverses))
        # Sizes are roots of energies, as in `FlexureStruts`.
        self.whole = square_root(slide) * made
        turn = np.repeat([1.0, 1.0 / alike.mean], 3) * self.whole
        roots = np.array([1.0 / square_root(s) for s in self.k], object)
        self.now = larger(largest(self.missing * roots), largest(self.gap * turn))
        # In equilibrium a strut must be near the straight shape and H positive, so that
        # it is stable.
        self.near = limited(largest(q[[3, 4, 5, 10, 11, 12]]), _LARGEST_HINGE_TURN)
        self.near = require_pivots(self.near, pivots, self.k, _LEAST_PIVOT_SHARE)

    def answer(self, forces: Array, gap: Array) -> tuple[Array, Array]:
        """Dq and dW."""
        own = below(self.L, forces[:, None])[:, 0]
        right = gap - self.reached.T @ (own * self.inverses)
        L, inverses, _ = positive_factor(self.C)
        dW = above(L, below(L, right[:, None])[:, 0] * inverses)
        return above(self.L, (own + self.reached @ dW) * self.inverses), dW


def _state(n: int) -> dict[str, int]:
    """Numbers of a strut that a step reads and writes, `n` coordinates giving."""
    return {"q": n, "W": 6, "dq": n, "dW": 6, "more_q": n, "more_W": 6, "rest": 1}


def _step(alike: _Alike) -> Program:
    """A step of one strut."""
    tape = Tape()
    strut = _Strut(tape, alike, True)
    dq, dW = strut.answer(strut.missing, strut.gap)
    unit = zeros(len(strut.free))
    unit[strut.at] = strut.k[strut.at]
    more_q, more_W = strut.answer(unit, zeros(6))
    state = {
        "q": strut.x,
        "W": strut.W,
        "dq": dq,
        "dW": dW,
        "more_q": more_q,
        "more_W": more_W,
        "rest": strut.rest,
    }
    seen = np.array([strut.now, strut.verdict, strut.near, strut.whole], object)
    return tape.program({**state, "seen": seen})


def _condensed(alike: _Alike) -> Program:
    """Energy, wrench and K^B of one strut in M, in equilibrium."""
    tape = Tape()
    strut = _Strut(tape, alike, False)
    ends = tape.vector("ends", 12)
    R, p = ends[:9].reshape(3, 3), ends[9:]
    back = zeros(6, 6)  # a wrench at the end, as one in M
    back[:3, :3] = back[3:, 3:] = R
    for a in range(3):
        back[:3, 3 + a] = cross(p, R[:, a])
    K = congruence(back.T, inverse((strut.C + strut.C.T) * 0.5))
    energy = (strut.k * strut.stretched) @ strut.stretched * 0.5
    return tape.program(
        {
            "energy": energy,
            "wrench": back @ strut.W,
            "stiffness": lower_triangle(K),
        }
    )


def _coupling(alike: _Alike) -> Program:
    """Changes of the rest lengths of six struts, and the residual of the gradient."""
    tape = Tape()
    ends = np.reshape(alike.ends, (-1, 4, 4))
    m, sizes = len(ends), alike.whole * np.repeat([1.0, 1.0 / alike.mean], 3)
    W, dW, more = (
        tape.vector(name, 6 * m).reshape(m, 6) for name in ("W", "dW", "more_W")
    )
    back = np.swapaxes(se3.adjoint_of_inverse(ends), -1, -2)
    now = tape.vector("gradient", 6) - sum(b @ w for b, w in zip(back, W, strict=True))
    short = now - sum(b @ w for b, w in zip(back, dW, strict=True))
    G = np.column_stack([b @ w for b, w in zip(back, more, strict=True)]) / sizes[:, None]
    shift, condition = solution_with_condition(G, short / sizes)
    verdict = limited(condition, (1e-3 * JACOBIAN_CONDITION) ** 2)
    return tape.program(
        {"shift": shift, "seen": np.array([largest(now / sizes), verdict], object)}
    )


@lru_cache(maxsize=24)
def _strut_program(written: Callable[[_Alike], Program], alike: _Alike) -> Kernel:
    return CompiledKernel(written(alike))


class _Search:
    """Newton iteration of struts, all struts of a posture together.

    Attributes
    ----------
    which : postures that have not converged, whose rows are in `rows`.
    balance : arrays of the struts of those that have.
    is_known : postures that have converged to struts near the straight shape.
    """

    def __init__(self, struts: FlexureStruts, poses: Array, rest: Array) -> None:
        self.struts, self.alike = struts, _Alike.of(struts)
        self._program = partial(_strut_program, alike=self.alike)
        # What does not change: where both ends are, and which strut it is.
        (N, m), n = rest.shape, len(self.alike.free)
        self.m, self.which, self.is_known = m, np.arange(N), np.zeros(N, bool)
        wanted, numbers = struts.wanted(poses), np.empty((N, m, _NUMBERS))
        numbers[..., :9] = wanted[..., :3, :3].reshape(N, m, 9)
        numbers[..., 9:12] = wanted[..., :3, 3]
        numbers[..., 12], numbers[..., 13] = struts.bars, struts.slides
        numbers[..., 14] = struts.made
        # What is searched: the struts begin straight, at the lengths that the drives
        # give.
        rows = {name: np.zeros((N * m, size)) for name, size in _state(n).items()}
        rows["rest"][:, 0] = (rest - struts.made).reshape(-1)
        rows["q"][:, self.alike.free.index(SLIDE)] = rows["rest"][:, 0]
        self.rows = {
            "numbers": numbers.reshape(N * m, -1),
            **rows,
            "shift": np.zeros((N * m, 1)),
        }
        self.balance = {name: np.empty(self.rows[name].shape) for name in _BALANCE}
        self._missed = np.full((N, m), np.inf)

    def step(self, gradients: Array | None) -> None:
        """One step of all unconverged postures.

        With gradients (N, 6) rest lengths change.
        """
        count, m = len(self.which), self.m
        # Each strut by itself.
        outputs = self._program(_step)(self.rows)
        now, verdict, near, whole = (x.reshape(count, m) for x in outputs["seen"].T)
        doubt, shift = verdict.max(axis=1), np.zeros((count * m, 1))
        # Chosen rest lengths couple them: all struts together balance the load.
        if gradients is not None:
            together = {
                name: outputs[name].reshape(count, -1) for name in ("W", "dW", "more_W")
            }
            together["gradient"] = np.ascontiguousarray(gradients[self.which])
            coupled = self._program(_coupling)(together)
            short, unsure = coupled["seen"].T
            now, doubt = np.maximum(now, short[:, None]), np.maximum(doubt, unsure)
            shift = coupled["shift"].reshape(count * m, 1)
        # At rest where round-off is left and no step makes it less.
        settled = (now >= 0.5 * self._missed) & (now <= numerics.ROUNDOFF * whole)
        settled |= now <= ROUNDINGS * numerics.EPSILON * whole
        is_plain = (doubt == PLAIN) & np.isfinite(now).all(axis=1)
        done = is_plain & settled.all(axis=1)
        # Those at rest are kept, those in doubt left out, the others go on.
        rows = {"numbers": self.rows["numbers"], **outputs, "shift": shift}
        if done.any():
            own, kept = (
                _rows_of(done, m),
                _rows_of(np.isin(np.arange(len(self.is_known)), self.which[done]), m),
            )
            for name in _BALANCE:
                self.balance[name][kept] = rows[name][own]
            self.is_known[self.which[done]] = near[done].max(axis=1) == PLAIN
        goes_on = is_plain & ~done
        self._missed = np.fmin(self._missed, now)[goes_on]
        own = _rows_of(goes_on, m)
        self.rows = {name: array[own] for name, array in rows.items()}
        self.which = self.which[goes_on]

    def condensed(self) -> StrutStates:
        """Energies, wrenches and K^B in M of the known postures."""
        m, count = self.m, int(self.is_known.sum())
        own = _rows_of(self.is_known, m)
        inputs = {name: array[own] for name, array in self.balance.items()}
        ends = self.struts.ends
        flat = np.concatenate([ends[:, :3, :3].reshape(m, 9), ends[:, :3, 3]], axis=1)
        inputs["ends"] = np.tile(flat, (count, 1))
        outputs = self._program(_condensed)(inputs)
        stands = np.ones((count, m), bool)
        return StrutStates(
            outputs["energy"][:, 0].reshape(count, m),
            outputs["wrench"].reshape(count, m, 6),
            from_triangles(outputs["stiffness"]).reshape(count, m, 6, 6),
            self.struts.made + inputs["rest"][:, 0].reshape(count, m),
            stands,
            stands,
        )


def _rows_of(which: NDArray[np.bool_], m: int) -> slice | NDArray[np.bool_]:
    """Rows of the struts of some postures; a slice, which copies nothing, for all."""
    return slice(None) if which.all() else np.repeat(which, m)


def strut_states(
    struts: FlexureStruts, poses: Array, gradients: Array, every: bool
) -> tuple[StrutStates, NDArray[np.bool_]]:
    """`FlexureStruts.many` at poses (N, 4, 4) under gradients (N, 6), by machine code.

    With `every` all rest lengths are chosen. Not computed are struts with large bending,
    or with some open rest lengths.

    Returns
    -------
    states : StrutStates
        States at the known poses.
    is_known : ndarray of bool (N,)
    """
    start, free = struts.start_rest(poses, every)
    search = _Search(struts, poses, start)
    if free.any() and not (free.all() and len(free) == 6):
        search.which = search.which[:0]
    for _ in range(_MAX_STEPS):
        if not search.which.size:
            break
        search.step(gradients if free.any() else None)
    return search.condensed(), search.is_known


#: Postures at a time, by machine code and by stacks of matrices, that fit into the cache.
_COMPILED_ROWS, _STACKED_ROWS = 256, 64
#: Largest asymmetry of a Hessian, as a share of its largest entry.
_MAX_ASYMMETRY = numerics.ROUNDOFF


class _Sums(NamedTuple):
    """Sums of potentials: energies (N, 1), gradients (N, n), Hessians (N, n, n);
    verdicts (N,).
    """

    energies: Array
    gradients: Array
    hessians: Array
    verdicts: Array


@dataclass(frozen=True)
class UntracedTerms:
    """Potentials outside a program, which takes their derivatives as inputs.

    Attributes
    ----------
    mechanism : Mechanism
        Mechanism whose coordinates are used.
    loose : tuple of Potential
        Potentials evaluated at one posture after the other.
    laws : dict of int to SpringLaw
        Nonlinear joint springs.
    rest : ndarray (n,), optional
        Their rest positions.
    beams : tuple of Beam
        Beams, with derivatives for each segment.
    struts : FlexureStruts, optional
        Struts of a platform.
    forces, points : tuple of ndarray (3,)
        Dead forces on the platform and their points in M, which open rest lengths
        balance.
    is_loaded : bool
        Whether rest lengths of struts are chosen so that they carry a wrench.
    load, axes : as of `cartstiff.recorded.chains.ChainCase`.
    """

    mechanism: Mechanism
    loose: tuple[Potential, ...] = ()
    laws: Mapping[int, SpringLaw] = field(default_factory=dict)
    rest: Array | None = None
    beams: tuple[Beam, ...] = ()
    struts: FlexureStruts | None = None
    forces: tuple[Array, ...] = ()
    points: tuple[Array, ...] = ()
    is_loaded: bool = False
    load: LoadKind = DEAD_AT_ORIGIN
    axes: Axes = "body"

    @property
    def is_dense(self) -> bool:
        """Whether the program has a whole gradient and Hessian as inputs."""
        return bool(self.loose or self.laws or self.struts)

    @property
    def has_drives(self) -> bool:
        """Whether forces of drives are found here, so that the program has none."""
        return bool(self.laws or self.struts)

    def __bool__(self) -> bool:
        return self.is_dense or bool(self.beams)

    @property
    def segments(self) -> tuple[tuple[int, ...], ...]:
        """Coordinates of each segment of the beams."""
        return tuple(tuple(map(int, own)) for beam in self.beams for own in beam.indices)

    def derivatives(
        self, q: Array, compiled: bool, wrench: Array | None = None
    ) -> tuple[dict[str, Array], Array]:
        """Inputs of a program at postures q (N, n), and verdicts on the postures (N,).

        With `compiled`, segments of beams and struts use machine code, else NumPy arrays.
        The wrench (1 or N, 6) is that which struts carry.
        """
        count, n = q.shape
        # Sums over all potentials; without dense ones they are not made.
        sums = _Sums(
            np.zeros((count, 1)),
            np.zeros((0, n)),
            np.zeros((0, n, n)),
            np.full(count, PLAIN),
        )
        inputs = {"energies": sums.energies}
        if self.is_dense:
            sums = sums._replace(
                gradients=np.zeros((count, n)), hessians=np.zeros((count, n, n))
            )
            # Springs with laws of their own, then potentials of any kind, then struts.
            for j, law in self.laws.items():
                x = q[:, j] - (0.0 if self.rest is None else self.rest[j])
                energy, torque, stiffness = law.evaluate(x)
                sums.energies[:, 0] += energy
                sums.gradients[:, j] += torque
                sums.hessians[:, j, j] += stiffness
            self._add_loose(q, sums)
            if self.struts is not None:
                self._add_struts(self.struts, q, wrench, compiled, sums)
            inputs |= {
                "gradients": sums.gradients,
                "hessians": sums.hessians.reshape(count, n * n),
            }
        # Beams keep theirs in the links' own coordinates.
        if self.beams:
            energy, gradient, hessian = segments_of_many(self.beams, q, compiled)
            sums.energies[:, 0] += energy
            inputs["segment_gradients"] = np.ascontiguousarray(
                gradient.reshape(count, -1)
            )
            inputs["segment_hessians"] = np.ascontiguousarray(hessian.reshape(count, -1))
        return inputs, sums.verdicts

    def _add_loose(self, q: Array, sums: _Sums) -> None:
        energies, gradients, hessians, verdicts = sums
        for i in range(len(q) if self.loose else 0):
            posture = self.mechanism.at(q[i])
            for potential in self.loose:
                try:
                    terms = potential.evaluate(posture)
                except (ArithmeticError, ValueError, RuntimeError):
                    verdicts[i] = FALLBACK
                    break
                energies[i] += terms.energy
                gradients[i] += terms.gradient
                hessians[i] += terms.hessian
            H = hessians[i]
            if np.abs(H - H.T).max() > _MAX_ASYMMETRY * np.abs(H).max():
                verdicts[i] = FALLBACK

    def _add_struts(
        self,
        struts: FlexureStruts,
        q: Array,
        wrench: Array | None,
        compiled: bool,
        sums: _Sums,
    ) -> None:
        energies, gradients, hessians, verdicts = sums
        poses = se3.from_roll_pitch_yaw(q[:, :3], q[:, 3:]) @ self.mechanism.frame_offset
        borne = -gradients - self._of_forces(poses)
        if wrench is not None:
            borne += wrench_in_body(wrench, poses, self.load.at, self.axes)
        # If rest lengths are chosen, struts without an equilibrium cannot carry the
        # wrench.
        left = UNBALANCED if self.is_loaded or not struts.is_complete else FALLBACK

        def add(own: Array, at: StrutStates) -> None:
            energies[own, 0] += at.energy.sum(axis=1)
            gradients[own] += at.wrench.sum(axis=1)
            hessians[own] += at.stiffness.sum(axis=1)
            is_found, is_stable = (
                np.asarray(each).all(axis=1) for each in (at.is_found, at.is_stable)
            )
            found = np.where(is_stable, PLAIN, FALLBACK)
            verdicts[own] = np.maximum(verdicts[own], np.where(is_found, found, left))

        others = np.arange(len(q))
        # The code is for struts alone, without a compliant base or platform.
        if compiled and type(struts) is FlexureStruts:
            doubtful = []
            for rows in np.split(others, range(_COMPILED_ROWS, len(q), _COMPILED_ROWS)):
                at, known = strut_states(struts, poses[rows], borne[rows], self.is_loaded)
                add(rows[known], at)
                doubtful.append(rows[~known])
            others = np.concatenate(doubtful)
        for start in range(0, len(others), _STACKED_ROWS):
            own = others[start : start + _STACKED_ROWS]
            add(own, struts.many(poses[own], borne[own], self.is_loaded))

    def _of_forces(self, poses: Array) -> Array:
        """Gradients (N, 6) of dead forces on the platform."""
        gradients = np.zeros((len(poses), 6))
        for force, point in zip(self.forces, self.points, strict=True):
            W = np.concatenate([np.zeros(3), force])
            gradients -= wrench_in_body(W, poses, point.tolist(), "world")
        return gradients
