"""Public names, with one home each: type checkers and `lazily.public` read them."""

from .shown.scene.appearance import Appearance as Appearance
from .shown.scene.arrows import add_wrench as add_wrench
from .shown.scene.ellipsoids import add_ellipsoid as add_ellipsoid
from .shown.scene.points import add_path as add_path
from .shown.scene.points import add_points as add_points
from .shown.scene.scales import Linear as Linear
from .shown.scene.scales import Logarithmic as Logarithmic
from .shown.scene.scales import Root as Root
from .shown.scene.scene import Scene as Scene
from .shown.scene.viewer import RecordingWindow as RecordingWindow
