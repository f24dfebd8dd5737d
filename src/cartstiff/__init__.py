"""cartstiff: how stiff a robot's end-effector really is, under every affine connection on SE(3).

The names below are loaded when first used, so that importing the package costs nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cartstiff.lazy import lazy_names
from cartstiff.version import __version__

if TYPE_CHECKING:
    from cartstiff.analysis.posture import analyse_posture as analyse_posture
    from cartstiff.analysis.tolerances import Tolerances as Tolerances
    from cartstiff.errors import CartstiffError as CartstiffError
    from cartstiff.errors import InputError as InputError
    from cartstiff.errors import UndefinedError as UndefinedError
    from cartstiff.geometry.connections import BI_INVARIANT as BI_INVARIANT
    from cartstiff.geometry.connections import CARTAN_MINUS as CARTAN_MINUS
    from cartstiff.geometry.connections import CARTAN_PLUS as CARTAN_PLUS
    from cartstiff.geometry.connections import KINEMATIC as KINEMATIC
    from cartstiff.geometry.connections import Connection as Connection
    from cartstiff.geometry.connections import from_bilinear_map as from_bilinear_map
    from cartstiff.geometry.connections import from_symbols as from_symbols
    from cartstiff.geometry.connections import levi_civita as levi_civita
    from cartstiff.kinematics.inverse import inverse_kinematics as inverse_kinematics
    from cartstiff.loading import load as load
    from cartstiff.loading.pinocchio_model import from_pinocchio as from_pinocchio
    from cartstiff.many.postures import Postures as Postures
    from cartstiff.many.postures import analyse_many as analyse_many
    from cartstiff.maps.cartesian import CartesianGrid as CartesianGrid
    from cartstiff.maps.opening import open_map as open_map
    from cartstiff.maps.pictures import draw_map as draw_map
    from cartstiff.maps.run import compute_map as compute_map
    from cartstiff.maps.sampling import Axis as Axis
    from cartstiff.maps.sampling import Grid as Grid
    from cartstiff.maps.sampling import RandomPostures as RandomPostures
    from cartstiff.maps.sampling import Trajectory as Trajectory
    from cartstiff.mechanisms.contract import Mechanism as Mechanism
    from cartstiff.mechanisms.elastic import ElasticMechanism as ElasticMechanism
    from cartstiff.page.api import show as show
    from cartstiff.potentials.contract import PosePotential as PosePotential
    from cartstiff.potentials.contract import Potential as Potential
    from cartstiff.potentials.functions import JointFunction as JointFunction
    from cartstiff.potentials.functions import PoseFunction as PoseFunction
    from cartstiff.potentials.functions import taylor_check as taylor_check
    from cartstiff.potentials.line_springs import LineSprings as LineSprings
    from cartstiff.potentials.loads import DeadForce as DeadForce
    from cartstiff.potentials.loads import DeadWrench as DeadWrench
    from cartstiff.potentials.loads import FollowerWrench as FollowerWrench
    from cartstiff.potentials.loads import payload as payload
    from cartstiff.potentials.springs import JointSprings as JointSprings
    from cartstiff.scene.scene import Scene as Scene
    from cartstiff.statics.continuation import load_curve as load_curve
    from cartstiff.statics.curves import LoadCurve as LoadCurve
    from cartstiff.statics.equilibrium import equilibrium as equilibrium
    from cartstiff.statics.held import Held as Held
    from cartstiff.statics.rest import Equilibrium as Equilibrium
    from cartstiff.statics.toolpath import compensate as compensate
    from cartstiff.stiffness.compute import PostureStiffness as PostureStiffness
    from cartstiff.stiffness.compute import analyse as analyse
    from cartstiff.stiffness.tensor import Compliance as Compliance
    from cartstiff.stiffness.tensor import StiffnessTensor as StiffnessTensor
    from cartstiff.toolpaths.optimise import optimise_path as optimise_path
    from cartstiff.toolpaths.placement import best_placement as best_placement
    from cartstiff.toolpaths.tool_path import ToolPath as ToolPath

_HOMES = {
    "Axis": "cartstiff.maps.sampling",
    "BI_INVARIANT": "cartstiff.geometry.connections",
    "CARTAN_MINUS": "cartstiff.geometry.connections",
    "CARTAN_PLUS": "cartstiff.geometry.connections",
    "CartesianGrid": "cartstiff.maps.cartesian",
    "CartstiffError": "cartstiff.errors",
    "Compliance": "cartstiff.stiffness.tensor",
    "Connection": "cartstiff.geometry.connections",
    "DeadForce": "cartstiff.potentials.loads",
    "DeadWrench": "cartstiff.potentials.loads",
    "ElasticMechanism": "cartstiff.mechanisms.elastic",
    "Equilibrium": "cartstiff.statics.rest",
    "FollowerWrench": "cartstiff.potentials.loads",
    "Grid": "cartstiff.maps.sampling",
    "Held": "cartstiff.statics.held",
    "InputError": "cartstiff.errors",
    "JointFunction": "cartstiff.potentials.functions",
    "JointSprings": "cartstiff.potentials.springs",
    "KINEMATIC": "cartstiff.geometry.connections",
    "LineSprings": "cartstiff.potentials.line_springs",
    "LoadCurve": "cartstiff.statics.curves",
    "Mechanism": "cartstiff.mechanisms.contract",
    "PoseFunction": "cartstiff.potentials.functions",
    "PosePotential": "cartstiff.potentials.contract",
    "PostureStiffness": "cartstiff.stiffness.compute",
    "Postures": "cartstiff.many.postures",
    "Potential": "cartstiff.potentials.contract",
    "RandomPostures": "cartstiff.maps.sampling",
    "Scene": "cartstiff.scene.scene",
    "StiffnessTensor": "cartstiff.stiffness.tensor",
    "Tolerances": "cartstiff.analysis.tolerances",
    "ToolPath": "cartstiff.toolpaths.tool_path",
    "Trajectory": "cartstiff.maps.sampling",
    "UndefinedError": "cartstiff.errors",
    "analyse": "cartstiff.stiffness.compute",
    "analyse_many": "cartstiff.many.postures",
    "analyse_posture": "cartstiff.analysis.posture",
    "best_placement": "cartstiff.toolpaths.placement",
    "compensate": "cartstiff.statics.toolpath",
    "compute_map": "cartstiff.maps.run",
    "draw_map": "cartstiff.maps.pictures",
    "equilibrium": "cartstiff.statics.equilibrium",
    "from_bilinear_map": "cartstiff.geometry.connections",
    "from_pinocchio": "cartstiff.loading.pinocchio_model",
    "from_symbols": "cartstiff.geometry.connections",
    "inverse_kinematics": "cartstiff.kinematics.inverse",
    "levi_civita": "cartstiff.geometry.connections",
    "load": "cartstiff.loading",
    "load_curve": "cartstiff.statics.continuation",
    "open_map": "cartstiff.maps.opening",
    "optimise_path": "cartstiff.toolpaths.optimise",
    "payload": "cartstiff.potentials.loads",
    "show": "cartstiff.page.api",
    "taylor_check": "cartstiff.potentials.functions",
}

__all__ = [
    "BI_INVARIANT",
    "CARTAN_MINUS",
    "CARTAN_PLUS",
    "KINEMATIC",
    "Axis",
    "CartesianGrid",
    "CartstiffError",
    "Compliance",
    "Connection",
    "DeadForce",
    "DeadWrench",
    "ElasticMechanism",
    "Equilibrium",
    "FollowerWrench",
    "Grid",
    "Held",
    "InputError",
    "JointFunction",
    "JointSprings",
    "LineSprings",
    "LoadCurve",
    "Mechanism",
    "PoseFunction",
    "PosePotential",
    "PostureStiffness",
    "Postures",
    "Potential",
    "RandomPostures",
    "Scene",
    "StiffnessTensor",
    "Tolerances",
    "ToolPath",
    "Trajectory",
    "UndefinedError",
    "__version__",
    "analyse",
    "analyse_many",
    "analyse_posture",
    "best_placement",
    "compensate",
    "compute_map",
    "draw_map",
    "equilibrium",
    "from_bilinear_map",
    "from_pinocchio",
    "from_symbols",
    "inverse_kinematics",
    "levi_civita",
    "load",
    "load_curve",
    "open_map",
    "optimise_path",
    "payload",
    "show",
    "taylor_check",
]

__getattr__, __dir__ = lazy_names(__name__, _HOMES, __all__)
