"""Public names, with one home each: type checkers and `lazily.public` read them."""

from .core.geometry import se3 as se3
from .core.geometry.charts import from_pose_function as from_pose_function
from .core.geometry.charts import paper as paper
from .core.geometry.connections import BI_INVARIANT as BI_INVARIANT
from .core.geometry.connections import CARTAN_MINUS as CARTAN_MINUS
from .core.geometry.connections import CARTAN_PLUS as CARTAN_PLUS
from .core.geometry.connections import KINEMATIC as KINEMATIC
from .core.geometry.connections import Connection as Connection
from .core.geometry.connections import from_symbols as from_symbols
from .core.geometry.made_connections import from_bilinear_map as from_bilinear_map
from .core.geometry.made_connections import levi_civita as levi_civita
