"""Properties of a stiffness matrix: ellipsoids, centres, screws, indices, tolerances.

The names in `analysis.pyi` are loaded when first used.
"""

from cartstiff.core.lazily import public

__getattr__, __dir__ = public(globals())
