"""The function around the vector code: taking blocks of postures, and writing their records."""

from __future__ import annotations

from itertools import product

import numpy as np

from cartstiff.many.machine_code.vector_writer import Key, Writer
from cartstiff.many.tape import Program

#: Lines per basic block where each cut makes values wait in memory.
_BLOCK = 1500
#: Postures that a thread takes at a time, and how often it looks whether the others are done.
_TAKEN, _LOOKS = 512, 20_000


def kernel(
    program: Program,
    width: int,
    stream: bool,
    arrays: list[str],
    widths: dict[str, int],
    lines: list[str],
    table: dict[Key, int],
    kept: dict[int, int],
) -> str:
    """The function itself and what it declares, around the `lines` that compute a block.

    The inputs' `arrays` with their `widths`, the places of what is the same for all postures in
    `table` and of what waits in memory in `kept`.
    """
    body = _mixed(lines, _records(program, width, stream, kept))
    function = _loop(program, width, arrays, widths, body, table, len(kept))
    return "\n".join([function, _declarations(width)])


def _records(program: Program, width: int, stream: bool, kept: dict[int, int]) -> list[list[str]]:
    """From memory to the outputs: entries side by side become records; in pieces.

    Two postures at a time: halves of vectors are put side by side as they are read, which leaves
    one exchange per vector written.
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
        how = f"align {8 * piece}, !nontemporal !0" if stream else "align 8"
        for lane, first in product(range(0, width, 2), range(0, size, piece)):
            writer = Writer(width, {}, f"r{i}.{lane}.{first}.")
            both = _exchanged(writer, [kept[s] for s in steps[first : first + piece]], lane)
            for half, start in zip(both, (lane * size, (lane + 1) * size), strict=True):
                at = writer.address(f"%out{i}", start + first)
                writer.lines.append(f"  store <{piece} x double> {half}, ptr {at}, {how}")
            pieces.append(writer.lines)
    return pieces


def _exchanged(writer: Writer, places: list[int], lane: int) -> tuple[str, str]:
    """Two or four vectors in memory as entries of two postures, of `lane` and of the next."""
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
    """Lines with pieces of other work in between."""
    cuts = np.linspace(0, len(lines), len(pieces) + 1).astype(int)
    code: list[str] = []
    for piece, start, stop in zip(pieces, cuts[:-1], cuts[1:], strict=True):
        code += piece + lines[start:stop]
    return code


def in_blocks(lines: list[str], length: int) -> list[str]:
    """The lines with branches that are never taken in between.

    The time LLVM takes grows faster than the length of a block.
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
    widths: dict[str, int],
    body: list[str],
    table: dict[Key, int],
    kept: int,
) -> str:
    """The function that goes through the blocks; records come a round after their inputs."""
    names = list(program.outputs)
    take = max(1, _TAKEN // width)
    lines = [
        "define void @kernel(i64 %blocks, ptr %inputs, ptr %outputs, ptr %table, ptr %progress) "
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
        # In the first round there is nothing to write, in the last nothing to compute: the first
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
        step = 0 if array in program.shared else widths[array]
        lines.append(f"  %in{i}.step = mul i64 %row.in, {step}")
        lines.append(f"  %in{i} = getelementptr double, ptr %in{i}.0, i64 %in{i}.step")
    for i, name in enumerate(names):
        lines.append(f"  %out{i}.step = mul i64 %row.out, {len(program.outputs[name])}")
        lines.append(f"  %out{i} = getelementptr double, ptr %out{i}.0, i64 %out{i}.step")
    lines += in_blocks(body, _BLOCK)
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
        "  fence seq_cst",  # what was written past the cache is there before it is said to be
        "  %others = getelementptr i64, ptr %progress, i64 1",
        "  %told = atomicrmw add ptr %others, i64 %done seq_cst",
        "  br label %wait",
        "wait:",
        "  %look = phi i64 [0, %end], [%looked, %wait]",
        "  %looked = add i64 %look, 1",
        "  %finished = load atomic i64, ptr %others acquire, align 8",
        "  %missing = icmp ult i64 %finished, %blocks",
        f"  %patient = icmp ult i64 %looked, {_LOOKS}",
        "  %again = and i1 %missing, %patient",
        "  br i1 %again, label %wait, label %never",
        "never:",
        "  ret void",
        "}",
    ]
    return "\n".join(lines)


def _taken(name: str, take: int) -> list[str]:
    """Take the next blocks, if there are `some`: from a number on, to `stop`."""
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
            f"declare {v} @llvm.sqrt.v{width}f64({v})",
            f"declare {v} @llvm.fabs.v{width}f64({v})",
            f"declare {v} @llvm.copysign.v{width}f64({v}, {v})",
            # Vectors that wait on the stack must not lie across cache lines.
            'attributes #0 = { nounwind alignstack=64 "stackrealign" '
            f'"min-legal-vector-width"="{bits}" "prefer-vector-width"="{bits}" }}',
            "!0 = !{i32 1}",
            "",
        ]
    )
