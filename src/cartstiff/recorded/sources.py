"""A recorded program as source text of a function: C for a controller, JAX, Python,
JavaScript.

The head of each says the names, shapes and units of what goes in and comes out. Numbers
that all postures share, such as stiffnesses, are constants of the function.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from heapq import heapify, heappop, heappush
from string import Template
from typing import NamedTuple

import numpy as np

from cartstiff.recorded.algebra import PLAIN
from cartstiff.recorded.execution import (
    C_LIKE,
    HELPERS,
    JAVASCRIPT,
    PYTHON,
    Language,
    written,
)
from cartstiff.recorded.source_steps import Before, declared
from cartstiff.recorded.tape import Arrays
from cartstiff.recorded.tape import Program as Tape


class Facts(NamedTuple):
    """What the head of a source says.

    Attributes
    ----------
    title : what the function computes.
    coordinates : names with units.
    wrench : names with units, and axes and point; empty without a load.
    inputs : other numbers that the function takes, and their count.
    outputs : lines on each output: shape and unit.
    shapes : shape of each output by name.
    """

    title: str
    coordinates: Sequence[str]
    wrench: Sequence[str]
    inputs: Mapping[str, int]
    outputs: Sequence[str]
    shapes: Mapping[str, tuple[int, ...]]

    @property
    def arguments(self) -> dict[str, int]:
        """What the function takes, and its size."""
        wrench = {"wrench": 6} if self.wrench else {}
        return {"q": len(self.coordinates), **wrench, **self.inputs}


class Routine(NamedTuple):
    """What a source text computes.

    Attributes
    ----------
    name : of the function.
    program : its arithmetic, with the outputs "record" and "verdict".
    shared : inputs (1, n) that are the same at all postures, by name.
    before : steps towards the posture.
    facts : for the head.
    """

    name: str
    program: Tape
    shared: Arrays
    before: Before
    facts: Facts

    def steps(self, language: str, write: Callable[..., str]) -> list[str]:
        """The steps in a language; `write` as `Before.text`, with the constants first."""
        own = partial(write, self.shared)
        return self.before.text(language, self.name, self.facts.arguments, own)

    @property
    def comment(self) -> str:
        """A comment of C or JavaScript on inputs and outputs."""
        lines = (f" * {line}".rstrip() for line in self.words)
        return "\n".join(["/*", *lines, " */"])

    @property
    def words(self) -> list[str]:
        """Names, shapes and units of inputs and outputs."""
        facts = self.facts
        words = [f"{self.name}: {facts.title}.", "", "q: coordinates"]
        if self.before.moves:
            words[-1] += " near the posture, whose own replace them: closed, links bent"
        if self.before.closing is not None and not any(self.before.numbers["sizes"]):
            words[-1] += "; to close, all move"
        words += [f"  {i}: {text}" for i, text in enumerate(facts.coordinates)]
        if facts.wrench:
            words += ["wrench: the load, which the springs balance", *facts.wrench]
        meanings = {
            "load_at": "point of the load in M",
            "payload": "mass [kg], and its centre in M",
            "tcp": "pose of the tool in M: x, y, z, and roll, pitch, yaw [rad]",
        }
        for array, count in facts.inputs.items():
            meaning = meanings.get(array, "of the springs")
            words.append(f"{array}: {meaning}, {count} numbers")
        words += ["out:", *(f"  {text}" for text in facts.outputs), ""]
        words.append(
            "Returns 0 where the posture is plainly regular; elsewhere the numbers do "
            "not count."
        )
        return words


_C = C_LIKE._replace(
    words={**C_LIKE.words, "abs": "fabs({})", "max": "larger({},{})"},
    nan="NAN",
    infinity="INFINITY",
    named="const double {}={};",
)
# C's fmax drops a NaN, which has to reach the verdict.
_LARGER = "static double larger(double x, double y) { return x > y || x != x ? x : y; }"


def c_source(of: Routine) -> str:
    """One C99 function of a posture, without allocation."""
    name, program, shared, before, facts = of
    # The arithmetic of a posture at rest.
    body, read, called = _c_body(program, shared, name)
    *body, verdict = body
    arguments = declared(facts.arguments, before.moves)
    parts = [of.comment, "#include <math.h>", "", _LARGER]
    calls = [f"  (void){array};" for array in facts.arguments if array not in read]
    # What comes before it, in this order: close the chain, come to rest, take up the
    # links.
    parts += of.steps("c", _c_function)
    if before.closing is not None:
        calls.append(f"  if ({name}_close(q)) return 1;")
    if before.settling is not None:
        calls.append(f"  if ({name}_settle({', '.join(facts.arguments)})) return 1;")
    if before.terms:
        arrays = ", ".join(f"{array}[{m}]" for array, m in before.terms.items())
        calls.insert(0, f"  double {arrays};")
        calls.append(f"  if ({name}_terms(q, {', '.join(before.terms)})) return 1;")
    # The function itself returns whether the numbers do not count.
    size = len(program.outputs["record"])
    head = f"int {name}({arguments}, double out[{size}])"
    returned = f"  return !({verdict} == {PLAIN!r});"
    return "\n".join([*parts, "", *called, head, "{", *calls, *body, returned, "}", ""])


def _c_function(
    shared: Arrays, program: Tape, name: str, arguments: Mapping[str, int]
) -> str:
    """A program as a function of all its outputs, the verdict last."""
    (*body, last), read, called = _c_body(program, shared, name)
    size = sum(map(len, program.outputs.values()))
    if "verdict" in program.outputs:
        body.append(f"  out[{size - 1}]={last};")
    else:
        body.append(last)
    unread = [f"  (void){array};" for array in arguments if array not in read]
    head = f"static void {name}({declared(arguments)}, double out[{size}])"
    return "\n".join([*called, head, "{", *unread, *body, "}"])


#: Number of lines of a function that a C compiler optimises in seconds.
_LONGEST = 3000
_VALUE = re.compile(r"\bv\d+\b")


def _c_body(
    program: Tape, shared: Arrays, name: str
) -> tuple[list[str], set[str], list[str]]:
    """Lines that compute and write a program's record, then its verdict; the arrays
    read; and functions that these lines call.

    A long program is cut into functions that pass their values in an array, as the time
    of a compiler grows faster than the length of a function.
    """
    lines, outputs, _, arrays = written(program, _C)
    # Arrays of the mechanism are constants of the file, the rest arguments.
    heads, constants = list[str](), list[str]()
    for array, short in arrays.items():
        if array in shared:
            numbers = ", ".join(_C.number(x) for x in np.ravel(shared[array]).tolist())
            constants.append(f"static const double {name}_{short}[] = {{{numbers}}};")
            heads.append(f"  const double *const {short} = {name}_{short};")
        else:
            heads.append(f"  const double *const {short} = {array};")
    count = sum(len(n) for o, n in program.outputs.items() if o != "verdict")
    lines += [f"out[{i}]={text};" for i, text in enumerate(outputs[:count])]
    # A short program is one function.
    if len(lines) <= 2 * _LONGEST:
        body = [*heads, *(f"  {line}" for line in lines), *outputs[count:]]
        return body, {*arrays}, constants
    # A long one is cut, since compilers take long for long functions; what later pieces
    # read is kept in m.
    pieces = [lines[i : i + _LONGEST] for i in range(0, len(lines), _LONGEST)]
    read = [{*_VALUE.findall("\n".join(piece))} for piece in pieces]
    last = _VALUE.findall("\n".join(outputs[count:]))
    kept, functions, calls = dict[str, str](), list[str](), list[str]()
    given = ", ".join([*arrays.values(), "m", "out"])
    taken = ", ".join(f"const double *{short}" for short in arrays.values())
    for i, piece in enumerate(pieces):
        own = {line.split("=")[0].split()[-1] for line in piece if line[0] == "c"}
        later = set[str]().union(*read[i + 1 :], last)
        before = [f"  const double {v}={kept[v]};" for v in sorted(read[i] - own)]
        after = list[str]()
        for value in sorted(own & later):
            kept[value] = f"m[{len(kept)}]"
            after.append(f"  {kept[value]}={value};")
        unread = "".join(f" (void){short};" for short in arrays.values())
        head = f"static void {name}_{i}({taken}, double *m, double *out)"
        rows = [*before, *(f"  {line}" for line in piece), *after]
        functions += [head, "{", f" {unread} (void)out; (void)m;", *rows, "}", ""]
        calls.append(f"  {name}_{i}({given});")
    # The caller of the pieces.
    room = f"  double m[{max(1, len(kept))}];"
    found = [f"  const double {v}={kept[v]};" for v in dict.fromkeys(last)]
    body = [room, *heads, *calls, *found, *outputs[count:]]
    return body, {*arrays}, [*constants, "", *functions]


def python_source(of: Routine) -> str:
    """A Python function of numbers: whether the posture is plainly regular,
    and the record.
    """
    name, program, shared, before, facts = of
    arguments = ", ".join(facts.arguments)
    lines = list[str]()
    if before.closing is not None:
        lines.append(f"q[:] = {name}_close(q)")
    if before.settling is not None:
        lines.append(f"q[:] = {name}_settle({arguments})")
    if before.terms:
        lines.append(f"{', '.join(before.terms)} = {name}_terms(q)")
    body, outputs = _body(program, shared, PYTHON)
    lines += [*body, f"*record, verdict = {', '.join(outputs)}"]
    lines.append(f"return verdict == {PLAIN!r} and isfinite(sum(record)), record")
    words = "\n    ".join(of.words[:-1])
    parts = [
        "from math import ceil, copysign, cos, inf, isfinite, sin, sqrt",
        "",
        *of.steps("python", _python_function),
        "",
        f"def {name}({arguments}):",
        f'    """{words}\n    """',
        "    try:",
        *(f"        {line}" for line in lines),
        "    except (ArithmeticError, ValueError):  # a number does not exist",
        "        return False, []",
        "",
    ]
    return "\n".join(parts)


def _body(
    program: Tape, shared: Arrays, language: Language
) -> tuple[list[str], list[str]]:
    """Lines of Python or JavaScript that compute a program, and its outputs."""
    lines, outputs, _, arrays = written(program, language)
    heads = list[str]()
    for array, short in arrays.items():
        numbers = map(language.number, np.ravel(shared.get(array, ())).tolist())
        known = f"[{', '.join(numbers)}]" if array in shared else array
        heads.append(language.named.format(short, known))
    return [*heads, *lines], outputs


def _python_function(
    shared: Arrays, program: Tape, name: str, arguments: Mapping[str, int]
) -> str:
    """A program as a function of lists."""
    lines, outputs = _body(program, shared, PYTHON)
    body = "".join(f"    {line}\n" for line in lines)
    head = f"\ndef {name}({', '.join(arguments)}):\n"
    return f"{head}{body}    return [{', '.join(outputs)}]\n"


#: Operations at once of a JAX function.
_AT_ONCE = 16
#: Their numbers there.
_KINDS: Sequence[str] = (
    *("", "add", "sub", "mul", "div", "neg", "sqrt", "abs", "max", "sin", "cos"),
    *("copysign", "pick"),
)
_JAX = """import jax
import jax.numpy as jnp
import numpy as np


