r"""A program as vector code: LLVM intermediate representation, one posture per lane.

The text is made straight from the operations, in their order; there is nothing left to optimise but
the choice of instructions. Multiplications and additions may be fused, nothing is reordered.
Constants and what is the same for all postures wait in memory as whole vectors. Results go through
memory that stays in the cache: writing turns one vector per entry into one record per posture, with
`stream` past the cache. The records of a block of postures are written between the operations of
the next: memory takes them no faster.

A long program is cut into functions that hand their values on in memory: the time LLVM takes grows
faster than the length of a function.
"""

from __future__ import annotations

from cartstiff.many.machine_code.vector_loop import in_blocks, kernel
from cartstiff.many.machine_code.vector_writer import Writer, kept_table
from cartstiff.many.tape import Program

#: Operations that are still compiled as one function.
LONGEST = 6000
#: Angles whose sines and cosines are found side by side.
_ANGLES = 3
#: Lines per basic block of a function that is one of many.
_BLOCK = 400
#: Operations for which a value in memory is held in a register too.
_NEAR = 30


def _segments(program: Program, longest: int) -> list[tuple[int, int]]:
    """Pieces of the program that become functions."""
    count = len(program.operations)
    size = count
    if program.size > longest:
        size = -(-count // -(-program.size // (longest // 2)))
    return [(start, min(start + size, count)) for start in range(0, count, size)]


def _kept(program: Program, segments: list[tuple[int, int]]) -> dict[int, int]:
    """Place in memory of every output, and of every value that outlives its segment."""
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


def scratch_size(program: Program, width: int, longest: int = LONGEST) -> int:
    """Doubles of scratch memory that one thread needs, from an address divisible by 64."""
    kept = _kept(program, _segments(program, longest))
    return width * (len(kept_table(program)) + 2 * len(kept))


def input_arrays(program: Program) -> list[str]:
    """Names of the inputs, in the order in which the kernel is given them."""
    return sorted(
        {program.inputs[o.arguments[0]].array for o in program.operations if o.name == "input"}
    )


class _Body:
    """Writes operations of one function; values come from before it through memory.

    What is in memory anyhow is read from there when it is needed again much later: of a value that
    has to leave its register the compiler would put another copy into memory.
    """

    def __init__(
        self,
        writer: Writer,
        program: Program,
        arrays: list[str],
        widths: dict[str, int],
        kept: dict[int, int],
    ) -> None:
        self.writer, self.program, self.arrays, self.widths = writer, program, arrays, widths
        self.kept = kept
        self.values: dict[int, str] = {}
        self._read: dict[int, int] = {}
        self._now = 0
        self.angles: dict[int, tuple[str, str]] = {}

    def value(self, step: int) -> str:
        """A value, computed here or read from memory."""
        name, arguments, number = self.program.operations[step]
        if name == "constant":
            return self.writer.constant(number)
        if name == "input" and self.program.inputs[arguments[0]].array in self.program.shared:
            return self.writer.kept(self.program.inputs[arguments[0]])
        if step in self.kept and self._now > self._read.get(step, self._now) + _NEAR:
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
            address = writer.address(base, lane * self.widths[array] + index)
            scalar = writer.new(f"load double, ptr {address}")
            vector = writer.new(
                f"insertelement {writer.vector} {vector}, double {scalar}, i32 {lane}"
            )
        return vector

    def write(self, start: int, stop: int) -> None:
        """Operations from `start` to `stop`."""
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
                self.writer.store(self.value(step), "%memory", self.writer.width * self.kept[step])

    def _turn(self, step: int, stop: int) -> None:
        """Sine and cosine of the next angles that are known by now."""
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


def vector_code(program: Program, width: int, stream: bool = False, longest: int = LONGEST) -> str:
    """LLVM text of ``kernel(blocks, inputs, outputs, scratch, progress)``.

    `inputs` and `outputs` are arrays of pointers in the order of `input_arrays` and of
    ``program.outputs``, `blocks` is the number of postures over `width`; with `stream`, outputs lie
    on addresses divisible by 64 and are written past the cache.

    Several threads may call it with the same arguments, but for scratch memory of their own: they
    share the blocks. `progress` is two whole numbers, zero at first: how many blocks are taken, and
    how many are done. A thread that finds none left waits a moment for the others.
    """
    arrays = input_arrays(program)
    widths: dict[str, int] = {}
    for array, index in program.inputs:
        widths[array] = max(widths.get(array, 0), index + 1)
    segments, table = _segments(program, longest), kept_table(program)
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
        body = _Body(Writer(width, table), program, arrays, widths, kept)
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
    around = kernel(program, width, stream, arrays, widths, lines, table, kept)
    return "\n".join([*functions, around])
