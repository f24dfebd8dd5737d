r"""Named numbers of many postures: what a map can hold.

A quantity is evaluated on stacks of matrices and equals, posture by posture, what
`cartstiff.analysis` says of the same thing. An asymmetric matrix (K^A, a tangent under load) is
read by its symmetric part, as there. What does not exist at a posture is NaN.

Any other number of the analysis can be named by its path in the analysis of one posture, such as
``indices.condition_exponent`` or ``centres.stiffness.2``; it is then found posture by posture, some
hundred times slower.

Stacks (N, 6, 6) of stiffness or compliance matrices, read all at once.

Each function equals, row by row, the function of `cartstiff.analysis` that it names. Rows with a
NaN give NaN.

What a quantity of many postures is, what it may depend on, and what it is computed from.

Any number of the analysis of one posture as a quantity of many, by its path.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartstiff import numerics
from cartstiff.analysis.asymmetry import largest_in_blocks, relative_changes, roots_of_positive
from cartstiff.analysis.ellipsoids import (
    Freedom,
    Others,
    compliance_ellipsoid,
    stiffness_about,
    stiffness_along,
    stiffness_ellipsoid,
)
from cartstiff.analysis.indices import isotropies
from cartstiff.analysis.matrices import (
    ROTATION,
    TRANSLATION,
    UNITS,
    block_scales,
    eliminate_each,
    stiffnesses_of_motions,
    symmetric_part,
    with_angles_times,
)
from cartstiff.analysis.posture import summarise
from cartstiff.analysis.sections import unit_of
from cartstiff.arrays import plain
from cartstiff.batch.vibrations import ManyModes
from cartstiff.errors import InputError, UndefinedError, UnknownNameError
from cartstiff.geometry.se3 import Array
from cartstiff.matrix_names import OF_MANY
from cartstiff.mechanisms.contract import Units
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.platform import Platform
from cartstiff.stiffness.applied_load import LoadKind, wrench_in_body
from cartstiff.vibration.chatter import Milling
from cartstiff.vibration.response import Damping


def on_finite(function: Callable[..., Array], *stacks: Array, shape: tuple[int, ...] = ()) -> Array:
    """Apply a function of stacks to the rows in which all are finite; NaN (N, *shape) elsewhere."""
    finite = np.ones(len(stacks[0]), bool)
    for stack in stacks:
        finite &= np.isfinite(stack).all(axis=tuple(range(1, stack.ndim)))
    if finite.all():
        return function(*stacks)
    result = np.full((len(finite), *shape), np.nan)
    if finite.any():
        result[finite] = function(*(stack[finite] for stack in stacks))
    return result


def eigenvalues(K: Array, C: Array, length: float | Array) -> Array:
    """Of stiffness matrices with lengths scaled (N, 6), as `cartstiff.analysis.indices`."""
    exists = np.isfinite(K).all(axis=(1, 2))
    if not exists.all():
        values = np.full((len(K), 6), np.nan)
        if exists.any():
            lengths = np.broadcast_to(length, exists.shape)[exists]
            values[exists] = eigenvalues(K[exists], C[exists], lengths)
        return values
    scaled = with_angles_times(K, 1.0 / np.asarray(length))
    values = numerics.eigenvalues(scaled)
    plain = np.asarray(numerics.condition(values) < numerics.PLAIN_BLOCK)
    rows = np.logical_not(plain) & np.isfinite(C).all(axis=(1, 2))
    if rows.any():
        inverse = with_angles_times(C, length)
        values[rows] = numerics.eigenvalues(scaled[rows], inverse[rows])
    return values


def block_values(
    stack: Array,
    inverse: Array,
    keep: slice,
    is_held: bool,
    one: Callable[[Array, Array], Array],
) -> Array:
    """Principal values (N, 3) of a stack of matrices, the other freedoms held or free.

    Held they are those of the matrix's block, free the inverses of those of the inverse's block;
    where that block has lost digits, what one posture says; where there is no inverse, those of
    the matrix alone.

    Parameters
    ----------
    stack, inverse : ndarray, shape (N, 6, 6)
        Stiffness and compliance, or the other way round; NaN where there is none.
    keep : slice
        `ROTATION` or `TRANSLATION` of `cartstiff.analysis.matrices`.
    is_held : bool
        Whether the block is that of `stack`.
    one : callable
        Values (3,) of one matrix, and its inverse.
    """
    exists = np.isfinite(stack).all(axis=(1, 2))
    if not exists.all():
        values = np.full((len(stack), 3), np.nan)
        if exists.any():
            values[exists] = block_values(stack[exists], inverse[exists], keep, is_held, one)
        return values
    values = numerics.eigenvalues((stack if is_held else inverse)[:, keep, keep])
    plain = np.asarray(numerics.condition(values) < numerics.PLAIN_BLOCK)
    if not is_held:
        values = np.sort(1.0 / values, axis=1)
    known = np.atleast_1d(np.isfinite(inverse).all(axis=(1, 2)))
    for i in np.flatnonzero(known & np.logical_not(plain)):
        try:
            values[i] = one(stack[i], inverse[i])
        except UndefinedError:
            values[i] = np.nan
    if (alone := ~known).any():
        own = stack[alone]
        blocks = own[:, keep, keep]
        size = np.abs(blocks).max(axis=(1, 2))[:, None]
        values[alone] = numerics.eigenvalues(blocks if is_held else eliminate_each(own, keep))
        values[alone] = np.where(np.abs(values[alone]) <= numerics.ZERO * size, 0.0, values[alone])
    return values


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
            lambda: eigenvalues(self.K, self.C, self.settings.length),
        )

    def singular_values(self) -> Array:
        """Of the Jacobian of length-scaled twists per length-scaled coordinates."""
        J = self.arrays["jacobian"]
        scale = np.repeat([self.settings.length, 1.0], 3)[:, None]
        columns = np.where(self._is_length(J.shape[2]), self.settings.length, 1.0)
        return on_finite(
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
        Outputs of `cartstiff.batch.postures.analyse_many`; {connection} stands for the connection,
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


def path_quantity(path: str) -> Quantity:
    """The quantity of a dotted path: keys and, in lists, positions counted from 0.

    Raises
    ------
    InputError
        If the analysis of a stiffness has no number at this path.
    """
    _check(path)

    def function(s: Stacks) -> Array:
        rows = s.once("analyses", lambda: _analyses(s))
        return np.array([_number(row, path) for row in rows])

    return Quantity(
        path,
        f"{path} of the analysis",
        unit_of(path),
        function,
        (*(f"stiffness_{c}" for c in OF_MANY), "inverse", "compliance_{connection}", "wrench"),
        "length",
        None,
    )


def _check(path: str) -> None:
    """Refuse a path that leads to no number where everything exists."""
    model = summarise({"B": np.diag([3.0, 2.0, 4.0, 50.0, 60.0, 70.0])}, np.zeros(6), 0.2)
    node: Any = model
    for key in path.split("."):
        if isinstance(node, dict) and key not in node:
            raise UnknownNameError("part of the analysis", key, [str(k) for k in node])
        node = _step(node, key)
    if isinstance(node, bool) or not isinstance(node, (int, float)):
        shown = "a group" if isinstance(node, dict) else "a list" if isinstance(node, list) else ""
        raise InputError(
            f"{path} is not a number of the analysis",
            expected="a path to one number",
            got=shown or repr(node),
        )


def _step(node: Any, key: str) -> Any:
    if isinstance(node, dict):
        return node.get(key)
    if isinstance(node, list) and key.isdigit() and int(key) < len(node):
        return node[int(key)]
    return None


def _number(tree: Any, path: str) -> float:
    for key in path.split("."):
        tree = _step(tree, key)
    return float(tree) if isinstance(tree, (int, float)) else np.nan


def _analyses(s: Stacks) -> list[dict[str, Any]]:
    settings, rows = s.settings, []
    wrenches = np.nan_to_num(s.arrays["wrench"])
    for i, W in enumerate(wrenches):
        matrices = {c: _or_none(s.arrays[f"stiffness_{c}"][i]) for c in OF_MANY}
        compliance = _or_none(s.arrays[f"compliance_{settings.connection}"][i])
        rows.append(
            plain(
                summarise(
                    matrices,
                    W,
                    settings.length,
                    connection=settings.connection,
                    compliance=compliance,
                    inverse=_or_none(s.C[i]),
                    springs=False,
                )
            )
        )
    return rows


def _or_none(matrix: Array) -> Array | None:
    return matrix if np.isfinite(matrix).all() else None


_PAIR, _FREE = ("stiffness_{matrix}", "inverse"), ("free",)
_DEFLECT = ("compliance_{connection}", "pose", "wrench")
_BLOCKS = {"rotation": ROTATION, "translation": TRANSLATION}
_STIFF, _SOFT = UNITS.stiffness, UNITS.compliance
_ALONG = _STIFF["translation"]


_FREEDOMS: tuple[Freedom, ...] = ("translation", "rotation")
_OTHERS: tuple[Others, ...] = ("free", "held")


def _principal(
    s: Stacks, kind: str, freedom: Freedom, others: Others, pair: Others | None = None
) -> Array:
    """Principal values (N, 3) of stiffness or compliance, the other freedoms held or free."""

    def make() -> Array:
        stiff = kind == "stiffness"
        function = stiffness_ellipsoid if stiff else compliance_ellipsoid

        def one(matrix: Array, inverse: Array) -> Array:
            return function(matrix, freedom, others, None, inverse).eigenvalues

        taken = others if pair is None else pair
        K, C = s.pair(taken)
        stack, inverse = (K, C) if stiff else (C, K)
        return block_values(stack, inverse, _BLOCKS[freedom], stiff == (others == "held"), one)

    return s.once(f"{kind} {freedom} {others} {pair}", make)


def _principal_quantities() -> Iterator[Quantity]:
    ends = ("min", "smallest", 0), ("max", "largest", 2)
    for kind, freedom, others, (end, which, column) in product(
        ("stiffness", "compliance"), _FREEDOMS, _OTHERS, ends
    ):
        is_stiff, locked = kind == "stiffness", "rotation translation".replace(freedom, "").strip()
        yield Quantity(
            f"{'' if is_stiff else 'compliance_'}{freedom}_{others}_{end}",
            f"{which} principal {freedom}al {kind}, {locked} {others}",
            (_STIFF if is_stiff else _SOFT)[freedom],
            partial(_end, kind=kind, freedom=freedom, others=others, column=column),
            _PAIR if others == "held" else _FREE,
            better="larger" if is_stiff else "smaller",
        )


def _end(s: Stacks, column: int, **which: Any) -> Array:
    return _principal(s, **which)[:, column]


def _directional_quantities() -> Iterator[Quantity]:
    for (word, block, unit), others in product(
        (("along", TRANSLATION, _ALONG), ("about", ROTATION, _STIFF["rotation"])), _OTHERS
    ):
        yield Quantity(
            f"{word}_{others}",
            f"stiffness {word} the direction, everything else {others}",
            unit,
            partial(_on_axis, block=block, others=others),
            (*(_PAIR if others == "held" else _FREE), "pose"),
            "direction",
        )


def _on_axis(s: Stacks, block: slice, others: str) -> Array:
    """Stiffness along or about the direction through the frame's origin."""
    u = s.direction()
    if others == "held":
        return _held_on_axis(s, block, u)
    K, C = s.pair("free")
    C = C[:, block, block]
    give = np.einsum("ni,nij,nj->n", u, C, u)
    stiffness: Array = 1.0 / give
    exists = np.isfinite(K).all(axis=(1, 2))
    # Without a K, a direction that does not give is held by the structure: no number says how much.
    rigid = np.abs(give) <= numerics.ZERO * np.abs(C).max(axis=(1, 2))
    stiffness[~exists & rigid] = np.nan
    function = stiffness_along if block is TRANSLATION else stiffness_about
    for i in np.flatnonzero(exists & ~np.isfinite(C).all(axis=(1, 2))):
        try:
            stiffness[i] = function(K[i], u[i], others="free")
        except UndefinedError:
            stiffness[i] = np.nan
    return stiffness


