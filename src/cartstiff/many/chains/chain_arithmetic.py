r"""The arithmetic of a serial chain, any number of joints, on recording numbers.

Twists J_C of the joints are found in C, the frame of a joint, from it outward and inward. For six
coordinates C stands in the middle of the chain: the axes beside it are constant, the next ones
depend on one angle each, and the outermost on half of the angles, so that much of J_C is zero
whatever the posture and is never computed. Else C is the body frame M. In coordinates of one kind,
with L[a, b] = W . [J_a, J_b] for a behind b, else 0, which does not depend on the frame, and with
H_L = H - S_W, S_W = -1/2 (L + L^T),

    n = 6:  J_C A = Ad(T_C_M),  W = A^T g,  K^F = A^T H A,  K^B = K^F + A^T L A - 1/2 Omega
    n > 6:  J^T = Q R,  Q^T H_L Q = [[a, b], [b^T, c]],
            K^B = R^-1 (a - b c^-1 b^T) R^-T,  W = R^-1 (Q^T g)_6
    n < 6:  J = Q R with lengths scaled,  W = Q R^-T g
    any n:  C^B = J H_L^-1 J^T

which is the reduction of `cartstiff.stiffness.reduction` without its singular value decomposition.
"""

from __future__ import annotations

from collections.abc import Collection
from functools import lru_cache

import numpy as np

from cartstiff import numerics
from cartstiff.geometry.se3 import Array
from cartstiff.many.algebra import (
    below,
    congruence,
    in_pairs,
    is_zero,
    largest,
    norm_squared,
    positive_factor,
    reflections,
    symmetric_product,
    upper_inverse,
    zeros,
)
from cartstiff.many.arithmetic import (
    ENGINE,
    JACOBIAN_CONDITION,
    PLAIN,
    STIFFNESS_CONDITION,
    UNBALANCED,
    add_under_load,
    changed_compliance,
    connections,
    equilibrated_squares,
    holds_soft_directions,
    limited,
    scaled_inverse,
    unsymmetric_part,
)
from cartstiff.many.chains.chain_numbers import ChainCase, ChainNumbers, against, curvature_of
from cartstiff.many.chains.chain_twists import ChainConstants
from cartstiff.many.tape import Scalar, Tape, absolute, larger, pick, square_root
from cartstiff.numerics import BALANCE, ROUNDING

#: Least pivot of the Hessian, as a share of its diagonal entry: what is lost is four digits.
_SHARE = numerics.LOST_ERROR
#: Most that factors of mixed signs may exceed the entries of their row.
_GROWTH = 100.0
#: Most that one step of Newton's method may change an inverse: it leaves the square of that.
_LOST_TO_PIVOTS = numerics.LAST_DIGITS**0.5
#: Least pivot of the self-motion's stiffness, and least size of what it leaves, as shares of the
#: largest entry, that are trusted.
_PIVOT = numerics.LOST_ERROR


