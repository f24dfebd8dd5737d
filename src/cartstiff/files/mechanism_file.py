"""Check mechanism files and build their mechanisms.

A refusal names file, line and key.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import reduce
from graphlib import CycleError, TopologicalSorter
from itertools import filterfalse
from operator import or_
from pathlib import Path
from string import digits
from typing import Annotated, Any

from cartstiff.core.arrays import checked_number
from cartstiff.core.errors import InputError, check_name, one_line
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.notes import Note
from cartstiff.core.units import SI, GivenStiffness, Units, convert_length
from cartstiff.files.bare import place_of, short_file, with_overrides
from cartstiff.files.expressions import Expression, is_name
from cartstiff.files.yaml_file import Lines, Way

#: Keys of a file whose texts are for readers.
_TEXT_KEYS = ("name", "description", "source")


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
        """Return a note on the parameters that were set from outside."""
        if not self.given:
            return []
        words = ", ".join(f"{name} = {value:g}" for name, value in self.given.items())
        return [
            Note(
                "parameters-set",
                f"set instead of what the file says: {words}",
                self.given,
            )
        ]


def with_parameters(
    data: dict[str, Any],
    place: Callable[[Way], str],
    chosen: Mapping[str, Any] | None = None,
) -> tuple[dict[str, Any], Parameters]:
    """Return a file's data with numbers in place of arithmetic, and its parameters.

    Texts that begin with "=" are arithmetic over the names under ``parameters``, which is
    removed. Stiffnesses with a unit, such as "392 N m/arcmin", are converted as well.

    Parameters
    ----------
    data : dict
        As read.
    place : callable
        Returns the place of a tuple of keys, for messages.
    chosen : mapping of str to float, optional
        Values that replace the file's.

    Raises
    ------
    InputError
        For names that cannot be used, are not known, depend on themselves, or are not
        used.
    """
    given = {
        name: checked_number(x, f"parameter {name!r}")
        for name, x in dict(chosen or {}).items()
    }
    entries = _entries(data, given, place)
    rest = {**data}
    rest.pop("parameters", None)
    units = _own_units(rest)
    turning = units if data.get("kind") == "parallel" else SI
    values, used = _evaluated(entries, given, place, (units, turning))
    # A stiffness with its unit is converted where it is used, as it may slide or turn.
    texts = {n: x for n, x in entries.items() if isinstance(x, str) and x[:1] != "="}

    def with_numbers(data: Any, at: Way) -> Any:
        if isinstance(data, dict):
            return {key: with_numbers(value, (*at, key)) for key, value in data.items()}
        if isinstance(data, list):
            return [with_numbers(value, (*at, i)) for i, value in enumerate(data)]
        if not str(data).startswith("="):
            return data
        formula = Expression(data[1:], place(at))
        used.update(formula.names)
        name = formula.text.strip()
        if name in texts and name not in given:
            return texts[name]
        value = formula.value(values)
        # Counts, such as the segments of a beam, are whole numbers.
        return int(value) if value.is_integer() else value

    # Texts for readers are left as they are.
    filled = {
        key: value if key in _TEXT_KEYS else with_numbers(value, (key,))
        for key, value in rest.items()
    }
    for name in filterfalse(used.__contains__, entries):
        raise InputError(
            f"parameter {name!r} is not used",
            where=place(("parameters", name)),
            expected=f"a number such as '={name}' in the file",
        )
    return filled, Parameters(values, given)


def _entries(
    data: Mapping[str, Any], given: Mapping[str, float], place: Callable[[Way], str]
) -> dict[str, Any]:
    """Parameters of a file, among which are all that are given."""
    entries = data.get("parameters", {})
    if not isinstance(entries, dict):
        raise InputError(
            "cannot be used",
            where=place(("parameters",)),
            expected="names and their numbers",
            got=one_line(entries),
        )
    for name in given:
        if not entries:
            raise InputError(
                "the mechanism has no parameters",
                where=place(()),
                expected="a key 'parameters' in its file",
                got=one_line(str(name)),
            )
        check_name("parameter", name, entries, place(()))
    return entries


def _evaluated(
    entries: Mapping[str, Any],
    given: Mapping[str, float],
    place: Callable[[Way], str],
    units: tuple[Units, Units],
) -> tuple[dict[str, float], set[str]]:
    """Value of every parameter, and the names that occur in the arithmetic of others.

    The units are those of stiffnesses of what slides, and of what turns.
    """
    numbers: dict[str, Expression | float] = {}
    for name, entry in entries.items():
        where = place(("parameters", name))
        if not is_name(name):
            raise InputError(
                "name of a parameter cannot be used",
                where=where,
                got=repr(name),
                expected="letters, digits and _, no word of arithmetic",
            )
        numbers[name] = _number_of(entry, where, units)
    needed = {n: x.names for n, x in numbers.items() if isinstance(x, Expression)}
    for name, others in needed.items():
        for other in sorted(others):
            check_name("parameter", other, entries, place(("parameters", name)))
    values: dict[str, float] = {}
    for name in [*_order(needed, place), *entries]:
        own = given.get(name, numbers[name])
        values[name] = own.value(values) if isinstance(own, Expression) else own
    return {name: values[name] for name in entries}, set().union(*needed.values())


def _order(needed: Mapping[str, Iterable[str]], place: Callable[[Way], str]) -> list[str]:
    """Parameters after those that they need."""
    try:
        return [*TopologicalSorter(needed).static_order()]
    except CycleError as error:
        circle = error.args[1][::-1]
        raise InputError(
            "parameters depend on each other in a circle",
            got=" -> ".join(circle),
            where=place(("parameters", circle[0])),
        ) from None


def _number_of(entry: Any, where: str, units: tuple[Units, Units]) -> Expression | float:
    """Arithmetic or number of an entry under ``parameters``."""
    if isinstance(entry, str) and entry.startswith("="):
        return Expression(entry[1:], where)
    if isinstance(entry, str) and entry[:1] in (*"+-.", *digits):
        given = GivenStiffness.read(entry, where)
        return given.in_units(units[not given.is_length], given.is_length)
    if isinstance(entry, (int, float)) and not isinstance(entry, bool):
        return checked_number(entry, where)
    raise InputError(
        "cannot be used",
        where=where,
        got=one_line(entry),
        expected="a number, or arithmetic such as '=2*r', or a stiffness with its unit",
    )


def _own_units(file: Mapping[str, Any]) -> Units:
    """Units of a file's numbers; SI where it is refused for them."""
    try:
        units = Units(**file.get("units", {}))
        convert_length(SI, units)
    except (InputError, TypeError):
        return SI
    return units