def _held_on_axis(s: Stacks, block: slice, u: Array) -> Array:
    """`stiffnesses_of_motions` of turning about, or shifting along, a direction (N, 3)."""
    twists = np.zeros((len(u), 6))
    twists[:, block] = u
    return stiffnesses_of_motions(twists, s.K, ~np.isfinite(s.C).all(axis=(1, 2)))


def _deflection(s: Stacks, part: slice) -> Array:
    def make() -> Array:
        C = s.arrays[f"compliance_{s.settings.connection}"]
        return np.einsum("nij,nj->ni", C, s.added_wrench())

    return np.linalg.norm(s.once("deflection", make)[:, part], axis=1)


def _unstable(s: Stacks) -> Array:
    (rr, _), (_, tt) = np.moveaxis(block_scales(s.K), 0, -1)
    length = np.where((rr > 0) & (tt > 0), np.sqrt(rr / tt), 1.0)
    values = eigenvalues(s.K, s.C, length)
    return np.where(np.isnan(values).any(axis=1), np.nan, (values < 0.0).sum(axis=1))


def _natural_length(s: Stacks) -> Array:
    translation = _principal(s, "stiffness", "translation", "held")
    rotation = _principal(s, "stiffness", "rotation", "free", pair="held")
    length = np.exp((np.log(rotation).sum(axis=1) - np.log(translation).sum(axis=1)) / 6.0)
    positive = (translation[:, 0] > 0.0) & (rotation[:, 0] > 0.0)
    return np.where(positive, length, np.nan)


