"""Stiffness drawn in any meshcat viewer.

The names in `scene.pyi` draw in any ``meshcat.Visualizer``; they are loaded when first
used.
"""

from cartstiff.core.lazily import public

__getattr__, __dir__ = public(globals())
