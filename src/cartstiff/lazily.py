"""Properties that are computed when they are first read."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from functools import cached_property as cached_property
else:

    class cached_property(functools.cached_property):  # noqa: N801 - that one, but for its lock
        """That of functools as it is from Python 3.12 on, without a lock.

        The lock costs as much as many of the numbers that are computed here.
        """

        def __get__(self, instance, owner=None):
            """The value, kept with the instance."""
            if instance is None:
                return self
            value = instance.__dict__[self.attrname] = self.func(instance)
            return value