def _asymmetry(s: Stacks) -> Array:
    K = s.arrays["stiffness_A"]
    return largest_in_blocks(K - K.swapaxes(1, 2), K)


def _connection_change(s: Stacks) -> Array:
    """Largest change that `cartstiff.analysis.asymmetry.compare_connections` finds."""
    reference, scale = s.arrays[f"stiffness_{s.settings.connection}"], 1.0 / s.settings.length
    scaled = with_angles_times(reference, scale)
    roots = on_finite(roots_of_positive, scaled, shape=(6, 6))
    worst = np.full(len(reference), np.nan)
    for name in OF_MANY:
        d = s.arrays[f"stiffness_{name}"] - reference
        if name != s.settings.connection:
            change = on_finite(relative_changes, scaled, roots, with_angles_times(d, scale))
            worst = np.fmax(worst, change)
    return worst


def _ratio(s: Stacks) -> Array:
    values = s.once("singular values", s.singular_values)
    return values[:, -1] / values[:, 0]


def _manipulability(s: Stacks) -> Array:
    return on_finite(
        lambda m: np.prod(np.linalg.svd(m, compute_uv=False), axis=1), s.arrays["jacobian"]
    )


def _column(s: Stacks, of: str, which: int) -> Array:
    values: Array = getattr(s, of)()
    return values[:, which]


