"""Public names, with one home each: type checkers and `lazily.public` read them."""

from .appearance import Appearance as Appearance
from .arrows import add_wrench as add_wrench
from .ellipsoids import add_ellipsoid as add_ellipsoid
from .points import add_path as add_path
from .points import add_points as add_points
from .scales import Linear as Linear
from .scales import Logarithmic as Logarithmic
from .scales import Root as Root
from .scene import Scene as Scene
from .viewer import RecordingWindow as RecordingWindow
