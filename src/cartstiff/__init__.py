"""cartstiff: how stiff a robot's end-effector really is,
under every affine connection on SE(3).

The public names stand in `__init__.pyi`. They are loaded when first used, so that
importing the package costs nothing: until the command has set its signals, an interrupt
would print a traceback.
"""

_stub = []  # look-up of public names, their list, and all of them, once they are read


def _read():  # type: ignore[no-untyped-def]
    if not _stub:
        import lazy_loader

        _stub.extend(lazy_loader.attach_stub(__name__, __file__))
    return _stub


def __dir__() -> list[str]:
    """The public names."""
    return sorted(_read()[2])


def __getattr__(name: str) -> object:
    """A public name, loaded now."""
    look_up, _, every = _read()
    if name == "__all__":
        return every
    try:
        return look_up(name)
    except AttributeError:
        if not name.startswith("analyze"):
            raise
        hint = (
            f"{__name__} has no attribute {name!r}; it is called "
            f"{name.replace('yze', 'yse')!r}"
        )
        raise AttributeError(hint) from None