def _vibration_quantities() -> Iterator[Quantity]:
    for name, words, unit, of in (
        ("frequency", "natural frequency {} under the load, the lowest first", "Hz", "frequencies"),
        (
            "damping",
            "damping ratio of mode {} under the load, the slowest first",
            "1",
            "damping_ratios",
        ),
    ):
        for i in range(6):
            yield Quantity(
                f"{name}_{i + 1}",
                words.format(i + 1),
                unit,
                partial(_column, of=of, which=i),
                ("pose",),
                "damping" if name == "damping" else None,
            )
    yield Quantity(
        "limiting_depth",
        "depth of a milling cut that is stable at every speed",
        "{length}",
        Stacks.limiting_depths,
        ("pose",),
        "milling",
    )


#: Every quantity by name.
QUANTITIES: dict[str, Quantity] = {
    q.name: q
    for q in (
        *_principal_quantities(),
        *_directional_quantities(),
        Quantity(
            "deflection",
            "displacement of the frame's origin under the given wrench",
            "{length}",
            lambda s: _deflection(s, TRANSLATION),
            _DEFLECT,
            "deflect",
            "smaller",
        ),
        Quantity(
            "deflection_angle",
            "rotation of the body under the given wrench",
            "rad",
            lambda s: _deflection(s, ROTATION),
            _DEFLECT,
            "deflect",
            "smaller",
        ),
        Quantity(
            "condition",
            "condition number of K at the characteristic length",
            "1",
            lambda s: numerics.condition(s.eigenvalues()),
            _PAIR,
            "length",
            "smaller",
        ),
        Quantity(
            "isotropy",
            "geometric over arithmetic mean of the eigenvalues of K",
            "1",
            lambda s: isotropies(s.eigenvalues()),
            _PAIR,
            "length",
        ),
        Quantity(
            "minimum",
            "smallest eigenvalue of K at the characteristic length",
            _ALONG,
            lambda s: s.eigenvalues()[:, 0],
            _PAIR,
            "length",
        ),
        Quantity(
            "translation_condition",
            "condition number of the translational block of K",
            "1",
            lambda s: numerics.condition(_principal(s, "stiffness", "translation", "held")),
            _PAIR,
            better="smaller",
        ),
        Quantity(
            "rotation_condition",
            "condition number of the rotational block of K",
            "1",
            lambda s: numerics.condition(_principal(s, "stiffness", "rotation", "held")),
            _PAIR,
            better="smaller",
        ),
        Quantity(
            "determinant",
            "determinant of K",
            UNITS.determinant,
            lambda s: np.prod(s.eigenvalues(), axis=1) * s.settings.length**6,
            _PAIR,
        ),
        Quantity(
            "unstable_directions",
            "number of negative eigenvalues of K",
            "1",
            _unstable,
            _PAIR,
            better="smaller",
        ),
        Quantity(
            "natural_length",
            "length at which rotation and translation are equally stiff",
            "{length}",
            _natural_length,
            _PAIR,
            better=None,
        ),
        Quantity(
            "asymmetry",
            "largest entry of K^A - (K^A)^T, relative to its block",
            "1",
            _asymmetry,
            ("stiffness_A",),
            better="smaller",
        ),
        Quantity(
            "connection_change",
            "largest relative change of stiffness by another choice of connection",
            "1",
            _connection_change,
            tuple(f"stiffness_{name}" for name in OF_MANY),
            "length",
            "smaller",
        ),
        Quantity(
            "singular_value_ratio",
            "smallest over largest singular value of the Jacobian",
            "1",
            _ratio,
            ("jacobian",),
            "length",
        ),
        Quantity(
            "manipulability",
            "product of the Jacobian's singular values, each joint in its own unit",
            "{length}^3",
            _manipulability,
            ("jacobian",),
        ),
        *_vibration_quantities(),
        Quantity(
            "moment",
            "size of the load's moment",
            UNITS.moment,
            lambda s: np.linalg.norm(s.arrays["wrench"][:, :3], axis=1),
            ("wrench",),
            better=None,
        ),
        Quantity(
            "force",
            "size of the load's force",
            "{force}",
            lambda s: np.linalg.norm(s.arrays["wrench"][:, 3:], axis=1),
            ("wrench",),
            better=None,
        ),
        Quantity(
            "energy",
            "potential energy of springs, gravity and loads",
            UNITS.moment,
            lambda s: s.arrays["energy"],
            ("energy",),
            better=None,
        ),
    )
}


