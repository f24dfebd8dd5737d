"""Mechanism files, checked and built: a refusal names file, line and key."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import cache, reduce
from graphlib import CycleError, TopologicalSorter
from importlib import import_module
from operator import or_
from pathlib import Path
from string import digits
from typing import Annotated, Any

from pydantic import BaseModel, Field, TypeAdapter, ValidationError

from cartstiff.arrays import checked_number
from cartstiff.errors import InputError, UnknownNameError, check_name, one_line
from cartstiff.expressions import Expression, is_name
from cartstiff.loading.schema import FileModel, with_findings
from cartstiff.loading.yaml_file import Lines
from cartstiff.mechanisms.contract import SI, GivenStiffness, Units, convert_length
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.notes import Note

#: Keys of a file whose texts are for readers.
_WORDS = ("name", "description", "source")
#: Module and model of each kind of file: a file loads the classes of its own kind.
_MODELS = {
    "serial": ("schema", "SerialFile"),
    "stewart-gough": ("platform_schema", "PlatformFile"),
    "springs": ("platform_schema", "SpringsFile"),
    "parallel": ("leg_schema", "ParallelFile"),
    "closed-chain": ("schema", "ClosedChainFile"),
}
_KINDS = ", ".join(_MODELS)
Place = tuple[str | int, ...]


@dataclass(frozen=True)
class Parameters:
    """Values of a file's parameters.

    Attributes
    ----------
    values : mapping of str to float
        All of them.
    given : mapping of str to float
        Those that were set from outside.
    """

    values: Mapping[str, float]
    given: Mapping[str, float]

    def notes(self) -> list[Note]:
        """What was set, for results."""
        if not self.given:
            return []
        words = ", ".join(f"{name} = {value:g}" for name, value in self.given.items())
        return [Note("parameters-set", f"set instead of what the file says: {words}", self.given)]


def with_parameters(
    data: dict[str, Any], place: Callable[[Place], str], chosen: Mapping[str, Any] | None = None
) -> tuple[dict[str, Any], Parameters]:
    """Data of a file without its parameters: numbers in place of the arithmetic.

    Parameters
    ----------
    data : dict
        As read; texts that begin with "=" are arithmetic over the names under ``parameters``.
    place : callable
        From keys to words for messages.
    chosen : mapping of str to float, optional
        Values that count instead of the file's.

    Raises
    ------
    InputError
        For names that cannot be used, are not known, depend on themselves, or are not used.
    """
    asked = {
        name: checked_number(x, f"parameter {name!r}") for name, x in dict(chosen or {}).items()
    }
    entries = data.get("parameters", {})
    if not isinstance(entries, dict):
        raise InputError(
            "cannot be used",
            where=place(("parameters",)),
            expected="names and their numbers",
            got=one_line(entries),
        )
    for name in asked:
        if name not in entries:
            if not entries:
                raise InputError(
                    "the mechanism has no parameters",
                    where=place(()),
                    expected="a key 'parameters' in its file",
                    got=one_line(str(name)),
                )
            raise UnknownNameError("parameter", str(name), entries, where=place(()))
    rest = {key: value for key, value in data.items() if key != "parameters"}
    units = _own_units(rest)
    values, used = _evaluated(entries, asked, place, units)
    # A stiffness with its unit is read where it is used: it may be of the other kind.
    known = {k: x if isinstance(x, str) and x[:1] != "=" else values[k] for k, x in entries.items()}
    known |= asked
    filled = {
        key: value
        if key in _WORDS
        else _in_units(
            _filled(value, (key,), known, values, used, place), (key,), rest, units, place
        )
        for key, value in rest.items()
    }
    for name in entries:
        if name not in used:
            raise InputError(
                f"parameter {name!r} is not used",
                where=place(("parameters", name)),
                expected=f"a number such as '={name}' in the file",
            )
    return filled, Parameters(values, asked)


def _evaluated(
    entries: Mapping[str, Any],
    asked: Mapping[str, float],
    place: Callable[[Place], str],
    units: Units,
) -> tuple[dict[str, float], set[str]]:
    """Value of every parameter, and the names that others need, by what the file says."""
    formulas: dict[str, Expression | float] = {}
    needed: dict[str, frozenset[str]] = {}
    for name, entry in entries.items():
        where = place(("parameters", name))
        if not is_name(name):
            raise InputError(
                "name of a parameter cannot be used",
                where=where,
                got=repr(name),
                expected="letters, digits and _, no word of arithmetic",
            )
        if isinstance(entry, str) and entry.startswith("="):
            formulas[name] = formula = Expression(entry[1:], where)
            needed[name] = formula.names
            for other in sorted(formula.names):
                check_name("parameter", other, entries, where)
        elif isinstance(entry, (int, float)) and not isinstance(entry, bool):
            formulas[name] = checked_number(entry, where)
        elif isinstance(entry, str) and entry[:1] in (*"+-.", *digits):
            given = GivenStiffness.read(entry, where)
            formulas[name] = given.in_units(units if given.is_length else SI, given.is_length)
        else:
            raise InputError(
                "cannot be used",
                where=where,
                got=one_line(entry),
                expected="a number, or arithmetic such as '=2*r', or a stiffness with its unit",
            )
    try:
        order = [*TopologicalSorter(needed).static_order()]
    except CycleError as error:
        circle = error.args[1][::-1]
        raise InputError(
            "parameters depend on each other in a circle",
            got=" -> ".join(circle),
            where=place(("parameters", circle[0])),
        ) from None
    values: dict[str, float] = {}
    for name in [*order, *entries]:
        own = asked.get(name, formulas[name])
        values[name] = own.value(values) if isinstance(own, Expression) else own
    return {name: values[name] for name in entries}, set().union(*needed.values())


def _filled(
    data: Any,
    at: Place,
    known: Mapping[str, float | str],
    values: Mapping[str, float],
    used: set[str],
    place: Callable[[Place], str],
) -> Any:
    """The data with numbers in place of arithmetic; adds the names that it needs to `used`.

    Names alone have what is `known` of them.
    """
    if isinstance(data, dict):
        return {k: _filled(v, (*at, k), known, values, used, place) for k, v in data.items()}
    if isinstance(data, list):
        return [_filled(v, (*at, i), known, values, used, place) for i, v in enumerate(data)]
    if not isinstance(data, str) or not data.startswith("="):
        return data
    formula = Expression(data[1:], place(at))
    used |= formula.names
    if isinstance(text := known.get(formula.text.strip()), str):
        return text
    value = formula.value(values)
    # Counts, such as the segments of a beam, are whole numbers.
    return int(value) if value.is_integer() else value


# Keys of stiffnesses: of joints and legs, of what slides, of what turns and is in N m/rad always.
_STIFFNESSES = ("stiffness", "polynomial", "axial", "shear", "bending", "torsion")


def _own_units(file: Mapping[str, Any]) -> Units:
    """Units of a file's numbers; SI where it is refused for them."""
    try:
        units = Units(**file.get("units", {}))
        convert_length(SI, units)
    except (InputError, TypeError):
        return SI
    return units


