r"""The flat connection of a mechanism's own coordinates at one posture:
K^F and its symbols.

The reduction of `cartstiff.core.stiffness.reduction` with the coordinates y of the chart
as the output, mu their force: ``K^F = M^T (H + lam c'' - mu y'') M`` with M the
coordinate rates per twist.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.errors import UndefinedError
from cartstiff.core.geometry import se3
from cartstiff.core.geometry.connections import Connection
from cartstiff.core.mechanisms.contract import MechanismPosture
from cartstiff.core.notes import Note
from cartstiff.core.potentials.contract import IDENTITY, Evaluation, SecondOrderMap
from cartstiff.core.stiffness.reduction import Reduction


@dataclass(frozen=True, eq=False)
class FlatChart:
    """K^F and its parts; all None if it does not exist.

    Attributes
    ----------
    stiffness : ndarray (6, 6) or None
        K^F.
    added : ndarray (n, n) or None
        What the Hessian in the chart, carried to the coordinates of the mechanism, has
        beside that of the energy there.
    to_chart : ndarray (6, 6) or None
        Rates of the chart's coordinates per twist.
    note : Note or None
        Reason why there is none; None also if the stiffness does not exist under any
        connection.
    """

    stiffness: Array | None = None
    added: Array | None = None
    to_chart: Array | None = None
    note: Note | None = None

    @property
    def missing(self) -> UndefinedError:
        """Error for a caller that needs K^F where it does not exist."""
        if self.note is None:
            return UndefinedError("K^F does not exist here", code="kf-undefined")
        return UndefinedError(self.note.message, code=self.note.code)


_NONE: Final = FlatChart()


def flat_chart(
    posture: MechanismPosture, energy: Evaluation, reduction: Reduction, natural: Array
) -> FlatChart:
    """K^F at a posture, or the reason why there is none.

    Parameters
    ----------
    posture : MechanismPosture
        Kinematics.
    energy : Evaluation
        Energy in the coordinates.
    reduction : Reduction
        To the end-effector.
    natural : ndarray, shape (6,)
        Natural sizes of the twist's components.
    """
    rates = reduction.rates
    if reduction.stiffness is None:
        return _NONE  # for the same reason as the other matrices
    chart = posture.chart()
    if isinstance(chart, str):
        return FlatChart(note=Note("kf-undefined", chart))
    if rates is None:
        free = reduction.free
        count = reduction.freedoms if free is None else free.jacobian.shape[1]
        message = (
            f"K^F needs six motions that move the body or cost energy: there are {count}"
        )
        return FlatChart(note=Note("kf-undefined", message))
    if chart is IDENTITY:  # nonsingular, as `rates` exists
        H = energy.hessian
        return FlatChart(rates.T.dot(H).dot(rates), np.zeros_like(H), rates)
    to_chart = chart.jacobian @ rates
    values = numerics.singular_values(to_chart * natural)
    if not numerics.is_regular(values):
        message = "the actuated coordinates do not determine the pose here"
        facts = {"singular_values": values.tolist()}
        return FlatChart(note=Note("type-2-singularity", message, facts))
    added = _added_in(chart, to_chart, rates, posture.closure, energy)
    H = energy.hessian + added
    return FlatChart(rates.T.dot(H).dot(rates), added, to_chart)


def _added_in(
    chart: SecondOrderMap,
    to_chart: Array,
    rates: Array,
    closure: SecondOrderMap | None,
    energy: Evaluation,
) -> Array:
    """`FlatChart.added`: ``lam c'' - mu y''``."""
    mu = np.linalg.solve(to_chart.T, rates.T.dot(energy.gradient))
    added: Array = -chart.curvature(mu)
    if closure is not None:
        balance = chart.jacobian.T @ mu - energy.gradient
        if any(balance.tolist()):
            lam = np.linalg.lstsq(closure.jacobian.T, balance, rcond=numerics.RANK)[0]
            added = added + closure.curvature(lam)
    return added


def flat_connection(
    posture: MechanismPosture, reduction: Reduction, flat: FlatChart
) -> Connection:
    """The flat connection of the chart at a posture, [ZK]_ eq. 47,
    from six probe wrenches.

    ``Gamma[i, j, k] W_k = K^A - K^F`` is linear in W and holds for any potential: each
    basis wrench gives one slice.

    Raises
    ------
    UndefinedError
        If K^F does not exist, with the reason.
    """
    chart, rates, to_chart = posture.chart(), reduction.rates, flat.to_chart
    if to_chart is None or rates is None or isinstance(chart, str):
        raise flat.missing
    symbols = np.empty((6, 6, 6))
    motion = posture.motion
    for k, w in enumerate(np.eye(6)):
        # The linear energy w . log(pose) has gradient J^T w, K^B = 0 and the curvature of
        # J.
        probe = Evaluation(0.0, motion.jacobian.T @ w, motion.curvature(w))
        added = _added_in(chart, to_chart, rates, posture.closure, probe)
        K_F = rates.T @ (probe.hessian + added) @ rates
        symbols[:, :, k] = -0.5 * se3.bracket_form(w) - K_F
    return Connection(
        "F", symbols, "Hessian in the joint coordinates", left_invariant=False, _flat=True
    )
