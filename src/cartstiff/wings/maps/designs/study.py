"""The file of a study of designs: its keys with types and meanings, and its reader."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    Field,
    ValidationError,
    field_validator,
    model_validator,
)

from cartstiff.core.errors import InputError, UnknownNameError, check_name, one_line
from cartstiff.files.bare import place_of
from cartstiff.files.expressions import Expression, is_name
from cartstiff.files.schema import (
    FileModel,
    Number,
    Pair,
    Positive,
    Text,
    Vector,
    first_error,
    keyed,
    only_one,
)
from cartstiff.files.yaml_file import Lines, read_yaml

#: Largest number of poses of one design.
MOST_POSES = 10**7
_Count = Annotated[int, Field(strict=True, ge=1, le=10**7)]
_Seed = Annotated[int, Field(strict=True, ge=0, le=2**31)]
_Flag = Annotated[bool, Field(strict=True)]
_Wrench = Annotated[list[Number], Field(min_length=6, max_length=6)]


class Variable(FileModel):
    """A parameter that is varied: between two ends, or among values."""

    low: Number | None = None
    high: Number | None = None
    values: list[Number] | None = keyed(
        "only these", None, min_length=1, max_length=10_000
    )
    count: _Count | None = keyed("values of a grid between low and high; default 5", None)
    log: _Flag = keyed("equal ratios instead of equal steps", False)

    @model_validator(mode="before")
    @classmethod
    def _short(cls, data: Any) -> Any:
        # Two numbers are low and high.
        if isinstance(data, list) and len(data) == 2:
            return {"low": data[0], "high": data[1]}
        return data

    def _fits(self) -> None:
        low, high = self.low, self.high
        if self.values is not None:
            if [low, high, self.count] != [None] * 3 or self.log:
                raise ValueError(
                    "values stand alone: no low, high, count or log beside them"
                )
        elif low is None or high is None:
            raise ValueError("give low and high, or values")
        elif not low < high:
            raise ValueError(f"low must be below high: {low:g}, {high:g}")
        elif self.log and not low > 0:
            raise ValueError("log needs numbers above zero")

    def at(self, share: float) -> float:
        """Return the value at a share from 0 to 1 of the range."""
        if self.values is not None:
            return self.values[min(int(share * len(self.values)), len(self.values) - 1)]
        low, high = self.low or 0.0, self.high or 0.0
        if self.log:
            value = math.exp(math.log(low) + share * (math.log(high) - math.log(low)))
        else:
            value = low + share * (high - low)
        # Twelve digits: readable, and the same on every processor.
        return min(max(float(f"{value:.12g}"), low), high)

    def size_at(self, value: float) -> float:
        """Its range, or among values the size of one, which is at least 1 near zero."""
        if self.low is None or self.high is None:
            return abs(value) or 1.0
        return self.high - self.low

    @property
    def grid(self) -> list[float]:
        """Values of a grid."""
        if self.values is not None:
            return self.values
        n = self.count or 5
        return [self.at(i / (n - 1) if n > 1 else 0.5) for i in range(n)]


class RandomPoses(FileModel):
    """Poses drawn at random."""

    count: _Count
    ranges: dict[str, Pair] = keyed(
        "[low, high] by coordinate, as in a grid; the others stay"
    )
    seed: _Seed = 0


class Poses(FileModel):
    """Poses at which every design is evaluated; default its default posture."""

    grid: dict[str, Annotated[list[Number], Field(min_length=3, max_length=3)]] | None = (
        keyed(
            "[low, high, count] by coordinate; the others "
            "stay. Of a body on legs: joints, or x, y, z, roll, pitch, yaw of the body",
            None,
            min_length=1,
        )
    )
    random: RandomPoses | None = None
    about_home: _Flag = keyed(
        "ranges are differences from each design's default posture", False
    )
    outside: Literal["refuse", "leave-out"] = keyed(
        "a design with poses at which a quantity does not exist (singular, beyond "
        "limits, not assembled) has failed, or is judged by the others",
        "refuse",
    )

    def _fits(self) -> None:
        only_one(self, "grid", "random", needed=False)
        for name, (low, high, count) in (self.grid or {}).items():
            if not (float(count).is_integer() and count >= 1):
                raise ValueError(f"grid.{name}: count must be a whole number, 1 or more")
            if count > 1 and not low < high:
                raise ValueError(f"grid.{name}: low must be below high")
        for name, (low, high) in self.ranges.items():
            if not low <= high:
                raise ValueError(f"random.ranges.{name}: low must not be above high")
        if self.count > MOST_POSES:
            raise ValueError(f"{self.count} poses a design: at most {MOST_POSES}")

    @property
    def ranges(self) -> Mapping[str, Sequence[float]]:
        """Ranges of random poses; none of others."""
        return self.random.ranges if self.random else {}

    @property
    def count(self) -> int:
        """Number of poses."""
        if self.random is not None:
            return self.random.count
        return math.prod(int(count) for _, _, count in (self.grid or {}).values())


class Case(FileModel):
    """A load and the settings of the quantities; keys as in `maps.compute_map`."""

    wrench: _Wrench | None = keyed("moment and force, carried everywhere", None)
    load_kind: Literal["dead", "follower", "conservative"] = "dead"
    load_at: Vector = keyed("point of the body at which it acts", [0, 0, 0])
    load_axes: Literal["body", "world"] = "body"
    connection: Literal["A", "B", "K", "F", "load"] | None = None
    length: Positive | None = keyed(
        "characteristic length; default each design's own natural length", None
    )
    direction: Vector | None = None
    deflect: _Wrench | None = keyed("wrench whose deflection is computed", None)
    deflect_at: Vector = keyed("point of the body at which that wrench acts", [0, 0, 0])
    world: _Flag = keyed("direction and deflect in the axes of F", False)
    damping: Number = keyed("modal damping ratio", 0.0, ge=0.0)

    @property
    def words(self) -> str:
        """The load in words."""
        W = ", ".join(f"{x:g}" for x in self.wrench or [])
        at = ", ".join(f"{x:g}" for x in self.load_at)
        return f"{self.load_kind}, ({W}) along the axes of the {self.load_axes} at ({at})"

    def alone(self, asks: str | None) -> Case:
        """The case without the settings that only other quantities ask for."""
        other = {"direction", "deflect", "damping"} - {asks}
        if asks != "deflect":
            other.add("deflect_at")
        if asks not in ("direction", "deflect"):
            other.add("world")
        return self.model_copy(update={n: Case().model_dump()[n] for n in other})

    def keywords(self) -> dict[str, Any]:
        """Arguments of `cartstiff.wings.maps.run.map_job`."""
        return self.model_dump()


class Measure(FileModel):
    """A number of a design: of a quantity over the poses,
    or arithmetic over the parameters.
    """

    quantity: Text | None = keyed("of a map; or", None)
    value: Text | None = keyed("arithmetic over parameters, such as '=2*r + h'", None)
    of: (
        Literal["worst", "best", "min", "max", "mean", "median", "share", "reached"]
        | None
    ) = keyed(
        "poses; share: of all poses, within `above` and `below`; reached: share of "
        "poses at which the quantity exists; default worst",
        None,
    )
    above: Number | None = keyed("for share: at least", None)
    below: Number | None = keyed("for share: at most", None)
    case: Text | None = keyed("name of a case, where there are several", None)

    def arithmetic(self, where: str) -> Expression:
        """Return the arithmetic of `value`; errors name `where`."""
        return Expression((self.value or "=")[1:], where)

    @field_validator("value")
    @classmethod
    def _begins(cls, text: str | None) -> str | None:
        if text is not None and not text.startswith("="):
            raise ValueError("arithmetic begins with '='")
        return text

    def _fits(self) -> None:
        only_one(self, "quantity", "value")
        keys = [
            key
            for key in ("of", "above", "below", "case")
            if getattr(self, key) is not None
        ]
        if self.value is not None and keys:
            raise ValueError(f"{keys[0]} is for quantities")
        bounds = {"above", "below"} & {*keys}
        if self.of == "share" and not bounds:
            raise ValueError("share needs above or below")
        if self.of != "share" and bounds:
            raise ValueError(f"{min(bounds)} is for `of: share`")

    @property
    def words(self) -> str:
        """Description of the measure."""
        if self.quantity is None:
            return str(self.value).lstrip("= ")
        level = "".join(
            f" {sign} {bound:g}"
            for sign, bound in ((">=", self.above), ("<=", self.below))
            if bound is not None
        )
        return f"{self.of or 'worst'} {self.quantity}{level}"


class Objective(Measure):
    """A number to be maximised or minimised."""

    goal: Literal["largest", "smallest"] | None = keyed(
        "default the better end of the quantity; largest for shares", None
    )

    def _fits(self) -> None:
        super()._fits()
        if self.value is not None and self.goal is None:
            raise ValueError("arithmetic needs a goal: largest or smallest")


class Constraint(Measure):
    """A number with bounds."""

    at_least: Number | None = None
    at_most: Number | None = None

    def _fits(self) -> None:
        super()._fits()
        if self.at_least is None and self.at_most is None:
            raise ValueError("give at_least or at_most")

    def is_kept(self, value: float) -> bool:
        """Whether a number is within its bounds."""
        low = -math.inf if self.at_least is None else self.at_least
        high = math.inf if self.at_most is None else self.at_most
        return low <= value <= high


class Method(FileModel):
    """Method by which designs are chosen."""

    kind: Literal["grid", "sobol", "latin-hypercube"] = "grid"
    designs: _Count | None = keyed("how many, at most; not for a grid; default 64", None)
    seed: _Seed | None = keyed("of what is drawn; default 0", None)

    @field_validator("kind", mode="before")
    @classmethod
    def _sweeps(cls, kind: object) -> object:
        if kind in ("local", "evolution"):
            raise ValueError(
                f"{kind} is no method: sweep with grid, sobol or latin-hypercube, or "
                "give "
                "cartstiff.extend.evaluator(study) to an optimiser such as scipy's"
            )
        return kind

    def _fits(self) -> None:
        if self.kind == "grid" and self.designs is not None:
            raise ValueError(
                "a grid has the counts of its variables: designs is not for it"
            )
        if self.kind == "grid" and self.seed is not None:
            raise ValueError("nothing is drawn: seed is not for a grid")


class StudyUnits(FileModel):
    """Units of a study's numbers and answers; default the mechanism file's."""

    length: Literal["m", "dm", "cm", "mm", "um", "in", "ft"] | None = None
    angle: Literal["rad", "deg"] = "rad"


class Study(FileModel):
    """A study: variables, poses, cases, objectives and constraints."""

    mechanism: Text = keyed("a mechanism file, or the name of a bundled one")
    description: Text | None = keyed("for readers", None)
    set: dict[Text, Number] = keyed("parameters that stay", {})
    tcp: Annotated[list[Number], Field(min_length=3, max_length=6)] | None = keyed(
        "M in the frame of every design: x, y, z and roll, pitch, yaw", None
    )
    gravity: Vector | None = keyed("instead of the file's [m/s^2]", None)
    payload: Annotated[list[Number], Field(min_length=1, max_length=4)] | None = keyed(
        "a mass [kg] on the body and its centre in M", None
    )
    units: StudyUnits | None = keyed(
        "of the study's numbers and answers; parameters, `set` and "
        "arithmetic over them stay in the mechanism file's",
        None,
    )
    variables: dict[Text, Variable] = Field(min_length=1, max_length=50)
    poses: Poses = Poses()
    cases: dict[Text, Case] = keyed("default one without a load", {})
    objectives: dict[Text, Objective] = Field(min_length=1, max_length=20)
    constraints: dict[Text, Constraint] = Field(default={}, max_length=50)
    method: Method = Method()

    def _fits(self) -> None:
        for name in self.variables:
            if not is_name(name):
                raise ValueError(f"{name!r} cannot be the name of a parameter")
            if name in self.set:
                raise ValueError(f"{name!r} is varied and set")
        if both := set(self.objectives) & set(self.constraints):
            raise ValueError(f"{min(both)!r} is an objective and a constraint")
        for name, measure in self.measures.items():
            if measure.quantity is not None:
                self._check(name, measure)
        used = {self.case_of(m) for m in self.measures.values()}
        for name in self.cases:
            if name not in used:
                raise ValueError(f"case {name!r} is not used")

    def _check(self, name: str, measure: Measure) -> None:
        """Refuse a measure of a quantity whose case or poses do not go with the study."""
        if measure.case is None and len(self.cases) > 1:
            raise ValueError(f"{name}: say which case: {', '.join(self.cases)}")
        if measure.case is not None and measure.case not in self.cases:
            raise ValueError(f"{name}: unknown case {measure.case!r}")
        if measure.of == "reached" and self.poses.outside == "refuse":
            raise ValueError(f"{name}: reached needs `outside: leave-out` under poses")

    @property
    def measures(self) -> dict[str, Objective | Constraint]:
        """Objectives and constraints by name."""
        return {**self.objectives, **self.constraints}

    def case_of(self, measure: Measure) -> str:
        """Return the name of a measure's case; "" for the default case."""
        return measure.case or next(iter(self.cases), "")

    def case(self, name: str) -> Case:
        """A case by its name."""
        return self.cases.get(name) or Case()

    @property
    def size(self) -> int:
        """Largest number of designs."""
        if self.method.kind == "grid":
            return math.prod(len(v.grid) for v in self.variables.values())
        return self.method.designs or 64