def _in_units(
    data: Any,
    at: Place,
    file: Mapping[str, Any],
    units: Units,
    place: Callable[[Place], str],
) -> Any:
    """The data with numbers in place of stiffnesses such as "392 N m/arcmin"."""
    if isinstance(data, dict):
        return {k: _in_units(v, (*at, k), file, units, place) for k, v in data.items()}
    if isinstance(data, list):
        return [_in_units(v, (*at, i), file, units, place) for i, v in enumerate(data)]
    key = next((part for part in reversed(at) if isinstance(part, str)), "")
    is_text = isinstance(data, str) and data != "rigid"
    if key not in _STIFFNESSES or not is_text or at[0] == "identified":
        return data
    given = GivenStiffness.read(data, where := place(at))
    if key in _STIFFNESSES[4:]:
        return given.in_units(SI, False, where)
    if "flexible" in at or (key == "polynomial" and at[-1] != 0):
        row, column = at[-2:]
        if key == "polynomial" or isinstance(row, str) or (row < 3) != (column < 3):
            expected = "a number: of its own unit none is read here"
            raise InputError("no stiffness", where=where, expected=expected, got=repr(data))
        return given.in_units(units, row >= 3, where)
    if file.get("kind") not in ("stewart-gough", "springs"):  # the joint says of what kind
        return given.in_units(SI, True, where) if "lines" in at else given
    return given.in_units(units, True, where)


def checked_file(
    data: dict[str, Any], lines: Lines, path: Path, values: Mapping[str, Any] | None = None
) -> tuple[Any, Parameters]:
    """Model of a file's data, and the values of its parameters.

    Parameters
    ----------
    data, lines, path
        As read, with the line of each value; messages name the path.
    values : mapping of str to float, optional
        Values of parameters that count instead of the file's.

    Raises
    ------
    InputError
        The first thing that is wrong, with file, line and key.
    """
    if "closed_loop" in data and "kind" not in data:
        data = _of_closure_list(data, path)
    data, parameters = with_parameters(data, lambda at: place_of(path, lines, at), values)
    try:
        if data.get("kind") == "stewart-gough":
            data = _with_layout(data, lines, path)
        file = _of_its_kind(data, path.parent)
    except ValidationError as error:
        raise first_error(error, data, lines, path) from None
    except RecursionError:
        raise InputError("file is nested too deeply", where=one_line(str(path))) from None
    return file, parameters


