r"""A program as vector code: LLVM intermediate representation, one posture per lane.

The text is made straight from the operations; there is nothing left to optimise but the choice of
instructions. Multiplications and additions may be fused, nothing is reordered. Three rounds are
under way at once, their lines taking turns, so that neither long chains of dependent operations nor
the memory is ever waited for: the first half of a block of postures, the second half of the block
before, and the writing of the block before that. Writing turns one vector per entry into one record
per posture, in order of address; with `stream`, past the cache.

A long program is cut into functions that hand their values on in memory: the time LLVM takes grows
faster than the length of a function.
"""

from __future__ import annotations

import struct

from cartstiff.batch.tape import Program

__all__ = ["LONGEST", "scratch_size", "vector_code"]

#: Operations that are still compiled as one function.
LONGEST = 6000
#: Share of the operations after which the first half may end.
_FROM, _TO = 0.4, 0.6
#: Lines per basic block, and per turn of the shortest of the interleaved sequences.
_BLOCK, _TURN = 120, 8

# Sine and cosine as in fdlibm: pi/2 in three parts of which the first two have 33 digits, so that
# their products with a whole number below 2^20 are exact, and the minimax polynomials.
_TWO_OVER_PI = 6.36619772367581382433e-01
_HALF_PI = (1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21)
_SINE = (
    -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04,
    2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10,
)  # fmt: skip
_COSINE = (
    4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05,
    -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11,
)  # fmt: skip
#: Adding this leaves the nearest whole number in the last digits.
_WHOLE = 6755399441055744.0

_BINARY = {"add": "fadd", "sub": "fsub", "mul": "fmul", "div": "fdiv"}
_UNARY = {"sqrt": "llvm.sqrt", "abs": "llvm.fabs"}


def _hex(value: float) -> str:
    return "0x" + struct.pack(">d", value).hex().upper()


class _Writer:
    """Lines of one function, with fresh names."""

    def __init__(self, width: int, prefix: str = "x") -> None:
        self.lines: list[str] = []
        self.width = width
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
        return "<" + ", ".join([f"double {_hex(value)}"] * self.width) + ">"

    def whole(self, value: int) -> str:
        return "<" + ", ".join([f"i64 {value}"] * self.width) + ">"

    def do(self, operation: str, a: str, b: str) -> str:
        return self.new(f"{operation} contract {self.vector} {a}, {b}")

    def address(self, base: str, index: int) -> str:
        return self.new(f"getelementptr double, ptr {base}, i64 {index}")

    def load(self, base: str, index: int) -> str:
        return self.new(f"load {self.vector}, ptr {self.address(base, index)}, align 64")

    def store(self, value: str, base: str, index: int, how: str = "align 64") -> None:
        self.lines.append(f"  store {self.vector} {value}, ptr {self.address(base, index)}, {how}")

    def splat(self, scalar: str) -> str:
        one = self.new(f"insertelement {self.vector} poison, double {scalar}, i32 0")
        both = f"{self.vector} {one}, {self.vector} poison"
        return self.new(f"shufflevector {both}, <{self.width} x i32> zeroinitializer")

    def sine_and_cosine(self, x: str) -> tuple[str, str]:
        """Both, to within two units of the last digit for angles up to 1e6."""
        shifted = self.do("fadd", self.do("fmul", x, self.constant(_TWO_OVER_PI)),
                          self.constant(_WHOLE))  # fmt: skip
        quarter = self.do("fsub", shifted, self.constant(_WHOLE))
        r = x
        for part in _HALF_PI:
            r = self.do("fsub", r, self.do("fmul", quarter, self.constant(part)))
        z = self.do("fmul", r, r)
        s = self.do("fmul", self._polynomial(z, _SINE), self.do("fmul", z, r))
        s = self.do("fadd", s, r)
        half = self.do("fmul", z, self.constant(0.5))
        near = self.do("fsub", self.constant(1.0), half)
        lost = self.do("fsub", self.do("fsub", self.constant(1.0), near), half)
        c = self.do("fmul", self._polynomial(z, _COSINE), self.do("fmul", z, z))
        c = self.do("fadd", near, self.do("fadd", lost, c))
        k = self.new(f"bitcast {self.vector} {shifted} to {self.integers}")
        odd = self.new(f"trunc {self.integers} {k} to <{self.width} x i1>")
        found = []
        for yes, no, count in ((c, s, k), (s, c, self._integer("add", k, 1))):
            value = self.new(
                f"select <{self.width} x i1> {odd}, {self.vector} {yes}, {self.vector} {no}"
            )
            sign = self._integer("shl", self._integer("and", count, 2), 62)
            bits = self.new(f"bitcast {self.vector} {value} to {self.integers}")
            bits = self.new(f"xor {self.integers} {bits}, {sign}")
            found.append(self.new(f"bitcast {self.integers} {bits} to {self.vector}"))
        return found[0], found[1]

    def _integer(self, operation: str, a: str, b: int) -> str:
        return self.new(f"{operation} {self.integers} {a}, {self.whole(b)}")

    def _polynomial(self, z: str, coefficients: tuple[float, ...]) -> str:
        value = self.constant(coefficients[-1])
        for c in coefficients[-2::-1]:
            value = self.do("fadd", self.do("fmul", value, z), self.constant(c))
        return value

    def operation(self, name: str, a: list[str]) -> str:
        """One operation of a program, but for sine and cosine."""
        v = self.vector
        if name in _BINARY:
            return self.do(_BINARY[name], a[0], a[1])
        if name == "neg":
            return self.new(f"fneg {v} {a[0]}")
        if name in _UNARY:
            return self.new(f"call {v} @{_UNARY[name]}.v{self.width}f64({v} {a[0]})")
        if name == "copysign":
            return self.new(f"call {v} @llvm.copysign.v{self.width}f64({v} {a[0]}, {v} {a[1]})")
        x, y, yes, no = (a[1], a[0], a[0], a[1]) if name == "max" else a
        mask = self.new(f"fcmp olt {v} {x}, {y}")
        return self.new(f"select <{self.width} x i1> {mask}, {v} {yes}, {v} {no}")


