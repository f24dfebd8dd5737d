"""What a quantity of many postures is, what it may depend on, and what it is computed from."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from cartstiff.errors import InputError
from cartstiff.geometry.se3 import Array
from cartstiff.many.given import CONNECTIONS
from cartstiff.maps import stacks
from cartstiff.mechanisms.contract import Units

__all__ = ["CONNECTIONS", "Quantity", "Settings", "Stacks"]


@dataclass(frozen=True)
class Settings:
    """What the quantities of a map refer to.

    Attributes
    ----------
    connection : {"load", "A", "B", "K", "F"}
        The matrix that is read; "load" is the tangent under a dead load at the frame's origin.
    length : float
        Characteristic length, one for all postures, in the mechanism's unit.
    direction : tuple of float, optional
        For stiffness along and about a direction.
    deflect : tuple of float, optional
        Added wrench (moment, force) whose linear deflection is asked for.
    world : bool
        Whether `direction` and `deflect` are in the axes of F instead of the body's.
    """

    connection: str = "B"
    length: float = 1.0
    direction: tuple[float, ...] | None = None
    deflect: tuple[float, ...] | None = None
    world: bool = False

    @property
    def matrix(self) -> str:
        """The symmetric matrix that is read: an asymmetric one by its symmetric part.

        That of K^A is K^B. That of the tangent under a dead load is K^K: a dead moment adds nothing
        symmetric, and a dead force at the origin has the tangent K^K.
        """
        return {"A": "B", "load": "K"}.get(self.connection, self.connection)


class Stacks:
    """Arrays of many postures by output name, and what several quantities derive from them."""

    def __init__(
        self,
        arrays: Mapping[str, Array],
        settings: Settings,
        lengths: Array | None = None,
    ) -> None:
        self.arrays = arrays
        self.settings = settings
        #: Which coordinates are distances (n,).
        self.lengths = lengths
        self._found: dict[str, Any] = {}

    def once(self, key: str, make: Callable[[], Any]) -> Any:
        """What `make` returned when the key was first asked for."""
        if key not in self._found:
            self._found[key] = make()
        return self._found[key]

    @property
    def K(self) -> Array:  # noqa: N802
        """Stiffness (N, 6, 6) that is read, symmetric."""
        return self.arrays[f"stiffness_{self.settings.matrix}"]

    @property
    def C(self) -> Array:  # noqa: N802
        """Compliance (N, 6, 6) of the same connection."""
        return self.arrays[f"compliance_{self.settings.matrix}"]

    def eigenvalues(self) -> Array:
        """Of the stiffness with lengths scaled (N, 6)."""
        return self.once(
            "eigenvalues",
            lambda: stacks.eigenvalues(self.K, self.C, self.settings.length),
        )

    def singular_values(self) -> Array:
        """Of the Jacobian of length-scaled twists per length-scaled coordinates."""
        J = self.arrays["jacobian"]
        scale = np.repeat([self.settings.length, 1.0], 3)[:, None]
        columns = np.where(self._is_length(J.shape[2]), self.settings.length, 1.0)
        return stacks.on_finite(
            lambda m: np.linalg.svd(m * scale * columns, compute_uv=False),
            J,
            shape=(min(J.shape[1:]),),
        )

    def _is_length(self, n: int) -> Array:
        return np.zeros(n, bool) if self.lengths is None else self.lengths

    def vectors(self, values: Sequence[float] | None, option: str) -> Array:
        """A direction (or the two halves of a wrench) in body axes, (N, 3 or 6)."""
        if values is None:
            raise InputError(f"this quantity needs a {option}")
        v = np.asarray(values, float)
        if not self.settings.world:
            return np.broadcast_to(v, (len(self.arrays["pose"]), v.size))
        R = self.arrays["pose"][:, :3, :3]
        return np.concatenate([np.einsum("nji,j->ni", R, part) for part in v.reshape(-1, 3)], 1)


@dataclass(frozen=True)
class Quantity:
    """A number that exists for every posture, or is NaN.

    Attributes
    ----------
    name, description : str
        For people and for files.
    unit : str
        With {length}, {force} for the mechanism's units.
    function : callable
        From `Stacks` to an array (N,).
    needs : tuple of str
        Outputs of `cartstiff.many.postures.analyse_many`; {connection} stands for the connection,
        {matrix} for the one whose matrix is its symmetric part.
    asks : {"direction", "deflect", "length"}, optional
        The setting that it depends on.
    better : {"larger", "smaller"}, optional
        Which end is the best posture.
    """

    name: str
    description: str
    unit: str
    function: Callable[[Stacks], Array] = field(repr=False)
    needs: tuple[str, ...]
    asks: Literal["direction", "deflect", "length"] | None = None
    better: Literal["larger", "smaller"] | None = "larger"

    def unit_in(self, units: Units) -> str:
        """The unit with the mechanism's names."""
        return self.unit.format(length=units.length, force=units.force)

    def outputs(self, settings: Settings) -> tuple[str, ...]:
        """Outputs of `analyse_many` that are needed."""
        names = {"matrix": settings.matrix, "connection": settings.connection}
        return tuple(name.format(**names) for name in self.needs)
