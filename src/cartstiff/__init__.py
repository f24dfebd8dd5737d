"""cartstiff: how stiff a robot's end-effector really is,
under every affine connection on SE(3).

The public names stand in `__init__.pyi`. They are loaded when first used, so that
importing the package costs nothing: until the command has set its signals, an interrupt
would print a traceback.
"""

from cartstiff.core.lazily import public

_look_up, __dir__ = public(globals())


def __getattr__(name: str) -> object:
    """A public name, loaded now."""
    try:
        return _look_up(name)
    except AttributeError:
        if not name.startswith("analyze"):
            raise
        hint = (
            f"{__name__} has no attribute {name!r}; it is called "
            f"{name.replace('yze', 'yse')!r}"
        )
        raise AttributeError(hint) from None
