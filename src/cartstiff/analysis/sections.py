"""The form of an analysis: what stands under each key, with unit, frame and meaning.

JSON schema, the page on it, the numbers that have an uncertainty and the units of numbers in maps
follow from here. `Analysis.model_validate` makes a typed object of what `analyse_posture` gives.
Everything is in the frame of the analysis, but "deflection" in that of the body; null stands for
what does not exist and for what is infinite.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from cartstiff.analysis.matrices import BY_BLOCK, BY_SOFT_BLOCK, PURE, UNITS, Definiteness
from cartstiff.arrays import Array
from cartstiff.errors import UndefinedError
from cartstiff.notes import Note

_2, _3, _4, _6 = (Field(min_length=n, max_length=n) for n in (2, 3, 4, 6))
Number = float | None
Pair = Annotated[list[Number], _2]
Vector = Annotated[list[Number], _3]
Six = Annotated[list[Number], _6]
Axes = Annotated[list[Vector], _3]
Pose = Annotated[list[Annotated[list[Number], _4]], _4]
Matrix = Annotated[list[Six], _6]

_FORCE, _MOMENT, _LENGTH, _PITCH = UNITS.force, UNITS.moment, UNITS.length, UNITS.pitch
_SOFT = UNITS.compliance
_ALONG, _ABOUT, _SCREW = (UNITS.blocks[block] for block in ("tt", "rr", "tr"))


def _is(
    words: str, unit: str = "", varies: Literal["", "number", "axes"] = "", default: Any = ...
) -> Any:
    """What a key means. Without a unit that of the keys above it; with a default it may be absent.

    What `varies` has an uncertainty: a number, or axes (columns) whose sign means nothing.
    """
    more: dict[str, Any] = {"unit": unit, "varies": varies}
    return Field(default, description=words, json_schema_extra=more)


def _may(words: str, unit: str = "", varies: Literal["", "number", "axes"] = "") -> Any:
    """The same of a key that may be absent."""
    return _is(words, unit, varies, None)


class _Section(BaseModel):
    # Built when it is first used.
    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)


class Length(_Section):
    """A length that makes angles comparable with lengths."""

    value: Number = _is("the length", varies="number")
    origin: Literal["given", "natural", "inertia", "unit"] = _is("where it comes from")
    reason: str = _is("the same for people")


class Ellipsoid(_Section):
    """Principal values of a 3x3 matrix."""

    axes: Axes = _is("principal axes as columns: a proper rotation", PURE, "axes")
    radii: Vector = _is("absolute principal values")
    eigenvalues: Vector = _is("principal values, smallest first", varies="number")
    definiteness: Definiteness = _is("their signs")
    asymmetry: Number = _is("largest entry of the antisymmetric part, which is not shown")


class Others(_Section):
    """Ellipsoids by what the other three freedoms do."""

    held: Ellipsoid | None = _is("the other three freedoms are locked")
    free: Ellipsoid | None = _is("the other three freedoms are unloaded")


class Stiffnesses(_Section):
    """Ellipsoids of stiffness."""

    translation: Others = _is("of the forces that displacements need", _ALONG)
    rotation: Others = _is("of the moments that rotations need", _ABOUT)


class Compliances(_Section):
    """Ellipsoids of compliance."""

    translation: Others = _is(
        "of the displacements that forces make", UNITS.compliance["translation"]
    )
    rotation: Others = _is("of the rotations that moments make", UNITS.compliance["rotation"])


class Ellipsoids(_Section):
    """Principal values and axes."""

    stiffness: Stiffnesses = _is("principal stiffnesses")
    compliance: Compliances = _is("principal compliances")


class HeldFree(_Section):
    """A stiffness with the other freedoms locked, and with them unloaded."""

    held: Number = _is("the other freedoms are locked", varies="number")
    free: Number = _is("the other freedoms are unloaded", varies="number")


class Direction(_Section):
    """Stiffness along and about a line through the origin."""

    name: str = _is("x, y, z, or given")
    direction: Vector = _is("unit vector", PURE)
    along: HeldFree = _is("force per displacement along it", _ALONG)
    about: HeldFree = _is("moment per rotation about it", _ABOUT)


class Centres(_Section):
    """Points of the body."""

    stiffness: Vector | None = _is("centre of stiffness", _LENGTH, "number")
    compliance: Vector | None = _is("centre of compliance", _LENGTH, "number")
    elasticity: Vector | None = _is("centre of elasticity", _LENGTH, "number")
    least_coupling: Vector | None = _is("point of least coupling", _LENGTH, "number")


class NormalForm(_Section):
    """The matrix in the frame in which its coupling blocks are diagonal."""

    T_m_n: Pose = _is("that frame in the frame of the analysis", "mixed")
    matrix: Matrix = _is("the matrix there", BY_BLOCK)
    coupling: Vector = _is("diagonal of the coupling block, smallest first", _SCREW, "number")


class DecouplingFrame(_Section):
    """The frame in which rotation and translation are coupled least."""

    T_m_n: Pose = _is("that frame in the frame of the analysis", "mixed")
    matrix: Matrix = _is("the matrix there", BY_BLOCK)
    coupling: Number = _is("size of the coupling there: 0 none, 1 full", PURE, "number")
    coupling_before: Number = _is("the same in the frame of the analysis", PURE, "number")


class ScrewAxis(_Section):
    """A line with a pitch."""

    direction: Vector = _is("unit vector", PURE, "axes")
    point: Vector = _is("its point nearest to the origin", _LENGTH, "number")
    pitch: Number = _is("null: infinite", _PITCH, "number")


class Eigenscrew(ScrewAxis):
    """A twist that a wrench on the same screw answers."""

    eigenvalue: Number = _is("wrench per twist", _SCREW, "number")
    rotational_stiffness: Number = _is("moment per rotation", _ABOUT, "number")
    translational_stiffness: Number = _is("force per displacement", _ALONG, "number")


class Eigenscrews(_Section):
    """All eigenscrews."""

    screws: list[Eigenscrew] = _is("the real ones")
    complete: bool = _is("whether they are six that are independent")
    complex_eigenvalues: list[Pair] = _is("real and imaginary part of the others", _SCREW)


class CompliantAxis(ScrewAxis):
    """An axis on which load and motion are parallel."""

    stiffness: Number = _is("load per motion", varies="number")


class Indices(_Section):
    """Single numbers; angles are multiplied by the characteristic length."""

    length: Number = _is("that length", _LENGTH)
    eigenvalues: Six = _is("smallest first", _ALONG, "number")
    definiteness: Definiteness = _is("their signs")
    condition_number: Number = _is("largest over smallest eigenvalue", PURE, "number")
    condition_exponent: Number = _is("how it changes with the length: a power", PURE)
    isotropy: Number = _is("1: equally stiff in all directions", PURE, "number")
    minimum_stiffness: Number = _is("smallest eigenvalue", _ALONG, "number")
    minimum_twist: Six = _is("its unit twist", "mixed", "axes")
    determinant: Number = _is("for any length and frame", UNITS.determinant, "number")
    translational_condition: Number = _is("condition of the block of forces", PURE, "number")
    rotational_condition: Number = _is("condition of the block of moments", PURE, "number")
    best_length: Number = _is("length of the least condition number", _LENGTH, "number")
    condition_at_best_length: Number = _is("condition number there", PURE, "number")


class Modes(_Section):
    """Eigenvalues with respect to a metric."""

    metric: Literal["length", "inertia"] = _is("the characteristic length, or a rigid body")
    eigenvalues: Six = _is("stiffness, or omega^2 in 1/s^2", "mixed", "number")
    frequencies: Six | None = _is("with a rigid body", "Hz", "number")
    twists: Matrix = _is("twists as columns", "mixed", "axes")
    definiteness: Definiteness = _is("signs of the eigenvalues")


class Spring(_Section):
    """One spring of a parallel connection."""

    kind: Literal["line", "screw", "torsional"] = _is("force, force with moment, or moment")
    stiffness: Number = _is("along its direction; torsional: about it", "mixed")
    direction: Vector = _is("unit vector", PURE)
    point: Vector = _is("its point nearest to the origin", _LENGTH)
    pitch: Number = _is("moment over force; null: infinite", _PITCH)


class DiagonalFit(_Section):
    """Independent joint springs that come closest to the target."""

    stiffness: list[Number] = _is("one for each joint; null: best locked", "mixed")
    cartesian: list[list[Number]] | None = _is("the K^B that they give", BY_BLOCK)
    residual: Number = _is("relative difference from the target", PURE)
    length: Number = _is("that angles are multiplied by there", _LENGTH)


class Target(_Section):
    """Joint stiffness that gives a desired stiffness."""

    joints: list[str] = _is("names")
    are_lengths: list[bool] = _is("whether each slides")
    matrix: list[list[Number]] = _is("matrix of joint stiffness that gives it exactly", "mixed")
    load_term: list[list[Number]] = _is("the part of it that answers the load", "mixed")
    torque: list[Number] = _is("what each joint carries", "mixed")
    definiteness: Definiteness = _is("of the matrix")
    eigenvalues: list[Number] = _is("of the matrix on a unit diagonal where possible", PURE)
    off_diagonal: Number = _is("largest relative coupling of two joints", PURE)
    is_diagonal: bool = _is("whether the joints need not be coupled")
    is_feasible: bool | None = _is("whether independent springs give it exactly")
    stable: bool = _is("whether the posture is stable with it")
    diagonal_fit: DiagonalFit | None = _is("the best that independent springs do")
    desired: Matrix = _is("the target", BY_BLOCK)
    order: str | None = _may("order of the target's file")
    order_from: str | None = _may("who says so")


class Synthesis(_Section):
    """Springs that realise the matrix."""

    passive: bool | None = _may("whether unloaded springs can give it")
    by_line_springs: bool | None = _may("whether without screw springs")
    trace: Number = _may("trace of the coupling block", _SCREW, "number")
    relative_trace: Number = _may("the same over the size of the blocks", PURE)
    rank: int | None = _may("how many springs it takes")
    screw_springs: int | None = _may("how many of them have a pitch")
    eigenvalues: Six | None = _may("over the largest, on balanced units", PURE)
    springs: list[Spring] | None = _may("one such set")
    residual: Number = _may("of their matrix, relative", PURE)
    target: Target | None = _is("joint stiffness for a desired matrix, where asked for")


class Asymmetry(_Section):
    """Asymmetry of K^A beside what the load predicts."""

    size: Number = _is("largest entry of K - K^T, relative to its block", PURE, "number")
    residual: Number = _is("largest difference from the prediction, likewise", PURE)
    agrees: bool = _is("whether that is rounding")
    predicted: Matrix = _is("K - K^T as the load predicts it", "mixed")


class Blocks(_Section):
    """A number for each 3x3 block: r moment or rotation, t force or translation."""

    rr: Number = _is("moment by rotation")
    rt: Number = _is("moment by translation")
    tr: Number = _is("force by rotation")
    tt: Number = _is("force by translation")


class ConnectionRow(_Section):
    """How the matrix of one connection differs from the reference."""

    name: str = _is("of the connection")
    reference: str = _is("the other one")
    largest: Blocks | None = _is("largest difference of entries", BY_BLOCK)
    relative: Blocks | None = _is("difference over the size of the block", PURE)
    change: Number = _is("largest relative change of the wrench", PURE, "number")
    matters: bool | None = _is("whether that exceeds the threshold")


class Connections(_Section):
    """Whether the choice of connection matters here."""

    reference: str = _is("what the others are compared with")
    rows: list[ConnectionRow] = _is("one for each other connection")
    threshold: Number = _is("relative change above which the choice matters", PURE)
    measure: Literal["energy", "length"] = _is("how the change is measured")
    length: Number = _is("of the measure", _LENGTH)
    matters: bool = _is("whether it does for any")
    verdict: str = _is("the answer in a sentence")


class Load(_Section):
    """The load, and what it does while the body moves."""

    kind: str = _is("dead, follower or conservative")
    meaning: str = _is("the same for people")
    at: Vector = _is("point at which it acts, in M", _LENGTH)
    moment: Vector = _is("about that point, in M", _MOMENT)
    force: Vector = _is("in M", _FORCE)
    is_tangent: bool = _is("whether the analysed matrix is the tangent under it")


class Share(_Section):
    """A joint's or spring's part in a deflection."""

    name: str = _is("of the joint or spring")
    is_length: bool | None = _is("whether it slides; null: a link that does both")
    energy: Number = _is("its part of the energy", _MOMENT)
    share: Number = _is("its part of the displacement (joints) or the energy (springs)", PURE)
    motion: Number = _may("joints: how far it turns or slides")
    twist: Six | None = _may("joints: motion of the body by it")
    displacement: Vector | None = _may("joints: of the point by it")
    elongation: Number = _may("springs: how far it gives")
    force: Number = _may("springs: change of its force")


class Deflection(_Section):
    """Linear deflection under a wrench, in the axes of M."""

    wrench: Six = _is("moment about the point acts_at, and force", "mixed")
    wrench_about_origin: Six = _is("the same, its moment about M's origin: C times it", "mixed")
    twist: Six = _is("rotation, and translation of M", "mixed", "number")
    point: Vector = _is("point of the body that is looked at, in M", _LENGTH)
    displacement: Vector = _is("of that point", _LENGTH, "number")
    energy: Number = _is("work of the growing wrench", _MOMENT, "number")
    acts_at: Vector = _is("point at which the wrench acts, in M", _LENGTH)
    connection: str = _is("of the matrix that is used")
    kind: Literal["joints", "springs"] | None = _is("what shares it")
    shares: list[Share] | None = _is("the parts")
    load_share: Number = _may("part of the energy that the load takes or gives")


class Analysis(_Section):
    """Everything that is read from a stiffness matrix."""

    connection: str | None = _is("the matrix that is analysed; null: only a compliance exists")
    symmetrised: bool = _is("whether its symmetric part is")
    definiteness: Definiteness | None = _is("of that")
    frame: Pose = _is("frame of the analysis in M", "mixed")
    length: Length = _is("characteristic length", _LENGTH)
    stiffness: Matrix | None = _is("the analysed matrix", BY_BLOCK, "number")
    compliance: Matrix | None = _is("its compliance", BY_SOFT_BLOCK, "number")
    ellipsoids: Ellipsoids = _is("principal values")
    directions: list[Direction] = _is("stiffness along and about directions")
    centres: Centres | None = _is("points")
    normal_form: NormalForm | None = _is("normal form")
    decoupling_frame: DecouplingFrame | None = _is("frame of least coupling")
    eigenscrews: Eigenscrews | None = _is("twists answered by a wrench on the same screw")
    wrench_compliant_axes: list[CompliantAxis] | None = _is("force and displacement", _ALONG)
    twist_compliant_axes: list[CompliantAxis] | None = _is("moment and rotation", _ABOUT)
    indices: Indices | None = _is("single numbers")
    modes: Modes | None = _is("eigenvalues with respect to a metric")
    synthesis: Synthesis | None = _is("springs that give the matrix")
    asymmetry: Asymmetry | None = _is("of K^A")
    connections: Connections | None = _is("whether the choice of connection matters")
    load: Load | None = _is("what the load does")
    deflection: Deflection | None = _is("linear deflection under the load or an added wrench")
    uncertainty: dict[str, Any] | None = _is("spread of every number, from tolerances")
    notes: list[dict[str, Any]] = _is("why something does not exist")


class Notes:
    """Collects the reasons of what does not exist."""

    def __init__(self) -> None:
        self.entries: list[dict[str, Any]] = []

    def add(self, error: UndefinedError, what: str) -> None:
        """Note an error once."""
        note = Note.of(error, what).as_dict()
        if note not in self.entries:
            self.entries.append(note)

    def attempt(self, what: str, function: Callable[..., Any], *arguments: Any) -> Any:
        """Call the function; None, with a note, where it says that its result does not exist."""
        try:
            return function(*arguments)
        except UndefinedError as error:
            self.add(error, what)
            return None


def section(keys: Iterable[str], *sources: object) -> dict[str, Any]:
    """The keys of a section, each from the first source that has an attribute of its name."""
    return {
        key: next(getattr(source, key) for source in sources if hasattr(source, key))
        for key in keys
    }


@cache
def schema() -> dict[str, Any]:
    """JSON Schema of an analysis (draft 2020-12), without references."""
    whole = Analysis.model_json_schema()
    definitions = whole.pop("$defs")

    def plain(node: Any) -> Any:
        if isinstance(node, list):
            return [plain(each) for each in node]
        if not isinstance(node, dict):
            return node
        if "$ref" in node:
            own = plain(definitions[node["$ref"].rpartition("/")[2]])
            return own | {k: v for k, v in node.items() if k != "$ref"}
        return {k: plain(v) for k, v in node.items() if k != "title" or not isinstance(v, str)}

    answer: dict[str, Any] = plain(whole)
    return answer


def _inner(node: dict[str, Any]) -> dict[str, Any]:
    """What stands there where it exists."""
    kinds = [kind for kind in node.get("anyOf", [node]) if kind.get("type") != "null"]
    return kinds[0] if len(kinds) == 1 else node


@cache
def varying() -> tuple[tuple[str, bool, bool], ...]:
    """Paths of what has an uncertainty; whether it is axes, and whether it stands in rows."""

    def walk(node: dict[str, Any], path: str, rows: bool) -> Iterator[tuple[str, bool, bool]]:
        for key, value in _inner(node).get("properties", {}).items():
            here, inside = f"{path}.{key}".lstrip("."), _inner(value)
            if value.get("varies"):
                yield here, value["varies"] == "axes", rows
            elif "properties" in inside:
                yield from walk(inside, here, rows)
            elif "properties" in inside.get("items", {}):
                yield from walk(inside["items"], here, True)

    return tuple(walk(schema(), "", False))


def unit_of(path: str) -> str:
    """Unit of the number at a dotted path of an analysis, with {length} and {force}; "1" for none.

    Entries of matrices have the unit of their block; what is not of one unit is "mixed".
    """
    node, unit, keys = schema(), "", path.split(".")
    for i, key in enumerate(keys):
        inside = _inner(node)
        rows = inside.get("items", {})
        if key.isdigit():
            node = rows
            continue
        node = inside.get("properties", rows.get("properties", {})).get(key, {})
        unit = node.get("unit") or unit
        blocks = {BY_BLOCK: UNITS.blocks, BY_SOFT_BLOCK: UNITS.blocks_of_compliance}.get(unit)
        if blocks is not None and len(keys) > i + 2:
            return blocks["".join("rt"[int(k) >= 3] for k in keys[i + 1 : i + 3])]
        if blocks is not None and key in blocks:
            return blocks[key]
    return "mixed" if unit in (BY_BLOCK, BY_SOFT_BLOCK) else unit


def _look_up(tree: Any, path: str) -> Any:
    """What stands at a dotted path; of rows a list."""
    for i, key in enumerate(keys := path.split(".")):
        if isinstance(tree, list):
            return [_look_up(row, ".".join(keys[i:])) for row in tree] or None
        tree = tree.get(key) if isinstance(tree, Mapping) else None
    return tree


def numbers(analysis: Mapping[str, Any], like: Mapping[str, Any] | None = None) -> dict[str, Array]:
    """All numbers of an analysis that depend on the parameters, by dotted name.

    What does not exist is NaN or missing. Principal values are sorted and their axes and screws
    stand in the same order, with the signs of `like`: where two principal values cross, these
    vectors change place, and their spread says so.

    Parameters
    ----------
    analysis : mapping
        From `cartstiff.analysis.posture.summarise` or `cartstiff.analysis.posture`.
    like : mapping, optional
        The analysis whose signs of axes are taken.
    """
    values: dict[str, Any] = {}
    like = analysis if like is None else like
    for path, are_axes, in_rows in varying():
        value = _look_up(analysis, path)
        if value is not None:
            along = 1 if in_rows else 0
            values[path] = _signed(value, _look_up(like, path), along) if are_axes else value
    return {name: np.array(value, dtype=float) for name, value in values.items()}


def _signed(value: Any, model: Any, along: int) -> Array:
    """Vectors turned to the side of their models."""
    vectors = np.array(value, dtype=float)
    if model is None or np.shape(model) != vectors.shape:
        return vectors
    products = np.sum(vectors * np.array(model, dtype=float), axis=along, keepdims=True)
    return np.where(products < 0.0, -vectors, vectors)
