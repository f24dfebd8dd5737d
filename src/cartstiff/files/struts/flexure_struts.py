r"""Struts between flexure joints, each condensed to a function of the body's pose.

From the ground to the body: a flexure, a rigid bar that a spring (the actuator's) lets
slide along its own line, a flexure. A flexure is three slides and three hinges about x,
y, z in a row, z along the strut as made; each has a spring, or is rigid. With the
coordinates q of one strut, their stiffnesses k, the pose T of its end and its body
Jacobian J, the energy at a given pose is least where

    k (q - q_0) = J^T W,    T(q) = T_wanted,                                           (1)

W being the wrench of the body on the strut. Its stiffness there is a Schur complement,

    K^B = (J H^-1 J^T)^-1,    H = diag k - S_W,    S_W[a, b] = 1/2 W . [J_a, J_b],     (2)

a before b: the equation of `cartstiff.core.stiffness.reduction` for a redundant chain. H
need not have an inverse: (2) is a block of the inverse of ``[[H, -J^T], [J, 0]]``, the
matrix of Newton's steps for (1). The strut has buckled if H is not positive on the
motions that leave its end in place.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.errors import InputError, NoEnergyError, UndefinedError
from cartstiff.core.geometry import se3
from cartstiff.core.geometry.jets import cosines_of, sines_of
from cartstiff.core.potentials.contract import (
    POSE,
    Evaluation,
    Named,
    Number,
    Parts,
    PosePotential,
    Posture,
)
from cartstiff.core.potentials.line_springs import LineSprings, lines_of_many
from cartstiff.core.potentials.springs import Chosen

_ENDS = ("lower", "upper")


def _name(end: str, word: str) -> str:
    return f"offset.{end}" if word == "offset" else f"stiffness.{end}.{word}"


#: Index of the sliding coordinate.
SLIDE = 6
_MAX_STEPS = 40
#: Round-off of residuals, which are sums of a few dozen products, in units of their
#: terms.
ROUNDINGS = 64.0


class Flexure(NamedTuple):
    """Stiffnesses of a flexure joint, infinite if rigid, and its place on the strut.

    Attributes
    ----------
    axial, shear : float
        Force per length, along the strut and across it.
    bending, torsion : float
        Moment per rad, about the axes across the strut and about its own.
    offset : float
        From the strut's end to the flexure's middle, along the strut.
    """

    axial: float
    shear: float
    bending: float
    torsion: float
    offset: float = 0.0

    @property
    def springs(self) -> list[float]:
        """Stiffnesses of the slides along x, y, z and the hinges about x, y, z."""
        return [
            self.shear,
            self.shear,
            self.axial,
            self.bending,
            self.bending,
            self.torsion,
        ]

    @property
    def length_powers(self) -> dict[str, float]:
        """See `cartstiff.core.potentials.contract.rescaled`."""
        return {"axial": -1.0, "shear": -1.0, "bending": 1, "torsion": 1, "offset": 1}


class StrutStates(NamedTuple):
    """Struts at poses: energies (N, m), wrenches (N, m, 6), K^B (N, m, 6, 6), in M;
    rest lengths.

    `is_found` and `is_stable` (N, m): whether (1) was solved, and whether the strut is
    not buckled.
    """

    energy: Array
    wrench: Array
    stiffness: Array
    rest_length: Array
    is_found: Any
    is_stable: Any


@dataclass(frozen=True, kw_only=True, eq=False)
class FlexureStruts(LineSprings):
    """Struts with a flexure joint at either end.

    `stiffness` is that of the straight strut from end to end, including its flexures, and
    `rest_length` its length without load, so that a straight strut has the force of a
    line spring.

    Attributes
    ----------
    lower, upper : Flexure
        Joints at the ground and at the body.
    home : ndarray (m, 4, 4)
        Poses in the body frame M of the struts' upper ends as made, z along the strut.
    feet : ndarray (m, 4, 4)
        Poses in F of their lower ends, likewise.
    made : ndarray (m,)
        Lengths as made.
    """

    lower: Flexure
    upper: Flexure
    home: Array
    feet: Array
    made: Array

    gives_aside = True
    length_powers: ClassVar = {
        **LineSprings.length_powers,
        "feet": POSE,
        "home": POSE,
        "made": 1,
        "lower": 0,
        "upper": 0,
    }

    def __post_init__(self) -> None:
        super().__post_init__()
        if np.any(self.slides <= 0.0):
            raise InputError(
                "a strut cannot be stiffer than its flexures",
                expected=f"below {1.0 / self._soft:g}",
                got=float(self.stiffness.max()),
            )
        if np.any(self.bars <= 0.0):
            raise InputError(
                "a strut's flexures pass each other",
                expected=f"offsets that add up to less than {self.made.min():g}",
                got=self.lower.offset + self.upper.offset,
            )

    @staticmethod
    def between(
        anchors: Array,
        points: Array,
        T_F_M: Array,
        axial: Array,
        lower: Flexure,
        upper: Flexure,
        rest_length: Array,
    ) -> FlexureStruts:
        """Struts as made between points of F and points of M (m, 3) with the
        body at a pose.
        """
        ends = se3.placed(T_F_M, points)
        along = ends - anchors
        made = np.linalg.norm(along, axis=1)
        z = along / made[:, None]
        # x is horizontal if possible, so that equal struts about z are symmetric.
        x = np.cross([0.0, 0.0, 1.0], z)
        upright = np.linalg.norm(x, axis=1) < numerics.NEGLIGIBLE_DISTANCE
        x[upright] = [1.0, 0.0, 0.0]
        x -= (x * z).sum(axis=1, keepdims=True) * z
        x /= np.linalg.norm(x, axis=1, keepdims=True)
        R = np.stack([x, np.cross(z, x), z], axis=-1)
        feet = np.array([se3.pose(r, a) for r, a in zip(R, anchors, strict=True)])
        home = np.array([se3.pose(r, b) for r, b in zip(R, ends, strict=True)])
        soft = 1.0 / lower.axial + 1.0 / upper.axial
        return FlexureStruts(
            anchors=anchors,
            points=points,
            stiffness=1.0 / (1.0 / axial + soft),
            rest_length=rest_length,
            lower=lower,
            upper=upper,
            feet=feet,
            made=made,
            home=se3.inverse(T_F_M) @ home,
        )

    @property
    def cost(self) -> int:  # type: ignore[override]
        """That of their searches."""
        return 64 * len(self.made)

    def numbers(
        self,
        names: Sequence[str],
        slides: Sequence[bool] | None = None,  # noqa: ARG002
    ) -> dict[str, Number]:
        """Springs and rest lengths of the struts, and the flexures at either end of all.

        "stiffness.LEG", "stiffness.lower.bending", "offset.upper"; rigid parts have no
        number.
        """
        found = {
            f"stiffness.{n}": Number(k, -1.0, 1.0, True)
            for n, k in zip(names, self.slides.tolist(), strict=True)
        }
        for end in _ENDS:
            flexure: Flexure = getattr(self, end)
            powers = flexure.length_powers
            for word, x in flexure._asdict().items():
                is_place = word == "offset"
                power = powers.get(word, 0.0)
                found[_name(end, word)] = Number(x, power, not is_place, not is_place)
        rest = zip(names, self.rest_length.tolist(), strict=True)
        found |= {f"rest.{n}": Number(x, 1.0) for n, x in rest}
        return {name: x for name, x in found.items() if np.isfinite(x.value)}

    def compliances(
        self,
        names: Sequence[str],  # noqa: ARG002
        slides: Sequence[bool],  # noqa: ARG002
    ) -> dict[str, Number]:
        """None: measurements of struts with flexures are refused."""
        self.require_ideal_joints("springs that are found by measurements")
        return {}

    def with_numbers(self, values: Mapping[str, float], names: Sequence[str]) -> Self:
        """The same with some of `numbers` changed."""
        own = self.numbers(names)
        if values.keys().isdisjoint(own):
            return self
        at = {name: values.get(name, x.value) for name, x in own.items()}
        slides = [at.get(f"stiffness.{name}", np.inf) for name in names]
        rest = [at.get(f"rest.{name}", np.nan) for name in names]
        lower, upper = (
            Flexure(
                **{
                    word: at.get(_name(end, word), x)
                    for word, x in getattr(self, end)._asdict().items()
                }
            )
            for end in _ENDS
        )
        soft = 1.0 / lower.axial + 1.0 / upper.axial
        stiffness = 1.0 / (1.0 / np.array(slides) + soft)
        other = replace(self, lower=lower, upper=upper)
        return other.replaced(stiffness, np.array(rest))

    def at_points(self, anchors: Array, points: Array) -> Self:
        """Struts made at the same pose of the body between other points;
        rest lengths stay.
        """
        ends = np.array(self.feet)
        ends[:, :3, 3] += self.made[:, None] * ends[:, :3, 2]
        T_F_M = (ends @ se3.inverse(self.home))[0]
        joints, rest = (self.lower, self.upper), self.rest_length
        other = FlexureStruts.between(anchors, points, T_F_M, self.slides, *joints, rest)
        own = ("anchors", "points", "feet", "home", "made")
        return replace(self, **{name: getattr(other, name) for name in own})

    def parts(
        self,
        posture: Posture,  # noqa: ARG002
        coordinates: Sequence[Named],  # noqa: ARG002
        names: Sequence[str],  # noqa: ARG002
    ) -> Parts:
        """Undefined: see the error."""
        what = "the flexures deflect too, not only the legs"
        raise UndefinedError(what, code="no-shares")

    def lines_and_rest(self, posture: Posture) -> None:
        """None: their forces are not along lines."""

    def require_ideal_joints(self, what: str) -> None:
        """Refuse: `what` needs legs that are lines between ideal joints.

        Raises
        ------
        InputError
        """
        raise InputError(
            f"{what} take legs for springs along lines between ideal joints",
            expected="legs with a stiffness",
            got="struts with flexures",
        )

    def shifted(self, posture: Posture, which: Sequence[int], less: Array) -> Self:  # noqa: ARG002
        """The same: their forces follow from rest lengths."""
        return self

    @property
    def _soft(self) -> float:
        return 1.0 / self.lower.axial + 1.0 / self.upper.axial

    @property
    def slides(self) -> Array:
        """Stiffnesses (m,) of the sliding springs alone."""
        with np.errstate(divide="ignore"):
            return np.asarray(1.0 / (1.0 / self.stiffness - self._soft))

    @property
    def bars(self) -> Array:
        """Lengths (m,) between the flexures' middles, as made."""
        return self.made - self.lower.offset - self.upper.offset

    @property
    def springs(self) -> Array:
        """Stiffnesses (m, 13) of all coordinates of each strut, infinite if rigid."""
        k = np.empty((len(self.made), 13))
        k[:, :SLIDE], k[:, SLIDE], k[:, SLIDE + 1 :] = (
            self.lower.springs,
            self.slides,
            self.upper.springs,
        )
        return k

    @property
    def ends(self) -> Array:
        """Poses (m, 4, 4) in M of the upper flexures' middles."""
        return self.home @ se3.inverse(se3.pose(translation=[0, 0, self.upper.offset]))

    def wanted(self, T_a_b: Array) -> Array:
        """Poses (N, m, 4, 4) of the upper flexures' middles relative to the
        lower ones'.
        """
        low = self.feet @ se3.pose(translation=[0, 0, self.lower.offset])
        return se3.inverse(low) @ T_a_b[:, None] @ self.ends

    @np.errstate(
        over="ignore", invalid="ignore"
    )  # a diverging search has `is_found` False
    def solve(
        self,
        T_a_b: Array,
        rest_length: Array,
        gradient: Array | None = None,
        free: Any = None,
    ) -> StrutStates:
        """States of the struts at poses (N, 4, 4) with rest lengths (N, m),
        from (1) and (2).

        With `gradient` (N, 6) the rest lengths of the struts `free` (m,) are changed, as
        little as possible if these are more than six, until all struts together exert the
        gradient.
        """
        N, m = len(T_a_b), len(self.made)
        k = self.springs
        free_q = np.isfinite(k[0])
        n, slide = int(free_q.sum()), int(free_q[:SLIDE].sum())
        k[:, ~free_q] = 0.0
        rest = np.zeros((N, m, 13))
        rest[..., SLIDE] = rest_length - self.made
        q = rest.copy()
        ends = self.ends
        wanted = self.wanted(T_a_b)
        # Scaled by roots of energies, so that soft springs keep their digits beside stiff
        # ones.
        whole = np.sqrt(self.slides) * self.made
        x_size = 1.0 / np.sqrt(np.where(k > 0.0, k, whole[:, None] ** 2))[:, free_q]
        W_size = whole[:, None] * np.repeat([1.0, 1.0 / float(self.made.mean())], 3)
        W = np.zeros((N, m, 6))
        M = np.zeros((N, m, n + 6, n + 6))
        right = np.zeros((N, m, n + 6))
        missed, settled = np.full((N, m), np.inf), np.zeros((N, m), bool)
        gradients = np.zeros((N, m, n + 6))
        gradients[..., slide] = self.slides * x_size[:, slide]
        to_end = se3.adjoint_of_inverse(ends)
        back = to_end.swapaxes(-1, -2)
        diagonal = np.arange(n)
        for _ in range(_MAX_STEPS):
            R, p, J = strut_end(q, self.bars)
            J = J[..., free_q]
            turning = -se3.chain_curvature(J, W) * x_size[:, :, None] * x_size[:, None, :]
            M[..., :n, :n] = turning
            M[..., diagonal, diagonal] += k[:, free_q] * x_size**2
            G = J * W_size[:, :, None] * x_size[:, None, :]
            M[..., :n, n:], M[..., n:, :n] = -G.swapaxes(-1, -2), G
            pull = (J.swapaxes(-1, -2) @ W[..., None])[..., 0]
            right[..., :n] = (pull - (k * (q - rest))[..., free_q]) * x_size
            right[..., n:] = se3.log(se3.inverse(se3.pose(R, p)) @ wanted) * W_size
            now = np.abs(right).max(axis=-1)
            short = np.zeros((N, 6))
            if gradient is not None:
                short = gradient - (back @ W[..., None])[..., 0].sum(axis=1)
                now = np.maximum(now, np.abs(short / W_size[0]).max(axis=1)[:, None])
            ended = (now >= 0.5 * missed) & (now <= numerics.ROUNDOFF * whole)
            ended |= now <= ROUNDINGS * numerics.EPSILON * whole
            # Struts that exert a gradient together must all have converged.
            settled |= ended if gradient is None else ended.all(axis=1, keepdims=True)
            if np.all(settled | ~np.isfinite(now)):
                break
            missed = np.fmin(missed, now)
            steps = solved(M, np.stack([right, gradients], axis=-1))
            if gradient is not None:
                G = (back @ (steps[..., n:, 1] * W_size)[..., None])[..., 0][:, free]
                W_next = W + steps[..., n:, 0] * W_size
                short = gradient - (back @ W_next[..., None])[..., 0].sum(axis=1)
                G = np.nan_to_num(G.swapaxes(-1, -2) / W_size[0][:, None])
                inverse = np.linalg.pinv(G, rcond=numerics.RANK)
                shift = np.zeros((N, m))
                shift[:, free] = (inverse @ (short / W_size[0])[..., None])[..., 0]
                rest[..., SLIDE] += np.where(settled, 0.0, shift)
                steps[..., 0] += steps[..., 1] * shift[..., None]
            step = np.where(settled[..., None], 0.0, steps[..., 0])
            q[..., free_q] += step[..., :n] * x_size
            W += step[..., n:] * W_size
        inverse = solved(M, np.broadcast_to(np.eye(n + 6), M.shape))
        K = inverse[..., n:, n:] * W_size[:, :, None] * W_size[:, None, :]
        # Without the curvature by the load, H is positive.
        stable = (np.linalg.norm(turning, axis=(-1, -2)) < 0.5) & np.all(
            k[:, free_q] > 0.0
        )
        if not stable.all():
            M[..., :n, n:] *= -1.0
            values = np.linalg.eigvalsh(np.nan_to_num(M[~stable]))
            stable[~stable] = (values > 0.0).sum(axis=-1) == n
        return StrutStates(
            0.5 * (k * (q - rest) ** 2).sum(axis=-1),
            (back @ W[..., None])[..., 0],
            back @ (0.5 * (K + K.swapaxes(-1, -2))) @ to_end,
            self.made + rest[..., SLIDE],
            settled,
            stable,
        )

    def balancing(
        self,
        posture: Posture,
        gradient: Array,
        size: float,  # noqa: ARG002
        every: bool,
    ) -> Chosen:
        """The same struts with rest lengths at which they exert a gradient (6,)
        at a posture.

        Raises
        ------
        InputError
            If no rest lengths of the open struts do.
        """
        T, _ = posture.relative(self.frame_a, self.frame_b)
        at = self.many(T[None], gradient[None], every)
        if not at.is_found.all():
            raise InputError(
                "no rest lengths of the struts balance this load at this pose",
                expected="a load that the struts can carry, and a pose near that at "
                "which they were made",
            )
        return Chosen(replace(self, rest_length=at.rest_length[0]))

    def many(self, T_a_b: Array, gradients: Array, every: bool = False) -> StrutStates:
        """`solve` at poses (N, 4, 4), the open or all rest lengths chosen to
        exert gradients.

        As for lines, open struts that cannot balance one another have their preload
        instead.
        """
        rest, free = self.start_rest(T_a_b, every)
        if not free.any():
            return self.solve(T_a_b, rest)
        return self._bearing_by(T_a_b, rest, gradients, free)

    def start_rest(self, T_a_b: Array, every: bool) -> tuple[Array, Array]:
        """Rest lengths (N, m) at poses, and the struts (m,) of which they are
        to be chosen.

        Those start from the given rest length, or from the length that they have there,
        more than six with their preload.
        """
        held = np.zeros(len(self.made), bool) if every else self.holding()
        free = self.rest_is_free(every) & ~held
        rest = np.broadcast_to(self.rest_length, (len(T_a_b), len(free)))
        if not np.isnan(rest).any():
            return rest, free
        wound = (
            held if self.preload is None or np.count_nonzero(free) <= 6 else held | free
        )
        tensions = np.where(
            wound, np.nan_to_num(self.given_tensions(self.rest_length)), 0.0
        )
        return np.where(np.isnan(rest), self.wound(T_a_b, tensions), rest), free

    def wound(self, T_a_b: Array, tensions: Array) -> Array:
        """Rest lengths (N, m) of straight struts with tensions (m,) at poses."""
        lengths = lines_of_many(T_a_b, self.anchors, self.points).lengths
        return np.asarray(lengths - tensions / self.stiffness)

    def _bearing_by(
        self, T_a_b: Array, rest: Array, gradient: Array, free: Any
    ) -> StrutStates:
        """`solve` with a gradient; found only if `solve` with these rest lengths agrees.

        Struts with large bending have several shapes for one rest length.
        """
        at = self.solve(T_a_b, rest, gradient, free)
        again = self.solve(T_a_b, np.where(at.is_found, at.rest_length, rest))
        difference = np.abs(at.wrench - again.wrench)[..., 3:].max(axis=-1)
        same = difference <= numerics.NEGLIGIBLE_DISTANCE * self.stiffness * self.made
        return at._replace(is_found=at.is_found & again.is_found & same)

    def evaluate(self, posture: Posture) -> Evaluation:
        """Energy, gradient and Hessian at a posture, from the pose and not from
        lengths alone.
        """
        return PosePotential.evaluate(self, posture)

    def exerted(self, posture: Posture) -> Array:
        """What the struts exert on frame b, moments of the flexures included."""
        T, _ = posture.relative(self.frame_a, self.frame_b)
        return -self.solve(T[None], self.rest_length[None]).wrench[0]

    def on_pose(self, T_a_b: Array) -> tuple[float, Array, Array]:
        """Energy, wrench and K^B in components of frame b."""
        at = self.solve(T_a_b[None], self.rest_length[None])
        first = int(np.argmin((at.is_found & at.is_stable)[0])) + 1
        if not at.is_found.all():
            raise NoEnergyError(
                f"the flexures of strut {first} find no balance: they are bent too far",
                code="strut-not-found",
                values={"strut": first},
            )
        if not at.is_stable.all():
            raise NoEnergyError(
                f"strut {first} has buckled: between its flexures it gives way by "
                "itself, and what is left is no stiffness of a balance that lasts",
                code="strut-buckled",
                values={"strut": first},
            )
        return (
            float(at.energy.sum()),
            at.wrench[0].sum(axis=0),
            at.stiffness[0].sum(axis=0),
        )


