"""The messages of a tab; all are checked here before anything is computed.

Messages are JSON objects with the keys "id", "do" and "state", and for some kinds a few
numbers. Nothing in them is a path, a command or a name that is looked up outside a fixed
list.
"""

from __future__ import annotations

import json
import re
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from cartstiff.core.choices import LARGEST_INPUT
from cartstiff.core.errors import InputError, one_line, printable
from cartstiff.core.matrix_names import Letter
from cartstiff.core.stiffness.applied_load import Axes, Behaviour

#: Bytes of a message that are read; a longer one is refused.
LARGEST_MESSAGE = 64 * 1024

_Number = Annotated[
    float, Field(ge=-LARGEST_INPUT, le=LARGEST_INPUT, allow_inf_nan=False)
]
_NotNegative = Annotated[float, Field(ge=0.0, le=LARGEST_INPUT, allow_inf_nan=False)]
_Positive = Annotated[float, Field(gt=0.0, le=LARGEST_INPUT)] | None
_Stiffnesses = Annotated[list[_NotNegative | None], Field(min_length=1, max_length=500)]
_Short = Annotated[str, Field(min_length=1, max_length=200)]
_Vector = Annotated[list[_Number], Field(min_length=1, max_length=500)]
_Three = tuple[_Number, _Number, _Number]
_Four = tuple[_Number, _Number, _Number, _Number]
_Six = tuple[_Number, _Number, _Number, _Number, _Number, _Number]


class _Strict(BaseModel):
    # Tuples are lists in JSON, so strictness is required of the numbers and words
    # themselves.
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class Measure(_Strict):
    """How large values are drawn, as `cartstiff.shown.scene.scales` says in a legend."""

    kind: Literal["root", "linear", "log"]
    value_per_length: _Positive = None
    cut_at: _Positive = None
    zero_at: _Positive = None
    length_per_decade: _Positive = None


class ViewState(_Strict):
    """Everything that decides what a tab shows; the default is what it shows at first.

    Attributes
    ----------
    q : list of float or None
        Coordinates; None for the mechanism's posture.
    moved : int or None
        The coordinate that the user has just moved: closures give way at the others.
    connection, quantity, axes
        Which matrix, stiffness or compliance, and along whose axes its components are.
    others : {"free", "held"}
        Whether the other three freedoms are free or held in principal values and
        ellipsoids.
    point : (3,)
        Reference point in the frame M.
    stiffness : list of float or None
        Stiffness of the joints or legs; None for the mechanism's own. In the list None is
        a rigid joint.
    load : (6,) or None
        Wrench (moment, force) that the environment applies, along `load_axes`.
    load_kind : {"dead", "follower", "conservative"}
        Behaviour of the load while the body moves.
    load_at : (3,) or None
        Point in M at which the load acts; None for the reference point, and for the
        origin of M where the springs decide what the load is.
    gravity : (3,) or None
        Acceleration in F in m/s^2; None for the mechanism's own.
    payload : (4,) or None
        A mass in kg on the body, and its centre in M.
    command : list of float or None
        How far each spring's drive is commanded to move from `q`; the pose that results
        is shown.
    ghost : list of float or None
        A second posture, drawn pale.
    quantity_of_map : str or None
        The quantity that colours the points of the map.
    mode : int or None
        The mode, from 1, whose nodal axis and swing are drawn; None for no modes at all.

    allowed : float or None
        The displacement of the reference point under the load that is enough.

    measures : dict or None
        How large the ellipsoids are drawn, by freedom; None for sizes that fit their
        values.
    drawn : {"stiffness", "compliance"} or None
        Quantity of the ellipsoids; None for `quantity`, under a load for the compliance.
    enlarged : float or None
        How many times the deflection is enlarged; None for about a tenth of the
        mechanism's size.

    The others say what the picture shows.
    """

    q: _Vector | None = None
    moved: Annotated[int, Field(ge=0, le=500)] | None = None
    connection: Letter = "load"
    quantity: Literal["stiffness", "compliance"] = "stiffness"
    others: Literal["free", "held"] = "free"
    axes: Axes = "body"
    point: _Three = (0.0, 0.0, 0.0)
    stiffness: _Stiffnesses | None = None
    load: _Six | None = None
    load_axes: Axes = "body"
    load_kind: Behaviour = "dead"
    load_at: _Three | None = None
    gravity: _Three | None = None
    payload: tuple[_NotNegative, _Number, _Number, _Number] | None = None
    command: _Vector | None = None
    ghost: _Vector | None = None
    quantity_of_map: _Short | None = None
    mode: Annotated[int, Field(ge=1, le=500)] | None = None
    allowed: _Positive = None
    measures: dict[Literal["translation", "rotation"], Measure] | None = None
    theme: Literal["light", "dark"] = "light"
    translation: bool = True
    rotation: bool = True
    scale: Literal["root", "linear", "log"] = "root"
    labels: bool = True
    wrench: bool = True
    deflection: bool = True
    enlarged: _Positive = None
    drawn: Literal["stiffness", "compliance"] | None = None
    centres: bool = False
    held_forces: bool = False

    @property
    def acts_at(self) -> tuple[float, float, float]:
        """The point in M at which the load acts."""
        if self.load_at is not None:
            return self.load_at
        return (0.0, 0.0, 0.0) if self.load is None else self.point


