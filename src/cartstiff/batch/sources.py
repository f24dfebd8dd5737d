"""A recorded program as source text of a function: C for a controller, Python,
JavaScript.

The head of each says the names, shapes and units of what goes in and comes out. Numbers
that all postures share, such as stiffnesses, are constants of the function.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from cartstiff import numerics
from cartstiff.batch.algebra import PLAIN
from cartstiff.batch.closed_chains import STEPS
from cartstiff.batch.execution import (
    HELPERS,
    JAVASCRIPT,
    PYTHON,
    Language,
    written,
)
from cartstiff.batch.tape import Program as Tape
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.closures import LONGEST_STEP

LANGUAGES = ("c", "python", "javascript")


class Facts(NamedTuple):
    """What the head of a source says.

    Attributes
    ----------
    title : what the function computes.
    coordinates : names with units.
    wrench : names with units, and axes and point; empty without a load.
    inputs : numbers of the springs that the function takes, and their count.
    outputs : lines on each output: shape and unit.
    """

    title: str
    coordinates: Sequence[str]
    wrench: Sequence[str]
    inputs: Mapping[str, int]
    outputs: Sequence[str]

    @property
    def arguments(self) -> dict[str, int]:
        """What the function takes, and its size."""
        wrench = {"wrench": 6} if self.wrench else {}
        return {"q": len(self.coordinates), **wrench, **self.inputs}


def _c_number(value: float) -> str:
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "INFINITY" if value > 0 else "(-INFINITY)"
    return (
        f"({value!r})" if value < 0 or str(value).startswith("-") else repr(float(value))
    )


_C = Language(
    {
        **{"add": "({}+{})", "sub": "({}-{})", "mul": "({}*{})", "div": "({}/{})"},
        "neg": "(-{})",
        **{"sqrt": "sqrt({})", "abs": "fabs({})", "sin": "sin({})", "cos": "cos({})"},
        "max": "larger({},{})",
        "copysign": "copysign({},{})",
        "pick": "({}<{}?{}:{})",
    },
    _c_number,
    "const double {}={};",
)
# C's fmax drops a NaN, which has to reach the verdict.
_LARGER = "static double larger(double x, double y) { return x > y || x != x ? x : y; }"


def c_source(
    program: Tape,
    shared: Mapping[str, Array],
    facts: Facts,
    name: str,
    closing: Tape | None = None,
) -> str:
    """One C99 function of a posture, without allocation.

    Parameters
    ----------
    program : Program
        With the outputs "record" and "verdict".
    shared : mapping of str to ndarray (1, n)
        Inputs that are the same at all postures.
    facts : Facts
        For the head.
    name : str
        Of the function.
    closing : Program, optional
        One step that closes a chain: its outputs are "next" and "left".
    """
    n, size = len(facts.coordinates), len(program.outputs["record"])
    body, read = _c_body(program, shared)
    verdict = body.pop()
    arguments = [f"const double {name}[{m}]" for name, m in facts.arguments.items()]
    if closing is not None:
        arguments[0] = f"double q[{n}]"
    parts = [_comment(facts, name, closing is not None), "#include <math.h>", "", _LARGER]
    calls = [f"  (void){array};" for array in facts.arguments if array not in read]
    if closing is not None:
        parts += ["", *_c_closing(closing, name, n)]
        calls.append(f"  if ({name}_close(q)) return 1;")
    head = f"int {name}({', '.join([*arguments, f'double out[{size}]'])})"
    returned = f"  return !({verdict} == {PLAIN!r});"
    return "\n".join([*parts, "", head, "{", *calls, *body, returned, "}", ""])


def _c_body(program: Tape, shared: Mapping[str, Array]) -> tuple[list[str], set[str]]:
    """Lines that compute and write a program's record, then its verdict;
    the arrays read.
    """
    lines, outputs, _, arrays = written(program, _C)
    heads = []
    for array, short in arrays.items():
        if array in shared:
            numbers = ", ".join(_c_number(x) for x in np.ravel(shared[array]).tolist())
            heads.append(f"  static const double {short}[] = {{{numbers}}};")
        else:
            heads.append(f"  const double *const {short} = {array};")
    count = sum(len(n) for o, n in program.outputs.items() if o != "verdict")
    writes = [f"  out[{i}]={text};" for i, text in enumerate(outputs[:count])]
    body = [*heads, *(f"  {line}" for line in lines), *writes, *outputs[count:]]
    return body, {*arrays}


def _c_closing(closing: Tape, name: str, n: int) -> list[str]:
    """The steps of `closed_chains.close` for one posture."""
    width = sum(map(len, closing.outputs.values()))
    step, _ = _c_body(closing, {})
    starts, at = dict[str, int](), 0
    for output, steps in closing.outputs.items():
        starts[output], at = at, at + len(steps)
    left, ahead = starts["left"], starts["next"]
    tight, loose = numerics.ATTAINABLE_PRECISION, numerics.ROUNDOFF
    head = f"static void {name}_step(const double q[{n}], double out[{width}])"
    loop = f"""
