"""Stiffness over many postures: where to look, computing, files, reading, pictures.

The names in `__init__.pyi` are loaded when first used.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
