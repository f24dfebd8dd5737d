"""Properties that are computed, and public names that are loaded, when first read."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

#: Modules beside `cartstiff` in which public names have their one home.
HOMES = ("analysis", "extend", "geometry", "identify", "maps", "scene", "vibration")

if TYPE_CHECKING:
    from functools import cached_property as cached_property
else:

    class cached_property(functools.cached_property):  # noqa: N801 - that one, but for its lock
        """`functools.cached_property` without its lock, as from Python 3.12 on.

        The lock takes as long as many of the computations.
        """

        def __get__(self, instance, owner=None):
            """The value, cached in the instance."""
            if instance is None:
                return self
            value = instance.__dict__[self.attrname] = self.func(instance)
            return value


def public(
    home: dict[str, Any],
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """`__getattr__` and `__dir__` of a module whose stub lists its public names.

    The stub, read when a name is first asked for, has imports only: type checkers read
    the same lines.

    Parameters
    ----------
    home : dict
        The module's `globals()`.
    """

    @functools.cache
    def places() -> dict[str, str]:
        """Module of each name, as the stub spells it."""
        import ast
        from pathlib import Path

        stub = ast.parse(Path(f"{home['__file__']}i").read_text("utf-8"))
        found = [node for node in stub.body if isinstance(node, ast.ImportFrom)]
        return {n.name: "." * f.level + (f.module or "") for f in found for n in f.names}

    def look_up(name: str) -> Any:
        if name == "__all__":
            return sorted(places())
        if name not in places():
            raise AttributeError(f"{home['__name__']} has no attribute {name!r}")
        from importlib import import_module

        place, package = places()[name], home["__package__"]
        if place == ".":  # a part of the package, which its import makes an attribute
            return import_module(f".{name}", package)
        module = import_module(place, package)
        if not hasattr(module, name):  # a module there, which nothing has imported yet
            import_module(f"{place}.{name}", package)
        thing = home[name] = getattr(module, name)
        return thing

    return look_up, lambda: sorted(places())
