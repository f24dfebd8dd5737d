"""cartstiff: how stiff a robot's end-effector really is,
under every affine connection on SE(3).

The public names stand in `__init__.pyi`. They are loaded when first used, so that
importing the package costs nothing.
"""

import lazy_loader

_public, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> object:
    """A public name, loaded now."""
    try:
        return _public(name)
    except AttributeError:
        if not name.startswith("analyze"):
            raise
        hint = (
            f"{__name__} has no attribute {name!r}; it is called "
            f"{name.replace('yze', 'yse')!r}"
        )
        raise AttributeError(hint) from None
