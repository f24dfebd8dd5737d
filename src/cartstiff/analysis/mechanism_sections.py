r"""What an added wrench does to a mechanism at a posture, and joint springs for a wanted stiffness.

Deflection, under any connection X: ``dq = (H_W + J^T D J)^-1 J^T dW`` with D = K^X - K^B gives
``J dq = (K^X)^-1 dW``. The connection says what the present load does meanwhile: "load", what it
was said to do; A, it follows the body; K, its force at M's origin keeps its direction. Without load
all are one.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.analysis.congruence import joint_stiffness
from cartstiff.analysis.deflection import (
    Deflection,
    compliance_deflection,
    joint_shares,
    spring_shares,
)
from cartstiff.analysis.matrices import as_symmetric
from cartstiff.analysis.plain import Notes, plain
from cartstiff.arrays import read_only
from cartstiff.errors import UndefinedError
from cartstiff.geometry.connections import NAMED
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.platform import PlatformPosture
from cartstiff.potentials.beams import Beam
from cartstiff.potentials.flexure_struts import FlexureStruts
from cartstiff.potentials.line_springs import LineSprings, second_derivative
from cartstiff.potentials.springs import CoupledSprings, JointSprings
from cartstiff.stiffness.compute import PostureStiffness


def change_from_symmetric(r: PostureStiffness, name: str) -> Array:
    """K^X - K^B: what the connection adds under the load; zero without one."""
    if name == "load":
        return r.change_by_load
    base, K = r.matrices["B"], r.matrices.get(name)
    if base is not None and K is not None:
        return K - base
    if name not in NAMED or r.wrench is None:
        return np.zeros((6, 6))
    return NAMED["B"].wrench_term(r.wrench) - NAMED[name].wrench_term(r.wrench)


def deflection_section(
    r: PostureStiffness, name: str, added: Array | None, acts_at: Array, point: Array, notes: Notes
) -> dict[str, Any] | None:
    """Linear deflection ``(K^X)^-1 dW`` at a point of the body, under a wrench at another.

    Parameters
    ----------
    r : PostureStiffness
        The posture.
    name : str
        The connection X.
    added : ndarray (6,) or None
        Wrench in the axes of M about `acts_at`; None for the load, at its own point.
    acts_at, point : ndarray (3,)
        In M.
    notes : Notes
        Takes the reason why there is none.
    """
    found = deflection_found(r, name, added, acts_at, point, notes)
    if found is None:
        return None
    return {
        **plain(found.whole),
        "wrench": found.added,
        "wrench_about_origin": found.whole.wrench,
        "acts_at": found.acts_at,
        "connection": name,
        **(found.shares or {"kind": None, "shares": None}),
    }


class FoundDeflection(NamedTuple):
    """What `deflection_section` tells."""

    whole: Deflection
    added: Array
    acts_at: Array
    shares: dict[str, Any] | None


def deflection_found(
    r: PostureStiffness, name: str, added: Array | None, acts_at: Array, point: Array, notes: Notes
) -> FoundDeflection | None:
    """The numbers of `deflection_section`, with the same parameters."""
    if added is None:
        if r.wrench is None or not r.is_loaded:
            return None
        whole_wrench, acts_at = r.wrench, np.array(r.load.at)
        added = whole_wrench - _about_origin(acts_at, whole_wrench[3:])
    else:
        whole_wrench = added + _about_origin(acts_at, added[3:])
    C = r.at().compliances[name]
    if C is None:
        reason = UndefinedError("no compliance exists here", code="no-compliance")
        notes.add(reason, "deflection")
        return None
    whole = compliance_deflection(C, whole_wrench, point)
    shares = notes.attempt("shares of the deflection", _shares, r, name, whole)
    return FoundDeflection(_without_rounding(whole, r.posture.length), added, acts_at, shares)


def _without_rounding(deflection: Deflection, length: float) -> Deflection:
    """A motion with zeros for what is rounding beside the rest, angles times the length."""
    twist, displacement = deflection.twist.tolist(), deflection.displacement.tolist()
    sizes = [*(length * abs(x) for x in twist[:3]), *map(abs, twist[3:] + displacement)]
    if min(sizes) > (noise := numerics.ROUNDING * max(sizes)):
        return deflection
    scaled, moved = np.array(sizes[:6]), np.array(sizes[6:])
    return replace(
        deflection,
        twist=read_only(np.where(scaled > noise, deflection.twist, 0.0)),
        displacement=read_only(np.where(moved > noise, deflection.displacement, 0.0)),
    )


def _about_origin(point: Array, force: Array) -> Array:
    """Wrench (6,) that a force at a point adds to its moment about the origin."""
    (x, y, z), (a, b, c) = point.tolist(), force.tolist()
    return np.array([y * c - z * b, z * a - x * c, x * b - y * a, 0.0, 0.0, 0.0])


def _shares(r: PostureStiffness, name: str, whole: Deflection) -> dict[str, Any]:
    """Each joint's or leg's part, with its name and unit kind."""
    springs, posture = r.elastic.springs, r.posture
    if isinstance(springs, FlexureStruts):
        raise UndefinedError("flexures share the deflection with the legs", code="no-shares")
    if isinstance(posture, PlatformPosture) and isinstance(springs, LineSprings):
        k = np.where(springs.is_taut(posture.lines.lengths), springs.stiffness, 0.0)
        legs = spring_shares(posture.lines.lines @ whole.twist, k, whole)
        rows = [
            {"name": leg, "elongation": e, "force": f, "energy": u, "share": s, "is_length": True}
            for leg, e, f, u, s in zip(
                r.elastic.spring_names,
                legs.elongation.tolist(),
                legs.force.tolist(),
                legs.energy.tolist(),
                legs.share.tolist(),
                strict=True,
            )
        ]
        return {"kind": "springs", "shares": rows, "load_share": legs.load_share}
    coordinates = r.elastic.mechanism.coordinates
    if posture.closure is None and not posture.coordinates_are_pose:
        J = posture.motion.jacobian
        W = np.zeros(6) if r.wrench is None else r.wrench
        H = r.evaluation.hessian - posture.motion.curvature(W)
        # The same change of connection in the joints: J (H_W + J^T D J)^-1 J^T = (K^B + D)^-1.
        H = H + J.T @ change_from_symmetric(r, name) @ J
        shares = joint_shares(J, H, whole.wrench, whole.point)
        rows = [
            {
                "name": c.name,
                "motion": shares.motion[i],
                "is_length": c.is_length,
                "twist": shares.twists[:, i],
                "displacement": shares.displacements[:, i],
                "energy": shares.energy[i],
                "share": shares.share[i],
            }
            for i, c in enumerate(coordinates)
        ]
        return {"kind": "joints", "shares": rows, "load_share": 0.0}
    motion = r.motion_under(whole.wrench, change_from_symmetric(r, name))
    rows, stiffness, elongations = [], [], []
    if isinstance(springs, JointSprings):
        k = np.diag(springs.evaluate(posture).hessian)
        for j in np.flatnonzero(k):
            rows.append({"name": coordinates[j].name, "is_length": coordinates[j].is_length})
            stiffness.append(k[j])
            elongations.append(motion[j])
    for link in r.elastic.potentials:
        if not isinstance(link, (CoupledSprings, Beam)):
            continue
        # Along its own deflection a link is one spring, of that much turn and displacement.
        at = link.indices.ravel()
        x = motion[at]
        size = float(np.linalg.norm(x)) or 1.0
        hessian = link.evaluate(posture).hessian[np.ix_(at, at)]
        rows.append({"name": f"{link.link or coordinates[at[0]].name} (link)", "is_length": None})
        stiffness.append(float(x @ hessian @ x) / size**2)
        elongations.append(size)
    if not rows:
        raise UndefinedError("no springs share the deflection", code="no-shares")
    parts = spring_shares(elongations, stiffness, whole)
    for i, row in enumerate(rows):
        row |= {
            "elongation": parts.elongation[i],
            "force": parts.force[i],
            "energy": parts.energy[i],
            "share": parts.share[i],
        }
    return {"kind": "springs", "shares": rows, "load_share": parts.load_share}


def target_section(r: PostureStiffness, target: ArrayLike) -> dict[str, Any]:
    """Joint or leg stiffness that gives a desired K^B in M under the present load."""
    K, W = as_symmetric(target, "target stiffness"), r.wrench
    if W is None:
        raise UndefinedError("no load balances this posture", code="unbalanced")
    posture, springs = r.posture, r.elastic.springs
    n = posture.motion.jacobian.shape[1]
    gradient, hessian = np.zeros(n), np.zeros((n, n))
    for term in r.elastic.terms(springs=False):
        _, g, h = term.evaluate(posture)
        gradient, hessian = gradient + g, hessian + h
    if isinstance(posture, PlatformPosture) and isinstance(springs, LineSprings):
        J = r.jacobian
        if isinstance(springs, FlexureStruts):
            J = None
        if J is None or len(posture.lines.lengths) != 6:
            raise UndefinedError(
                "leg stiffnesses follow from a stiffness only for six independent legs",
                code="kf-undefined",
            )
        tension = np.linalg.solve(posture.lines.lines.T, W - gradient)
        own = second_derivative(posture.lines, r.elastic.mechanism.points, tension)  # type: ignore[attr-defined]
        joint_springs = joint_stiffness(K, J, W, load_term=-J.T @ (own + hessian) @ J)
        names, torque, lengths = r.elastic.spring_names, tension, [True] * 6
    elif posture.closure is None and not posture.coordinates_are_pose:
        J = posture.motion.jacobian
        joint_springs = joint_stiffness(K, J, W, load_term=posture.motion.curvature(W) - hessian)
        torque = joint_springs.torque - gradient
        names = r.elastic.names
        lengths = [c.is_length for c in r.elastic.mechanism.coordinates]
    else:
        raise UndefinedError(
            "joint stiffnesses for a target are found for serial arms and six-legged platforms",
            code="kf-undefined",
        )
    answer: dict[str, Any] = {"joints": names, "are_lengths": lengths, **plain(joint_springs)}
    return answer | {"desired": K, "torque": torque}
