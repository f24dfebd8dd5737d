"""Springs from measurements, and which measurements to make.

The names in `identify.pyi` are loaded when first used.
"""

from cartstiff.core.lazily import public

__getattr__, __dir__ = public(globals())