def _chosen(kind, several):
    found = 0.0
    for i, each in several.items():
        found = jnp.where(kind == i, each, found)
    return found


def _results(x, kind, turns):
    a, b, c, d = (x[..., i] for i in range(4))
    over, under = jnp.where(kind == 4, b, 1.0), jnp.where(kind == 6, a, 1.0)
    several = {1: a + b, 2: a - b, 3: a * b, 4: a / over, 5: -a, 6: jnp.sqrt(under)}
    several |= {7: jnp.abs(a), 8: jnp.maximum(a, b)}
    several |= {11: jnp.abs(a) * jnp.where(jnp.signbit(b), -1.0, 1.0)}
    several |= {12: jnp.where(a < b, c, d)}
    turned = [lambda a: (jnp.sin(a), jnp.cos(a)), lambda a: (a, a)]
    several[9], several[10] = jax.lax.cond(turns, *turned, a)
    return _chosen(kind, several)


def _slopes(x, y, kind):
    a, b = x[..., 0], x[..., 1]
    over, root = jnp.where(kind == 4, b, 1.0), jnp.where(kind == 6, y, 1.0)
    size, sign = (jnp.where(jnp.signbit(z), -1.0, 1.0) for z in (a, b))
    taken = jnp.where(a < b, 1.0, 0.0)
    first = {1: 1.0, 2: 1.0, 3: b, 4: 1.0 / over, 5: -1.0, 6: 0.5 / root, 7: size}
    first |= {8: 1.0 - taken, 9: jnp.cos(a), 10: -jnp.sin(a), 11: size * sign}
    second = {1: 1.0, 2: -1.0, 3: a, 4: -y / over, 8: taken}
    four = first, second, {12: taken}, {12: 1.0 - taken}
    slopes = jnp.stack([_chosen(kind, each) for each in four], -1)
    return jnp.where(jnp.isfinite(slopes), slopes, 0.0)