#: Of a state what an address does not hold.
_NOT_IN_ADDRESS = ("moved", "ghost", "measures", "theme", "enlarged", "drawn")


@cache
def address_forms() -> dict[str, dict[str, Any]]:
    """How an address writes each field of a state that it holds.

    One of some "words", or numbers, so many if there is a "count"; null where it is
    "optional".
    """
    forms = dict[str, dict[str, Any]]()
    for name, field_of in ViewState.model_fields.items():
        if name in _NOT_IN_ADDRESS:
            continue
        annotation = field_of.annotation
        kinds = get_args(annotation) if type(None) in get_args(annotation) else ()
        kind = next((one for one in kinds if one is not type(None)), annotation)
        if get_origin(kind) is Annotated:
            kind = get_args(kind)[0]
        if get_origin(kind) is Literal:
            forms[name] = {"words": list(get_args(kind))}
        elif kind is bool:
            forms[name] = {"words": ["true", "false"]}
        else:
            count = len(get_args(kind)) if get_origin(kind) is tuple else None
            count = 1 if kind in (int, float) else count
            forms[name] = {"count": count, "optional": bool(kinds)}
    return forms


class _Request(_Strict):
    id: int = Field(ge=0, le=2**53)
    state: ViewState = ViewState()


class Towards(_Strict):
    """A pose that a hand pulls M to, ``T_F_M``, and whether it turns M as well."""

    pose: tuple[_Four, _Four, _Four, _Four]
    turning: bool = True


class Draw(_Request):
    """The numbers and the picture of a state; of the posture that follows a hand,
    if one pulls.

    With `lengths` that of the platform's legs, next to the state's.
    """

    do: Literal["draw"]
    towards: Towards | None = None
    lengths: _Vector | None = None


class Numbers(_Request):
    """The numbers of a state alone: the picture stays."""

    do: Literal["numbers"]


class Result(_Request):
    """All that `analyse` says of a state, as JSON."""

    do: Literal["result"]


class Sweep(_Request):
    """Principal values while one coordinate runs through its range."""

    do: Literal["sweep"]
    coordinate: int = Field(ge=0, le=500)
    steps: int = Field(default=61, ge=2, le=201)


class Better(_Request):
    """A better posture under the load of the state, as the report has it."""

    do: Literal["better"]


class WhatIf(_Request):
    """How far the load moves the point with another stiffness of one spring,
    for each spring.
    """

    do: Literal["stiffer"]
    to: _Stiffnesses


class Series(_Request):
    """Principal values along the trajectory that the page was started with."""

    do: Literal["series"]


class Response(_Request):
    """Receptance at the reference point over frequency, all modes damped by one ratio."""

    do: Literal["response"]
    ratio: float = Field(default=0.02, ge=0.0, le=10.0)


class Analysis(_Request):
    """The analysis of the matrix, as text."""

    do: Literal["analysis"]


class Said(_Request):
    """The answer at a posture in sentences, its displacement checked by the
    equilibrium.
    """

    do: Literal["answer"]


class Export(_Request):
    """The page at this state as one file.

    The rest of the page's state is in `address`.
    """

    do: Literal["export"]
    address: str | None = Field(default=None, max_length=20_000)


