"""Public names, with one home each: type checkers and `lazily.public` read them."""

from . import se3 as se3
from .charts import from_pose_function as from_pose_function
from .charts import paper as paper
from .connections import BI_INVARIANT as BI_INVARIANT
from .connections import CARTAN_MINUS as CARTAN_MINUS
from .connections import CARTAN_PLUS as CARTAN_PLUS
from .connections import KINEMATIC as KINEMATIC
from .connections import Connection as Connection
from .connections import from_bilinear_map as from_bilinear_map
from .connections import from_symbols as from_symbols
from .connections import levi_civita as levi_civita
