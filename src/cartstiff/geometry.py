"""Rigid motions, twists and wrenches, affine connections, charts.

The names in `geometry.pyi` are loaded when first used.
"""

from cartstiff.core.lazily import public

__getattr__, __dir__ = public(globals())