def _program(inputs, constants, kinds, reads, outputs):
    # Operations in steps of several: kind of each, and the places of what it reads. A
    # place is that of an input or constant, or of an earlier result.
    first, width = len(inputs) + len(constants), $width
    kinds = np.array(kinds, np.int32).reshape(-1, width)
    reads = np.array(reads, np.int32).reshape(-1, width, 4)
    places = first + width * np.arange(len(kinds))

    def along(numbers, function, *rows):
        def step(known, row):
            place, read, *more = row
            found = function(known[read], *more)
            return jax.lax.dynamic_update_slice(known, found, (place,)), None

        room = jnp.concatenate([numbers, jnp.zeros(kinds.size)])
        return jax.lax.scan(step, room, (places, reads, *rows))[0]

    # One posture after the other is faster than the table of many.
    @jax.custom_batching.sequential_vmap
    def one(numbers):
        turns = ((kinds == 9) | (kinds == 10)).any(axis=1)
        return along(numbers, _results, kinds, turns)

    @jax.custom_jvp
    def values(numbers):
        return one(numbers)

    @values.defjvp
    def _(numbers, changes):
        found = values(*numbers)
        slopes = _slopes(found[reads], found[first:].reshape(kinds.shape), kinds)

        def change(x, slope):
            return jnp.where(slope == 0.0, 0.0, x * slope).sum(-1)

        return found, along(*changes, change, slopes)

    arrays = list(dict.fromkeys(array for array, _ in inputs))

    def run(given):
        rows = [given[array].reshape(-1) for array in arrays]
        starts = dict(zip(arrays, np.cumsum([0, *map(len, rows)])))
        at = np.array([starts[array] + i for array, i in inputs])
        numbers = [jnp.concatenate(rows)[at], np.array(constants)]
        return values(jnp.concatenate(numbers))[np.array(outputs)]

    return run


