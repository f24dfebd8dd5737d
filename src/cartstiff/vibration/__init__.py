"""Small vibrations about a rest state: modes under load, response, damping.

The names in `__init__.pyi` are loaded when first used.
"""

from cartstiff.lazily import public

__getattr__, __dir__ = public(globals())
