r"""A program as vector code: LLVM intermediate representation, one posture per lane.

The text follows the operations in their order, so that LLVM only chooses instructions.
Multiplications and additions may be fused, nothing is reordered. Constants and shared
inputs are in memory as whole vectors. Results go through memory that stays in the cache,
from which one vector per entry is transposed to one record per posture, with `stream`
written past the cache. The records of a block of postures are written between the
operations of the next block, as fast as memory allows.

A long program is cut into functions that pass their values in memory, as the time of LLVM
grows faster than the length of a function.
"""

from __future__ import annotations

import struct
from itertools import product

import numpy as np

from cartstiff.recorded.tape import Input, Program

# Sine and cosine as in fdlibm: pi/2 in three parts of which the first two have 33 digits,
# so that their products with a whole number below 2^20 are exact, and the minimax
# polynomials.
_TWO_OVER_PI = 6.36619772367581382433e-01
_HALF_PI = (
    1.57079632673412561417e00,
    6.07710050630396597660e-11,
    2.02226624879595063154e-21,
)
_SINE = (
    -1.66666666666666324348e-01,
    8.33333333332248946124e-03,
    -1.98412698298579493134e-04,
    2.75573137070700676789e-06,
    -2.50507602534068634195e-08,
    1.58969099521155010221e-10,
)
_COSINE = (
    4.16666666666666019037e-02,
    -1.38888888888741095749e-03,
    2.48015872894767294178e-05,
    -2.75573143513906633035e-07,
    2.08757232129817482790e-09,
    -1.13596475577881948265e-11,
)
#: Adding this leaves the nearest whole number in the last digits.
_WHOLE = 6755399441055744.0
_FIXED = (_TWO_OVER_PI, *_HALF_PI, *_SINE, *_COSINE, _WHOLE, 0.5, 1.0)

_BINARY = {"add": "fadd", "sub": "fsub", "mul": "fmul", "div": "fdiv"}
#: Functions of LLVM, with their number of arguments.
_CALLED = {"sqrt": ("sqrt", 1), "abs": ("fabs", 1), "copysign": ("copysign", 2)}


#: A constant in hexadecimal, or an input that all postures share.
Key = str | Input


def _hex(value: float) -> str:
    return "0x" + struct.pack(">d", value).hex().upper()


def kept_table(program: Program) -> dict[Key, int]:
    """Place of each constant, and of each component of shared inputs,
    in the table of vectors.
    """
    keys: list[Key] = [_hex(x) for x in _FIXED]
    for name, arguments, value in program.operations:
        if name == "constant":
            keys.append(_hex(value))
        elif name == "input" and program.inputs[arguments[0]].array in program.shared:
            keys.append(program.inputs[arguments[0]])
    return {key: place for place, key in enumerate(dict.fromkeys(keys))}


