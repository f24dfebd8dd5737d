"""Stiffness drawn in any meshcat viewer.

The names in `__init__.pyi` draw in any ``meshcat.Visualizer``; they are loaded when first
used.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