_CLOSURE_LISTS = ("closed_loop", "type", "name_mot", "joint_name", "joint_type")


def _of_closure_list(data: dict[str, Any], path: Path) -> dict[str, Any]:
    """A closed chain by the list that stands beside a URDF in example-parallel-robots.

    Its keys: frames that are tied in pairs, "6d" or "3d" for each, names of the actuated joints,
    and joints that are taken as others than in the URDF.
    """
    where, lists = one_line(str(path)), [data.get(key) or [] for key in _CLOSURE_LISTS]
    for key, value in data.items():
        if key not in _CLOSURE_LISTS:
            check_name("key", key, _CLOSURE_LISTS, where)
        if value is not None and not isinstance(value, list):
            raise InputError("cannot be used", where=f"{where}, key {key}", expected="a list")
    loops, kinds, actuated, names, types = lists
    for (a, b), one, other in (
        (("closed_loop", "type"), loops, kinds),
        (("joint_name", "joint_type"), names, types),
    ):
        if len(one) != len(other):
            raise InputError(
                f"{a} and {b} do not fit",
                where=where,
                expected=f"{len(one)} of {b}",
                got=len(other),
            )
    beside = [path.with_suffix(".urdf"), *sorted(path.parent.glob("*.urdf"))]
    urdf = next((file for file in beside if file.is_file()), None)
    if urdf is None:
        raise InputError(
            "no URDF beside the list of closures", where=where, expected=beside[0].name
        )
    tied = {"6d": "weld", "3d": "point"}
    return {
        "kind": "closed-chain",
        "model": urdf.name,
        "closures": [
            {"frames": frames, "type": tied.get(str(kind).lower(), kind)}
            for frames, kind in zip(loops, kinds, strict=True)
        ],
        "actuated": actuated,
        "joint_types": {n: str(t).lower() for n, t in zip(names, types, strict=True)},
    }


def _of_its_kind(data: dict[str, Any], folder: Path) -> Any:
    """The model of a file. Others than its own are built for a message only, which tells the kind.

    Raises
    ------
    ValidationError
        If anything is wrong.
    """
    kind, context = data.get("kind"), {"folder": folder}
    if isinstance(kind, str) and kind in _MODELS:
        try:
            return _model(kind).model_validate(data, context=context)
        except ValidationError:
            pass
    return _any_kind().validate_python(data, context=context)


def _model(kind: str) -> Any:
    module, name = _MODELS[kind]
    return getattr(import_module(f"cartstiff.loading.{module}"), name)


@cache
def _any_kind() -> TypeAdapter[Any]:
    kinds = reduce(or_, map(_model, _MODELS))
    chosen: Any = Annotated[kinds, Field(discriminator="kind")]
    return TypeAdapter(chosen)


def json_schema() -> dict[str, Any]:
    """JSON schema of the mechanism file, of every kind."""
    return _any_kind().json_schema()


def _with_layout(data: dict[str, Any], lines: Lines, path: Path) -> dict[str, Any]:
    """The data with points in place of a layout."""
    if data.get("layout") is None:
        return data
    for key in ("base", "platform", "pose"):
        if key in data:
            raise InputError(f"give layout or {key}, not both", where=place_of(path, lines, (key,)))
    from cartstiff.loading.platform_schema import LayoutModel, laid_out

    try:
        layout = LayoutModel.model_validate(data["layout"])
    except ValidationError as error:
        # Its places begin where the layout does; as those of a file they name its kind first.
        raise first_error(error, data, lines, path, ("kind", "layout")) from None
    return {**{k: v for k, v in data.items() if k != "layout"}, **laid_out(layout)}


def place_of(path: Path, lines: Lines, at: tuple[str | int, ...]) -> str:
    """File, line and key of a value, for messages."""
    known = at
    while known and known not in lines:
        known = known[:-1]
    line = f", line {lines.get(known, 1)}" if lines else ""  # what comes from Python has none
    key = ".".join(str(part + 1) if isinstance(part, int) else part for part in at)
    return f"{one_line(str(path))}{line}" + (f", key {one_line(key)}" if key else "")


@contextmanager
def places_in(where: str, place: Callable[[Place], str] | None = None) -> Iterator[None]:
    """Errors within name a leg and a key, or nothing: they get the file, with the key's line."""
    try:
        yield
    except InputError as error:
        match = re.fullmatch(r"(?:leg (\d+)(?:, |$))?(?:key ([\w.-]+))?", error.where or "")
        if match is None:
            if where in (error.where or ""):
                raise
            raise error.at(where) from None
        leg, key = match.groups()
        at: Place = () if leg is None else ("legs", int(leg) - 1)
        at += () if key is None else tuple(key.split("."))
        own = f"{where}, {error.where}" if error.where else where
        raise error.moved_to(place(at) if place and at else own) from None