class Writer:
    """Writes the lines of one function, with new names for values."""

    def __init__(self, width: int, table: dict[Key, int], prefix: str = "x") -> None:
        self.lines: list[str] = []
        self.width = width
        self.table = table
        self._prefix = prefix
        self.vector = f"<{width} x double>"
        self.integers = f"<{width} x i64>"
        self._count = 0

    def new(self, text: str) -> str:
        """Define a value."""
        self._count += 1
        name = f"%{self._prefix}{self._count}"
        self.lines.append(f"  {name} = {text}")
        return name

    def constant(self, value: float) -> str:
        """Load a constant."""
        return self.kept(_hex(value))

    def kept(self, key: Key) -> str:
        """Load a constant or a component of a shared input."""
        return self.load("%table", self.width * self.table[key])

    def whole(self, value: int) -> str:
        """Write a whole number in every lane."""
        return "<" + ", ".join([f"i64 {value}"] * self.width) + ">"

    def do(self, operation: str, a: str, b: str) -> str:
        """Write a sum, difference, product or quotient that may be fused with another."""
        return self.new(f"{operation} contract {self.vector} {a}, {b}")

    def address(self, base: str, index: int) -> str:
        """Write the address of a number, `index` after the base."""
        return self.new(f"getelementptr double, ptr {base}, i64 {index}")

    def load(self, base: str, index: int) -> str:
        """Load a vector from memory."""
        how = f"align {8 * self.width}"
        return self.new(f"load {self.vector}, ptr {self.address(base, index)}, {how}")

    def store(self, value: str, base: str, index: int, how: str = "") -> None:
        """Store a vector into memory."""
        how = how or f"align {8 * self.width}"
        self.lines.append(
            f"  store {self.vector} {value}, ptr {self.address(base, index)}, {how}"
        )

    def splat(self, scalar: str) -> str:
        """Write a scalar in every lane."""
        one = self.new(f"insertelement {self.vector} poison, double {scalar}, i32 0")
        both = f"{self.vector} {one}, {self.vector} poison"
        return self.new(f"shufflevector {both}, <{self.width} x i32> zeroinitializer")

    def sine_and_cosine(self, x: str) -> tuple[str, str]:
        """Write sine and cosine, within two units of the last digit for
        angles up to 1e6.
        """
        # The nearest quarter turn, by adding a number that leaves no digits behind the
        # point.
        shifted = self.do(
            "fadd", self.do("fmul", x, self.constant(_TWO_OVER_PI)), self.constant(_WHOLE)
        )
        quarter = self.do("fsub", shifted, self.constant(_WHOLE))
        # The rest in three parts, so that large angles keep their digits.
        r = x
        for part in _HALF_PI:
            r = self.do("fsub", r, self.do("fmul", quarter, self.constant(part)))
        # Both series near zero; the cosine with what rounding has lost.
        z = self.do("fmul", r, r)
        s = self.do("fmul", self._polynomial(z, _SINE), self.do("fmul", z, r))
        s = self.do("fadd", s, r)
        half = self.do("fmul", z, self.constant(0.5))
        near = self.do("fsub", self.constant(1.0), half)
        lost = self.do("fsub", self.do("fsub", self.constant(1.0), near), half)
        c = self.do("fmul", self._polynomial(z, _COSINE), self.do("fmul", z, z))
        c = self.do("fadd", near, self.do("fadd", lost, c))
        # Odd quarters swap both, and the bits of the quarter are the signs.
        k = self.new(f"bitcast {self.vector} {shifted} to {self.integers}")
        odd = self.new(f"trunc {self.integers} {k} to <{self.width} x i1>")
        pair = []
        for yes, no, count in ((c, s, k), (s, c, self._integer("add", k, 1))):
            value = self.new(
                f"select <{self.width} x i1> {odd}, {self.vector} {yes}, {self.vector} "
                f"{no}"
            )
            sign = self._integer("shl", self._integer("and", count, 2), 62)
            bits = self.new(f"bitcast {self.vector} {value} to {self.integers}")
            bits = self.new(f"xor {self.integers} {bits}, {sign}")
            pair.append(self.new(f"bitcast {self.integers} {bits} to {self.vector}"))
        return pair[0], pair[1]

    def _integer(self, operation: str, a: str, b: int) -> str:
        return self.new(f"{operation} {self.integers} {a}, {self.whole(b)}")

    def _polynomial(self, z: str, coefficients: tuple[float, ...]) -> str:
        value = self.constant(coefficients[-1])
        for c in coefficients[-2::-1]:
            value = self.do("fadd", self.do("fmul", value, z), self.constant(c))
        return value

    def side_by_side(self, angles: list[str]) -> list[tuple[str, str]]:
        """Write sines and cosines of several angles, interleaved to hide latency."""
        pairs, parts = [], []
        start = len(self.lines)
        for x in angles:
            pairs.append(self.sine_and_cosine(x))
            parts.append(self.lines[start:])
            del self.lines[start:]
        self.lines += [line for lines in zip(*parts, strict=True) for line in lines]
        return pairs

    def operation(self, name: str, a: list[str]) -> str:
        """Write one operation of a program other than sine and cosine."""
        v = self.vector
        if name in _BINARY:
            return self.do(_BINARY[name], a[0], a[1])
        if name == "neg":
            return self.new(f"fneg {v} {a[0]}")
        if name in _CALLED:
            given = ", ".join(f"{v} {x}" for x in a)
            return self.new(
                f"call {v} @llvm.{_CALLED[name][0]}.v{self.width}f64({given})"
            )
        x, y, yes, no = (a[1], a[0], a[0], a[1]) if name == "max" else a
        mask = self.new(f"fcmp olt {v} {x}, {y}")
        return self.new(f"select <{self.width} x i1> {mask}, {v} {yes}, {v} {no}")