class Program(_Request):
    """The arithmetic of the mechanism, for the page itself."""

    do: Literal["program"]


class Frame(_Request):
    """Another frame of the mechanism as the frame of interest; `kept` states go along."""

    do: Literal["frame"]
    name: _Short
    kept: Annotated[list[ViewState], Field(max_length=3)] = []


class Bounds(_Request):
    """How much room the picture of a state takes."""

    do: Literal["bounds"]


class Slide(_Request):
    """A slider that the user's code has added is somewhere else."""

    do: Literal["slide"]
    name: _Short
    value: _Number


Message = (
    Draw
    | Numbers
    | Result
    | Sweep
    | Better
    | WhatIf
    | Series
    | Response
    | Analysis
    | Said
    | Export
    | Frame
    | Bounds
    | Program
    | Slide
)
_MESSAGES: TypeAdapter[Message] = TypeAdapter(
    Annotated[Message, Field(discriminator="do")]
)
_T = TypeVar("_T")


def read_message(text: str | bytes) -> Message:
    """A message from a tab.

    Raises
    ------
    InputError
        For a message that is too long, is no JSON, or holds an unknown key, a wrong type,
        or a number that is not finite.
    """
    return _read(_MESSAGES, text)


def _read(kind: TypeAdapter[_T], text: str | bytes) -> _T:
    if len(text) > LARGEST_MESSAGE:
        raise InputError(
            "message is too long",
            expected=f"at most {LARGEST_MESSAGE} bytes",
            got=f"{len(text)}",
        )
    try:
        return kind.validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        place = ".".join(str(part) for part in first["loc"])
        more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
        raise InputError(
            one_line(f"message refused: {first['msg']}{more}"),
            where=one_line(place) or None,
        ) from None


# Characters as JSON writes them: in two halves, as \uXXXX, behind a backslash.
_UNSEEN = re.compile(r"\\ud[89ab]..\\ud[c-f]..|\\u([0-9a-f]{4})|\\.|\x7f")


# Numbers as text: ten times as fast as by the standard library.
_PLAIN = TypeAdapter[Any](Any, config=ConfigDict(ser_json_inf_nan="constants"))


def _shown(match: re.Match[str]) -> str:
    """What `printable` makes of an escaped character."""
    code = match.group(1)
    if code is None:
        return r"\\x7f" if match.group() == "\x7f" else match.group()
    shown = printable(chr(int(code, 16)))
    return match.group() if len(shown) == 1 else shown.replace("\\", r"\\")


@dataclass(frozen=True)
class Answer:
    """A JSON object and commands for the viewer.

    Attributes
    ----------
    data : dict
        For the page.
    commands : list of bytes
        Packed commands for the viewer, in order.
    """

    data: dict[str, Any]
    commands: list[bytes] = field(default_factory=list)

    def pack(self) -> bytes:
        """Chunks one after the other, each behind its length (uint32, big endian).

        The first is the JSON text, the others are commands.

        Raises
        ------
        InputError
            If a number is not finite.
        """
        text, parts = self._text(), list[bytes]()
        for chunk in (text, *self.commands):
            parts += [len(chunk).to_bytes(4, "big"), chunk]
        return b"".join(parts)

    def _text(self) -> bytes:
        with suppress(ValueError):
            text = _PLAIN.dump_json(self.data)
            # All of it is seen as it is, and no number is beyond what JSON has.
            others = (b"\\", b"\x7f", b"NaN", b"Infinity")
            is_plain = text.isascii() or text.decode().isprintable()
            if is_plain and not any(_has(text, other) for other in others):
                return text
        try:
            plain = json.dumps(self.data, allow_nan=False, separators=(",", ":"))
        except ValueError:
            raise InputError(
                "the result leaves the range of double precision",
                expected="numbers of moderate size",
            ) from None
        return _UNSEEN.sub(_shown, plain).encode()


def _has(text: bytes, word: bytes) -> bool:
    """Whether a word is in a text of numbers: by its first letter, which is seldom there
    and found five times as fast.
    """
    at = text.find(word[0])
    while at >= 0 and not text.startswith(word, at):
        at = text.find(word[0], at + 1)
    return at >= 0