/* Closes the chain from q, in place; 1 where these steps do not close it. */
static int {name}_close(double q[{n}])
{{
  double out[{width}], size = INFINITY, best = INFINITY;
  int i, steps, futile = 0;
  for (steps = 0; steps < {STEPS}; steps++) {{
    const double before = size;
    double unit, step;
    {name}_step(q, out);
    size = out[{left}];
    step = out[{left + 1}];
    unit = out[{left + 2}] > 1.0 ? out[{left + 2}] : 1.0;
    if (size <= {tight!r} * unit) return 0;
    if (size <= {loose!r} * unit &&
        (size > 0.1 * before || step <= {numerics.SMALLEST_STEP!r})) return 0;
    futile = size < 0.9 * best ? 0 : futile + 1;
    best = size < best ? size : best;
    if (out[{left + 3}] != {PLAIN!r} || !(step < INFINITY)) return 1;
    if (futile >= {numerics.MAX_FUTILE_STEPS} && step < {LONGEST_STEP!r}) return 1;
    for (i = 0; i < {n}; i++) q[i] = out[{ahead} + i];
  }}
  return 1;
}}"""
    return [head, "{", *step, "}", loop]


def python_source(
    program: Tape, shared: Mapping[str, Array], facts: Facts, name: str
) -> str:
    """A Python function of numbers: whether the posture is plainly regular,
    and the record.
    """
    lines, outputs, _, arrays = written(program, PYTHON)
    names = [*facts.arguments]
    heads = [
        f"{short} = {np.ravel(shared[array]).tolist() if array in shared else array}"
        for array, short in arrays.items()
    ]
    *record, verdict = outputs
    body = [*heads, *lines, f"return {verdict} == {PLAIN!r}, [{', '.join(record)}]"]
    words = "\n    ".join(_words(facts, name, is_closed=False)[:-1])
    parts = [
        "from math import copysign, cos, sin, sqrt",
        "",
        "",
        f"def {name}({', '.join(names)}):",
        f'    """{words}\n    """',
        "    try:",
        *(f"        {line}" for line in body),
        "    except (ArithmeticError, ValueError):  # a number does not exist",
        "        return False, []",
        "",
    ]
    return "\n".join(parts)


def javascript_source(
    program: Tape, shared: Mapping[str, Array], facts: Facts, name: str
) -> str:
    """A JavaScript function of arrays: the record, or null where it is not
    plainly regular.
    """
    lines, outputs, _, arrays = written(program, JAVASCRIPT)
    names = [*facts.arguments]
    heads = []
    for array, short in arrays.items():
        numbers = (
            json.dumps(np.ravel(shared[array]).tolist()) if array in shared else array
        )
        heads.append(f"const {short}={numbers};")
    *record, verdict = outputs
    ends = f"return {verdict}==={PLAIN:g}?[{','.join(record)}]:null;"
    parts = [_comment(facts, name, is_closed=False), HELPERS]
    parts.append(
        f"function {name}({','.join(names)}){{{''.join([*heads, *lines])}{ends}}}\n"
    )
    return "\n".join(parts)


def _comment(facts: Facts, name: str, is_closed: bool) -> str:
    """A comment of C or JavaScript on inputs and outputs."""
    words = _words(facts, name, is_closed)
    return "\n".join(["/*", *(f" * {line}".rstrip() for line in words), " */"])


def _words(facts: Facts, name: str, is_closed: bool) -> list[str]:
    """Names, shapes and units of inputs and outputs."""
    words = [f"{name}: {facts.title}.", "", "q: coordinates"]
    if is_closed:
        words[-1] += " near a closed posture, whose coordinates replace them"
    words += [f"  {i}: {text}" for i, text in enumerate(facts.coordinates)]
    if facts.wrench:
        words += ["wrench: the load, which the springs balance", *facts.wrench]
    for array, count in facts.inputs.items():
        words.append(f"{array}: of the springs, {count} numbers")
    words += ["out:", *(f"  {text}" for text in facts.outputs), ""]
    words.append(
        "Returns 0 where the posture is plainly regular; elsewhere the numbers do not "
        "count."
    )
    return words
