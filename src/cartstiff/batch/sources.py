"""A recorded program as source text of a function: C for a controller, JAX, Python,
JavaScript.

The head of each says the names, shapes and units of what goes in and comes out. Numbers
that all postures share, such as stiffnesses, are constants of the function.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from heapq import heapify, heappop, heappush
from typing import NamedTuple

import numpy as np

from cartstiff import numerics
from cartstiff.batch.algebra import PLAIN
from cartstiff.batch.closed_chains import MAX_SETTLING_STEPS, STEPS
from cartstiff.batch.execution import (
    HELPERS,
    JAVASCRIPT,
    PYTHON,
    Language,
    written,
)
from cartstiff.batch.tape import Program as Tape
from cartstiff.batch.untraced import segment_program
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.closures import LONGEST_STEP
from cartstiff.potentials.beams import Beam, alike
from cartstiff.stiffness.settled_links import LAST, ROUNDED

LANGUAGES = ("c", "jax", "python", "javascript")


class Facts(NamedTuple):
    """What the head of a source says.

    Attributes
    ----------
    title : what the function computes.
    coordinates : names with units.
    wrench : names with units, and axes and point; empty without a load.
    inputs : other numbers that the function takes, and their count.
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


class Before(NamedTuple):
    """Steps that a posture takes before its numbers are computed.

    Attributes
    ----------
    closing : one step that closes a chain: its outputs are "next" and "left".
    settling : one step of links towards rest under a load: "settled" and "moved".
    beams : links, whose derivatives are inputs of the programs.
    """

    closing: Tape | None = None
    settling: Tape | None = None
    beams: Sequence[Beam] = ()

    @property
    def moves(self) -> bool:
        """Whether the coordinates change."""
        return self.closing is not None or self.settling is not None


