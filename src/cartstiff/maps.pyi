"""Public names, with one home each: type checkers and `lazily.public` read them."""

from .wings.maps.cartesian import CartesianGrid as CartesianGrid
from .wings.maps.pictures import draw_map as draw_map
from .wings.maps.reading import best as best
from .wings.maps.reading import slice_map as slice_map
from .wings.maps.reading import summary as summary
from .wings.maps.run import compute_map as compute_map
from .wings.maps.run import map_of as map_of
from .wings.maps.sampling import Axis as Axis
from .wings.maps.sampling import Grid as Grid
from .wings.maps.sampling import RandomPostures as RandomPostures
from .wings.maps.sampling import Trajectory as Trajectory
from .wings.maps.store import open_map as open_map