def _followed(at, changes, ahead):
    # Newton's steps from a posture where they end have its derivatives.
    near = at + changes
    for _ in range(2):
        near = ahead(near)
    return at + near - jax.lax.stop_gradient(near)
$programs

def $name($arguments):
    \"\"\"$words
    \"\"\"
    if not jax.config.jax_enable_x64:
        raise RuntimeError("jax.config.update('jax_enable_x64', True) first")
    given = {**${name}_shared, $given}
    fixed, plain = jax.lax.stop_gradient(given), True
$lines
    found = ${name}_numbers(given)
    return plain & (found[-1] == 0.0), {$moved**{
        name: found[start : start + int(np.prod(shape))].reshape(shape)
        for name, start, shape in $places
    }}
"""


def jax_source(of: Routine) -> str:
    """A function of JAX arrays: whether the posture is plainly regular,
    and the outputs by name.

    JAX takes minutes to compile thousands of numbers with names. The operations are
    therefore rows of a table, and a loop computes some at once; it compiles in a second,
    whatever their number. Derivatives are those of each operation, along the same loop.
    """
    name, program, shared, before, facts = of
    # The steps towards the posture, from numbers that are no variables there; then its
    # derivatives.
    constants = {array: rows.ravel().tolist() for array, rows in shared.items()}
    every = ", ".join(f"{n!r}: np.array({row})" for n, row in constants.items())
    parts = ["", f"\n{name}_shared = {{{every}}}"]
    parts += of.steps("jax", _jax_function)
    parts.append(_jax_function(shared, program, f"{name}_numbers", {}))
    lines, ahead = list[str](), f"{name}_step({{'q': q}})"
    if before.closing is not None:
        lines += [f"fixed['q'], plain = {name}_close(fixed['q'])"]
    if before.settling is not None:
        lines += [f"fixed['q'], at_rest = {name}_settle(fixed)", "plain &= at_rest"]
        ahead = f"{name}_bend({{**given, **{name}_terms(q)[0], 'q': q}})"
    if before.moves:
        n = facts.arguments["q"]
        lines += ["changes = given['q'] - jax.lax.stop_gradient(given['q'])"]
        lines += [f"ahead = lambda q: {ahead}[:{n}]"]
        lines += ["given['q'] = _followed(fixed['q'], changes, ahead)"]
    if before.terms:
        lines += [f"terms, unbent = {name}_terms(given['q'])", "given |= terms"]
        lines += ["plain &= unbent"]
    # Where each output lies in the flat row.
    starts, places = 0, list[tuple[str, int, tuple[int, ...]]]()
    for output, shape in facts.shapes.items():
        places.append((output, starts, shape))
        starts += math.prod(shape)
    head = of.words[:-2]
    head += [
        "",
        "Returns whether the posture is plainly regular, and the outputs by name;",
    ]
    head.append("elsewhere they do not count. Takes jax.jit, jax.vmap and jax.grad.")
    given = [f"{n!r}: jnp.asarray({n}, float)" for n in facts.arguments]
    return Template(_JAX).substitute(
        width=_AT_ONCE,
        name=name,
        arguments=", ".join(facts.arguments),
        words="\n    ".join(head),
        given=", ".join(given),
        programs="\n".join(parts),
        lines="".join(f"    {line}\n" for line in lines).rstrip("\n"),
        moved="'q': given['q'], " if before.moves else "",
        places=places,
    )


def _jax_function(
    shared: Arrays,  # noqa: ARG001
    program: Tape,
    name: str,
    arguments: Mapping[str, int],  # noqa: ARG001
) -> str:
    """A program as tables, of all outputs."""
    steps, place, _ = _in_steps(program)
    inputs, constants = list[tuple[str, int]](), list[float]()
    for operation in program.operations:
        if operation.name == "input":
            array, component = program.inputs[operation.arguments[0]]
            inputs.append((array, component))
        elif operation.name == "constant":
            constants.append(operation.value)
    kinds, reads = list[int](), list[int]()
    # A step does several operations at once; one that is not full is padded.
    for own in steps:
        for step in own + [None] * (_AT_ONCE - len(own)):
            read: Sequence[int] = ()
            kind = 0
            if step is not None:
                kind = _KINDS.index(program.operations[step].name)
                read = program.operations[step].arguments
            kinds.append(kind)
            reads += [place[a] for a in read] + [0] * (4 - len(read))
    outputs = [place[step] for steps in program.outputs.values() for step in steps]
    numbers = f"[{', '.join(map(PYTHON.number, constants))}]"
    given = f"{inputs}, {numbers}, {kinds}, {reads}, {outputs}"
    return f"{name} = _program({given})"


def _in_steps(program: Tape) -> tuple[list[list[int]], dict[int, int], int]:
    """Operations that are computed together, the place of each value,
    and the number of inputs and constants.

    Those on which the longest chain of operations waits come first.
    """
    operations = program.operations
    # Inputs and constants are there from the beginning.
    leaves = [i for i, o in enumerate(operations) if o.name == "input"]
    leaves += [i for i, o in enumerate(operations) if o.name == "constant"]
    place, first = {step: i for i, step in enumerate(leaves)}, len(leaves)
    # Who waits for whom, and how long a chain hangs on each operation.
    readers = dict[int, list[int]]()
    missing, waits = dict[int, int](), [0] * len(operations)
    for step, operation in enumerate(operations):
        if step not in place:
            own = {a for a in operation.arguments if a not in place}
            missing[step] = len(own)
            for argument in own:
                readers.setdefault(argument, []).append(step)
    for step in reversed(range(len(operations))):
        waits[step] = 1 + max((waits[r] for r in readers.get(step, ())), default=0)
    # Longest chains first, as many at once as a step holds.
    ready = [(-waits[step], step) for step, count in missing.items() if not count]
    heapify(ready)
    steps = list[list[int]]()
    while ready:
        together = [heappop(ready)[1] for _ in range(min(_AT_ONCE, len(ready)))]
        for i, step in enumerate(together):
            place[step] = first + _AT_ONCE * len(steps) + i
            for reader in readers.get(step, ()):
                missing[reader] -= 1
                if not missing[reader]:
                    heappush(ready, (-waits[reader], reader))
        steps.append(together)
    return steps, place, first


def javascript_source(of: Routine) -> str:
    """A JavaScript function of arrays: the record, or null where it is not
    plainly regular.
    """
    name, program, shared, before, facts = of
    arguments, lines = ",".join(facts.arguments), list[str]()
    # The posture is found first, and replaces the coordinates.
    moves = {"close(q)": before.closing, f"settle({arguments})": before.settling}
    for call in (call for call, step in moves.items() if step is not None):
        lines += [f"const {call[:5]}={name}_{call};", f"if(!{call[:5]})return null;"]
        lines += [f"for(let i=0;i<q.length;i++)q[i]={call[:5]}[i];"]
    if before.terms:
        lines += [f"const terms={name}_terms(q);", "if(!terms)return null;"]
        lines += [f"const [{','.join(before.terms)}]=terms;"]
    body, (*record, verdict) = _body(program, shared, JAVASCRIPT)
    lines += [*body, f"return {verdict}==={PLAIN:g}?[{','.join(record)}]:null;"]
    parts = [of.comment, HELPERS, *of.steps("javascript", javascript_function)]
    return "\n".join([*parts, f"function {name}({arguments}){{{''.join(lines)}}}\n"])


def javascript_function(
    shared: Arrays, program: Tape, name: str, arguments: Mapping[str, int]
) -> str:
    """A program as a function of arrays."""
    body, outputs = _body(program, shared, JAVASCRIPT)
    head = f"function {name}({','.join(arguments)})"
    return f"{head}{{{''.join(body)}return [{','.join(outputs)}];}}"


#: Writes a source.
WRITERS = {
    "c": c_source,
    "jax": jax_source,
    "python": python_source,
    "javascript": javascript_source,
}
