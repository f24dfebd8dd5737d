"""Stiffness over many postures: where to look, computing, files, reading, pictures.

The names in `maps.pyi` are loaded when first used.
"""

from cartstiff.core.lazily import public

__getattr__, __dir__ = public(globals())
