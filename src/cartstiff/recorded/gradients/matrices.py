"""Derivatives of stiffness, pose and frequencies by each parameter,
exact where they can be.

The matrices, the pose, and stiffness and masses on the motions are recorded with their
derivatives, at a held posture and of what comes to rest again; the rest are difference
quotients.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property

import numpy as np

from cartstiff.answer.analysis.parameters import Quotient, largest
from cartstiff.answer.analysis.tolerances import Tolerances, Uncertain, shares_of
from cartstiff.answer.vibration.modes import Modes, stiffness_under_load
from cartstiff.answer.vibration.sensitivities import (
    MATRICES,
    Accuracy,
    Sensitivities,
    change_of_squares,
    in_hertz,
    modes_of,
)
from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.checked_call import checked
from cartstiff.core.errors import CartstiffError, UndefinedError, one_line
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.statics.rest import Equilibrium
from cartstiff.core.statics.small_motions import kinetic_matrix
from cartstiff.core.stiffness.applied_load import DEAD_AT_ORIGIN
from cartstiff.core.stiffness.compute import PostureStiffness
from cartstiff.recorded.chains import ChainCase
from cartstiff.recorded.gradients.exact import Recorded, parameters_of
from cartstiff.recorded.plans import Case

#: Outputs that are differentiated; those on the motions exist with masses only.
_OUTPUTS = ("stiffness_B", "stiffness_F", "wrench", "pose")
_ON_MOTIONS = ("lagrangian", "kinetic", "motion")


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
        Function from values of the file's parameters, in its units, to the mechanism, for
        derivatives by these: ``lambda values: cartstiff.load(file, parameters=values)``.
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
    question = _Question(subject, modes, reread)
    names = [
        name
        for name in question.parameters.nominal
        if geometry or name.partition(".")[0] in ("stiffness", "mass")
    ]
    return question.derivatives(names, progress)


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
    >>> from cartstiff.analysis import Tolerances
    >>> state = cartstiff.equilibrium(cartstiff.load("stewart-gough"), wrench=[0, 0, 0, 0, 0, -50])
    >>> spread = cartstiff.accuracy(state, Tolerances(length=0.01))
    >>> spread.deviations["pose"][3:].round(3).tolist()
    [0.046, 0.043, 0.019]
    """  # noqa: E501
    modes = subject if isinstance(subject, Modes) else modes_of(subject)
    if modes is not None and modes.spectrum.is_complex:
        modes = None
    question, tolerances = _Question(subject, modes), tolerances or Tolerances()
    known = question.parameters.result.elastic.identified
    if level is None:
        level = 0.95 if known is None else known.level
    uncertain = Uncertain.of(question.parameters, tolerances)
    factor = uncertain.factor(level)
    if given is None or not set(uncertain.names) <= set(given.names):
        given = question.derivatives(uncertain.names, progress)
    kept = [name for name in uncertain.names if name in given.names]
    if not kept:
        raise UndefinedError(given.left_out or "", code="no-parameters")
    uncertain, rows = uncertain.among(kept), [given.names.index(name) for name in kept]
    nominal, slopes = {}, {}
    if question.state is not None:
        nominal["pose"], slopes["pose"] = question.state.displacement, given.pose[rows]
    for name, rates in given.stiffness.items():
        if (K := question.result.matrices[name]) is not None:
            nominal[name], slopes[name] = K, rates[rows]
    if modes is not None:
        nominal["frequencies"] = modes.frequencies
        slopes["frequencies"] = given.frequencies[rows]
    deviations, shares = {}, {}
    for quantity, rates in slopes.items():
        parts = uncertain.variances(rates)
        if quantity == "frequencies" and modes is not None:
            # Repeated frequencies split under any change: each of them gets the variances
            # of all, which bound tr F^2 of the form F that splits them.
            for alike in modes.groups:
                parts[:, alike] = parts[:, alike].sum(axis=1, keepdims=True)
        deviations[quantity], shares[quantity] = shares_of(parts)
    return Accuracy(
        uncertain.names,
        uncertain.deviations,
        nominal,
        deviations,
        shares,
        level,
        factor,
        given.left_out if tolerances.moves else None,
    )


#: Arrays of an answer that are differentiated: K^A, K^B, K^K, K^F (4, 6, 6); the pose (4,
#: 4); K and M on the modes (k, k).
_Parts = list[Array]


