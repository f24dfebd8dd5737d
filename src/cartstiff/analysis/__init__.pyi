"""Public names, with one home each: type checkers and `lazily.public` read them."""

from .asymmetry import compare_connections as compare_connections
from .centres import centres_of as centres_of
from .centres import decoupling_frame as decoupling_frame
from .congruence import cartesian_stiffness as cartesian_stiffness
from .congruence import joint_stiffness as joint_stiffness
from .ellipsoids import stiffness_about as stiffness_about
from .ellipsoids import stiffness_along as stiffness_along
from .ellipsoids import stiffness_ellipsoid as stiffness_ellipsoid
from .indices import best_conditioned_length as best_conditioned_length
from .indices import condition_numbers as condition_numbers
from .indices import indices_of as indices_of
from .metrics import natural_length as natural_length
from .screws import eigenscrews as eigenscrews
from .tolerances import Tolerances as Tolerances
