"""cartstiff: how stiff a robot's end-effector really is, under every affine connection on SE(3).

The names below are loaded when first used, so that importing the package costs nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cartstiff.lazy import lazy_names
from cartstiff.version import __version__

if TYPE_CHECKING:
    from cartstiff.loading import load as load
    from cartstiff.many.postures import Postures as Postures
    from cartstiff.many.postures import analyse_many as analyse_many
    from cartstiff.mechanisms.elastic import ElasticMechanism as ElasticMechanism
    from cartstiff.page.api import show as show
    from cartstiff.statics.continuation import load_curve as load_curve
    from cartstiff.statics.equilibrium import equilibrium as equilibrium
    from cartstiff.statics.toolpath import compensate as compensate
    from cartstiff.stiffness.compute import PostureStiffness as PostureStiffness
    from cartstiff.stiffness.compute import analyse as analyse
    from cartstiff.stiffness.tensor import StiffnessTensor as StiffnessTensor

_HOMES = {
    "ElasticMechanism": "cartstiff.mechanisms.elastic",
    "PostureStiffness": "cartstiff.stiffness.compute",
    "Postures": "cartstiff.many.postures",
    "StiffnessTensor": "cartstiff.stiffness.tensor",
    "analyse": "cartstiff.stiffness.compute",
    "analyse_many": "cartstiff.many.postures",
    "compensate": "cartstiff.statics.toolpath",
    "equilibrium": "cartstiff.statics.equilibrium",
    "load": "cartstiff.loading",
    "load_curve": "cartstiff.statics.continuation",
    "show": "cartstiff.page.api",
}

__all__ = [
    "ElasticMechanism",
    "PostureStiffness",
    "Postures",
    "StiffnessTensor",
    "__version__",
    "analyse",
    "analyse_many",
    "compensate",
    "equilibrium",
    "load",
    "load_curve",
    "show",
]

__getattr__, __dir__ = lazy_names(__name__, _HOMES, __all__)