#: Lines per basic block of a single function: each cut moves values to memory.
_LOOP_BLOCK = 1500
#: Postures that a thread takes at a time, and how often it polls whether the others are
#: done.
_POSTURES_TAKEN, _MAX_POLLS = 512, 20_000


def kernel(
    program: Program,
    width: int,
    stream: bool,
    arrays: list[str],
    lines: list[str],
    table: dict[Key, int],
    kept: dict[int, int],
) -> str:
    """The function around the `lines` that compute a block, with its declarations.

    `arrays` are the inputs; `table` has the places of constants and
    shared inputs, `kept` the places of values in memory.
    """
    body = _mixed(lines, _records(program, width, stream, kept))
    function = _loop(program, width, arrays, body, table, len(kept))
    return "\n".join([function, _declarations(width)])


def _records(
    program: Program, width: int, stream: bool, kept: dict[int, int]
) -> list[list[str]]:
    """From memory to the outputs: entries side by side become records; in pieces.

    Two postures at a time: halves of vectors are put side by side as they are read, which
    leaves one exchange per vector written.
    """
    pieces: list[list[str]] = []
    for i, steps in enumerate(program.outputs.values()):
        size = len(steps)
        if size == 1:
            writer = Writer(width, {}, f"r{i}.")
            value = writer.load("%written", width * kept[steps[0]])
            writer.store(value, f"%out{i}", 0, "align 8")
            pieces.append(writer.lines)
            continue
        piece = 4 if size % 4 == 0 and width >= 4 else 2
        if stream and size % 2 == 0:
            how = f"align {8 * piece}, !nontemporal !0"
        else:
            how = "align 8"
        for lane, first in product(range(0, width, 2), range(0, size - size % 2, piece)):
            writer = Writer(width, {}, f"r{i}.{lane}.{first}.")
            both = _exchanged(
                writer, [kept[s] for s in steps[first : first + piece]], lane
            )
            for half, start in zip(both, (lane * size, (lane + 1) * size), strict=True):
                at = writer.address(f"%out{i}", start + first)
                writer.lines.append(f"  store <{piece} x double> {half}, ptr {at}, {how}")
            pieces.append(writer.lines)
        for lane in range(width * (size % 2)):  # the last entry of an odd number
            writer = Writer(width, {}, f"r{i}.{lane}.last.")
            address = writer.address("%written", width * kept[steps[-1]] + lane)
            value = writer.new(f"load double, ptr {address}")
            at = writer.address(f"%out{i}", lane * size + size - 1)
            writer.lines.append(f"  store double {value}, ptr {at}")
            pieces.append(writer.lines)
    return pieces


def _exchanged(writer: Writer, places: list[int], lane: int) -> tuple[str, str]:
    """Transpose two or four vectors in memory to entries of two postures,
    `lane` and the next.
    """
    halves = []
    for place in places:
        address = writer.address("%written", writer.width * place + lane)
        halves.append(writer.new(f"load <2 x double>, ptr {address}, align 16"))
    pair = "<2 x double>"
    if len(places) == 4:
        a, b = (
            writer.new(
                f"shufflevector {pair} {halves[k]}, {pair} {halves[k + 2]}, "
                "<4 x i32> <i32 0, i32 1, i32 2, i32 3>"
            )
            for k in (0, 1)
        )
        both = f"shufflevector <4 x double> {a}, <4 x double> {b}, <4 x i32>"
        return (
            writer.new(f"{both} <i32 0, i32 4, i32 2, i32 6>"),
            writer.new(f"{both} <i32 1, i32 5, i32 3, i32 7>"),
        )
    both = f"shufflevector {pair} {halves[0]}, {pair} {halves[1]}, <2 x i32>"
    return writer.new(f"{both} <i32 0, i32 2>"), writer.new(f"{both} <i32 1, i32 3>")


def _mixed(lines: list[str], pieces: list[list[str]]) -> list[str]:
    """Lines with pieces of other code interleaved."""
    cuts = np.linspace(0, len(lines), len(pieces) + 1).astype(int)
    code: list[str] = []
    for piece, start, stop in zip(pieces, cuts[:-1], cuts[1:], strict=True):
        code += piece + lines[start:stop]
    return code


