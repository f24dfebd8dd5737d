r"""Outputs of a user's own: matrices under a connection,
and functions of recorded arrays.

With ``T[i, j] = sum_k Gamma[i, j, k] W_k`` of a connection the stiffness is ``K = K^A -
T``, see `cartstiff.core.geometry.connections`, and its inverse that of K^B, changed by
``D = K
- K^B``.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.errors import InputError, UnknownNameError
from cartstiff.core.geometry.connections import Connection
from cartstiff.core.matrix_names import OF_MANY
from cartstiff.recorded.algebra import PLAIN, changed_compliance, limited
from cartstiff.recorded.arguments import (
    DETAILS,
    EVERY_OUTPUT,
    MOTIONS,
    OF_VIBRATIONS,
)
from cartstiff.recorded.quantities import Quantity, Settings
from cartstiff.recorded.tape import Arrays, Scalar, absolute, larger

#: A number, or an array, made of arrays by + - * / and products:
#: ``lambda a: a["stiffness_B"][3:, 3:] @ a["wrench"][3:]``.
Function = Callable[[Arrays], Any]


#: Names of what programs and data sets have besides.
_TAKEN = {
    *EVERY_OUTPUT,
    *OF_MANY,
    *DETAILS,
    *OF_VIBRATIONS,
    MOTIONS,
    *("verdict", "q", "state", "given_wrench", "W", "posture", "coordinate"),
}
#: Outputs that the matrices under a connection follow from.
_OF_CONNECTIONS = "stiffness_A", "stiffness_B", "compliance_B", "wrench"


class _Read(dict[str, Array]):
    """Arrays that remember which of them were read."""

    def __init__(self, arrays: Arrays) -> None:
        super().__init__(arrays)
        self.names: dict[str, None] = {}

    def __getitem__(self, name: str) -> Array:
        if name not in self:
            raise UnknownNameError("output", name, EVERY_OUTPUT)
        self.names[name] = None
        return super().__getitem__(name)


class _Function(NamedTuple):
    """A function, the outputs that it reads, and the shape of its result."""

    function: Function
    needs: tuple[str, ...]
    shape: tuple[int, ...]


@dataclass(frozen=True)
class OwnOutputs:
    """Connections and functions by name, and quantities of the table.

    Attributes
    ----------
    connections : tuple of (str, Connection)
        Each has the outputs "stiffness_NAME" and "compliance_NAME".
    functions : tuple of (str, function with its needs and shape)
    quantities : tuple of str
        Names in `cartstiff.recorded.quantities.QUANTITIES`.
    settings : Settings, optional
        Those of the quantities.
    defined : tuple of Quantity
        Those of the quantities that a user has defined, if other processes do not know
        them.
    """

    connections: tuple[tuple[str, Connection], ...] = ()
    functions: tuple[tuple[str, _Function], ...] = ()
    quantities: tuple[str, ...] = ()
    settings: Settings | None = None
    defined: tuple[Quantity, ...] = ()

    @classmethod
    def of(
        cls, outputs: Mapping[str, Any], shapes: Mapping[str, tuple[int, ...]]
    ) -> OwnOutputs:
        """Those among outputs by name, for arrays of the given shapes.

        Raises
        ------
        InputError
            If something is neither a connection nor a function, or has the name of
            another.
        """
        connections = list[tuple[str, Connection]]()
        functions = list[tuple[str, _Function]]()
        for name, output in outputs.items():
            if isinstance(output, str):
                continue
            if isinstance(output, Connection):
                connections.append((name, output))
            elif callable(output):
                functions.append((name, _looked_at(output, shapes)))
            else:
                raise InputError(
                    "output cannot be used",
                    where=f"outputs, {name}",
                    expected="a name, a connection, or a function",
                    got=output,
                )
        own = cls(tuple(connections), tuple(functions))
        for name in own.names:
            if not isinstance(name, str) or not name or name in _TAKEN:
                raise InputError(
                    "output has no name, or that of another",
                    expected="its own name",
                    got=name,
                )
        return own

    def __bool__(self) -> bool:
        return bool(self.connections or self.functions)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the outputs of connections and functions."""
        pairs = [
            (f"stiffness_{name}", f"compliance_{name}") for name, _ in self.connections
        ]
        return (
            *(n for pair in pairs for n in pair),
            *(name for name, _ in self.functions),
        )

    @property
    def needs(self) -> tuple[str, ...]:
        """Outputs that these follow from."""
        needs = [name for _, own in self.functions for name in own.needs]
        if self.connections:
            needs += _OF_CONNECTIONS
        return tuple(dict.fromkeys(needs))

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Shape of each output at one posture."""
        shapes: dict[str, tuple[int, ...]] = dict.fromkeys(self.names, (6, 6))
        return shapes | {name: own.shape for name, own in self.functions}

    def beside(self, arrays: Collection[str]) -> OwnOutputs:
        """Those that follow from some arrays."""
        connections = self.connections if {*arrays}.issuperset(_OF_CONNECTIONS) else ()
        functions = (f for f in self.functions if {*arrays}.issuperset(f[1].needs))
        return replace(self, connections=connections, functions=tuple(functions))

    def record(self, arrays: Arrays, length: Scalar) -> tuple[dict[str, Array], Scalar]:
        """Outputs on recorded numbers, and the verdict on them."""
        found = dict[str, Array]()
        verdict: Scalar = PLAIN
        for name, connection in self.connections:
            term = (connection.symbols @ arrays["wrench"]).astype(object)
            K = found[f"stiffness_{name}"] = arrays["stiffness_A"] - term
            found[f"compliance_{name}"], doubt = changed_compliance(
                arrays["compliance_B"], K - arrays["stiffness_B"], length
            )
            verdict = larger(verdict, doubt)
        for name, own in self.functions:
            try:
                values = found[name] = np.asarray(own.function(arrays), object)
            except TypeError as other:  # recorded numbers have no such operation
                raise InputError(
                    f"{name} cannot be recorded",
                    expected="+ - * / and products of arrays",
                    got=other,
                ) from None
            for value in values.flat:
                verdict = larger(verdict, limited(absolute(value), np.inf))
        return found, verdict

    def values(self, arrays: Arrays) -> dict[str, Array]:
        """Outputs (N, ...) of stacks (N, ...)."""
        found = dict[str, Array]()
        for name, connection in self.connections:
            K = found[f"stiffness_{name}"] = arrays["stiffness_A"] - (
                connection.wrench_term(arrays["wrench"])
            )
            C, D = arrays["compliance_B"], K - arrays["stiffness_B"]
            known = np.isfinite(C).all(axis=(1, 2)) & np.isfinite(D).all(axis=(1, 2))
            inverse = found[f"compliance_{name}"] = np.full_like(C, np.nan)
            if known.any():
                inverse[known] = numerics.inverses_of_sums(C[known], D[known])[0]
        for name, own in self.functions:
            rows = [
                own.function({n: arrays[n][i] for n in own.needs})
                for i in range(len(next(iter(arrays.values()))))
            ]
            found[name] = np.asarray(rows, float).reshape(len(rows), *own.shape)
        return found


def _looked_at(function: Function, shapes: Mapping[str, tuple[int, ...]]) -> _Function:
    """A function with what it reads, and the shape of its result,
    at numbers of no meaning.
    """
    rng = np.random.default_rng(0)
    exist = {name: shape for name, shape in shapes.items() if 0 not in shape}
    read = _Read({name: rng.uniform(1.0, 2.0, shape) for name, shape in exist.items()})
    result = np.asarray(function(read))
    if result.dtype.kind not in "fiu":
        raise InputError("function has no numbers as its result", got=result.dtype)
    return _Function(function, tuple(read.names), result.shape)
