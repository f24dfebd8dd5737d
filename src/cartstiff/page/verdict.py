"""The state of a posture in one line of words, and how serious it is."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from cartstiff import numerics
from cartstiff.geometry.se3 import Array
from cartstiff.stiffness.compute import PostureStiffness

Level = Literal["good", "warning", "bad"]

# Asymmetry below this share of the largest entry is rounding.
_ROUNDING = numerics.SYMMETRY

# Why there is no matrix, the most telling first.
_NO_MATRIX: tuple[tuple[str, Level, str], ...] = (
    ("constraint-singularity", "bad", "Constraint singularity: branches of motion cross here"),
    ("non-regular-redundancy", "bad", "The closures lose rank and block the motion"),
    ("unbalanced", "bad", "Unbalanced: the arm would move by itself, no wrench holds it"),
    ("buckled", "bad", "Buckled: the energy has no minimum along the self-motion"),
    ("strut-buckled", "bad", "A strut has buckled between its flexures"),
    ("strut-not-found", "bad", "The flexures are bent too far: no balance of a strut was found"),
    ("serial-singularity", "bad", "Singular posture: a motion of the end-effector is impossible"),
    ("idle-self-motion", "bad", "A self-motion costs no energy, yet moves the end-effector"),
    (
        "fewer-than-six-freedoms",
        "warning",
        "Fewer than six free motions: only the compliance exists",
    ),
)
NEAR: tuple[tuple[str, Level, str], ...] = (
    ("type-2-singularity", "bad", "Singular posture: the actuators do not hold the body"),
    ("near-constraint-singularity", "warning", "The closures nearly repeat each other"),
    ("singular-stiffness", "warning", "Singular stiffness: one motion costs nothing"),
    ("near-serial-singularity", "warning", "Near a singularity: one motion is almost impossible"),
    ("near-type-2-singularity", "warning", "Near a singularity: one direction is hardly held"),
    ("slack", "warning", "Slack cables carry nothing"),
)
DEFINITE: dict[str, tuple[Level, str]] = {
    "positive": ("good", "Positive definite: every motion is resisted"),
    "positive semidefinite": ("warning", "Positive semidefinite: some motion costs nothing"),
    "indefinite": ("bad", "Indefinite: along some motion the load pushes further away"),
    "negative semidefinite": ("bad", "Not positive along any motion"),
    "negative": ("bad", "Negative definite: no motion is resisted"),
    "zero": ("bad", "Zero stiffness"),
}


def asymmetries(matrices: list[Array]) -> list[float]:
    """Largest entry of K - K^T of each, 0 where it is only rounding."""
    if not matrices:
        return []
    stack = np.array(matrices)
    differences = (stack - stack.swapaxes(1, 2)).max(axis=(1, 2)).tolist()
    largest = np.abs(stack).max(axis=(1, 2)).tolist()
    return [
        difference if difference > _ROUNDING * size else 0.0
        for difference, size in zip(differences, largest, strict=True)
    ]


def verdict(
    result: PostureStiffness, connection: str, matrix: Array | None, definiteness: str | None
) -> dict[str, Any]:
    """Words and level for the shown stiffness matrix.

    Parameters
    ----------
    result : PostureStiffness
        The posture.
    connection : str
        The name of the connection shown.
    matrix : ndarray or None
        The stiffness, None where it does not exist.
    definiteness : str or None
        Definiteness of its symmetric part.

    Returns
    -------
    dict
        "level" ("good", "warning", "bad"), "title" in one line, "code" of the state or None.
    """
    notes = {note.code: note.message for note in result.notes}
    if matrix is None:
        for code, level, title in _NO_MATRIX:
            if code in notes:
                return {"level": level, "title": title, "code": code}
        if connection == "F" and (reason := notes.get("kf-undefined")):
            return {"level": "warning", "title": f"No K^F: {reason}", "code": "kf-undefined"}
        for code, level, title in NEAR:
            if code in notes:
                return {"level": level, "title": title, "code": code}
        return {"level": "bad", "title": "The matrix does not exist here", "code": None}
    level, title = DEFINITE[definiteness or "zero"]
    if level == "bad":
        return {"level": level, "title": title, "code": definiteness}
    for code, near, words in NEAR:
        if code in notes:
            return {"level": near, "title": words, "code": code}
    return {"level": level, "title": title, "code": None if level == "good" else definiteness}
