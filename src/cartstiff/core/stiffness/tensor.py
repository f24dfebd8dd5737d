r"""The stiffness tensor at a pose: a matrix that knows its connection, frame, load,
units, order.

    K(X, Y) = <nabla_Y dPhi; X> = (Y X - nabla_Y X) Phi, K[i, j] = K(L_i, L_j) ([ZK]_
    30-33)

Column j is the direction of motion, row i the component of the wrench. Also its inverse,
the compliance, and both as text, for notebooks, xarray and pandas, with names and units
of rows and columns.
"""

from __future__ import annotations

import io
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core import numerics
from cartstiff.core.arrays import (
    Array,
    checked_array,
    checked_pose,
    real_array,
    safe_cell,
)
from cartstiff.core.choices import AXES, Axes, Order
from cartstiff.core.errors import InputError, UndefinedError, checked_kind, imported
from cartstiff.core.geometry import se3
from cartstiff.core.geometry.connections import NAMED, Connection, Field
from cartstiff.core.notebook import html_table
from cartstiff.core.notes import Note
from cartstiff.core.units import SI, Units, convert_length
from cartstiff.core.writing import write_whole

#: Names along the axes of matrices: components of wrenches, and of motions.
COMPONENTS = {
    "wrench": ("mx", "my", "mz", "fx", "fy", "fz"),
    "motion": ("rx", "ry", "rz", "x", "y", "z"),
}


def with_labels(
    arrays: Mapping[str, tuple[Sequence[str], Array]],
    axes: Mapping[str, Sequence[Any]] = COMPONENTS,
    **about: object,
) -> Any:
    """An `xarray.Dataset` of arrays, each with the names of its axes.

    Parameters
    ----------
    arrays : mapping of str to (names of axes, ndarray)
        Contents.
    axes : mapping of str to sequence
        Labels along some of the axes.
    **about
        Attributes of the dataset.

    Raises
    ------
    MissingDependencyError
        Without xarray.
    """
    xarray = imported("xarray", "xarray", "a table with labels", "maps")
    used = {axis for names, _ in arrays.values() for axis in names}
    return xarray.Dataset(
        {
            name: (list(names), np.array(values))
            for name, (names, values) in arrays.items()
        },
        coords={axis: list(labels) for axis, labels in axes.items() if axis in used},
        attrs=about,
    )


def format_matrix(matrix: Array, row_units: Sequence[str], title: str = "") -> str:
    """Matrix as aligned text, one row a line, each row followed by its unit."""
    # One format for the whole matrix, so that columns can be compared at a glance.
    lines = [title] if title else []
    size = numerics.largest(matrix)
    for row, unit in zip(matrix, row_units, strict=True):
        least = numerics.ROUNDOFF_OF_SUMS * size
        rounded = [0.0 if abs(x) < least else x for x in row]
        cells = "".join(f"{x:>14.6g}" for x in rounded)
        lines.append(f"{cells}   {unit}".rstrip())
    return "\n".join(lines)


BlockUnits = tuple[tuple[str, str], tuple[str, str]]


def numbers_text(values: Array) -> str:
    """A few numbers on one line, to four digits.

    Round-off of the largest is printed as 0.
    """
    least = numerics.PRINTED_AS_ZERO * numerics.largest(values)
    return ", ".join(f"{x if abs(x) > least else 0.0:.4g}" for x in values.tolist())


def codes_of(notes: Iterable[Note]) -> str:
    """The codes of notes, each once, in a line."""
    return ", ".join(dict.fromkeys(note.code for note in notes)) or "none"


