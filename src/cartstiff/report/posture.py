"""A result as text for people."""

from __future__ import annotations

import numpy as np

from cartstiff import numerics
from cartstiff.errors import joined
from cartstiff.geometry import se3
from cartstiff.matrix_names import MATRICES
from cartstiff.mechanisms.elastic import gravity_loads
from cartstiff.mechanisms.limits import beyond_limits
from cartstiff.report.layout import body_frame, wide_row
from cartstiff.stiffness.compute import PostureStiffness
from cartstiff.stiffness.tensor import format_matrix

_SAME = "they are the same here"

#: What to do where springs push along a self-motion and no load has been given.
BALANCING = "--load 0,0,0,0,0,0 (or what acts) chooses rest positions at which the springs balance"


def describe(result: PostureStiffness, analysis: str = "", at_rest: bool = False) -> str:
    """Everything about a result, for reading; the text of its analysis stands before the notes.

    `at_rest` says that the loads are among what gives the stiffness, and W is what acts besides.
    """
    elastic = result.elastic
    mechanism, units = elastic.mechanism, elastic.units
    lines = [
        f"{elastic.name}: {mechanism.kind}, {body_frame(mechanism)}, "
        f"lengths in {units.length}, forces in {units.force}",
        *([] if at_rest else beyond_limits(result.notes)),
        "",
        "Posture",
    ]
    # Searches leave coordinates, and those of a closed chain, to these shares of their sizes.
    noise = numerics.BLANK if result.posture.closure is None else numerics.CONVERGED
    sizes = [result.posture.length if c.is_length else 1.0 for c in mechanism.coordinates]
    q = np.where(np.abs(result.q) <= noise * np.array(sizes), 0.0, result.q)
    for coordinate, value in zip(mechanism.coordinates, q, strict=True):
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
        f"  position          {wide_row(position, result.posture.length)} {units.length}",
        f"  roll, pitch, yaw  {wide_row(np.degrees(angles), np.degrees(1.0))} deg",
        "",
    ]
    lines += load_lines(result, at_rest)
    lines.append(gravity_loads(elastic).text)
    if np.isfinite(result.stored_energy):
        lines.append(f"  energy stored in the springs {result.stored_energy:.6g} {units.moment}")
    outside = _outside(result)
    if np.isfinite(outside) and outside != 0.0:
        lines.append(f"  potential of gravity and loads {outside:.6g} {units.moment}")
    lines.append("")
    if any(K is not None for K in result.matrices.values()):
        lines += [
            "Stiffness: rows wrench (moment, force), columns motion (rotation, translation)",
            "  units [[{rr}, {rt}], [{tr}, {tt}]]".format(**units.blocks),
            "",
        ]
    for names, K in _different(result, at_rest):
        asymmetry = float(np.abs(K - K.T).max())
        verdict = (
            "symmetric"
            if asymmetry <= numerics.SYMMETRY * float(np.abs(K).max())
            else f"asymmetric, |K - K^T| up to {asymmetry:.4g}"
        )
        meaning = MATRICES[names[-1]].words if names[-1] == "load" or len(names) == 1 else _SAME
        lines += [
            f"{' = '.join(f'K^{name}' for name in names)}  {meaning}; {verdict}",
            *format_matrix(K, [""] * 6).split("\n"),
            "",
        ]
    if result.reduction.stiffness is None and result.reduction.reachable is not None:
        lines += _reachable(result, at_rest)
    if analysis:
        lines += analysis.split("\n")
    if result.notes:
        lines.append("Notes")
        lines += [f"  {note}" for note in result.notes]
    return joined(lines).rstrip()


def _outside(result: PostureStiffness) -> float:
    """Potential of gravity and loads; 0 where it is rounding beside their work over natural sizes.

    A weight over the origin of F, say.
    """
    total, works = 0.0, 0.0
    for term in result.elastic.parted_terms()[1]:
        energy, gradient, _ = term.evaluate(result.posture)
        total += energy
        works += float(np.abs(gradient * result.posture.coordinate_lengths).max(initial=0.0))
    return 0.0 if abs(total) <= numerics.BLANK * works else total


def load_lines(result: PostureStiffness, at_rest: bool = False) -> list[str]:
    """The wrench, and what it does while the body moves."""
    if result.wrench is None:
        return []
    units, W = result.elastic.units, result.shown_wrench(result.wrench)
    if at_rest and not W.any():
        return ["Load: part of what follows; nothing else holds the body"]
    what = "the wrench that holds the body here" + (" besides the loads" if at_rest else "")
    if not (W.any() or result.is_loaded) and result.wrench_is_known:
        return ["Load: none; no wrench is needed to hold the body here"]
    lines = [
        f"Load: {what}, in its own frame",
        f"  moment  {wide_row(W[:3])} {units.moment}",
        f"  force   {wide_row(W[3:])} {units.force}",
    ]
    if not result.wrench_is_known:
        lines.append("  what the structure carries is not known, and taken as zero")
    if result.is_loaded and not at_rest:
        x, y, z = result.load.at
        at = f"({x:g}, {y:g}, {z:g}) {units.length}" if any(result.load.at) else "the origin"
        lines.append(f"  taken as a {result.load.kind} load at {at}: {result.load.words}")
    return lines


def _different(result: PostureStiffness, at_rest: bool) -> list[tuple[list[str], np.ndarray]]:
    """The matrices that exist with all their names; what is equal stands once."""
    matrices = dict(result.matrices)
    if result.is_loaded and not at_rest:
        matrices["load"] = result.tangent
    kinds: list[tuple[list[str], np.ndarray]] = []
    for name, K in matrices.items():
        if K is None:
            continue
        for names, other in kinds:
            if np.abs(K - other).max() <= numerics.SYMMETRY * np.abs(K).max():
                names.append(name)
                break
        else:
            kinds.append(([name], K))
    return kinds


def _reachable(result: PostureStiffness, at_rest: bool) -> list[str]:
    """The stiffness on the motions that exist, where the 6x6 matrix does not."""
    motions, K = result.reduction.reachable, result.reduction.reachable_stiffness
    if motions is None or K is None:
        return []
    rank = motions.shape[1]
    if rank == 0:
        return ["No motion exists: nothing that gives moves the body", ""]
    loaded = result.is_loaded and not at_rest
    what = "Stiffness K^B" if loaded else "Stiffness"
    lines = [f"{what} on the {rank} motion(s) that exist, as twists (rotation, translation)"]
    lines += [f"  {i + 1}: {wide_row(twist)}" for i, twist in enumerate(motions.T)]
    lines += [*format_matrix(K, [""] * rank).split("\n"), ""]
    change = motions.T @ result.change_by_load @ motions
    if loaded and np.abs(change).max() > numerics.SYMMETRY * np.abs(K).max():
        lines.append("K^load on them, the tangent under the load: what an added wrench meets")
        lines += [*format_matrix(K + change, [""] * rank).split("\n"), ""]
    return lines