@lru_cache(maxsize=64)
def _middle(constants: ChainConstants) -> int:
    """The joint in whose frame the Jacobian of six coordinates is inverted with least effort."""
    counts = {}
    for joint in range(1, len(constants.screws) // 6 + 1):
        tape = Tape()
        chain = ChainNumbers(tape, ChainCase(constants, None), joint)
        chain.inverse()
        counts[joint] = len(tape.operations)
    return min(counts, key=lambda joint: counts[joint])


def _six(chain: ChainNumbers) -> tuple[Array, Array, Array]:
    """W, K^B and K^F of six coordinates."""
    A = chain.inverse()
    W = chain.load()
    if W is None:
        W = A.T @ chain.gradient
    K_F = congruence(A, chain.hessian)
    if chain.mimic is not None:
        return W, congruence(A, chain.lagrangian(W)), K_F
    return W, symmetric_product(A.T, -_curved(chain, A, W), K_F + unsymmetric_part(W)), K_F


def _curved(chain: ChainNumbers, A: Array, W: Array) -> Array:
    """``-L A`` with L the lower triangle of J^T Omega J, without diagonal, and ``A = J^-1``.

    As J^T Omega J A = J^T Omega = N, row a of L A is sum_(b < a) L[a, b] A_b as well as
    N_a - sum_(b >= a) (N J)[a, b] A_b. Joints near the body have sparse twists in M: their half of
    the rows takes the second form, and of all pairs of joints only those within a half are needed,
    in C those of the first.
    """
    half = 3
    curved = zeros(6, 6)
    J, kinematics = chain.J, chain.kinematics
    S = curvature_of(kinematics.J[:, :half], kinematics.wrench(W * 2.0))
    for a in range(half):
        for b in range(a):
            curved[a] = curved[a] + A[b] * S[a, b]
    for a in range(half, 6):
        curved[a] = minus_N = against(J[:, a], W)
        for b in range(a + 1, 6):
            curved[a] = curved[a] - A[b] * (minus_N @ J[:, b])
    return curved


def _redundant(chain: ChainNumbers) -> tuple[Array, Array]:
    """W and K^B of more than six joints, the energy least over the self-motion."""
    n, columns = chain.n, chain.columns
    Q = reflections((chain.J * columns).T)
    inverse_R = upper_inverse(Q.R)
    chain.squared_condition = chain.condition(Q.R, inverse_R)
    regular = limited(chain.squared_condition, JACOBIAN_CONDITION**2)
    W = chain.load()
    balanced: Scalar = PLAIN
    if W is None:
        gradient = chain.gradient * columns
        turned = Q.apply_transposed(gradient)
        W = inverse_R @ turned[:6]
        noise = largest(chain.hessian * columns * columns[:, None]) * ROUNDING
        limit = largest(gradient) * BALANCE + noise
        felt = square_root(norm_squared(turned[6:]))
        # The engine's basis of the self-motion is another: its largest entry is only bounded.
        balanced = pick(felt, limit * 0.5, PLAIN, pick(limit * (2.0 * n), felt, UNBALANCED, ENGINE))
    H = chain.lagrangian(W) * columns * columns[:, None]
    turned_H = Q.conjugate(H)
    L, inverses, pivots = positive_factor(turned_H[6:, 6:])
    reached = below(L, turned_H[6:, :6])
    S = turned_H[:6, :6] - congruence(reached, np.diag(inverses))
    limit = largest(H) * _PIVOT
    stable: Scalar = PLAIN
    for pivot in pivots:
        stable = larger(stable, pick(limit, pivot, PLAIN, ENGINE))
    stable = larger(stable, pick(limit * limit, norm_squared(S), PLAIN, ENGINE))
    # An unbalanced posture has no H_L; whatever else is doubtful goes to the engine.
    verdict = pick(balanced, 0.5, larger(balanced, stable), balanced)
    verdict = pick(regular, 0.5, verdict, ENGINE)
    chain.verdict = pick(chain.verdict, 0.5, verdict, ENGINE)
    return W, congruence(inverse_R.T, S)


def _through_compliance(chain: ChainNumbers) -> tuple[Array, Array]:
    """W, which is known, and K^B of more than six motions: the inverse of their compliance."""
    W = chain.load()
    if W is None:
        raise ValueError("the wrench of more than six motions is not known beforehand")
    C, verdict = _softness(chain, chain.lagrangian(W))
    K, condition = scaled_inverse(C, 1.0 / chain.length)
    verdict = larger(verdict, limited(condition, STIFFNESS_CONDITION**2))
    chain.verdict = larger(chain.verdict, verdict)
    chain.squared_condition = condition
    return W, K


def _deficient(chain: ChainNumbers) -> Array:
    """W of least norm of fewer than six joints."""
    columns, length = chain.columns, chain.length
    scaled = chain.J * columns
    scaled[3:] = scaled[3:] / length
    Q = reflections(scaled)
    inverse_R = upper_inverse(Q.R)
    condition = norm_squared(Q.R) * norm_squared(inverse_R)
    verdict = limited(condition, JACOBIAN_CONDITION**2)
    W = chain.load()
    if W is None:
        w = zeros(6)
        w[: chain.n] = inverse_R.T @ (chain.gradient * columns)
        W = Q.apply(w)
        W[3:] = W[3:] / length
    chain.verdict = larger(chain.verdict, verdict)
    chain.squared_condition = condition
    return W


def _compliances(
    chain: ChainNumbers, W: Array, arrays: dict[str, Array], wanted: Collection[str]
) -> Scalar:
    """Put ``C^X = J (H_L + J^T D J)^-1 J^T`` into `arrays`, D = K^X - K^B; the verdict on them."""
    names = [name for name in "ABKF" if f"compliance_{name}" in wanted]
    verdict: Scalar = PLAIN
    if not names:
        return verdict
    unloaded = all(is_zero(w) for w in W)
    # Six coordinates leave no self-motion whose balance hangs on a sign.
    signed = chain.n == 6 and not (chain.is_closed or chain.case.singular)
    H = chain.hessian if unloaded else chain.lagrangian(W)
    C, verdict = _softness(chain, H, signed)
    for name in names:
        if name == "F":
            if not chain.has_chart:
                continue
            C_F, doubt = (C, PLAIN) if unloaded else _softness(chain, chain.hessian, signed)
            arrays["compliance_F"], verdict = C_F, larger(verdict, doubt)
        elif name == "B" or unloaded:
            arrays[f"compliance_{name}"] = C
        else:
            D = connections(zeros(6, 6), W)[name]
            arrays[f"compliance_{name}"], doubt = changed_compliance(
                C, D, chain.length, numerics.PLAIN_CHANGE
            )
            verdict = larger(verdict, doubt)
    return verdict


def _softness(chain: ChainNumbers, H: Array, signed: bool = False) -> tuple[Array, Scalar]:
    """``J H^-1 J^T`` and the verdict on it; `signed` admits an H that is not positive.

    Of a positive H the sum over k of ``L_ak^2 d_k`` is its diagonal entry; where signs are mixed,
    that of their sizes says what the factors lose for want of pivoting. Where that is much, one
    step of Newton's method, ``X (2 - H X)``, squares what is lost, as long as it is little. It is
    not taken elsewhere: what H has next to its softest motion the factors know better.
    """
    L, inverses, pivots = positive_factor(H)
    C = congruence(below(L, chain.J.T), np.diag(inverses))
    verdict: Scalar = PLAIN
    if not signed:
        for a, pivot in enumerate(pivots):
            verdict = larger(verdict, pick(H[a, a] * _SHARE, pivot, PLAIN, ENGINE))
        return C, verdict
    sizes = np.array([absolute(pivot) for pivot in pivots], object)
    scaled = H * chain.columns / chain.columns[:, None]
    for a in range(len(H)):
        grown = sizes[: a + 1] @ (L[a, : a + 1] * L[a, : a + 1])
        verdict = larger(verdict, pick(grown, largest(scaled[a]) * _GROWTH, PLAIN, ENGINE))
        verdict = larger(verdict, pick(grown * _SHARE, sizes[a], PLAIN, ENGINE))
    X = congruence(below(L, np.eye(len(H))), np.diag(inverses))
    step = symmetric_product(X, np.eye(len(H)) - H @ X, zeros(*H.shape))
    size, inverse_size = equilibrated_squares(H, X + step)
    known = limited(size * inverse_size, numerics.WELL_CONDITIONED**2)
    change = equilibrated_squares(H, step)[1]
    known = larger(known, pick(change, inverse_size * _LOST_TO_PIVOTS**2, PLAIN, ENGINE))
    return C + congruence(chain.J.T, step) * verdict, pick(verdict, 0.5, PLAIN, known)


def chain_motion(tape: Tape, constants: ChainConstants) -> tuple[Array, Array]:
    """Pose (4, 4) and body Jacobian (6, n)."""
    chain = ChainNumbers(tape, ChainCase(constants, None), len(constants.screws) // 6)
    return chain.pose(), chain.J


def chain_arrays(tape: Tape, case: ChainCase, wanted: Collection[str]) -> dict[str, Array]:
    """What of the outputs exists, among it all that is wanted, and "verdict" on the posture."""
    joints = len(case.constants.screws) // 6
    if case.singular:
        return _singular_arrays(ChainNumbers(tape, case, joints), wanted)
    is_six = len(case.constants.is_length) == 6 and not case.rigid
    chain = ChainNumbers(tape, case, _middle(case.constants) if is_six else joints)
    return arrays_of(chain, wanted)


def _singular_arrays(chain: ChainNumbers, wanted: Collection[str]) -> dict[str, Array]:
    """What exists where rank is lost, and "looked_at": what tells that it is.

    That is the scaled Jacobian (6, n), the gradient (n,) and the largest entry of the Hessian, in
    natural sizes of the coordinates that give. The wrench and the compliances are those of a known
    load.
    """
    scaled = chain.J * chain.columns
    scaled[3:] = scaled[3:] * (1.0 / chain.length)
    sizes = chain.columns * chain.columns[:, None]
    looked_at = [*scaled.ravel(), *(chain.gradient * chain.columns), largest(chain.hessian * sizes)]
    arrays = {
        "pose": chain.pose(),
        "jacobian": chain.J_q,
        "energy": np.array([chain.energy], object),
        "looked_at": in_pairs(np.array(looked_at, object)),
    }
    W, verdict = chain.load(), chain.verdict
    if W is not None:
        arrays["wrench"], chain.has_chart = W, False
        # Else a self-motion may cost nothing, or buckle.
        verdict = larger(verdict, _softness(chain, chain.lagrangian(W))[1])
        verdict = larger(verdict, _compliances(chain, W, arrays, wanted))
    arrays["verdict"] = np.array([verdict], object)
    return arrays


def arrays_of(chain: ChainNumbers, wanted: Collection[str]) -> dict[str, Array]:
    """`chain_arrays` of a chain."""
    arrays: dict[str, Array] = {
        "pose": chain.pose(),
        "jacobian": chain.J_q,
        "energy": np.array([chain.energy], object),
    }
    stiffness: dict[str, Array] = {}
    if chain.n < 6:
        W = _deficient(chain)
    elif chain.n == 6:
        W, K_B, K_F = _six(chain)
        stiffness = {**connections(K_B, W), "F": K_F}
    elif chain.is_closed or chain.case.settled:
        W, K_B = _through_compliance(chain)
        stiffness = connections(K_B, W)
    else:
        W, K_B = _redundant(chain)
        stiffness = connections(K_B, W)
    if not chain.has_chart:
        stiffness.pop("F", None)
    arrays["wrench"] = W
    arrays.update({f"stiffness_{name}": K for name, K in stiffness.items()})
    if "frames" in wanted:
        arrays["frames"] = chain.kinematics.frames()
    if "hessian" in wanted:
        arrays |= {"hessian": chain.hessian, "lagrangian": chain.lagrangian(W)}
        arrays["length"] = np.array([chain.length], object)
    if chain.case.bodies is not None:
        arrays |= {
            "kinetic": chain.kinetic(chain.case.bodies),
            "motion": chain.J,
            "lagrangian": chain.lagrangian(W),
        }
    verdict = _compliances(chain, W, arrays, wanted)
    add_under_load(arrays, wanted, chain.length)
    if stiffness:
        verdict = larger(verdict, holds_soft_directions(stiffness["B"], wanted))
    # What does not balance stays so, whatever its stiffness would be.
    both = larger(chain.verdict, verdict)
    arrays["verdict"] = np.array([pick(chain.verdict, 1.5, both, chain.verdict)], object)
    if "noteworthy" in wanted and stiffness and "compliance_B" in arrays:
        H = chain.lagrangian(W)
        L, inverses, _ = positive_factor(H)
        softness = congruence(below(L, np.eye(chain.n)), np.diag(inverses))
        pairs = (H, softness), (stiffness["B"], arrays["compliance_B"])
        arrays["noteworthy"] = chain.noteworthy(*pairs)
    return arrays