def checked_file(
    data: dict[str, Any],
    lines: Lines,
    path: Path,
    values: Mapping[str, Any] | None,
) -> tuple[Any, Parameters]:
    """Return the model of a file's data, and the values of its parameters.

    Parameters
    ----------
    data, lines, path
        As read, with the line of each value; messages name the path.
    values : mapping of str to float or None
        Values of parameters that replace the file's.

    Raises
    ------
    InputError
        The first thing that is wrong, with file, line and key.
    """
    if "closed_loop" in data and "kind" not in data:
        data = _from_closure_list(data, path)
    data, parameters = with_parameters(data, lambda at: place_of(path, lines, at), values)
    if (short := short_file(data)) is not None:
        return short, parameters
    # Few files need no more than that: Pydantic, and the models, take long to import.
    from pydantic import ValidationError

    from cartstiff.files.schema import FILE_KINDS, file_model, first_error

    kind = data.get("kind")
    if not isinstance(kind, str) or kind not in FILE_KINDS:
        raise InputError(
            "unknown kind",
            where=place_of(path, lines, ("kind",)),
            expected=", ".join(FILE_KINDS),
            got=repr(kind) if "kind" in data else "no key 'kind'",
        )
    units = {"units": _own_units(data)}
    try:
        file = file_model(kind).model_validate(data, context=units)
    except ValidationError as error:
        raise first_error(error, data, lines, path) from None
    except RecursionError:
        raise InputError("file is nested too deeply", where=one_line(str(path))) from None
    return file, parameters


