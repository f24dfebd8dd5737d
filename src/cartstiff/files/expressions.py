"""Arithmetic in a file, such as ``2*r*cos(pi/6)``, evaluated without running
it as Python.
"""

from __future__ import annotations

import ast
import math
import re
import warnings
from collections.abc import Callable, Mapping

from cartstiff.core.errors import InputError, UnknownNameError, one_line

#: Largest number of characters.
LONGEST = 400
_CONSTANTS = {"pi": math.pi}
_FUNCTIONS: dict[str, tuple[int, Callable[..., float]]] = {
    "sin": (1, math.sin),
    "cos": (1, math.cos),
    "tan": (1, math.tan),
    "asin": (1, math.asin),
    "acos": (1, math.acos),
    "atan2": (2, math.atan2),
    "sqrt": (1, math.sqrt),
}
_TWO: dict[type[ast.operator], Callable[[float, float], float]] = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b,
    ast.Pow: math.pow,  # ** would return complex roots of negative numbers
}
_WHAT = f"numbers, parameters, pi, + - * / ** ( ), {', '.join(_FUNCTIONS)}"


def is_name(text: str) -> bool:
    """Whether a text can be the name of a parameter and is no constant or function."""
    plain = re.fullmatch(r"[A-Za-z_][A-Za-z_0-9]*", text) is not None
    return (
        plain and len(text) <= 100 and text not in _FUNCTIONS and text not in _CONSTANTS
    )


class Expression:
    """Arithmetic over names, checked on construction.

    Parameters
    ----------
    text : str
        Numbers, names, ``pi``, ``+ - * / **``, parentheses, and the functions sin, cos,
        tan, asin, acos, atan2, sqrt of radians.
    where : str
        Its place, for messages.

    Attributes
    ----------
    names : frozenset of str
        Names in it.

    Raises
    ------
    InputError
        For any other text: no other function, attribute, index or comparison is accepted.
    """

    def __init__(self, text: str, where: str) -> None:
        self.text, self.where = text, where
        if len(text) > LONGEST:
            raise InputError(
                "arithmetic is too long",
                where=where,
                expected=f"at most {LONGEST} characters",
                got=len(text),
            )
        try:
            with warnings.catch_warnings():
                warnings.simplefilter(
                    "ignore"
                )  # of Python about "2if", which is refused below
                self._tree = ast.parse(text.strip(), mode="eval").body
            self.names = frozenset(self._checked(self._tree))
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            if isinstance(error, InputError):
                raise
            raise self._refused(text) from None

    def _refused(self, part: str) -> InputError:
        return InputError(
            "arithmetic cannot be read",
            where=self.where,
            expected=_WHAT,
            got=repr(one_line(part, 60)),
        )

    def _checked(self, node: ast.expr) -> set[str]:
        """Names below a node; raises for anything but arithmetic."""
        if isinstance(node, ast.Constant) and type(node.value) in (int, float):
            return set()
        if isinstance(node, ast.Name) and node.id.isascii():
            if node.id in _FUNCTIONS:
                raise self._refused(node.id)
            return set() if node.id in _CONSTANTS else {node.id}
        if isinstance(node, ast.BinOp) and type(node.op) in _TWO:
            return self._checked(node.left) | self._checked(node.right)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.UAdd, ast.USub)):
            return self._checked(node.operand)
        if (
            isinstance(node, ast.Call)
            and isinstance(node.func, ast.Name)
            and not node.keywords
        ):
            if node.func.id not in _FUNCTIONS:
                raise UnknownNameError(
                    "function", node.func.id, _FUNCTIONS, where=self.where
                )
            if len(node.args) == _FUNCTIONS[node.func.id][0]:
                return set().union(*map(self._checked, node.args))
        raise self._refused(ast.unparse(node))

    def value(self, values: Mapping[str, float]) -> float:
        """Evaluate for values of the names.

        Raises
        ------
        UnknownNameError
            For a name without a value.
        InputError
            If there is no finite real number: a division by zero, the root of a negative
            number.
        """
        for name in sorted(self.names):
            if name not in values:
                raise UnknownNameError("parameter", name, values, where=self.where)
        try:
            result = self._value(self._tree, values)
        except ZeroDivisionError:
            raise self._none("division by zero", values) from None
        except (ValueError, OverflowError):
            raise self._none("no finite real number", values) from None
        if not math.isfinite(result):
            raise self._none("no finite real number", values)
        return result

    def _none(self, what: str, values: Mapping[str, float]) -> InputError:
        names = ", ".join(f"{name} = {values[name]:g}" for name in sorted(self.names))
        text = f"{one_line(self.text, 60)}{f' with {names}' if names else ''}"
        return InputError(what, where=self.where, got=text)

    def _value(self, node: ast.expr, values: Mapping[str, float]) -> float:
        if isinstance(node, ast.BinOp):
            left, right = self._value(node.left, values), self._value(node.right, values)
            return _TWO[type(node.op)](left, right)
        if isinstance(node, ast.UnaryOp):
            inner = self._value(node.operand, values)
            return -inner if isinstance(node.op, ast.USub) else inner
        if isinstance(node, ast.Call):
            function = _FUNCTIONS[ast.unparse(node.func)][1]
            return function(*(self._value(argument, values) for argument in node.args))
        if isinstance(node, ast.Name):
            return (
                _CONSTANTS[node.id] if node.id in _CONSTANTS else float(values[node.id])
            )
        return float(ast.literal_eval(node))
