"""cartstiff: how stiff a robot's end-effector really is, under every affine connection on SE(3).

The names below are loaded when first used, so that importing the package costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from cartstiff.version import __version__

if TYPE_CHECKING:
    from cartstiff.mechanisms.elastic import ElasticMechanism as ElasticMechanism
    from cartstiff.mechanisms.loading import load as load
    from cartstiff.statics.continuation import load_curve as load_curve
    from cartstiff.statics.equilibrium import equilibrium as equilibrium
    from cartstiff.statics.toolpath import compensate as compensate
    from cartstiff.stiffness.compute import PostureStiffness as PostureStiffness
    from cartstiff.stiffness.compute import analyse as analyse
    from cartstiff.stiffness.tensor import StiffnessTensor as StiffnessTensor

_HOMES = {
    "ElasticMechanism": "cartstiff.mechanisms.elastic",
    "PostureStiffness": "cartstiff.stiffness.compute",
    "StiffnessTensor": "cartstiff.stiffness.tensor",
    "analyse": "cartstiff.stiffness.compute",
    "compensate": "cartstiff.statics.toolpath",
    "equilibrium": "cartstiff.statics.equilibrium",
    "load": "cartstiff.mechanisms.loading",
    "load_curve": "cartstiff.statics.continuation",
}

__all__ = [
    "ElasticMechanism",
    "PostureStiffness",
    "StiffnessTensor",
    "__version__",
    "analyse",
    "compensate",
    "equilibrium",
    "load",
    "load_curve",
]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
