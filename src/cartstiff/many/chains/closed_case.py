"""Which closed chains have recorded arithmetic, and what it is made for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cartstiff import numerics
from cartstiff.errors import ConvergenceError
from cartstiff.geometry.se3 import Array
from cartstiff.many.chains.closed_chain import ClosedCase
from cartstiff.many.chains.settling import settles
from cartstiff.many.chains.spring_laws import is_recorded
from cartstiff.many.chains.tree_twists import Tie, TreeConstants, TreeKinematics
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.tree import FixedFrame
from cartstiff.potentials.beams import Beam
from cartstiff.potentials.contract import Potential
from cartstiff.potentials.springs import CoupledSprings, JointSprings

#: Postures that closures are looked at in, and how far from home they are sought (rad, or shares
#: of the characteristic length).
_SAMPLES, _AWAY = 4, 0.1


def _flat(array: Array) -> tuple[float, ...]:
    return tuple(np.ravel(array).tolist())


def tree_constants(chain: Chain) -> TreeConstants:
    """Geometry of a tree with its ties."""
    tree = chain.tree
    places = [(chain.placement(c.frame_a), chain.placement(c.frame_b)) for c in chain.closures]

    def tie(a: FixedFrame, b: FixedFrame, is_weld: bool) -> Tie:
        return Tie(a.joint, _flat(a.T_j_f), b.joint, _flat(b.T_j_f), is_weld)

    return TreeConstants(
        _flat(np.array(tree.placements())),
        _flat(tree.screws()),
        _flat(chain.body.T_j_f),
        None,
        None,
        tuple(bool(x) for x in chain.is_length),
        tuple(int(p) for p in list(tree.model.parents)[1:]),
        chain.body.joint,
        tuple(
            tie(a, b, closure.type == "weld")
            for closure, (a, b) in zip(chain.closures, places, strict=True)
        ),
    )


def _samples(chain: Chain, q: Array) -> list[Array]:
    """Coordinates of a few closed postures about q."""
    samples, rng = list[Array](), np.random.default_rng(0)
    for i in range(3 * _SAMPLES):
        away = chain.at(q).coordinate_lengths * rng.uniform(-_AWAY, _AWAY, q.size)
        away[list(chain.virtual)] = 0.0
        try:
            samples.append(chain.closed(q if i == 0 else q + away).q)
        except ConvergenceError:
            continue
        if len(samples) == _SAMPLES:
            break
    return samples


def _rows(
    constants: TreeConstants, samples: Sequence[Array], held: Sequence[int] = ()
) -> tuple[tuple[tuple[int, ...], ...], list[Array], int] | None:
    """Of each tie the rows that make the closures independent; None where they differ.

    Also these rows at the samples, without columns of what is held, and how many are not zero.
    """
    every, names = list[Array](), list[tuple[int, int]]()
    for at in samples:
        tree = TreeKinematics(constants, at.astype(object))
        rows = list[Array]()
        names = []
        for k, tie in enumerate(constants.ties):
            own = range(0 if tie.is_weld else 3, 6)
            about = None if tie.is_weld else tree.placed(tie.joint_b, tie.T_b)[1]
            twists = np.delete(tree.tied(tie, about), held, axis=1)
            rows += list(twists[list(own)].astype(float))
            names += [(k, i) for i in own]
        every.append(np.array(rows))
    ranks = {numerics.rank(numerics.singular_values(C)) for C in every}
    if len(ranks) != 1:
        return None
    together = np.concatenate(every, axis=1)
    # Rows that are zero everywhere come last; of the others the first that are independent.
    kept = sorted(numerics.first_independent(_reduced(together, ranks.pop()).T).tolist())
    sizes = np.abs(together).max(axis=1)
    acting = int(np.count_nonzero(sizes > numerics.RANK * sizes.max(initial=0.0)))
    every = [C[kept] for C in every]
    if not all(numerics.is_regular(numerics.singular_values(C)) for C in every):
        return None
    return (
        tuple(
            tuple(i for j in kept for t, i in [names[j]] if t == k)
            for k in range(len(constants.ties))
        ),
        every,
        acting,
    )


def _independent(
    chain: Chain, moving: Array, closures: Sequence[Array], freedoms: int
) -> tuple[int, ...]:
    """Coordinates that tell all motions: those held, or else as many without a say in closing.

    Of more actuators than motions none are left out: there are no such coordinates then. The
    closures' columns are the `moving` ones.
    """
    held = [j for j in chain.held if j not in chain.rigid]
    driven = [j for j in chain.actuated or () if j not in chain.rigid]
    if len(held) in (0, freedoms) or len(driven) > freedoms:
        return tuple(held) if len(held) == freedoms else ()
    # What closes the chain depends on the others as far as it goes.
    weights = np.where(np.isin(moving, held), 1e-3, 1.0)
    dependent = numerics.first_independent(closures[0] * weights)
    free = np.setdiff1d(np.arange(len(moving)), dependent)
    each = (C[:, dependent] for C in closures)
    is_regular = all(numerics.is_regular(numerics.singular_values(C)) for C in each)
    return tuple(moving[free].tolist()) if is_regular else ()


def _reduced(rows: Array, rank: int) -> Array:
    """Columns that span those of some rows together, as many as one posture's rank."""
    U, values, _ = np.linalg.svd(rows, full_matrices=False)
    return np.asarray(U[:, :rank] * values[:rank])


