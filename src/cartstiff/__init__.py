"""cartstiff: how stiff a robot's end-effector really is, under every affine connection on SE(3).

The public names stand in `__init__.pyi`. They are loaded when first used, so that importing the
package costs nothing.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