class _Question:
    """What is differentiated, at a held posture or of what comes to rest again."""

    def __init__(
        self,
        subject: Modes | PostureStiffness | Equilibrium,
        modes: Modes | None,
        reread: Callable[[Mapping[str, float]], ElasticMechanism] | None = None,
    ) -> None:
        if isinstance(subject, Modes):
            subject = subject.held if subject.state is None else subject.state
        self.subject, self.modes = subject, modes
        self.state = subject if isinstance(subject, Equilibrium) else None
        #: The stiffness, for an equilibrium with the part of its loads.
        self.result = subject.stiffness if isinstance(subject, Equilibrium) else subject
        self.parameters = parameters_of(subject, reread)

    @cached_property
    def here(self) -> _Parts:
        """The arrays at the nominal values."""
        return self.seen(self.subject)

    def derivatives(
        self, names: Sequence[str], progress: Callable[[int, int], None] | None
    ) -> Sensitivities:
        """Derivatives by parameters, and reasons for gaps."""
        modes, parameters = self.modes, self.parameters
        if modes is not None and modes.spectrum.is_complex:
            raise UndefinedError(
                "modes that flutter have no sensitivities", code="flutter"
            )
        # Exact where recorded, else a difference quotient; what has neither is said.
        found, rows = self._exact(names), dict[str, Quotient]()
        missing = [] if (left_out := parameters.left_out) is None else [left_out]
        for done, name in enumerate(names, 1):
            try:
                rows[name] = found.get(name) or parameters.quotient(
                    name, self.seen, self.here
                )
            except CartstiffError as error:
                missing.append(f"{name} is not varied: {one_line(str(error), 200)}")
            if progress is not None:
                progress(done, len(names))
        errors = np.array([row.error for row in rows.values()])
        told = self._told(list(rows), [row.slopes for row in rows.values()], errors)
        matrices, poses, squares = told
        return Sensitivities(
            tuple(rows),
            np.array([parameters.value(name) for name in rows]),
            {letter: matrices[:, i] for i, letter in enumerate(MATRICES)},
            poses,
            squares,
            squares if modes is None else in_hertz(modes, squares),
            errors,
            tuple(parameters.is_angle(name) for name in rows),
            "; ".join(missing) or None,
        )

    def _told(
        self, names: Sequence[str], slopes: Sequence[_Parts], errors: Array
    ) -> tuple[Array, Array, Array]:
        """Derivatives (p, ...) of the matrices, the pose (6,) and omega^2 (k,),
        what is below round-off 0.
        """
        modes, p = self.modes, len(names)
        dK, dT, dH, dM = (
            np.array([row[i] for row in slopes]).reshape(p, *x.shape)
            for i, x in enumerate(self.here)
        )
        natural = np.array([self.parameters.size(name) for name in names])
        turns = se3.unskew(dT[:, :3, :3] @ self.subject.pose[:3, :3].T)
        poses = np.hstack([turns, dT[:, :3, 3]])
        squares = np.zeros((p, 0)) if modes is None else change_of_squares(modes, dH, dM)
        # Entries below the round-off of their matrix are 0.
        error = np.minimum(errors, numerics.NEGLIGIBLE_DIFFERENCE)
        noise = np.maximum(numerics.ROUNDOFF_OF_SUMS, error) / natural
        columns = np.repeat([1.0, self.result.posture.length], 3)
        energies = np.outer(columns, columns)
        finite = np.isfinite(dK)
        changed = np.max(np.abs(dK) * energies, (2, 3), where=finite, initial=0.0)
        there = np.array([largest(K * energies) for K in self.here[0]])
        size = noise[:, None] * np.maximum(natural[:, None] * changed, there)
        dK[np.abs(dK) * energies <= size[:, :, None, None]] = 0.0
        poses[np.abs(poses) <= np.multiply.outer(noise, columns)] = 0.0
        if modes is not None:
            least = np.maximum(noise, numerics.PRINTED_AS_ZERO / natural)
            squares[
                np.abs(squares) <= np.multiply.outer(least, np.abs(modes.squares))
            ] = 0.0
        return dK, poses, squares

    def seen(self, subject: PostureStiffness | Equilibrium) -> _Parts:
        """The arrays of an answer; motions keep the closures."""
        modes = self.modes
        # The matrices and the pose; without masses that is all.
        result = subject.stiffness if isinstance(subject, Equilibrium) else subject
        dK = np.array([result[name] for name in MATRICES])
        if modes is None:
            return [dK, subject.pose, np.zeros((0, 0)), np.zeros((0, 0))]
        posture = subject.posture
        # Stiffness and mass of all coordinates, seen from the unvaried modes: their first
        # change is that of the frequencies.
        if isinstance(subject, Equilibrium):
            K, C = subject.full_stiffness
        else:
            K = stiffness_under_load(subject)[0]
            C = None if posture.closure is None else posture.closure.jacobian
        M = kinetic_matrix(posture, result.elastic.terms(), result.elastic.units)
        M = np.zeros_like(K) if M is None else M
        right = modes.basis @ modes.spectrum.vectors
        left = modes.basis @ modes.spectrum.left
        # Closures move with the parameter: the modes are brought back onto them.
        if C is not None and len(C):
            columns = posture.coordinate_lengths
            back = columns[:, None] * np.linalg.pinv(
                (C * columns).astype(float), rcond=numerics.RANK
            )
            right, left = right - back @ (C @ right), left - back @ (C @ left)
        return [dK, subject.pose, left.T @ K @ right, left.T @ M @ right]

    # -- by the recorded arithmetic

    def _exact(self, names: Sequence[str]) -> dict[str, Quotient]:
        """Derivatives by parameter of what is recorded.

        None where the posture is not plainly regular.
        """
        modes, result = self.modes, self.parameters.result
        recorded = Recorded.of(self.parameters, self.state, modes is not None)
        if isinstance(recorded, str):
            return {}
        # What exists here, and for modes the matrices on the free motions.
        outputs = tuple(n for n in _OUTPUTS if self._exists(n.removeprefix("stiffness_")))
        to_motions = _to_motions(result, recorded.case)
        if modes is not None:
            if to_motions is None:
                return {}
            outputs += _ON_MOTIONS
        m = 6 if to_motions is None else len(to_motions)
        found = recorded.slopes(outputs, names, self.state is not None, m)
        if found is None:
            return {}
        kept, slopes, here = found
        stacks = self._parts(slopes, here, recorded, to_motions)
        return {
            name: Quotient([x[i] for x in stacks], 0.0, np.nan)
            for i, name in enumerate(kept)
        }

    def _exists(self, name: str) -> bool:
        """Whether an output exists; at rest K^F is that of all loads."""
        is_own = self.state is None or name != "F"
        return is_own and (name not in MATRICES or self.result.matrices[name] is not None)

    def _parts(
        self,
        slopes: Mapping[str, Array],
        here: Mapping[str, Array],
        recorded: Recorded,
        to_motions: Array | None,
    ) -> _Parts:
        """Derivatives (p, ...) of the arrays of an answer."""
        modes, kind = self.modes, recorded.case.load
        dW, dT = slopes["wrench"], slopes["pose"]
        none = np.full((len(dW), 6, 6), np.nan)
        dB = slopes.get("stiffness_B", none)
        if self.state is None:
            kind = self.result.load
            of_A, of_K, _ = np.moveaxis(DEAD_AT_ORIGIN.changes(dW), 1, 0)
            each = [dB + of_A, dB, dB + of_K, slopes.get("stiffness_F", none)]
            dK = np.stack(each, axis=1)
        else:
            # With the loads among the energies no wrench is left: all matrices agree.
            all_alike = (dB + kind.change(dW))[:, None]
            dK = np.where(np.isnan(self.here[0]), np.nan, all_alike)
        if modes is None or to_motions is None:
            nothing = np.zeros((len(dW), 0, 0))
            return [dK, dT, nothing, nothing]
        # The tangent under the load on the motions, H + J^T D J, and its derivative.
        J, dJ = here["motion"], slopes["motion"]
        D, dD = (kind.change(W) for W in (here["wrench"], dW))
        H = slopes["lagrangian"] + J.T @ dD @ J + dJ.swapaxes(1, 2) @ D @ J + J.T @ D @ dJ
        right = to_motions @ modes.basis @ modes.spectrum.vectors
        left = to_motions @ modes.basis @ modes.spectrum.left
        return [dK, dT, left.T @ H @ right, left.T @ slopes["kinetic"] @ right]


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
