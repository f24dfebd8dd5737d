"""Small vibrations about a rest state: modes under load, response, damping.

The names in `vibration.pyi` are loaded when first used.
"""

from cartstiff.core.lazily import public

__getattr__, __dir__ = public(globals())
