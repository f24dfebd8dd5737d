"""Properties that are computed when they are first read."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING

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