def _segments(program: Program, longest: int) -> list[tuple[int, int]]:
    """Pieces of the program: two that are interleaved, or functions called in turn."""
    count = len(program.operations)
    if program.size > longest:
        size = -(-count // -(-program.size // (longest // 2)))
        return [(start, min(start + size, count)) for start in range(0, count, size)]
    # Cut in the middle third where the fewest values wait.
    last = list(range(count))
    for step, operation in enumerate(program.operations):
        if operation.name not in ("input", "constant"):
            for a in operation.arguments:
                last[a] = step
    for steps in program.outputs.values():
        for a in steps:
            last[a] = count
    waiting, best, cut = [0] * (count + 1), count, count // 2
    for step, operation in enumerate(program.operations):
        if operation.name not in ("input", "constant"):
            waiting[step + 1] += 1
            waiting[min(last[step] + 1, count)] -= 1
    total = 0
    for at in range(count):
        total += waiting[at]
        if count * _FROM <= at <= count * _TO and total < best:
            best, cut = total, at
    return [(0, cut), (cut, count)]


def _kept(program: Program, segments: list[tuple[int, int]]) -> dict[int, int]:
    """Place in memory of every output, and of every value that outlives its segment."""
    segment_of = [0] * len(program.operations)
    for i, (start, stop) in enumerate(segments):
        segment_of[start:stop] = [i] * (stop - start)
    outputs = (step for steps in program.outputs.values() for step in steps)
    places = {step: i for i, step in enumerate(dict.fromkeys(outputs))}

    def keep(a: int, reader: int) -> None:
        name = program.operations[a].name
        if name == "input":
            leaves = reader > 0 and _moves(program, a, segments)
        else:
            leaves = name != "constant" and segment_of[a] != reader
        if leaves:
            places.setdefault(a, len(places))

    for step, operation in enumerate(program.operations):
        if operation.name not in ("input", "constant"):
            for a in operation.arguments:
                keep(a, segment_of[step])
    return places


def _moves(program: Program, step: int, segments: list[tuple[int, int]]) -> bool:
    """Whether an input belongs to one block: the second piece runs on the block before."""
    which = program.operations[step].arguments[0]
    return len(segments) == 2 and program.inputs[which].array not in program.shared


def scratch_size(program: Program, width: int, longest: int = LONGEST) -> int:
    """Doubles of scratch memory that one thread needs, from an address divisible by 64."""
    return 3 * width * len(_kept(program, _segments(program, longest)))


def input_arrays(program: Program) -> list[str]:
    """Names of the inputs, in the order in which the kernel is given them."""
    return sorted({program.inputs[o.arguments[0]].array
                   for o in program.operations if o.name == "input"})  # fmt: skip


class _Body:
    """Writes operations of one function; values come from before it through memory."""

    def __init__(
        self, writer: _Writer, program: Program, arrays: list[str], widths: dict[str, int],
        kept: dict[int, int], memory: str, begins: bool = False,
    ) -> None:  # fmt: skip
        self.writer, self.program, self.arrays, self.widths = writer, program, arrays, widths
        self.kept, self.memory, self.begins = kept, memory, begins
        self.values: dict[int, str] = {}
        self.angles: dict[int, tuple[str, str]] = {}

    def value(self, step: int) -> str:
        """A value, computed here, read from memory, or a constant."""
        if step not in self.values:
            name, arguments, number = self.program.operations[step]
            if name == "constant":
                return self.writer.constant(number)
            if name == "input" and (self.begins or step not in self.kept):
                self.values[step] = self._input(arguments[0])
            else:
                place = self.writer.width * self.kept[step]
                self.values[step] = self.writer.load(self.memory, place)
        return self.values[step]

    def _input(self, which: int) -> str:
        writer, (array, index) = self.writer, self.program.inputs[which]
        base = f"%in{self.arrays.index(array)}"
        if array in self.program.shared:
            return writer.splat(writer.new(f"load double, ptr {writer.address(base, index)}"))
        vector = "poison"
        for lane in range(writer.width):
            address = writer.address(base, lane * self.widths[array] + index)
            scalar = writer.new(f"load double, ptr {address}")
            vector = writer.new(
                f"insertelement {writer.vector} {vector}, double {scalar}, i32 {lane}"
            )
        return vector

    def write(self, start: int, stop: int) -> None:
        """Operations from `start` to `stop`."""
        operations = self.program.operations
        if self.begins:
            for step in self.kept:
                if operations[step].name in ("constant", "input"):
                    self._store(step)
        for step in range(start, stop):
            name, arguments, _ = operations[step]
            if name in ("constant", "input"):
                continue
            if name in ("sin", "cos"):
                if arguments[0] not in self.angles:
                    x = self.value(arguments[0])
                    self.angles[arguments[0]] = self.writer.sine_and_cosine(x)
                self.values[step] = self.angles[arguments[0]][name == "cos"]
            else:
                read = [self.value(a) for a in arguments]
                self.values[step] = self.writer.operation(name, read)
            if step in self.kept:
                self._store(step)

    def _store(self, step: int) -> None:
        self.writer.store(self.value(step), self.memory, self.writer.width * self.kept[step])


def vector_code(program: Program, width: int, stream: bool = False, longest: int = LONGEST) -> str:
    """LLVM text of ``kernel(blocks, inputs, outputs, scratch)``.

    `inputs` and `outputs` are arrays of pointers in the order of `input_arrays` and of
    ``program.outputs``, `blocks` is the number of postures over `width`; with `stream`, outputs lie
    on addresses divisible by 64 and are written past the cache.
    """
    arrays = input_arrays(program)
    widths: dict[str, int] = {}
    for array, index in program.inputs:
        widths[array] = max(widths.get(array, 0), index + 1)
    segments = _segments(program, longest)
    kept = _kept(program, segments)

    def body(prefix: str, memory: str, begins: bool = False) -> _Body:
        return _Body(_Writer(width, prefix), program, arrays, widths, kept, memory, begins)

    functions: list[str] = []
    if len(segments) == 2:
        first, second = body("a", "%first", True), body("b", "%second")
        first.write(*segments[0])
        second.write(*segments[1])
        records = _records(program, width, stream, kept, "%third")
        parts = [first.writer.lines, second.writer.lines, records]
        lines, shift = _in_blocks(_interleaved(parts)), 2
    else:
        pointers = [*(f"ptr %in{i}" for i in range(len(arrays))), "ptr %first", "i1 %always"]
        lines, shift = [], 0
        for i, (start, stop) in enumerate(segments):
            part = body("x", "%first", begins=i == 0)
            part.write(start, stop)
            head = f"define internal void @part{i}({', '.join(pointers)}) #0 {{"
            text = [head, *_in_blocks(part.writer.lines), "  br label %end", "end:"]
            functions.append("\n".join([*text, "  ret void", "}"]))
            lines.append(f"  call void @part{i}({', '.join(pointers)})")
        lines += _in_blocks(_records(program, width, stream, kept, "%first"))
    loop = _loop(program, width, arrays, widths, lines, shift, len(kept))
    return "\n".join([*functions, loop, _declarations(width)])


def _records(
    program: Program, width: int, stream: bool, kept: dict[int, int], base: str
) -> list[str]:
    """From memory to the outputs: entries side by side become records, in order of address.

    Two postures at a time: halves of vectors are put side by side as they are read, which leaves
    one exchange per vector written.
    """
    lines: list[str] = []
    for i, (name, steps) in enumerate(program.outputs.items()):
        size = len(steps)
        writer = _Writer(width, f"r{i}.")
        piece = 4 if size % 4 == 0 and width >= 4 else 2
        how = f"align {8 * piece}, !nontemporal !0" if stream else "align 8"

        def pair(step: int, lane: int, writer: _Writer = writer) -> str:
            address = writer.address(base, width * kept[step] + lane)
            return writer.new(f"load <2 x double>, ptr {address}, align 16")

        def put(text: str, at: int, writer: _Writer = writer, piece: int = piece, how: str = how,
                out: str = f"%out{i}") -> None:  # fmt: skip
            value = writer.new(f"shufflevector {text}")
            address = writer.address(out, at)
            writer.lines.append(f"  store <{piece} x double> {value}, ptr {address}, {how}")

        if size == 1:
            value = writer.load(base, width * kept[steps[0]])
            how = f"align {8 * width}, !nontemporal !0" if stream else "align 8"
            writer.store(value, f"%out{i}", 0, how)
            lines += writer.lines
            continue
        if size % 2:
            raise ValueError(f"output {name} has an odd number of entries")
        for lane in range(0, width, 2):
            second = []
            for first in range(0, size, piece):
                members = [pair(step, lane) for step in steps[first : first + piece]]
                if piece == 4:
                    a, b = (
                        writer.new(
                            f"shufflevector <2 x double> {members[k]}, <2 x double> "
                            f"{members[k + 2]}, <4 x i32> <i32 0, i32 1, i32 2, i32 3>"
                        )
                        for k in (0, 1)
                    )
                    both = f"<4 x double> {a}, <4 x double> {b}, <4 x i32>"
                    low, high = "<i32 0, i32 4, i32 2, i32 6>", "<i32 1, i32 5, i32 3, i32 7>"
                else:
                    both = f"<2 x double> {members[0]}, <2 x double> {members[1]}, <2 x i32>"
                    low, high = "<i32 0, i32 2>", "<i32 1, i32 3>"
                put(f"{both} {low}", lane * size + first)
                second.append((f"{both} {high}", (lane + 1) * size + first))
            for text, at in second:
                put(text, at)
        lines += writer.lines
    return lines


def _interleaved(parts: list[list[str]]) -> list[str]:
    """Independent sequences as one, taking turns."""
    turns = max(1, min(map(len, parts)) // _TURN)
    lines: list[str] = []
    for i in range(turns):
        for part in parts:
            lines += part[len(part) * i // turns : len(part) * (i + 1) // turns]
    return lines


def _in_blocks(lines: list[str]) -> list[str]:
    """The lines with branches that are never taken in between.

    LLVM schedules a block at a time, and in long ones brings so much forward that most of it must
    wait in memory. The order of the lines is good enough.
    """
    found: list[str] = []
    for i in range(0, len(lines), _BLOCK):
        found += lines[i : i + _BLOCK]
        found += [f"  br i1 %always, label %piece{i}, label %end", f"piece{i}:"]
    return found


def _loop(
    program: Program, width: int, arrays: list[str], widths: dict[str, int], body: list[str],
    shift: int, kept: int,
) -> str:  # fmt: skip
    """The function that goes through the blocks; results come `shift` rounds after their inputs."""
    names = list(program.outputs)
    lines = ["define void @kernel(i64 %blocks, ptr %inputs, ptr %outputs, ptr %scratch) #0 {",
             "entry:"]  # fmt: skip
    for kind, count in (("in", len(arrays)), ("out", len(names))):
        for i in range(count):
            lines.append(f"  %{kind}{i}.at = getelementptr ptr, ptr %{kind}puts, i64 {i}")
            lines.append(f"  %{kind}{i}.0 = load ptr, ptr %{kind}{i}.at")
    lines += [
        "  %last = sub i64 %blocks, 1",
        "  %always = icmp ne ptr %scratch, null",
        f"  %rounds = add i64 %blocks, {shift}",
        f"  %memory1 = getelementptr double, ptr %scratch, i64 {width * kept}",
        f"  %memory2 = getelementptr double, ptr %scratch, i64 {2 * width * kept}",
        "  br label %block",
        "block:",
        "  %b = phi i64 [0, %entry], [%next, %done]",
        "  %first = phi ptr [%scratch, %entry], [%third, %done]",
        "  %second = phi ptr [%memory1, %entry], [%first, %done]",
        "  %third = phi ptr [%memory2, %entry], [%second, %done]",
        # In the first round there is nothing to finish, in the last nothing to begin: the first
        # block is written once more, the last block read once more.
        "  %inside = icmp ult i64 %b, %blocks",
        "  %block.in = select i1 %inside, i64 %b, i64 %last",
        f"  %begun = icmp uge i64 %b, {shift}",
        f"  %before = sub i64 %b, {shift}",
        "  %block.out = select i1 %begun, i64 %before, i64 0",
        f"  %row.in = mul i64 %block.in, {width}",
        f"  %row.out = mul i64 %block.out, {width}",
    ]
    for i, array in enumerate(arrays):
        step = 0 if array in program.shared else widths[array]
        lines.append(f"  %in{i}.step = mul i64 %row.in, {step}")
        lines.append(f"  %in{i} = getelementptr double, ptr %in{i}.0, i64 %in{i}.step")
    for i, name in enumerate(names):
        lines.append(f"  %out{i}.step = mul i64 %row.out, {len(program.outputs[name])}")
        lines.append(f"  %out{i} = getelementptr double, ptr %out{i}.0, i64 %out{i}.step")
    lines += body
    lines += [
        "  br label %done",
        "done:",
        "  %next = add i64 %b, 1",
        "  %more = icmp ult i64 %next, %rounds",
        "  br i1 %more, label %block, label %end",
        "end:",
        "  fence seq_cst",
        "  ret void", "}",
    ]  # fmt: skip
    return "\n".join(lines)


def _declarations(width: int) -> str:
    v, bits = f"<{width} x double>", width * 64
    return "\n".join([
        f"declare {v} @llvm.sqrt.v{width}f64({v})",
        f"declare {v} @llvm.fabs.v{width}f64({v})",
        f"declare {v} @llvm.copysign.v{width}f64({v}, {v})",
        # Vectors that wait on the stack must not lie across cache lines.
        'attributes #0 = { nounwind alignstack=64 "stackrealign" '
        f'"min-legal-vector-width"="{bits}" "prefer-vector-width"="{bits}" }}',
        "!0 = !{i32 1}", "",
    ])  # fmt: skip
