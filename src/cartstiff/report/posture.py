"""A result as text for people."""

from __future__ import annotations

import numpy as np

from cartstiff.errors import joined
from cartstiff.geometry import se3
from cartstiff.mechanisms.weighed import weighed
from cartstiff.stiffness.compute import PostureStiffness
from cartstiff.stiffness.tensor import format_matrix

__all__ = ["describe"]

_MEANINGS = {
    "A": "wrench components in the moving body frame (Cartan minus; asymmetric under load)",
    "B": "symmetric part of K^A, independent of both frames (bi-invariant)",
    "K": "force components in inertial directions (kinematic; depends on the frame's origin)",
    "F": "Hessian in the joint coordinates, carried to the body (flat)",
    "load": "tangent under the load: what an added wrench meets",
}


def describe(result: PostureStiffness, analysis: str = "") -> str:
    """Everything about a result, for reading; the text of its analysis stands before the notes."""
    elastic = result.elastic
    mechanism, units = elastic.mechanism, elastic.units
    lines = [
        f"{elastic.name}: {mechanism.kind}, body frame {mechanism.frame!r}, "
        f"lengths in {units.length}, forces in {units.force}",
        "",
        "Posture",
    ]
    for coordinate, value in zip(mechanism.coordinates, result.q, strict=True):
        if coordinate.is_length:
            lines.append(f"  {coordinate.name:<28} {value:>12.6g} {units.length}")
        else:
            lines.append(
                f"  {coordinate.name:<28} {value:>12.6g} rad {np.degrees(value):>10.4g} deg"
            )
    position, angles = result.pose[:3, 3], se3.roll_pitch_yaw(result.pose)
    lines += [
        "",
        "Pose of the body frame",
        f"  position          {_row(position)} {units.length}",
        f"  roll, pitch, yaw  {_row(np.degrees(angles))} deg",
        "",
    ]
    if result.wrench is not None:
        W = result.shown_wrench(result.wrench)
        lines += [
            "Load: the wrench that holds the body here, in its own frame",
            f"  moment  {_row(W[:3])} {units.moment}",
            f"  force   {_row(W[3:])} {units.force}",
        ]
        if not result.wrench_is_known:
            lines.append("  what the structure carries is not known, and taken as zero")
        if result.is_loaded:
            x, y, z = result.load.at
            at = f"({x:g}, {y:g}, {z:g}) {units.length}" if any(result.load.at) else "the origin"
            lines.append(f"  taken as a {result.load.kind} load at {at}: {result.load.words}")
    lines.append(weighed(elastic).text)
    if np.isfinite(result.stored_energy):
        lines.append(f"  energy stored in the springs {result.stored_energy:.6g} {units.moment}")
    outside = result.energy - result.stored_energy
    if np.isfinite(outside) and outside != 0.0:
        lines.append(f"  potential of gravity and loads {outside:.6g} {units.moment}")
    lines.append("")
    if any(K is not None for K in result.matrices.values()):
        lines += [
            "Stiffness: rows wrench (moment, force), columns motion (rotation, translation)",
            f"  units [[{units.moment}/rad, {units.force}], "
            f"[{units.force}/rad, {units.force}/{units.length}]]",
            "",
        ]
    matrices = dict(result.matrices)
    if result.is_loaded:
        matrices["load"] = result.tangent
    for name, K in matrices.items():
        if K is None:
            continue
        asymmetry = float(np.abs(K - K.T).max())
        size = float(np.abs(K).max())
        verdict = (
            "symmetric"
            if asymmetry <= 1e-9 * size
            else f"asymmetric, |K - K^T| up to {asymmetry:.4g}"
        )
        lines += [
            f"K^{name}  {_MEANINGS[name]}; {verdict}",
            *format_matrix(K, [""] * 6).split("\n"),
            "",
        ]
    if result.reduction.stiffness is None and result.reduction.reachable is not None:
        lines += _reachable(result)
    if analysis:
        lines += analysis.split("\n")
    if result.notes:
        lines.append("Notes")
        lines += [f"  [{note.code}] {note.message}" for note in result.notes]
    return joined(lines).rstrip()


def _reachable(result: PostureStiffness) -> list[str]:
    """The stiffness on the motions that exist, where the 6x6 matrix does not."""
    motions, K = result.reduction.reachable, result.reduction.reachable_stiffness
    if motions is None or K is None:
        return []
    rank = motions.shape[1]
    lines = [f"Stiffness on the {rank} motion(s) that exist, as twists (rotation, translation)"]
    lines += [f"  {i + 1}: {_row(twist)}" for i, twist in enumerate(motions.T)]
    return [*lines, *format_matrix(K, [""] * rank).split("\n"), ""]


def _row(values: np.ndarray) -> str:
    return " ".join(f"{0.0 if abs(v) < 1e-12 else v:>12.6g}" for v in values)
