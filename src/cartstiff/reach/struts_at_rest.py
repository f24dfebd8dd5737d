"""Where struts with flexures come to rest, near the pose that ideal joints would take."""

from __future__ import annotations

from collections.abc import Callable

from cartstiff.errors import ConvergenceError, UndefinedError
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.notes import Note
from cartstiff.potentials.flexure_struts import FlexureStruts
from cartstiff.statics.equilibrium import equilibrium
from cartstiff.stiffness.compute import PostureStiffness, analyse

# Steps of a search that leads to a rest at all are fewer.
_STEPS = 20


def at_rest_with(
    elastic: ElasticMechanism,
    home: Array,
    lengths: Array,
    q: Array,
    stiffness: Callable[[Array], PostureStiffness],
) -> tuple[PostureStiffness, tuple[Note, ...]]:
    """The stiffness of a platform with actuators at leg lengths (m,), at or near a pose q (6,).

    Of legs between ideal joints at q itself. Struts with flexures hold at `home`, where they were
    made, with the actuators where these need no load; from there they are told the lengths. They
    come to rest beside q; where no rest is found, the answer is that at q, with a note. `stiffness`
    is `analyse` at a pose, under the load that is asked for.
    """
    if not isinstance(elastic.springs, FlexureStruts):
        return stiffness(q), ()
    if not elastic.springs.is_complete:
        at_home = elastic.balanced(home).springs
        moved = lengths - elastic.mechanism.at(home).lines.lengths  # type: ignore[attr-defined]
        elastic = elastic.with_springs(rest=at_home.rest + moved)  # type: ignore[union-attr]
    try:
        return equilibrium(elastic, q0=q, iterations=_STEPS).stiffness, ()
    except (ConvergenceError, UndefinedError):
        message = "flexures hold the platform in no balance near this pose: it is ideal joints'"
        return analyse(elastic, q), (Note("struts-not-in-equilibrium", message, {"q": q.tolist()}),)
