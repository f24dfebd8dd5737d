"""Derivatives of stiffness, pose and frequencies by each parameter,
exact where they can be.

At a held posture the matrices, the pose, and stiffness and masses on the motions are
recorded with their derivatives; the rest are difference quotients
(`cartstiff.vibration.sensitivities`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from cartstiff.analysis.tolerances import Tolerances
from cartstiff.arrays import Array
from cartstiff.batch.chains import ChainCase
from cartstiff.batch.gradient import Differentiated
from cartstiff.batch.plans import Case
from cartstiff.checked_call import checked
from cartstiff.gradients.exact import Recorded
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.statics.rest import Equilibrium
from cartstiff.stiffness.applied_load import DEAD_AT_ORIGIN
from cartstiff.stiffness.compute import PostureStiffness
from cartstiff.vibration.modes import Modes
from cartstiff.vibration.sensitivities import (
    Accuracy,
    Home,
    Row,
    Sensitivities,
    deviations_of,
    modes_of,
)

#: Outputs that are differentiated; those on the motions exist with masses only.
_MATRICES = ("stiffness_B", "stiffness_F", "wrench", "pose")
_ON_MOTIONS = ("lagrangian", "kinetic", "motion")
#: Shapes of outputs other than (6, 6); -1 is the number of motions.
_SHAPES = {
    "wrench": (6,),
    "pose": (4, 4),
    "lagrangian": (-1, -1),
    "kinetic": (-1, -1),
    "motion": (6, -1),
}


@checked
def sensitivities(
    subject: Modes | PostureStiffness | Equilibrium,
    *,
    geometry: bool = True,
    reread: Callable[[Mapping[str, float]], ElasticMechanism] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Sensitivities:
    """Derivatives of stiffness, pose and frequencies by every parameter.

    Parameters
    ----------
    subject : Modes, PostureStiffness or Equilibrium
        A held posture, or an equilibrium.
    geometry : bool
        Whether placements of joints, or points of platforms, are varied.
    reread : callable, optional
        Function from values of the file's parameters to the mechanism, for derivatives by
        these: ``lambda values: cartstiff.load(file, parameters=values)``.
    progress : callable, optional
        Called with (done, total) parameters.

    Raises
    ------
    UndefinedError
        For modes that flutter, whose complex frequencies have no derivative here, and for
        a posture without any stiffness.

    Examples
    --------
    >>> import cartstiff
    >>> known = cartstiff.sensitivities(cartstiff.analyse(cartstiff.load("stewart-gough")))
    >>> float(known.stiffness["K"][known.index("stiffness.leg1"), 5, 5].round(3))
    0.496
    """  # noqa: E501
    modes = subject if isinstance(subject, Modes) else modes_of(subject)
    home = Home(subject, reread)
    names = [
        name
        for name in home.parameters.nominal
        if geometry or name.partition(".")[0] in ("stiffness", "mass")
    ]
    rows = {} if home.state is not None else _exact_rows(home, names, modes)
    return home.derivatives(names, modes, rows, progress)


@checked
def accuracy(
    subject: Modes | PostureStiffness | Equilibrium,
    tolerances: Tolerances | None = None,
    *,
    level: float | None = None,
    given: Sensitivities | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Accuracy:
    """Standard deviations of pose, stiffness and frequencies from tolerances,
    to first order.

    Parameters
    ----------
    subject : Modes, PostureStiffness or Equilibrium
        A held posture, whose rest positions follow; or an equilibrium, whose pose has an
        error as well.
    tolerances : Tolerances, optional
        Standard deviations: relative of every spring stiffness, absolute of every length
        and rotation [rad] of the geometry. Without one of the stiffness, measured springs
        have their own. The answer has what follows from them, and what contributes most.
    level : float, optional
        Probability between 0 and 1; default that of the measured springs, else 0.95.
    given : Sensitivities, optional
        Sensitivities of `subject`, if already computed.
    progress : callable, optional
        Called with (done, total) parameters.

    Raises
    ------
    InputError
        For a level outside (0, 1).
    UndefinedError
        If no parameter has a tolerance.

    Examples
    --------
    >>> import cartstiff
    >>> from cartstiff.analysis.tolerances import Tolerances
    >>> state = cartstiff.equilibrium(cartstiff.load("stewart-gough"), wrench=[0, 0, 0, 0, 0, -50])
    >>> spread = cartstiff.accuracy(state, Tolerances(length=0.01))
    >>> spread.deviations["pose"][3:].round(3).tolist()
    [0.046, 0.043, 0.019]
    """  # noqa: E501
    modes = subject if isinstance(subject, Modes) else modes_of(subject)
    if modes is not None and modes.spectrum.is_complex:
        modes = None
    home = Home(subject, tolerances=tolerances or Tolerances())
    if given is not None:
        rows = given.rows()
    elif home.state is None:
        rows = _exact_rows(home, list(home.parameters.named), modes)
    else:
        rows = {}
    return deviations_of(home, modes, level, rows, progress)


@lru_cache(maxsize=8)
def _program(case: Case, names: tuple[str, ...]) -> Differentiated | None:
    """Outputs with their derivatives, recorded once.

    None if one of them does not exist.
    """

    def objective(arrays: Mapping[str, Array]) -> tuple[list[Any], Any]:
        return [x for name in names for x in np.ravel(arrays[name])], 0.0

    try:
        return Differentiated(case, names, objective)
    except KeyError:
        return None


def _exact_rows(home: Home, names: Sequence[str], modes: Modes | None) -> dict[str, Row]:
    """Rows by parameter of what is recorded.

    None where the posture is not plainly regular.
    """
    result = home.result
    load = result.wrench if result._load_is_given else None
    recorded = Recorded.of(
        result, home.parameters.nominal, load, with_inertia=modes is not None
    )
    if isinstance(recorded, str):
        return {}
    outputs = tuple(
        n for n in _MATRICES if n != "stiffness_F" or result.matrices["F"] is not None
    )
    to_motions = _to_motions(result, recorded.case)
    if modes is not None:
        if to_motions is None:
            return {}
        outputs += _ON_MOTIONS
    program = _program(recorded.case, outputs)
    found = None if program is None else program.at(recorded.given)
    if program is None or found is None:
        return {}
    m = 6 if to_motions is None else len(to_motions)
    shapes = [_SHAPES.get(name, (6, 6)) for name in outputs]
    sizes = [tuple(m if n < 0 else n for n in shape) for shape in shapes]
    ends = np.cumsum([np.prod(size) for size in sizes])[:-1]

    def split(flat: Array) -> dict[str, Array]:
        parts = zip(outputs, np.split(flat, ends), sizes, strict=True)
        return {name: part.reshape(size) for name, part, size in parts}

    here, by = split(found.values), recorded.named(found)
    rows = {}
    for name in (name for name in names if name in by):
        parts = _parts(split(by[name]), here, result, modes, to_motions)
        rows[name] = home.row_of(name, parts, [np.zeros_like(x) for x in parts], modes)
    return rows


def _to_motions(result: PostureStiffness, case: Case) -> Array | None:
    """Recorded motions (m, n) of coordinate rates that keep the closures;
    None if not simple.

    Of a platform twists of its body, of a chain its coordinates, of a closed chain those
    that determine the others.
    """
    if not isinstance(case, ChainCase):
        return result.posture.motion.jacobian
    if case.is_closed and not case.independent:
        return None
    kept: Array = np.eye(len(result.q))[case.names]
    return kept


def _parts(
    slopes: Mapping[str, Array],
    here: Mapping[str, Array],
    result: PostureStiffness,
    modes: Modes | None,
    to_motions: Array | None,
) -> list[Array]:
    """Derivatives of K^A, K^B, K^K, K^F; of the pose; of K and M on the modes."""
    dB, dW = slopes["stiffness_B"], slopes["wrench"]
    of_A, of_K, _ = DEAD_AT_ORIGIN.changes(dW)
    none = np.full((6, 6), np.nan)
    dK = np.array([dB + of_A, dB, dB + of_K, slopes.get("stiffness_F", none)])
    if modes is None or to_motions is None:
        return [dK, slopes["pose"], np.zeros((0, 0)), np.zeros((0, 0))]
    # The tangent under the load on the motions, H + J^T D J, and its derivative.
    J, dJ = here["motion"], slopes["motion"]
    D, dD = (result.load.change(W) for W in (here["wrench"], dW))
    H = slopes["lagrangian"] + J.T @ dD @ J + dJ.T @ D @ J + J.T @ D @ dJ
    right = to_motions @ modes.basis @ modes.spectrum.vectors
    left = to_motions @ modes.basis @ modes.spectrum.left
    return [dK, slopes["pose"], left.T @ H @ right, left.T @ slopes["kinetic"] @ right]