def read_study(
    source: str | Path | Mapping[str, Any], given: Mapping[str, Any] | None = None
) -> tuple[Study, Path]:
    """Read a study; also return the folder that its mechanism's path is relative to.

    Parameters
    ----------
    source : str, Path or mapping
        File or content of the study.
    given : mapping, optional
        Replacements of the file's `tcp`, `gravity`, `payload` and `units`; keys of `Case`
        under "load" replace those of every case.

    Raises
    ------
    InputError
        For the first fault, with file, line and key.
    """
    lines: Lines = {}
    if isinstance(source, Mapping):
        data, path = dict(source), Path("study")
    elif isinstance(source, (str, Path)):
        path = Path(source).expanduser()
        data, lines = read_yaml(path)
    else:
        raise InputError(
            "not a study",
            expected="a file's path or a mapping",
            got=type(source).__name__,
        )
    data = _with(data, given or {})
    try:
        study = Study.model_validate(data)
    except ValidationError as error:
        raise first_error(error, data, lines, path) from None
    for name, measure in study.measures.items():
        if measure.value is not None:
            kind = "objectives" if name in study.objectives else "constraints"
            measure.arithmetic(place_of(path, lines, (kind, name, "value")))
    if study.size > MOST_POSES:
        raise InputError(
            "too many designs",
            where=one_line(str(path)),
            expected=f"{MOST_POSES}",
            got=study.size,
        )
    return study, path.parent


def _with(data: dict[str, Any], options: Mapping[str, Any]) -> dict[str, Any]:
    """Return a study's data with the given replacements."""
    load = options.get("load")
    own = {
        key: value
        for key, value in options.items()
        if key != "load" and value is not None
    }
    if load:
        cases = data.get("cases") or {"load": {}}
        if isinstance(cases, dict) and all(
            isinstance(case, dict) for case in cases.values()
        ):
            own["cases"] = {name: {**case, **load} for name, case in cases.items()}
    return {**data, **own}


def check_names(study: Study, parameters: Mapping[str, float]) -> None:
    """Refuse names that the mechanism does not have.

    Raises
    ------
    UnknownNameError
        For a variable, or a name in arithmetic, that is no parameter of the mechanism.
    """
    for name in (*study.variables, *study.set):
        check_name(
            "parameter", name, parameters, f"variables or set of the study: {name}"
        )
    for key, measure in study.measures.items():
        if measure.value is not None:
            for name in sorted(measure.arithmetic(key).names - set(parameters)):
                raise UnknownNameError("parameter", name, parameters, where=key)
