"""Stiffness drawn in any meshcat viewer.

The names in `__init__.pyi` draw in any ``meshcat.Visualizer``; they are loaded when first
used.
"""

from cartstiff.lazily import public

__getattr__, __dir__ = public(globals())