def solved(M: Array, right: Array) -> Array:
    """Solutions of a stack of linear systems; NaN for singular ones."""
    try:
        return np.linalg.solve(M, right)
    except np.linalg.LinAlgError:
        regular = np.linalg.matrix_rank(np.nan_to_num(M)) == M.shape[-1]
        safe = np.where(regular[..., None, None], M, np.eye(M.shape[-1]))
        return np.where(regular[..., None, None], np.linalg.solve(safe, right), np.nan)


def turned(angles: Array) -> tuple[Array, Array]:
    """Rotations (..., 3, 3) by hinges about x, y, z in a row,
    and their axes at the far end.
    """
    (sx, sy, sz), (cx, cy, cz) = (
        np.moveaxis(f(angles), -1, 0) for f in (sines_of, cosines_of)
    )
    R = np.stack(
        [
            cy * cz,
            -cy * sz,
            sy,
            cx * sz + sx * sy * cz,
            cx * cz - sx * sy * sz,
            -sx * cy,
            sx * sz - cx * sy * cz,
            sx * cz + cx * sy * sz,
            cx * cy,
        ],
        axis=-1,
    ).reshape(*sx.shape, 3, 3)
    zero, one = np.zeros_like(sx), np.ones_like(sx)
    axes = np.stack([cy * cz, sz, zero, -cy * sz, cz, zero, sy, zero, one], axis=-1)
    return R, axes.reshape(*sx.shape, 3, 3)


def strut_end(q: Array, bars: Any) -> tuple[Array, Array, Array]:
    """Rotations and positions of struts' far ends, and their body Jacobians (..., 6, 13).

    The coordinates (..., 13) may be recorded numbers.
    """
    J, beyond = np.zeros((*q.shape[:-1], 6, 13), q.dtype), q[..., 7:10].copy()
    (R1, R2), (axes1, axes2) = turned(np.stack([q[..., 3:6], q[..., 10:13]]))
    # From the lower flexure's middle to the end, along the bar's axes.
    beyond[..., 2] = beyond[..., 2] + q[..., SLIDE] + bars
    back = R2.swapaxes(-1, -2)
    J[..., 3:, :3] = back @ R1.swapaxes(-1, -2)
    J[..., :3, 3:6], J[..., 3:, 3:6] = (
        back @ axes1,
        -(back @ (se3.skew_of(beyond) @ axes1)),
    )
    J[..., 3:, SLIDE] = R2[..., 2, :]
    J[..., 3:, 7:10], J[..., :3, 10:] = back, axes2
    return R1 @ R2, q[..., :3] + (R1 @ beyond[..., None])[..., 0], J