def matrix_html(matrix: Array, block_units: BlockUnits, title: str, order: str) -> str:
    """A 6x6 matrix as a table, the unit of each 3x3 block beside its rows and over
    its columns.
    """
    parts = ("rotation", "translation")
    names = parts if order == "angular-linear" else parts[::-1]
    size = numerics.largest(matrix)
    rows = [
        (
            names[i // 3],
            *(
                f"{0.0 if abs(x) < numerics.ROUNDOFF_OF_SUMS * size else x:.6g}"
                for x in row
            ),
            " | ".join(block_units[i // 3]),
        )
        for i, row in enumerate(matrix.tolist())
    ]
    return html_table(
        [("", 1), *((name, 3) for name in names), ("units", 1)], rows, title
    )


class LabelledMatrix:
    """A 6x6 matrix in one of the two orders, for NumPy, xarray and pandas."""

    matrix: Array
    connection: Connection
    pose: Array
    frame: str
    units: Units
    order: Order
    #: Letter of the matrix, and names of the axes of its rows and columns.
    _letter = "K"
    _axes = ("wrench", "motion")

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        """The matrix, for NumPy."""
        return np.array(self.matrix, dtype=dtype)

    def __getitem__(self, index: Any) -> Any:
        """Entries of the matrix: ``K[3:, 3:]``."""
        return self.matrix[index]

    @property
    def T(self) -> Array:  # noqa: N802
        """The transposed matrix (6, 6), in the same units."""
        return self.matrix.T

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the matrix."""
        return self.matrix.shape

    # Sums, multiples and products are plain arrays: their load, and what they are of, are
    # others.

    def __add__(self, other: Any) -> Array:
        return self.matrix + self._beside(other)

    def __sub__(self, other: Any) -> Array:
        return self.matrix - self._beside(other)

    def __mul__(self, factor: float) -> Array:
        return self.matrix * factor

    __rmul__ = __mul__

    def __truediv__(self, factor: float) -> Array:
        return self.matrix / factor

    def __matmul__(self, other: ArrayLike) -> Array:
        return self.matrix @ np.asarray(other)

    def _beside(self, other: Any) -> Any:
        """The numbers of another matrix of the same place and kind; an array as it is.

        InputError for one in another frame, order, unit, connection or at another pose.
        """
        if not isinstance(other, LabelledMatrix):
            return other
        for what in ("_letter", "frame", "units", "order"):
            mine, its = getattr(self, what), getattr(other, what)
            if mine != its:
                where = f"{what.lstrip('_')} of the other matrix"
                raise InputError(where, expected=str(mine), got=str(its))
        mine, its = self.connection, other.connection
        if not np.array_equal(mine.symbols, its.symbols):
            where = "connection of the other matrix"
            raise InputError(where, expected=mine.name, got=its.name)
        apart = np.abs(self.pose - other.pose).max()
        if apart > numerics.NEGLIGIBLE_DISTANCE:
            off = f"{apart:.2g} off"
            raise InputError("pose of the other matrix", expected="the same", got=off)
        return other.matrix

    def to_xarray(self) -> Any:
        """`xarray.DataArray` with the components' names.

        MissingDependencyError without xarray.
        """
        angular = self.order == se3.ANGULAR_LINEAR
        axes = {n: v if angular else (*v[3:], *v[:3]) for n, v in COMPONENTS.items()}
        return with_labels({self._letter: (self._axes, self.matrix)}, axes)[self._letter]

    def to_pandas(self) -> Any:
        """`pandas.DataFrame` with the components' names on rows and columns."""
        return self.to_xarray().to_pandas()

    @property
    def block_units(self) -> BlockUnits:
        """Units of the four 3x3 blocks, in the matrix's order."""
        names = (
            self.units.blocks if self._letter == "K" else self.units.blocks_of_compliance
        )
        a, b = "rt" if self.order == se3.ANGULAR_LINEAR else "tr"
        return (names[a + a], names[a + b]), (names[b + a], names[b + b])

    def __str__(self) -> str:
        (a, b), (c, d) = self.block_units
        title = f"{self._title}, order {self.order}"
        return format_matrix(
            self.matrix, [f"[{a} | {b}]"] * 3 + [f"[{c} | {d}]"] * 3, title
        )

    __repr__ = __str__

    def _repr_html_(self) -> str:
        return matrix_html(self.matrix, self.block_units, self._title, self.order)

    @property
    def _title(self) -> str:
        return f"{self._letter}^{self.connection.name} in {self.frame}"


@dataclass(frozen=True, eq=False, repr=False)
class Compliance(LabelledMatrix):
    """A compliance matrix: twist (rows) per wrench (columns).

    The inverse of a stiffness matrix, with its `connection`, frame, units and `order` of
    components, as those of `StiffnessTensor`.
    """

    _letter = "C"
    _axes = ("motion", "wrench")

    matrix: Array
    connection: Connection
    pose: Array
    frame: str
    units: Units
    order: Order = "angular-linear"

    def to_order(self, order: Order) -> Compliance:
        """Components in another order."""
        if order == self.order:
            return self
        return replace(self, matrix=self.matrix[se3.SWAP][:, se3.SWAP], order=order)


@dataclass(frozen=True, eq=False, repr=False)
class StiffnessTensor(LabelledMatrix):
    """A Cartesian stiffness matrix with its connection, frame, load, units and order.

    Attributes
    ----------
    matrix : ndarray, shape (6, 6)
        Stiffness K in body components of `frame`; read-only.
    connection : Connection
        How wrenches at neighbouring poses were compared.
    wrench : ndarray, shape (6,)
        W = dPhi, which the environment applies to the body to hold it; same frame, order,
        units.
    pose : ndarray, shape (4, 4)
        ``T_F_M`` of the frame.
    frame : str
        Name of the body frame M.
    units : Units
        Blocks are [[moment/rad, force], [force/rad, force/length]] in (omega, v) order.
    order : {"angular-linear", "linear-angular"}
        Order of twist components.
    inverse : ndarray, shape (6, 6), or None
        Compliance C = K^-1 if known more accurately than from K; it is transformed
        together with K.
    base : ndarray, shape (4, 4)
        Pose ``T_F_B`` of the robot's own base frame.
    is_singular : bool
        Whether K is known to have no inverse, though its rounded numbers may have one.

    Raises
    ------
    InputError
        For another shape or order.
    """

    matrix: Array
    connection: Connection
    wrench: Array
    pose: Array = field(default_factory=lambda: np.eye(4))
    frame: str = "body"
    units: Units = SI
    order: Order = "angular-linear"
    inverse: Array | None = field(default=None, repr=False)
    base: Array = field(default_factory=lambda: np.eye(4), repr=False)
    is_singular: bool = field(default=False, repr=False)

    def __post_init__(self) -> None:
        for name, shape in (
            ("matrix", (6, 6)),
            ("wrench", (6,)),
            ("pose", (4, 4)),
            ("base", (4, 4)),
        ):
            array = checked_array(getattr(self, name), shape, name, finite=False)
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        if self.order not in (se3.ANGULAR_LINEAR, se3.LINEAR_ANGULAR):
            raise InputError(
                "unknown order",
                expected="angular-linear or linear-angular",
                got=self.order,
            )

    def __call__(self, x: Field | ArrayLike, y: Field | ArrayLike) -> float:
        """K(X, Y): fields are evaluated at the pose, arrays are twists in the
        tensor's order.
        """
        a, b = (
            v.at(self.pose) if isinstance(v, Field) else real_array(v, "twist")
            for v in (x, y)
        )
        if self.order != se3.ANGULAR_LINEAR:
            a, b = (
                se3.to_linear_angular(v) if isinstance(f, Field) else v
                for v, f in ((a, x), (b, y))
            )
        return float(a @ self.matrix @ b)

    # -- symmetry
    # ---------------------------------------------------------------------------

    @property
    def asymmetry(self) -> Array:
        """K - K^T (6, 6), in the units of the stiffness."""
        return self.matrix - self.matrix.T

    @property
    def predicted_asymmetry(self) -> Array:
        """K - K^T (6, 6) from load and connection alone, [ZK]_ eq. 50.

        K[i, j] - K[j, i] = [L_j, L_i] Phi - (nabla_{L_j} L_i - nabla_{L_i} L_j) Phi: the
        wrench against the torsion.
        """
        here = self.to_order("angular-linear")
        term = here.connection.wrench_term(here.wrench)
        predicted = -se3.bracket_form(here.wrench) - (term - term.T)
        if self.order == se3.ANGULAR_LINEAR:
            return predicted
        return predicted[se3.SWAP][:, se3.SWAP]

    @property
    def symmetric_part(self) -> Array:
        """(K + K^T) / 2, shape (6, 6), in the units of the stiffness."""
        return 0.5 * (self.matrix + self.matrix.T)

    def split(self) -> tuple[Array, Array, Array]:
        """The three terms (K_I, K_II, K_III) of [ZK]_ eq. 52 in the paper's chart
        at this pose.

        K_I is the Hessian in the chart of section 2.4 placed at the pose, K_II its
        bracket term (W against the upper triangle of the structure constants), K_III =
        -Gamma W. The printed matrices hold for w = -dPhi; with W = dPhi, as here and as
        in the paper's tables, K_II and K_III have the opposite sign. The rotation block
        of the printed K_II (53) is moreover that of a chart with the rotations in the
        order z, y, x: its entries stand below the diagonal, those of the chart of section
        2.4 above it.
        """
        here = self.to_order("angular-linear")
        third = -here.connection.wrench_term(here.wrench)
        # Coordinates act in the order 1..6, so d gamma_a / d xi_b = [L_a, L_b] for b
        # after a and K_II[i, j] = -W . [L_i, L_j] for i before j.
        second = -np.triu(se3.bracket_form(here.wrench), 1)
        terms = (here.matrix - second - third, second, third)
        if self.order == se3.ANGULAR_LINEAR:
            return terms
        first, second, third = (t[se3.SWAP][:, se3.SWAP] for t in terms)
        return first, second, third

    # -- changes
    # ----------------------------------------------------------------------------

    def to_connection(self, connection: Connection | str) -> StiffnessTensor:
        """The same potential under another connection: K' = K + (Gamma - Gamma') W.

        Raises
        ------
        InputError
            For a name that is not one of "A", "B", "K", "+".
        """
        if isinstance(connection, str):
            if connection not in NAMED:
                raise InputError(
                    "unknown connection", expected=", ".join(NAMED), got=repr(connection)
                )
            connection = NAMED[connection]
        checked_kind(
            connection, Connection, "connection", f"{', '.join(NAMED)} or a Connection"
        )
        here = self.to_order("angular-linear")
        change = here.connection.wrench_term(here.wrench) - connection.wrench_term(
            here.wrench
        )
        C = here.inverse
        moved = replace(
            here,
            matrix=here.matrix + change,
            connection=connection,
            inverse=None if C is None else numerics.inverse_of_sum(C, change),
            is_singular=False,
        )
        return moved.to_order(self.order)

    def to_frame(self, T_M_N: ArrayLike, frame: str = "offset frame") -> StiffnessTensor:
        """The tensor for another frame N fixed to the same body, given ``T_M_N``.

        A tensor changes by Ad: K' = Ad^T K Ad, W' = Ad^T W. The kinematic connection is
        that of its own origin: under the same name it is another connection for N, and
        K^K is recomputed from K^A' and W'. A connection known by its symbols is carried
        along.

        Raises
        ------
        InputError
            If ``T_M_N`` is no pose.
        """
        T = checked_pose(T_M_N, "T_M_N")
        here = self.to_order("angular-linear")
        connection = here.connection
        if connection.tied_to_origin:
            neutral = here.to_connection("A")
            return (
                neutral.to_frame(T, frame).to_connection(connection).to_order(self.order)
            )
        a, back = se3.adjoint(T), se3.adjoint(se3.inverse(T))
        moved = replace(
            here,
            matrix=a.T @ here.matrix @ a,
            wrench=a.T @ here.wrench,
            pose=here.pose @ T,
            frame=frame,
            connection=connection.carried_to(T),
            inverse=None if here.inverse is None else back @ here.inverse @ back.T,
        )
        return moved.to_order(self.order)

    def to_order(self, order: Order) -> StiffnessTensor:
        """Components in order "angular-linear" (ours) or "linear-angular" (Pinocchio's).

        Raises
        ------
        InputError
            For another order.
        """
        if order not in (se3.ANGULAR_LINEAR, se3.LINEAR_ANGULAR):
            raise InputError(
                "unknown order", expected="angular-linear or linear-angular", got=order
            )
        if order == self.order:
            return self
        C = self.inverse
        return replace(
            self,
            matrix=self.matrix[se3.SWAP][:, se3.SWAP],
            wrench=self.wrench[se3.SWAP],
            order=order,
            inverse=None if C is None else C[se3.SWAP][:, se3.SWAP],
        )

    def to_units(self, length: str = "m", force: str = "N") -> StiffnessTensor:
        """The same in other units of length and force; angles stay radians."""
        units = Units(length, force)
        a, f = convert_length(self.units, units)
        here = self.to_order("angular-linear")
        by_length = np.array([a, a, a, 1.0, 1.0, 1.0])
        # Wrench rows scale by (force length, force); twist columns by (1, 1/length).
        pose, base = here.pose.copy(), here.base.copy()
        pose[:3, 3] *= a
        base[:3, 3] *= a
        connection = replace(
            here.connection, symbols=_scale_symbols(here.connection.symbols, a)
        )
        sizes = f * np.outer(by_length, np.array([1.0] * 3 + [1 / a] * 3))
        moved = replace(
            here,
            matrix=here.matrix * sizes,
            inverse=None if here.inverse is None else here.inverse / sizes.T,
            wrench=here.wrench * f * by_length,
            pose=pose,
            base=base,
            units=units,
            connection=connection,
        )
        return moved.to_order(self.order)

    def compliance(self) -> Compliance:
        """Inverse matrix: motion (rows) per wrench (columns).

        Raises
        ------
        UndefinedError
            If the matrix is singular, with its singular values.
        """
        here = self.to_order("angular-linear")
        inverse = here.inverse
        if inverse is None:
            compliance = None if self.is_singular else numerics.invert(here.matrix)
            if compliance is None:
                values = np.linalg.svd(here.matrix, compute_uv=False)
                raise UndefinedError(
                    "the stiffness matrix is singular: it has no inverse",
                    code="singular-stiffness",
                    values={"singular_values": values.tolist()},
                )
            inverse = compliance.matrix
        tensor = Compliance(
            inverse, self.connection, here.pose, self.frame, self.units, "angular-linear"
        )
        return tensor if self.order == se3.ANGULAR_LINEAR else tensor.to_order(self.order)

    # -- output
    # -----------------------------------------------------------------------------

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "matrix": self.matrix.tolist(),
            "connection": self.connection.to_dict(),
            "wrench": self.wrench.tolist(),
            "pose": self.pose.tolist(),
            "base": self.base.tolist(),
            "frame": self.frame,
            "units": self.units.to_dict(),
            "order": self.order,
        }

    @classmethod
    def from_controller(
        cls,
        matrix: ArrayLike,
        *,
        order: Order = "linear-angular",
        axes: Axes = "base",
        pose: ArrayLike | None = None,
        base: ArrayLike | None = None,
        frame: str = "body",
        units: Units = SI,
    ) -> StiffnessTensor:
        """The stiffness that an impedance controller was given, as K^B of the body frame,
        unloaded.

        Parameters
        ----------
        matrix : array_like (6, 6)
            Symmetric stiffness about M's origin.
        order : {"linear-angular", "angular-linear"}
            Order of its rows and columns; most controllers have translation first.
        axes : {"base", "body", "world"}
            Axes of its components: of the robot's own base B, of M, or of the room F
            (world).
        pose : array_like (4, 4), optional
            ``T_F_M``, which base and world axes need.
        base : array_like (4, 4), optional
            Pose ``T_F_B``; default the identity.
        frame, units
            As of any tensor.

        Raises
        ------
        InputError
            For a matrix that is not symmetric, other words, or base axes without a pose.
        """
        K = checked_array(matrix, (6, 6), "stiffness of the controller")
        if skew := numerics.asymmetry(K):
            raise InputError(
                "stiffness of the controller is not symmetric",
                expected="its symmetric part: without an error there is no load",
                got=f"|K - K^T| up to {skew:.3g}",
            )
        if axes != "body" and pose is None:
            raise InputError(f"{axes} axes need the pose", expected="pose=T_F_M")
        T_F_M = np.eye(4) if pose is None else checked_pose(pose)
        T_F_B = np.eye(4) if base is None else checked_pose(base, "base")
        bare = cls(K, NAMED["B"], np.zeros(6), T_F_M, frame, units, order, base=T_F_B)
        turn = bare._to_axes(axes)  # T_M_N
        there = replace(bare, pose=T_F_M @ turn)
        return there.to_frame(se3.inverse(turn), frame)

    def as_controller(
        self, *, order: Order = "linear-angular", axes: Axes = "base"
    ) -> Array:
        """The stiffness (6, 6) in the order and along the axes of a controller; see
        `from_controller`.

        Raises
        ------
        InputError
            For another order or other axes.
        """
        return self.to_frame(self._to_axes(axes), f"{axes} axes").to_order(order).matrix

    def _to_axes(self, axes: Axes) -> Array:
        """Pose in M of the frame at M's origin along M's own axes,
        the base's or the room's.
        """
        if axes not in AXES:
            raise InputError("unknown axes", expected=", ".join(AXES), got=repr(axes))
        if axes == "body":
            return np.eye(4)
        R_F_N = self.base[:3, :3] if axes == "base" else np.eye(3)
        return se3.pose(self.pose[:3, :3].T @ R_F_N)

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> StiffnessTensor:
        """Inverse of `to_dict`.

        Raises
        ------
        InputError
            For `data` that `to_dict` did not make.
        """
        try:
            connection = Connection.from_dict(data["connection"])
            units = Units(data["units"]["length"], data["units"]["force"])
            convert_length(units, SI)
            return cls(
                np.array(data["matrix"]),
                connection,
                np.array(data["wrench"]),
                np.array(data["pose"]),
                data["frame"],
                units,
                data["order"],
                base=np.array(data.get("base", np.eye(4))),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(
                "not the data of a stiffness tensor", got=str(error)
            ) from None

    def as_json(self) -> str:
        """JSON text with full double precision."""
        return json.dumps(self.to_dict())

    def to_csv(self) -> str:
        """The matrix as CSV at full double precision, with a comment line
        saying what it is.
        """
        buffer = io.StringIO()
        (a, b), (c, d) = self.block_units
        header = (
            f"K^{self.connection.name}, frame {self.frame}, order {self.order}, "
            f"blocks [[{a}, {b}], [{c}, {d}]]"
        )
        np.savetxt(
            buffer, self.matrix, delimiter=",", fmt="%.17g", header=safe_cell(header)
        )
        return buffer.getvalue()

    def save(self, path: str | Path) -> None:
        """Write to a .json, .csv or .npz file (matrix, wrench, pose), by the ending of
        `path`.

        Raises
        ------
        InputError
            For another ending, or a place that cannot be written.
        """
        path = Path(path)
        if path.suffix == ".json":
            data = f"{self.as_json()}\n".encode()
        elif path.suffix == ".csv":
            data = self.to_csv().encode()
        elif path.suffix == ".npz":
            buffer = io.BytesIO()
            np.savez(
                buffer,
                matrix=self.matrix,
                wrench=self.wrench,
                pose=self.pose,
                description=np.array(json.dumps(self.to_dict())),
            )
            data = buffer.getvalue()
        else:
            raise InputError(
                "unknown file ending", expected=".json, .csv or .npz", got=path.name
            )
        write_whole(path, data)


def _scale_symbols(symbols: Array, a: float) -> Array:
    """Christoffel symbols when lengths are multiplied by `a`:
    each linear component scales.
    """
    s = np.array([1.0] * 3 + [a] * 3)
    return symbols / s[:, None, None] / s[None, :, None] * s[None, None, :]