def first_error(
    error: ValidationError,
    data: dict[str, Any],
    lines: Lines,
    path: Path,
    within: tuple[str, ...] = (),
    known: set[str] | None = None,
) -> InputError:
    """The most helpful of pydantic's errors, in the words of this program."""
    # Of a union's alternatives the one that went deepest is the one the user meant; an unknown
    # key says most of all, as it often explains a missing one.
    problems = error.errors(include_url=False)
    chosen = max(problems, key=lambda p: (p["type"] == "extra_forbidden", len(p["loc"])))
    kind = chosen["type"]
    at = _keys((*within, *chosen["loc"]), data, kind)
    got = chosen["input"]
    got = "nothing" if got is None or got == "" else repr(got) if isinstance(got, str) else got
    if kind == "extra_forbidden":
        close = get_close_matches(str(at[-1]), (known or known_keys(FileModel)) - {at[-1]}, n=3)
        what, got = "unknown key", repr(at[-1])
        expected = f"keys of the file format (closest: {', '.join(close)})" if close else None
    elif kind == "missing":
        what, expected, got = f"key {at[-1]!r} is missing", None, None
    elif kind in ("union_tag_invalid", "union_tag_not_found"):
        what, expected, at = "unknown kind", _KINDS, ("kind",)
        got = repr(data["kind"]) if "kind" in data else "no key 'kind'"
    elif kind == "value_error":
        what, expected, got = chosen["msg"].removeprefix("Value error, "), None, None
    else:
        what, expected = "cannot be used", _expectation(chosen)
        if kind in ("too_short", "too_long"):
            what, got = "wrong count", str(len(got))
    return InputError(what, where=place_of(path, lines, at), expected=expected, got=got)


def _keys(location: tuple[str | int, ...], data: Any, kind: str) -> tuple[str | int, ...]:
    """Keys of the file in pydantic's location, which also names the branches of unions."""
    at: list[str | int] = []
    for i, part in enumerate(location[1:], start=2):
        here = isinstance(data, dict) and isinstance(part, str) and part in data
        if here or (isinstance(data, list) and isinstance(part, int)):
            at.append(part)
            data = data[part]
        elif kind == "missing" and i == len(location):
            at.append(part)
    return tuple(at)


def known_keys(base: type[BaseModel]) -> set[str]:
    """Every key of the models of a file."""
    models = [base]
    keys: set[str] = set()
    while models:
        model = models.pop()
        keys.update(model.model_fields)
        models.extend(model.__subclasses__())
    return keys


_TYPES = {
    "float_type": "a number",
    "finite_number": "a finite number",
    "string_type": "text",
    "string_unicode": "text",
    "string_too_short": "text",
    "bool_type": "true or false",
    "list_type": "a list",
    "dict_type": "a mapping of keys",
    "model_type": "a mapping of keys",
}


def _expectation(problem: Any) -> str:
    """What pydantic would have accepted, in the words of the file."""
    kind, context = problem["type"], problem.get("ctx", {})
    if kind in _TYPES:
        return _TYPES[kind]
    if kind == "too_short":
        return f"at least {context['min_length']}"
    if kind == "too_long":
        return f"at most {context['max_length']}"
    if kind == "string_too_long":
        return f"at most {context['max_length']} characters"
    if kind == "less_than_equal":
        return f"at most {context['le']:g}"
    if kind == "greater_than_equal":
        least = context["ge"]
        if least > 0:
            return f"above zero (at least {least:g})"
        return "zero or more" if least == 0 else f"at least {least:g}"
    message = problem["msg"].removeprefix("Input should be ")
    return str(message[0].lower() + message[1:])


def mechanism_of(
    file: Any, parameters: Parameters, path: Path, overrides: dict[str, Any]
) -> ElasticMechanism:
    """The mechanism of a checked file."""
    from cartstiff.loading import build
    from cartstiff.loading.plausible import file_notes

    name = file.name or path.stem
    if file.kind == "parallel":
        from cartstiff.loading.legs import with_drawn_legs

        file = with_drawn_legs(file)
    file = build.with_overrides(file, overrides)
    if file.kind in ("stewart-gough", "springs"):
        elastic = build.build_platform(file, name)
    else:
        make = build.build_parallel if file.kind == "parallel" else build.build_chain
        elastic = make(file, path.parent, name)
    notes = (*elastic.notes, *file_notes(file), *parameters.notes())
    source = " ".join((file.source or "").split())
    elastic = replace(elastic, notes=notes, source=source, parameters=parameters.values)
    if file.identified is None:
        return elastic
    return with_findings(elastic, file.identified)
