"""Public names, with one home each: type checkers and `lazily.public` read them."""

from .cartesian import CartesianGrid as CartesianGrid
from .pictures import draw_map as draw_map
from .reading import best as best
from .reading import slice_map as slice_map
from .reading import summary as summary
from .run import compute_map as compute_map
from .run import map_of as map_of
from .sampling import Axis as Axis
from .sampling import Grid as Grid
from .sampling import RandomPostures as RandomPostures
from .sampling import Trajectory as Trajectory
from .store import open_map as open_map
