"""What a quantity of many postures is, what it may depend on, and what it is computed from."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartstiff import numerics
from cartstiff.errors import InputError
from cartstiff.geometry.se3 import Array
from cartstiff.maps import row_by_row
from cartstiff.maps.row_by_row import symmetric_part
from cartstiff.mechanisms.contract import Units
from cartstiff.stiffness.applied_load import LoadKind, wrench_in_body
from cartstiff.vibration.chatter import Milling
from cartstiff.vibration.many_modes import ManyModes
from cartstiff.vibration.response import Damping

#: Connections whose matrix may be asymmetric.
ASYMMETRIC = ("A", "load")


@dataclass(frozen=True)
class Settings:
    """What the quantities of a map refer to.

    Attributes
    ----------
    connection : {"A", "B", "K", "F", "load"}
        The matrix that is read; "load" is the tangent under the load.
    length : float
        Characteristic length, one for all postures, in the mechanism's unit.
    direction : tuple of float, optional
        For stiffness along and about a direction.
    deflect : tuple of float, optional
        Wrench (moment, force) added to the load, whose linear deflection is asked for; default the
        load itself.
    world : bool
        Whether `direction` and `deflect` are in the axes of F instead of the body's.
    load : LoadKind
        What the load does while the body moves.
    deflect_at : tuple of float
        Point of the body, in M, at which the wrench `deflect` acts.
    is_loaded : bool
        Whether a load is given, whose own deflection can be asked for.
    damping : Damping
        What damps the vibrations, beside the mechanism's own dampers.
    milling : Milling, optional
        The cutter whose limiting depth is asked for.
    """

    connection: str = "B"
    length: float = 1.0
    direction: tuple[float, ...] | None = None
    deflect: tuple[float, ...] | None = None
    world: bool = False
    load: LoadKind = field(default_factory=LoadKind)
    deflect_at: tuple[float, ...] = (0.0, 0.0, 0.0)
    is_loaded: bool = False
    damping: Damping = field(default_factory=Damping)
    milling: Milling | None = None

    @property
    def matrix(self) -> str:
        """The matrix whose symmetric part is read: for A that is B itself."""
        return "B" if self.connection == "A" else self.connection

    @property
    def free(self) -> tuple[str, ...]:
        """Outputs that `Stacks.pair` needs with the other freedoms free."""
        if self.connection in ASYMMETRIC:
            name = self.connection
            return f"stiffness_{name}", f"compliance_{name}"
        return f"stiffness_{self.matrix}", *self.inverted

    @property
    def inverted(self) -> tuple[str, ...]:
        """Outputs from which the inverse of that symmetric part follows."""
        if self.matrix == "load":
            return "compliance_B", "wrench"
        return (f"compliance_{self.matrix}",)


class Stacks:
    """Arrays of many postures by output name, and what several quantities derive from them."""

    def __init__(
        self,
        arrays: Mapping[str, Array],
        settings: Settings,
        lengths: Array | None = None,
        swing: ManyModes | None = None,
    ) -> None:
        self.arrays = arrays
        self.settings = settings
        #: Which coordinates are distances (n,).
        self.lengths = lengths
        #: Small vibrations at the postures, computed when they are asked for.
        self.swing = swing
        self._found: dict[str, Any] = {}

    def once(self, key: str, make: Callable[[], Any]) -> Any:
        """What `make` returned when the key was first asked for."""
        if key not in self._found:
            self._found[key] = make()
        return self._found[key]

    @property
    def K(self) -> Array:  # noqa: N802
        """Stiffness (N, 6, 6) that is read: the symmetric part."""
        K = self.arrays[f"stiffness_{self.settings.matrix}"]
        return K if self.settings.matrix != "load" else self.once("K", lambda: symmetric_part(K))

    @property
    def C(self) -> Array:  # noqa: N802
        """Inverse (N, 6, 6) of `K`, as `StiffnessInFrame.inverse_of_symmetric_part`."""
        if self.settings.matrix != "load":
            return self.arrays[f"compliance_{self.settings.matrix}"]

        def make() -> Array:
            D = symmetric_part(self.settings.load.change(self.arrays["wrench"]))
            C = self.arrays["compliance_B"]
            return numerics.inverses_of_sums(C, D)[0] if D.any() else C

        return self.once("C", make)

    def pair(self, others: str) -> tuple[Array, Array]:
        """Stiffness and compliance (N, 6, 6), as `StiffnessInFrame.pair`."""
        if others == "held" or self.settings.connection not in ASYMMETRIC:
            return self.K, self.C

        def make() -> tuple[Array, Array]:
            K, C = self.arrays[f"stiffness_{name}"], self.arrays[f"compliance_{name}"]
            with np.errstate(invalid="ignore"):
                even = numerics.is_about_symmetric(K) & numerics.is_about_symmetric(C)
            stiff, flexible = symmetric_part(K), symmetric_part(C)
            rows = np.flatnonzero(~even & np.isfinite(K + C).all(axis=(1, 2)))
            if rows.size:
                stiff[rows] = numerics.invert_each(flexible[rows])[0]
            return stiff, flexible

        name = self.settings.connection
        return self.once("free", make)

    @property
    def vibrations(self) -> ManyModes:
        """Small vibrations at the postures."""
        if self.swing is None:
            raise InputError("vibrations need the postures, which are not at hand here")
        return self.swing

    def frequencies(self) -> Array:
        """The six lowest frequencies (N, 6) in Hz."""
        return self.once("frequencies", self.vibrations.frequencies)

    def damping_ratios(self) -> Array:
        """Damping ratios (N, 6) of the six slowest modes."""
        return self.once("damping", lambda: self.vibrations.damping_ratios(self.settings.damping))

    def limiting_depths(self) -> Array:
        """Depth of cut (N,) that is stable at every speed."""
        if self.settings.milling is None:
            raise InputError("a limiting depth needs a cutter")
        return self.vibrations.limiting_depths(self.settings.milling, self.settings.damping)

    def eigenvalues(self) -> Array:
        """Of the stiffness with lengths scaled (N, 6)."""
        return self.once(
            "eigenvalues",
            lambda: row_by_row.eigenvalues(self.K, self.C, self.settings.length),
        )

    def singular_values(self) -> Array:
        """Of the Jacobian of length-scaled twists per length-scaled coordinates."""
        J = self.arrays["jacobian"]
        scale = np.repeat([self.settings.length, 1.0], 3)[:, None]
        columns = np.where(self._is_length(J.shape[2]), self.settings.length, 1.0)
        return row_by_row.on_finite(
            lambda m: np.linalg.svd(m * scale * columns, compute_uv=False),
            J,
            shape=(min(J.shape[1:]),),
        )

    def _is_length(self, n: int) -> Array:
        return np.zeros(n, bool) if self.lengths is None else self.lengths

    def direction(self) -> Array:
        """Unit vectors (N, 3) of the direction, in body axes."""
        if self.settings.direction is None:
            raise InputError("this quantity needs a direction")
        # Turned as the force of a wrench is.
        u = self._in_body([0.0, 0.0, 0.0, *self.settings.direction], (0.0, 0.0, 0.0))[:, 3:]
        unit: Array = u / np.linalg.norm(u, axis=1, keepdims=True)
        return unit

    def added_wrench(self) -> Array:
        """The wrench (N, 6) whose deflection is asked for, about M's origin in body axes."""
        if self.settings.deflect is None:
            return self.arrays["wrench"]
        return self._in_body(self.settings.deflect, self.settings.deflect_at)

    def _in_body(self, wrench: Sequence[float], at: Sequence[float]) -> Array:
        poses = self.arrays["pose"]
        wrenches = np.broadcast_to(np.asarray(wrench, float), (len(poses), 6))
        return wrench_in_body(wrenches, poses, at, "world" if self.settings.world else "body")


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
        {matrix} for the one whose matrix is its symmetric part; "inverse" for what the inverse
        of that needs, "free" for what is read with other freedoms free.
    asks : {"direction", "deflect", "length", "damping", "milling"}, optional
        The setting that it depends on.
    better : {"larger", "smaller"}, optional
        Which end is the best posture.
    """

    name: str
    description: str
    unit: str
    function: Callable[[Stacks], Array] = field(repr=False)
    needs: tuple[str, ...]
    asks: Literal["direction", "deflect", "length", "damping", "milling"] | None = None
    better: Literal["larger", "smaller"] | None = "larger"

    def unit_in(self, units: Units) -> str:
        """The unit with the mechanism's names."""
        return self.unit.format(length=units.length, force=units.force)

    def outputs(self, settings: Settings) -> tuple[str, ...]:
        """Outputs of `analyse_many` that are needed."""
        names = {"matrix": settings.matrix, "connection": settings.connection}
        several = {"inverse": settings.inverted, "free": settings.free}
        needed = [several.get(n) or (n.format(**names),) for n in self.needs]
        return tuple(dict.fromkeys(name for some in needed for name in some))


def needed_outputs(quantities: Sequence[Quantity], settings: Settings) -> tuple[str, ...]:
    """Outputs of `analyse_many` that some quantities are read from, and the pose."""
    needed = {"pose"}
    for quantity in quantities:
        needed.update(quantity.outputs(settings))
    return tuple(sorted(needed))


class MapRows(NamedTuple):
    """Postures (N, n) as assembled, what state they are in, where they are, and their numbers."""

    q: Array
    state: NDArray[np.uint8]
    poses: Array
    values: dict[str, Array]