def closed_case(
    elastic: ElasticMechanism, chain: Chain, wrench: str
) -> tuple[ClosedCase, tuple[Potential, ...]] | str:
    """The case of a closed chain and potentials that it does not hold, or why there is none."""
    springs = elastic.springs
    if springs is not None and not isinstance(springs, JointSprings):
        return "line springs of a chain have no arithmetic of their own"
    if chain.tree.mimic is not None:
        return "joints that follow others in a closed chain"
    constants = tree_constants(chain)
    way = constants.support(constants.carrier)
    if not any(np.any(np.reshape(constants.screws, (-1, 6))[j, :3]) for j in way):
        return "no joint on the way to the frame turns"
    if not chain.rigid <= set(chain.held):
        return "a rigid joint that is no motor moves while a closed chain is assembled"
    samples = _samples(chain, elastic.q)
    rigid = tuple(sorted(chain.rigid))
    held = tuple(j for j in chain.held if j not in rigid)
    free, shut = (
        _rows(constants, samples, some) if samples else None for some in (rigid, (*held, *rigid))
    )
    if free is None or shut is None:
        return "the closures have no rank that most postures share"
    rows, closures, acting = free
    n, rank = len(constants.is_length), sum(map(len, rows))
    moving = np.setdiff1d(np.arange(n), rigid)
    freedoms = len(moving) - rank
    if not freedoms:
        return "no joint gives"
    is_freed = not held or len(held) > freedoms
    if is_freed and acting > rank:
        return "redundant closures without actuated coordinates are closed posture by posture"
    actuated = chain.actuated
    if actuated is not None and not set(actuated) <= {*held, *rigid}:
        return "the actuated coordinates are not those that are held"

    settled = settles(elastic, wrench)
    still, others = list[tuple[tuple[int, ...], tuple[float, ...]]](), list[Potential]()
    for potential in elastic.potentials:
        if settled:
            others.append(potential)
        elif isinstance(potential, Beam):
            blocks = zip(potential.indices, potential._straight, strict=True)
            still += [(tuple(map(int, at)), _flat(K)) for at, K in blocks]
        elif type(potential) is CoupledSprings:
            still.append((tuple(map(int, potential.indices)), _flat(potential.matrix)))
        else:
            others.append(potential)
    own = np.zeros(n, bool) if springs is None else ~springs.is_passive
    is_open = np.zeros(n, bool) if springs is None else springs.rest_is_free(wrench != "none")
    laws = {} if springs is None else springs.laws
    if any(is_open[j] and not is_recorded(law) for j, law in laws.items()):
        return "the rest position of such a spring is found posture by posture"
    springy = {*np.flatnonzero(own).tolist(), *(j for at, _ in still for j in at), *settled}
    if springy < set(held) and not others and elastic.gravity is None:
        return "coordinates that are held without a spring are judged posture by posture"
    acts = bool(others) or elastic.gravity is not None or bool((own & ~is_open).any())
    # Torques and forces beside each other are shared by way of a length that is not the same there.
    kinds = {constants.is_length[a] for a in np.flatnonzero(is_open)}
    independent = _independent(chain, moving, closures, freedoms)
    if not is_open.any():  # where links give, nothing but them carries a load
        balance = "chosen" if settled else "given" if acts or wrench != "none" else "idle"
    elif settled:
        if not set(np.flatnonzero(is_open).tolist()) <= set(independent):
            return "what springs carry beside links that give is found posture by posture"
        balance = "chosen"
    elif set(np.flatnonzero(is_open).tolist()) == set(independent):
        balance = "chosen"
    elif wrench == "none" and not acts:
        balance = "idle"
    elif not independent and is_open.sum() >= freedoms and len(kinds) == 1:
        balance = "chosen"
    else:
        return "what springs carry beside closures is found posture by posture"
    if freedoms > 6 and balance == "given":
        return "whether self-motions of a closed chain balance is seen posture by posture"
    return ClosedCase(
        constants,
        tuple(is_open.tolist()),
        wrench,
        held=held,
        independent=independent,
        rows=rows,
        shut=shut[0],
        length=float(chain.at(samples[0]).length),
        balance=balance,
        springs=tuple(np.flatnonzero(own).tolist()),
        still=tuple(still),
        settled=settled,
        rigid=rigid,
        has_chart=actuated is not None and len(actuated) == 6 == freedoms,
        is_driven=actuated is not None and set(actuated) == set(independent),
    ), tuple(others)
