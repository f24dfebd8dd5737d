"""Lines of LLVM's intermediate representation for vectors of numbers, one posture per lane."""

from __future__ import annotations

import struct

from cartstiff.many.tape import Input, Program

# Sine and cosine as in fdlibm: pi/2 in three parts of which the first two have 33 digits, so that
# their products with a whole number below 2^20 are exact, and the minimax polynomials.
_TWO_OVER_PI = 6.36619772367581382433e-01
_HALF_PI = (1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21)
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
_UNARY = {"sqrt": "llvm.sqrt", "abs": "llvm.fabs"}


#: A constant in hexadecimal, or an input that all postures share.
Key = str | Input


def _hex(value: float) -> str:
    return "0x" + struct.pack(">d", value).hex().upper()


def kept_table(program: Program) -> dict[Key, int]:
    """Place of each constant, and of each component of shared inputs, among the vectors kept."""
    keys: list[Key] = [_hex(x) for x in _FIXED]
    for name, arguments, value in program.operations:
        if name == "constant":
            keys.append(_hex(value))
        elif name == "input" and program.inputs[arguments[0]].array in program.shared:
            keys.append(program.inputs[arguments[0]])
    return {key: place for place, key in enumerate(dict.fromkeys(keys))}


class Writer:
    """Lines of one function, with fresh names."""

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
        """A number, the same for all postures."""
        return self.kept(_hex(value))

    def kept(self, key: Key) -> str:
        """What is the same for all postures."""
        return self.load("%table", self.width * self.table[key])

    def whole(self, value: int) -> str:
        """A whole number in every lane."""
        return "<" + ", ".join([f"i64 {value}"] * self.width) + ">"

    def do(self, operation: str, a: str, b: str) -> str:
        """A sum, difference, product or quotient; what can be fused may be."""
        return self.new(f"{operation} contract {self.vector} {a}, {b}")

    def address(self, base: str, index: int) -> str:
        """Where a number lies behind another."""
        return self.new(f"getelementptr double, ptr {base}, i64 {index}")

    def load(self, base: str, index: int) -> str:
        """A vector from memory."""
        how = f"align {8 * self.width}"
        return self.new(f"load {self.vector}, ptr {self.address(base, index)}, {how}")

    def store(self, value: str, base: str, index: int, how: str = "") -> None:
        """A vector into memory."""
        how = how or f"align {8 * self.width}"
        self.lines.append(f"  store {self.vector} {value}, ptr {self.address(base, index)}, {how}")

    def splat(self, scalar: str) -> str:
        """A scalar in every lane."""
        one = self.new(f"insertelement {self.vector} poison, double {scalar}, i32 0")
        both = f"{self.vector} {one}, {self.vector} poison"
        return self.new(f"shufflevector {both}, <{self.width} x i32> zeroinitializer")

    def sine_and_cosine(self, x: str) -> tuple[str, str]:
        """Both, to within two units of the last digit for angles up to 1e6."""
        shifted = self.do(
            "fadd", self.do("fmul", x, self.constant(_TWO_OVER_PI)), self.constant(_WHOLE)
        )
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
        pair = []
        for yes, no, count in ((c, s, k), (s, c, self._integer("add", k, 1))):
            value = self.new(
                f"select <{self.width} x i1> {odd}, {self.vector} {yes}, {self.vector} {no}"
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
        """Sines and cosines of some angles, their lines taking turns: each waits for its last."""
        pairs, parts = [], []
        start = len(self.lines)
        for x in angles:
            pairs.append(self.sine_and_cosine(x))
            parts.append(self.lines[start:])
            del self.lines[start:]
        self.lines += [line for lines in zip(*parts, strict=True) for line in lines]
        return pairs

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