_CLOSURE_LIST_KEYS = ("closed_loop", "type", "name_mot", "joint_name", "joint_type")


def _from_closure_list(data: dict[str, Any], path: Path) -> dict[str, Any]:
    """Data of a closed chain from a list of closures as example-parallel-robots has
    beside a URDF.

    Its keys: pairs of frames that are tied, "6d" or "3d" for each pair, names of the
    actuated joints, names of joints with another type than in the URDF, and these types.
    """
    where = one_line(str(path))
    for key, value in data.items():
        check_name("key", key, _CLOSURE_LIST_KEYS, where)
        if not isinstance(value, list | None):
            raise InputError(
                "cannot be used", where=f"{where}, key {key}", expected="a list"
            )
    loops, kinds, actuated, names, types = (
        data.get(key) or [] for key in _CLOSURE_LIST_KEYS
    )
    # Two pairs of lists belong together.
    for a, b, one, other in (
        ("closed_loop", "type", loops, kinds),
        ("joint_name", "joint_type", names, types),
    ):
        if len(one) != len(other):
            raise InputError(
                f"{a} and {b} do not fit",
                where=where,
                expected=f"{len(one)} of {b}",
                got=len(other),
            )
    # The robot's own file lies beside the list, in the best case with the same name.
    beside = [path.with_suffix(".urdf"), *sorted(path.parent.glob("*.urdf"))]
    urdf = next(filter(Path.is_file, beside), None)
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


def file_schema() -> dict[str, Any]:
    """Return the JSON schema of mechanism files of every kind."""
    from pydantic import Field, TypeAdapter
    from pydantic.json_schema import GenerateJsonSchema

    from cartstiff.files.schema import FILE_KINDS, file_model

    class WithSections(GenerateJsonSchema):
        """Writes the models of sections, which are built when a file has them."""

        def function_plain_schema(self, schema: Any) -> dict[str, Any]:
            model = schema.get("metadata", {}).get("section")
            if model is None:
                return super().function_plain_schema(schema)
            model.model_rebuild()
            ref = f"{model.__module__}.{model.__qualname__}:{id(model)}"
            return self.generate_inner({**model.__pydantic_core_schema__, "ref": ref})

    kinds = reduce(or_, map(file_model, FILE_KINDS))
    chosen: Any = Annotated[kinds, Field(discriminator="kind")]
    return TypeAdapter(chosen).json_schema(schema_generator=WithSections)


def mechanism_of(
    file: Any, parameters: Parameters, path: Path, overrides: dict[str, Any]
) -> ElasticMechanism:
    """Build the mechanism of a checked file."""
    from cartstiff.files.plausible import file_notes

    name = file.name or path.stem
    if file.kind == "parallel":
        from cartstiff.files.legs import with_drawn_legs

        file = with_drawn_legs(file)
    file = with_overrides(file, overrides)
    if file.kind in ("stewart-gough", "springs"):
        from cartstiff.files.platforms import build_platform

        elastic = build_platform(file, name)
    else:
        from cartstiff.files.passes import build

        elastic = build(file, path.parent, name)
    if table := getattr(getattr(file, "springs", None), "name", None):
        from cartstiff.files.published import with_named_springs

        elastic = with_named_springs(elastic, table, "key springs", path.parent)
    notes = (*elastic.notes, *file_notes(file), *parameters.notes())
    source = " ".join((file.source or "").split())
    elastic = replace(elastic, notes=notes, source=source, parameters=parameters.values)
    if file.identified is None:
        return elastic
    from cartstiff.files.findings import with_findings

    return with_findings(elastic, file.identified)
