"""Public names, with one home each: type checkers and `lazily.public` read them."""

from .answer.analysis.asymmetry import compare_connections as compare_connections
from .answer.analysis.centres import centres_of as centres_of
from .answer.analysis.centres import decoupling_frame as decoupling_frame
from .answer.analysis.congruence import cartesian_stiffness as cartesian_stiffness
from .answer.analysis.congruence import joint_stiffness as joint_stiffness
from .answer.analysis.ellipsoids import stiffness_about as stiffness_about
from .answer.analysis.ellipsoids import stiffness_along as stiffness_along
from .answer.analysis.ellipsoids import stiffness_ellipsoid as stiffness_ellipsoid
from .answer.analysis.indices import best_conditioned_length as best_conditioned_length
from .answer.analysis.indices import condition_numbers as condition_numbers
from .answer.analysis.indices import indices_of as indices_of
from .answer.analysis.metrics import natural_length as natural_length
from .answer.analysis.screws import eigenscrews as eigenscrews
from .answer.analysis.tolerances import Tolerances as Tolerances