def c_source(
    program: Tape,
    shared: Mapping[str, Array],
    facts: Facts,
    name: str,
    before: Before,
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
    before : Before
        Steps towards the posture.
    """
    n, size = len(facts.coordinates), len(program.outputs["record"])
    # The arithmetic of a posture at rest.
    body, read, called = _c_body(program, shared, name)
    verdict = body.pop()
    arguments = [f"const double {name}[{m}]" for name, m in facts.arguments.items()]
    if before.moves:
        arguments[0] = f"double q[{n}]"
    parts = [_comment(facts, name, before.moves), "#include <math.h>", "", _LARGER]
    calls = [f"  (void){array};" for array in facts.arguments if array not in read]
    # What comes before it, in this order: shut the closures, come to rest, take up the
    # beams.
    if before.closing is not None:
        parts += ["", *_c_closing(before.closing, name, n)]
        calls.append(f"  if ({name}_close(q)) return 1;")
    if before.beams:
        parts += ["", *_c_beams(before.beams, name, n)]
        terms = _terms(before.beams)
        declared = ", ".join(f"{array}[{m}]" for array, m in terms.items())
        calls.insert(0, f"  double {declared};")
        if before.settling is not None:
            parts += ["", *_c_settling(before.settling, shared, facts, name, terms)]
            calls.append(f"  if ({name}_settle({', '.join(facts.arguments)})) return 1;")
        calls.append(f"  if ({name}_terms(q, {', '.join(terms)})) return 1;")
    # The function itself returns whether the numbers do not count.
    head = f"int {name}({', '.join([*arguments, f'double out[{size}]'])})"
    returned = f"  return !({verdict} == {PLAIN!r});"
    return "\n".join([*parts, "", *called, head, "{", *calls, *body, returned, "}", ""])


def _terms(beams: Sequence[Beam]) -> dict[str, int]:
    """Inputs that links determine, and their sizes."""
    count = sum(len(beam.indices) for beam in beams)
    return {"energies": 1, "segment_gradients": 6 * count, "segment_hessians": 36 * count}


def _c_beams(beams: Sequence[Beam], name: str, n: int) -> list[str]:
    """Energy, gradient and Hessian of each segment."""
    parts, chosen, kinds = list[str](), list[str](), dict[int, int]()
    for k, group in enumerate(alike(beams)):
        segment = segment_program(group[0].length, group[0].section)
        body, _, _ = _c_body(segment, {}, f"{name}_segment{k}")
        plain = f"  return !({body.pop()} == {PLAIN!r});"
        head = f"static int {name}_segment{k}(const double x[6], double out[28])"
        parts += [head, "{", *body, plain, "}", ""]
        chosen.append(f"    if (kinds[i] == {k} && {name}_segment{k}(x, out)) return 1;")
        kinds |= {id(beam): k for beam in group}
    own = [(kinds[id(beam)], row) for beam in beams for row in beam.indices.tolist()]
    rows = ", ".join(f"{{{', '.join(map(str, row))}}}" for _, row in own)
    arrays = ", ".join(f"double {array}[{m}]" for array, m in _terms(beams).items())
    choice = "\n".join(chosen)
    return [
        *parts,
        f"""/* Derivatives of the energy of the links; 1 where one bends too far. */
static int {name}_terms(const double q[{n}], {arrays})
{{
  static const int kinds[{len(own)}] = {{{", ".join(str(k) for k, _ in own)}}};
  static const int at[{len(own)}][6] = {{{rows}}};
  int i, a, b;
  energies[0] = 0.0;
  for (i = 0; i < {len(own)}; i++) {{
    double x[6], out[28] = {{0}};
    const double *entry = out + 7;
    for (a = 0; a < 6; a++) x[a] = q[at[i][a]];
{choice}
    energies[0] += out[0];
    for (a = 0; a < 6; a++) {{
      segment_gradients[6*i + a] = out[1 + a];
      for (b = 0; b <= a; b++, entry++)
        segment_hessians[36*i + 6*a + b] = segment_hessians[36*i + 6*b + a] = *entry;
    }}
  }}
  return 0;
}}""",
    ]


def _c_settling(
    settling: Tape,
    shared: Mapping[str, Array],
    facts: Facts,
    name: str,
    terms: Mapping[str, int],
) -> list[str]:
    """The steps of `closed_chains.settle` for one posture."""
    n = len(facts.coordinates)
    body, read, called = _c_body(settling, shared, f"{name}_bend")
    sizes = {**facts.arguments, **terms}
    given = [f"const double {array}[{m}]" for array, m in sizes.items()]
    unread = [f"  (void){array};" for array in sizes if array not in read]
    step = f"static void {name}_bend({', '.join(given)}, double out[{n + 2}])"
    own = [f"double q[{n}]", *given[1 : len(facts.arguments)]]
    declared = ", ".join(f"{array}[{m}]" for array, m in terms.items())
    loop = f"""
/* Moves the links to rest under the load, from q, in place; 1 where they do not. */
static int {name}_settle({", ".join(own)})
{{
  double {declared}, out[{n + 2}], moved = INFINITY;
  int i, steps;
  for (steps = 0; steps < {MAX_SETTLING_STEPS}; steps++) {{
    if ({name}_terms(q, {", ".join(terms)})) return 1;
    {name}_bend({", ".join(sizes)}, out);
    moved = out[{n}];
    if (out[{n + 1}] != {PLAIN!r} || !(moved < INFINITY)) return 1;
    for (i = 0; i < {n}; i++) q[i] = out[i];
    if (moved <= {LAST!r}) return 0;
  }}
  return !(moved <= {ROUNDED!r});
}}"""
    return [*called, step, "{", *unread, *body, "}", loop]


#: Number of lines of a function that a C compiler optimises in seconds.
_LONGEST = 3000
_VALUE = re.compile(r"\bv\d+\b")


def _c_body(
    program: Tape, shared: Mapping[str, Array], name: str
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
            numbers = ", ".join(_c_number(x) for x in np.ravel(shared[array]).tolist())
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


def _c_closing(closing: Tape, name: str, n: int) -> list[str]:
    """The steps of `closed_chains.close` for one posture."""
    width = sum(map(len, closing.outputs.values()))
    step, _, called = _c_body(closing, {}, f"{name}_step")
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
    return [*called, head, "{", *step, "}", loop]


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
    words = "\n    ".join(_words(facts, name, is_moved=False)[:-1])
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

# Operations in steps of {width}: kind of each, and the places of what it reads. A place
# is that of an input or constant, or of an earlier result.
_KIND = np.array({kinds}, np.int32).reshape(-1, {width})
_READ = np.array({reads}, np.int32).reshape(-1, {width}, 4)
_PLACE = {first} + {width} * np.arange(len(_KIND))


def _chosen(kind, several):
    found = 0.0
    for i, each in several.items():
        found = jnp.where(kind == i, each, found)
    return found


def _results(x, kind, turns):
    a, b, c, d = (x[..., i] for i in range(4))
    over, under = jnp.where(kind == 4, b, 1.0), jnp.where(kind == 6, a, 1.0)
    several = {{1: a + b, 2: a - b, 3: a * b, 4: a / over, 5: -a, 6: jnp.sqrt(under)}}
    several |= {{7: jnp.abs(a), 8: jnp.maximum(a, b)}}
    several |= {{11: jnp.abs(a) * jnp.where(jnp.signbit(b), -1.0, 1.0)}}
    several |= {{12: jnp.where(a < b, c, d)}}
    turned = [lambda a: (jnp.sin(a), jnp.cos(a)), lambda a: (a, a)]
    several[9], several[10] = jax.lax.cond(turns, *turned, a)
    return _chosen(kind, several)


def _slopes(x, y, kind):
    a, b = x[..., 0], x[..., 1]
    over, root = jnp.where(kind == 4, b, 1.0), jnp.where(kind == 6, y, 1.0)
    size, sign = (jnp.where(jnp.signbit(z), -1.0, 1.0) for z in (a, b))
    taken = jnp.where(a < b, 1.0, 0.0)
    first = {{1: 1.0, 2: 1.0, 3: b, 4: 1.0 / over, 5: -1.0, 6: 0.5 / root, 7: size}}
    first |= {{8: 1.0 - taken, 9: jnp.cos(a), 10: -jnp.sin(a), 11: size * sign}}
    second = {{1: 1.0, 2: -1.0, 3: a, 4: -y / over, 8: taken}}
    four = first, second, {{12: taken}}, {{12: 1.0 - taken}}
    slopes = jnp.stack([_chosen(kind, each) for each in four], -1)
    return jnp.where(jnp.isfinite(slopes), slopes, 0.0)


def _along(numbers, function, *rows):
    def step(known, row):
        place, read, *more = row
        found = function(known[read], *more)
        return jax.lax.dynamic_update_slice(known, found, (place,)), None

    room = jnp.concatenate([numbers, jnp.zeros(_KIND.size)])
    return jax.lax.scan(step, room, (_PLACE, _READ, *rows))[0]


# One posture after the other is faster than the table of many.
@jax.custom_batching.sequential_vmap
def _one(numbers):
    turns = ((_KIND == 9) | (_KIND == 10)).any(axis=1)
    return _along(numbers, _results, _KIND, turns)


@jax.custom_jvp
def _values(numbers):
    return _one(numbers)


@_values.defjvp
def _(numbers, changes):
    values = _values(*numbers)
    slopes = _slopes(values[_READ], values[{first} :].reshape(_KIND.shape), _KIND)

    def change(x, slope):
        return jnp.where(slope == 0.0, 0.0, x * slope).sum(-1)

    return values, _along(*changes, change, slopes)


def {name}({arguments}):
    \"\"\"{words}
    \"\"\"
    if not jax.config.jax_enable_x64:
        raise RuntimeError("jax.config.update('jax_enable_x64', True) first")
    given = {{{given}}}
    inputs = [given[array].reshape(-1)[i] for array, i in {inputs}]
    values = _values(jnp.array([*inputs, *{constants}]))
    found = values[np.array({outputs})]
    return values[{verdict}] == 0.0, {{
        name: found[start : start + int(np.prod(shape))].reshape(shape)
        for name, start, shape in {places}
    }}
"""


def jax_source(
    program: Tape,
    shared: Mapping[str, Array],
    facts: Facts,
    name: str,
    shapes: Mapping[str, tuple[int, ...]],
) -> str:
    """A function of JAX arrays: whether the posture is plainly regular,
    and the outputs by name.

    JAX takes minutes to compile thousands of numbers with names. The operations are
    therefore rows of a table, and a loop computes some at once; it compiles in a second,
    whatever their number. Derivatives are those of each operation, along the same loop.
    """
    steps, place, first = _in_steps(program)
    # The operations as tables, which one loop in JAX follows: it compiles in a second.
    inputs, constants = list[tuple[str, int]](), list[float]()
    for operation in program.operations:
        if operation.name == "input":
            inputs.append(program.inputs[operation.arguments[0]])
        elif operation.name == "constant":
            constants.append(operation.value)
    kinds, reads = list[int](), list[int]()
    # A step does several operations at once; one that is not full is padded.
    for own in steps:
        for step in own + [None] * (_AT_ONCE - len(own)):
            arguments: Sequence[int] = ()
            kind = 0
            if step is not None:
                kind = _KINDS.index(program.operations[step].name)
                arguments = program.operations[step].arguments
            kinds.append(kind)
            reads += [place[a] for a in arguments] + [0] * (4 - len(arguments))
    # Where each output lies in the flat row.
    starts, places = 0, list[tuple[str, int, tuple[int, ...]]]()
    for output, shape in shapes.items():
        places.append((output, starts, shape))
        starts += math.prod(shape)
    # Arguments and constants by name, and the function's own words.
    given = [f"{n!r}: jnp.asarray({n}, float)" for n in facts.arguments]
    given += [
        f"{n!r}: np.array({np.ravel(rows).tolist()})"
        for n, rows in shared.items()
        if any(array == n for array, _ in inputs)
    ]
    head = _words(facts, name, is_moved=False)[:-2]
    head += [
        "",
        "Returns whether the posture is plainly regular, and the outputs by name;",
    ]
    head.append("elsewhere they do not count. Takes jax.jit, jax.vmap and jax.grad.")
    return _JAX.format(
        width=_AT_ONCE,
        kinds=kinds,
        reads=reads,
        first=first,
        name=name,
        arguments=", ".join(facts.arguments),
        words="\n    ".join(head),
        given=", ".join(given),
        inputs=[tuple(each) for each in inputs],
        constants=f"[{', '.join(map(PYTHON.number, constants))}]",
        outputs=[place[step] for step in program.outputs["record"]],
        verdict=place[program.outputs["verdict"][0]],
        places=places,
    )


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
    parts = [_comment(facts, name, is_moved=False), HELPERS]
    parts.append(
        f"function {name}({','.join(names)}){{{''.join([*heads, *lines])}{ends}}}\n"
    )
    return "\n".join(parts)


def _comment(facts: Facts, name: str, is_moved: bool) -> str:
    """A comment of C or JavaScript on inputs and outputs."""
    words = _words(facts, name, is_moved)
    return "\n".join(["/*", *(f" * {line}".rstrip() for line in words), " */"])


def _words(facts: Facts, name: str, is_moved: bool) -> list[str]:
    """Names, shapes and units of inputs and outputs."""
    words = [f"{name}: {facts.title}.", "", "q: coordinates"]
    if is_moved:
        words[-1] += " near the posture, whose own replace them: closed, links bent"
    words += [f"  {i}: {text}" for i, text in enumerate(facts.coordinates)]
    if facts.wrench:
        words += ["wrench: the load, which the springs balance", *facts.wrench]
    meanings = {
        "load_at": "point of the load in M",
        "payload": "mass [kg], and its centre in M",
        "tcp": "pose of the tool in M: x, y, z, and roll, pitch, yaw [rad]",
    }
    for array, count in facts.inputs.items():
        words.append(f"{array}: {meanings.get(array, 'of the springs')}, {count} numbers")
    words += ["out:", *(f"  {text}" for text in facts.outputs), ""]
    words.append(
        "Returns 0 where the posture is plainly regular; elsewhere the numbers do not "
        "count."
    )
    return words