def in_blocks(lines: list[str], length: int) -> list[str]:
    """The lines in basic blocks of some length, separated by branches that are
    never taken.

    The time of LLVM grows faster than the length of a basic block.
    """
    code: list[str] = []
    for i in range(0, len(lines), length):
        code += lines[i : i + length]
        code += [f"  br i1 %always, label %piece{i}, label %never", f"piece{i}:"]
    return code


def _loop(
    program: Program,
    width: int,
    arrays: list[str],
    body: list[str],
    table: dict[Key, int],
    kept: int,
) -> str:
    """The function that loops over blocks.

    Each round writes the records of the round before.
    """
    names = list(program.outputs)
    take = max(1, _POSTURES_TAKEN // width)
    lines = [
        "define void @kernel(i64 %blocks, ptr %inputs, ptr %outputs, ptr %table, ptr "
        "%progress) "
        "#0 {",
        "entry:",
        *_taken("first", take),
        "  br i1 %first.some, label %begin, label %never",
        "begin:",
    ]
    for kind, count in (("in", len(arrays)), ("out", len(names))):
        for i in range(count):
            lines.append(f"  %{kind}{i}.at = getelementptr ptr, ptr %{kind}puts, i64 {i}")
            lines.append(f"  %{kind}{i}.0 = load ptr, ptr %{kind}{i}.at")
    writer = Writer(width, table, "t")
    for key, place in table.items():
        if isinstance(key, str):
            vector = "<" + ", ".join([f"double {key}"] * width) + ">"
        else:
            base = f"%in{arrays.index(key.array)}.0"
            vector = writer.splat(
                writer.new(f"load double, ptr {writer.address(base, key.component)}")
            )
        writer.store(vector, "%table", width * place)
    lines += writer.lines
    lines += [
        "  %always = icmp ne ptr %table, null",
        f"  %one = getelementptr double, ptr %table, i64 {width * len(table)}",
        f"  %other = getelementptr double, ptr %table, i64 {width * (len(table) + kept)}",
        "  br label %block",
        # The first round has nothing to write and the last nothing to compute: the first
        # block is written twice, the last one computed twice.
        "block:",
        "  %b = phi i64 [%first, %begin], [%next, %go]",
        "  %stop = phi i64 [%first.stop, %begin], [%next.stop, %go]",
        "  %before = phi i64 [%first, %begin], [%b, %go]",
        "  %last = phi i1 [false, %begin], [%next.last, %go]",
        "  %done = phi i64 [0, %begin], [%next.done, %go]",
        "  %memory = phi ptr [%one, %begin], [%written, %go]",
        "  %written = phi ptr [%other, %begin], [%memory, %go]",
        f"  %row.in = mul i64 %b, {width}",
        f"  %row.out = mul i64 %before, {width}",
    ]
    for i, array in enumerate(arrays):
        step = 0 if array in program.shared else program.widths[array]
        lines.append(f"  %in{i}.step = mul i64 %row.in, {step}")
        lines.append(f"  %in{i} = getelementptr double, ptr %in{i}.0, i64 %in{i}.step")
    for i, name in enumerate(names):
        lines.append(f"  %out{i}.step = mul i64 %row.out, {len(program.outputs[name])}")
        lines.append(f"  %out{i} = getelementptr double, ptr %out{i}.0, i64 %out{i}.step")
    lines += in_blocks(body, _LOOP_BLOCK)
    lines += [
        "  br i1 %last, label %end, label %on",
        "on:",
        "  %next.done = add i64 %done, 1",
        "  %after = add i64 %b, 1",
        "  %within = icmp ult i64 %after, %stop",
        "  br i1 %within, label %go, label %more",
        "more:",
        *_taken("got", take),
        "  %got.block = select i1 %got.some, i64 %got, i64 %b",
        "  %got.none = xor i1 %got.some, true",
        "  br label %go",
        "go:",
        "  %next = phi i64 [%after, %on], [%got.block, %more]",
        "  %next.stop = phi i64 [%stop, %on], [%got.stop, %more]",
        "  %next.last = phi i1 [false, %on], [%got.none, %more]",
        "  br label %block",
        "end:",
        "  fence seq_cst",  # writes past the cache end before they are counted as done
        "  %others = getelementptr i64, ptr %progress, i64 1",
        "  %told = atomicrmw add ptr %others, i64 %done seq_cst",
        "  br label %wait",
        "wait:",
        "  %look = phi i64 [0, %end], [%looked, %wait]",
        "  %looked = add i64 %look, 1",
        "  %finished = load atomic i64, ptr %others acquire, align 8",
        "  %missing = icmp ult i64 %finished, %blocks",
        f"  %patient = icmp ult i64 %looked, {_MAX_POLLS}",
        "  %again = and i1 %missing, %patient",
        "  br i1 %again, label %wait, label %never",
        "never:",
        "  ret void",
        "}",
    ]
    return "\n".join(lines)


def _taken(name: str, take: int) -> list[str]:
    """Take the next blocks, if there are `some`, up to `stop`."""
    return [
        f"  %{name} = atomicrmw add ptr %progress, i64 {take} seq_cst",
        f"  %{name}.some = icmp ult i64 %{name}, %blocks",
        f"  %{name}.end = add i64 %{name}, {take}",
        f"  %{name}.whole = icmp ult i64 %{name}.end, %blocks",
        f"  %{name}.stop = select i1 %{name}.whole, i64 %{name}.end, i64 %blocks",
    ]


def _declarations(width: int) -> str:
    v, bits = f"<{width} x double>", width * 64
    return "\n".join(
        [
            *(
                f"declare {v} @llvm.{name}.v{width}f64({', '.join([v] * count)})"
                for name, count in _CALLED.values()
            ),
            # Vectors on the stack must not cross cache lines.
            'attributes #0 = { nounwind alignstack=64 "stackrealign" '
            f'"min-legal-vector-width"="{bits}" "prefer-vector-width"="{bits}" }}',
            "!0 = !{i32 1}",
            "",
        ]
    )


#: Largest number of operations in one function.
LONGEST = 6000
#: Number of angles whose sines and cosines are interleaved.
_ANGLES = 3
#: Lines per basic block of one of several functions.
_BLOCK = 400
#: Number of operations after which a value in memory is loaded again.
_RELOAD_AFTER = 30


def _segments(program: Program) -> list[tuple[int, int]]:
    """Ranges of operations that become functions."""
    count = len(program.operations)
    size = count
    if program.size > LONGEST:
        size = -(-count // -(-program.size // (LONGEST // 2)))
    return [(start, min(start + size, count)) for start in range(0, count, size)]


def _kept(program: Program, segments: list[tuple[int, int]]) -> dict[int, int]:
    """Place in memory of each output, and of each value that a later segment reads."""
    segment_of = [0] * len(program.operations)
    for i, (start, stop) in enumerate(segments):
        segment_of[start:stop] = [i] * (stop - start)
    outputs = (step for steps in program.outputs.values() for step in steps)
    places = {step: i for i, step in enumerate(dict.fromkeys(outputs))}
    for step, operation in enumerate(program.operations):
        if operation.name not in ("input", "constant"):
            for a in operation.arguments:
                computed = program.operations[a].name not in ("input", "constant")
                if computed and segment_of[a] != segment_of[step]:
                    places.setdefault(a, len(places))
    return places


def scratch_size(program: Program, width: int) -> int:
    """Number of doubles of scratch memory for one thread, aligned to 64 bytes."""
    kept = _kept(program, _segments(program))
    return width * (len(kept_table(program)) + 2 * len(kept))


def input_arrays(program: Program) -> list[str]:
    """Names of the inputs, in the order of the kernel's argument."""
    return sorted(
        {
            program.inputs[o.arguments[0]].array
            for o in program.operations
            if o.name == "input"
        }
    )


class _Body:
    """Writes the operations of one function, which loads values of earlier functions
    from memory.

    A value that is in memory is loaded again if it is read much later: otherwise the
    compiler would store a second copy when it runs out of registers.
    """

    def __init__(
        self,
        writer: Writer,
        program: Program,
        arrays: list[str],
        kept: dict[int, int],
    ) -> None:
        self.writer, self.program, self.arrays = writer, program, arrays
        self.kept = kept
        self.values: dict[int, str] = {}
        self._read: dict[int, int] = {}
        self._now = 0
        self.angles: dict[int, tuple[str, str]] = {}

    def value(self, step: int) -> str:
        """Return a value of this function, or load one from memory."""
        name, arguments, number = self.program.operations[step]
        if name == "constant":
            return self.writer.constant(number)
        if (
            name == "input"
            and self.program.inputs[arguments[0]].array in self.program.shared
        ):
            return self.writer.kept(self.program.inputs[arguments[0]])
        if (
            step in self.kept
            and self._now > self._read.get(step, self._now) + _RELOAD_AFTER
        ):
            self.values.pop(step, None)
        self._read[step] = self._now
        if step not in self.values:
            if name == "input":
                self.values[step] = self._input(arguments[0])
            else:
                place = self.writer.width * self.kept[step]
                self.values[step] = self.writer.load("%memory", place)
        return self.values[step]

    def _input(self, which: int) -> str:
        writer, (array, index) = self.writer, self.program.inputs[which]
        base, vector = f"%in{self.arrays.index(array)}", "poison"
        for lane in range(writer.width):
            address = writer.address(base, lane * self.program.widths[array] + index)
            scalar = writer.new(f"load double, ptr {address}")
            vector = writer.new(
                f"insertelement {writer.vector} {vector}, double {scalar}, i32 {lane}"
            )
        return vector

    def write(self, start: int, stop: int) -> None:
        """Write the operations from `start` to `stop`."""
        operations = self.program.operations
        for step in range(start, stop):
            self._now = step
            name, arguments, _ = operations[step]
            if name in ("sin", "cos"):
                if arguments[0] not in self.angles:
                    self._turn(step, stop)
                self.values[step] = self.angles[arguments[0]][name == "cos"]
            elif name not in ("constant", "input"):
                read = [self.value(a) for a in arguments]
                self.values[step] = self.writer.operation(name, read)
            if step in self.kept:
                self.writer.store(
                    self.value(step), "%memory", self.writer.width * self.kept[step]
                )

    def _turn(self, step: int, stop: int) -> None:
        """Write sines and cosines of the next angles that are already computed."""
        angles: list[int] = []
        for name, arguments, _ in self.program.operations[step:stop]:
            if name in ("sin", "cos") and arguments[0] not in (*angles, *self.angles):
                angle = arguments[0]
                if angle < step or self.program.operations[angle].name == "input":
                    angles.append(angle)
            if len(angles) == _ANGLES:
                break
        both = self.writer.side_by_side([self.value(angle) for angle in angles])
        self.angles.update(zip(angles, both, strict=True))


def vector_code(program: Program, width: int, stream: bool = False) -> str:
    """LLVM text of ``kernel(blocks, inputs, outputs, scratch, progress)``.

    `inputs` and `outputs` are arrays of pointers in the order of `input_arrays` and of
    ``program.outputs``, `blocks` is the number of postures over `width`; with `stream`,
    outputs lie on addresses divisible by 64 and are written past the cache.

    Several threads may call it with the same arguments except for scratch memory: they
    share the blocks. `progress` is two whole numbers, zero at first: the number of blocks
    that are taken, and that are done. A thread that finds no block left waits briefly for
    the others.
    """
    arrays = input_arrays(program)
    segments, table = _segments(program), kept_table(program)
    kept = _kept(program, segments)
    arguments = [
        *(f"ptr %in{i}" for i in range(len(arrays))),
        "ptr %table",
        "ptr %memory",
        "i1 %always",
    ]
    pointers = ", ".join(arguments)
    bodies = []
    for start, stop in segments:
        body = _Body(Writer(width, table), program, arrays, kept)
        body.write(start, stop)
        bodies.append(body.writer.lines)
    functions: list[str] = []
    if len(bodies) > 1:
        for i, body_lines in enumerate(bodies):
            head = f"define internal void @part{i}({pointers}) #0 {{"
            text = [head, *in_blocks(body_lines, _BLOCK), "  br label %never", "never:"]
            functions.append("\n".join([*text, "  ret void", "}"]))
        lines = [f"  call void @part{i}({pointers})" for i in range(len(bodies))]
    else:
        lines = bodies[0]
    around = kernel(program, width, stream, arrays, lines, table, kept)
    return "\n".join([*functions, around])
