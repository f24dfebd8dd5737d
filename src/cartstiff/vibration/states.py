"""Free, unstable, fluttering, repeated and massless motions, named with their numbers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cartstiff.geometry.se3 import Array
from cartstiff.notes import Note
from cartstiff.statics.small_motions import Spectrum


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
