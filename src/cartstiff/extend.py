"""What own mechanisms, energies, file formats, quantities and designs are made of;
schemas for other programs.

The names in `extend.pyi` are loaded when first used.
"""

from cartstiff.core.lazily import public

__getattr__, __dir__ = public(globals())