def choose_quantities(
    names: Sequence[str], settings: Settings, elastic: ElasticMechanism
) -> tuple[Quantity, ...]:
    """Quantities by name, checked against the settings and the mechanism.

    Raises
    ------
    UnknownNameError
        For a name that is neither in `QUANTITIES` nor a path of the analysis.
    InputError
        If a quantity asks for a setting that is missing, is named twice, or does not exist for this
        kind of mechanism.
    """
    if settings.connection not in OF_MANY:
        raise UnknownNameError("connection", settings.connection, OF_MANY)
    if not names:
        raise InputError("no quantity was named", expected="one or more names")
    chosen = []
    for name in names:
        if names.count(name) > 1:
            raise InputError("quantity given twice", got=repr(name))
        if "." in name:
            chosen.append(path_quantity(name))
            continue
        if name not in QUANTITIES:
            raise UnknownNameError("quantity", name, QUANTITIES)
        quantity = QUANTITIES[name]
        if quantity.asks == "direction" and settings.direction is None:
            raise InputError(f"the quantity {name} needs a direction")
        if quantity.asks == "deflect" and settings.deflect is None and not settings.is_loaded:
            raise InputError(f"the quantity {name} needs a wrench to deflect the body")
        if quantity.asks == "milling" and settings.milling is None:
            raise InputError(f"the quantity {name} needs a cutter (milling)")
        if quantity.asks in ("damping", "milling") and not settings.damping.acts_on(elastic):
            raise InputError(f"the quantity {name} needs damping", got="no ratio, no dampers")
        if "jacobian" in quantity.needs and elastic.mechanism.kind in ("closed-chain", "parallel"):
            raise InputError(
                f"the quantity {name} is not defined for a mechanism with closures",
                expected="a serial chain or a platform",
            )
        if name == "manipulability":
            quantity = replace(quantity, unit=_manipulability_unit(elastic))
        chosen.append(quantity)
    return tuple(chosen)


def _manipulability_unit(elastic: ElasticMechanism) -> str:
    """Unit of the product of singular values: each joint counts in its own unit."""
    mechanism = elastic.mechanism
    slides = sum(c.is_length for c in mechanism.coordinates)
    if isinstance(mechanism, Platform):
        slides = 6  # what moves are the legs
    elif len(mechanism.coordinates) < 6 or (slides and len(mechanism.coordinates) > 6):
        return "mixed, of rad and {length}"
    return f"{{length}}^{3 - slides}"


def evaluate(
    quantities: Sequence[Quantity],
    arrays: Mapping[str, Array],
    settings: Settings,
    lengths: Array | None = None,
    swing: ManyModes | None = None,
) -> dict[str, Array]:
    """Values (N,) of quantities by name, from the arrays of `analyse_many`.

    Parameters
    ----------
    quantities : sequence of Quantity
        From `choose_quantities`.
    arrays : mapping of str to ndarray
        Outputs by name, with NaN where one does not exist.
    settings : Settings
        What the quantities refer to.
    lengths : ndarray of bool, shape (n,), optional
        Which coordinates are distances; default none.
    swing : ManyModes, optional
        Small vibrations at the postures, where they may be asked for.
    """
    source = Stacks(arrays, settings, lengths, swing)
    with np.errstate(all="ignore"):
        return {q.name: np.asarray(q.function(source), float) for q in quantities}
