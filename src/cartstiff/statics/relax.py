"""The balanced posture of a redundant mechanism, with its end-effector held."""

from __future__ import annotations

from numpy.typing import ArrayLike

from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.statics.equilibrium import equilibrium
from cartstiff.statics.held import Held


def relaxed(elastic: ElasticMechanism, q: ArrayLike | None = None) -> Array:
    """Coordinates to which the self-motion settles while the end-effector stays at its pose.

    Under arbitrary joint torques a redundant arm is not in equilibrium with any wrench at its
    end-effector: it moves along its self-motion until the energy has a minimum over it. There
    ``Z^T grad Phi = 0`` with Z the null space of the Jacobian, and a wrench exists.

    Parameters
    ----------
    elastic : ElasticMechanism
        With the rest positions that make the torques.
    q : array_like (n,), optional
        Where it is let go; default the file's posture.

    Raises
    ------
    ConvergenceError
        If no minimum is found.
    """
    start = elastic.mechanism.closed(elastic.q if q is None else q)
    held = Held.from_pose(start.pose)
    return equilibrium(elastic, q0=start.q, held=held, limits=False).q
