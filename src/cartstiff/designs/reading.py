"""A study of designs from its file, checked: what is wrong is said with file, line and key."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from cartstiff.designs.study import MOST_POSES, Study, StudyModel
from cartstiff.errors import InputError, UnknownNameError, one_line
from cartstiff.expressions import Expression
from cartstiff.loading.mechanism_file import first_error, place_of
from cartstiff.loading.yaml_file import Lines, read_yaml


def read_study(
    source: str | Path | Mapping[str, Any], given: Mapping[str, Any] | None = None
) -> tuple[Study, Path]:
    """A study and the folder that its mechanism's path is relative to.

    Parameters
    ----------
    source : str, Path or mapping
        Its file, or what would stand there.
    given : mapping, optional
        What is said instead of the file's `tcp`, `gravity`, `payload` and `units`; keys of `Case`
        under "load" replace those of every case.

    Raises
    ------
    InputError
        The first thing that is wrong, with file, line and key.
    """
    lines: Lines = {}
    if isinstance(source, Mapping):
        data, path = dict(source), Path("study")
    elif isinstance(source, (str, Path)):
        path = Path(source).expanduser()
        data, lines = read_yaml(path)
    else:
        raise InputError(
            "not a study", expected="a file's path or a mapping", got=type(source).__name__
        )
    data = _with(data, given or {})
    try:
        study = Study.model_validate(data)
    except ValidationError as error:
        raise first_error(error, data, lines, path, ("study",), _keys()) from None
    for name, measure in study.measures.items():
        if measure.value is not None:
            kind = "objectives" if name in study.objectives else "constraints"
            Expression(measure.value[1:], place_of(path, lines, (kind, name, "value")))
    if study.size > MOST_POSES:
        raise InputError(
            "too many designs", where=one_line(str(path)), expected=f"{MOST_POSES}", got=study.size
        )
    return study, path.parent


def _with(data: dict[str, Any], options: Mapping[str, Any]) -> dict[str, Any]:
    """A study's data, and what is said beside it."""
    load = options.get("load")
    own = {key: value for key, value in options.items() if key != "load" and value is not None}
    if load:
        cases = data.get("cases") or {"load": {}}
        if isinstance(cases, dict) and all(isinstance(case, dict) for case in cases.values()):
            own["cases"] = {name: {**case, **load} for name, case in cases.items()}
    return {**data, **own}


def _keys() -> set[str]:
    """Every key that may stand in a study."""
    models, keys = [StudyModel], set[str]()
    while models:
        model = models.pop()
        keys.update(model.model_fields)
        models.extend(model.__subclasses__())
    return keys


def check_names(study: Study, parameters: Mapping[str, float]) -> None:
    """Refuse names that the mechanism does not have.

    Raises
    ------
    UnknownNameError
        For a variable, or a name in arithmetic, that is no parameter of the mechanism.
    """
    for name in (*study.variables, *study.set):
        if name not in parameters:
            raise UnknownNameError("parameter", name, parameters, where="study")
    for key, measure in study.measures.items():
        if measure.value is not None:
            for name in sorted(Expression(measure.value[1:], key).names - set(parameters)):
                raise UnknownNameError("parameter", name, parameters, where=key)
