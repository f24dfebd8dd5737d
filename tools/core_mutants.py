"""Mutants of the core: in each, one formula is changed; a test beside the core must fail.

    python tools/core_mutants.py [--count N] [--seed N] [--only ROOM/FILE.py:FUNCTION ...]

A mutant has one operator, sign, number, comparison or transpose changed, or one statement taken
out. They are drawn over the rooms `ROOMS`, a function at most twice. The tests of `TESTS` run once
to learn which of them enter which function (kept in `build/`); a mutant then gets those that enter
its function, quickest first, for `--seconds` of processor time. Each runs in a fork of one process
in which the code of the function is replaced, so nothing is imported or collected twice.

A mutant that survives these few tests gets all cases of the file that `WHOLE` names for it. Without
such a file it is to be looked at with those that enter its function; if it still survives, a test
is missing, or nothing that can be seen has changed: `SAME` says of those why. Functions that run
while modules are imported, and those inside others that were made then, keep their old code. The
exit code is 1 if one survives that is not in `SAME`.

Of the 120 of seed 72, 36 are killed by whole files, five are the same, and quick tests kill the
others. Numbers that are made while modules are imported stand outside of functions: edit the
file, and a law's test fails.
"""

from __future__ import annotations

import argparse
import ast
import copy
import gc
import json
import os
import resource
import signal
import sys
import time
import zlib
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any, NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "src" / "cartstiff"
CORE = PACKAGE / "core"
sys.path.insert(0, str(PACKAGE.parent))
ROOMS = ("geometry", "potentials", "mechanisms", "stiffness", "statics", "numerics")
TESTS = ("oracles", "published", "mechanisms", "laws", "rooms/core")
#: Files that reach the core through programs, pages and commands, and take long.
APART = (
    "many_",
    "program",
    "gradients",
    "table_of",
    "set_ups",
    "every_answer",
    "recorded",
    "doors",
)
KEPT = ROOT / "build" / "core_mutants.jsonl"
SLOWEST = 0.2  # seconds of processor time of a test that is still worth running here
HANGS = 200  # seconds after which a mutant counts as noticed

#: Mutants that change nothing that can be seen, with the reason.
SAME: dict[str, str] = {
    "geometry/se3.py:_coefficients:139 56 -> 57": "below an ulp of exp at any angle",
    "geometry/se3.py:_cot_coefficient:68 40 -> 41": "below an ulp of log at any angle",
    "statics/newton.py:_Iteration._step:30 Sub -> Add": "of 2100 saddle steps none is within 1e-4",
    "stiffness/motions.py:motions:214 0 -> 1": "lost directions are read below full rank only",
    "numerics/spectra.py:eigenpairs:309 0.0 -> 1.0": "the sign of an eigenvector has no meaning",
}

#: Files whose slower tests kill a mutant that the quick ones leave.
_BY_FILE = {
    "oracles/test_rigid_joints.py": [
        "mechanisms/chain.py:ChainPosture.residual:53 Is -> IsNot",
        "mechanisms/given_springs.py:with_values:135 In -> NotIn",
    ],
    "identify/test_later_answers.py": [
        "statics/rest.py:motion_under_forces:48 Div -> Mult",
    ],
    "laws/test_balance_of_bodies.py": [
        "stiffness/wrenches.py:wrenches_at:64 0 -> 1",
    ],
    "laws/test_charts.py": [
        "geometry/charts.py:product_of_exponentials:119 A @ B -> B @ A",
    ],
    "laws/test_drive_forces.py": [
        "stiffness/forces.py:forces_of:265 0.0 -> 1.0",
    ],
    "laws/test_equilibrium_constraints.py": [
        "statics/problem.py:System.balance:69 0 -> 1",
        "statics/held.py:Held.scaled:12 Mult -> Div",
        "statics/held.py:_series:112 Div -> Mult",
    ],
    "laws/test_equilibrium_curves.py": [
        "statics/continuation.py:LoadCurve.branch:99 Lt -> GtE",
        "statics/continuation.py:_is_elsewhere:30 sign",
    ],
    "laws/test_equilibrium_loads.py": [
        "statics/newton.py:_Iteration._downwards:367 Eq -> NotEq",
        "statics/newton.py:_Iteration._watched:93 GtE -> Lt",
    ],
    "laws/test_group.py": [
        "geometry/se3.py:_cot_coefficient:42 12 -> 13",
        "geometry/se3.py:right_jacobian:186 Div -> Mult",
    ],
    "laws/test_matrix_pair.py": [
        "numerics/spectra.py:_errors:158 Mult -> Div",
    ],
    "laws/test_mechanisms.py": [
        "mechanisms/platform.py:Struts.__eq__:10 Eq -> NotEq",
    ],
    "laws/test_potentials.py": [
        "potentials/functions.py:_differentiate:121 max -> min",
    ],
    "laws/test_preload.py": [
        "potentials/tensions.py:_nearest:716 Mult -> Div",
    ],
    "laws/test_tensor.py": [
        "stiffness/tensor.py:StiffnessTensor.symmetric_part:4 0.5 -> 1.0",
    ],
    "laws/test_units_of_force.py": [
        "mechanisms/elastic.py:ElasticMechanism.may_be_loaded:59 Gt -> LtE",
        "mechanisms/platform.py:PlatformPosture.gravity:45 Div -> Mult",
        "numerics/policy.py:asymmetry:47 0.0 -> 1.0",
        "statics/problem.py:System._by_lengths:25 0.0 -> 1.0",
        "statics/problem.py:System.balance:508 0.0 -> 1.0",
    ],
    "mechanisms/test_beams.py": [
        "potentials/beams.py:Beam.diagnostics:27 not",
        "potentials/beams.py:Beam.rotational:328 Add -> Sub",
        "potentials/segment_shapes.py:sheared:30 Add -> Sub",
    ],
    "mechanisms/test_link_mass.py": [
        "potentials/link_springs.py:CoupledSprings.compliances:56 sign",
    ],
    "oracles/test_compliance_fifty_digits.py": [
        "numerics/spectra.py:eigenpairs:50 0 -> 1",
    ],
    "oracles/test_platform_fifty_digits.py": [
        "stiffness/posture_notes.py:error_of_chosen_forces:86 0.0 -> 1.0",
    ],
    "oracles/test_searches.py": [
        "numerics/searches.py:least_change:106 0 -> 1",
    ],
    "oracles/test_sensitivities_of_legs.py": [
        "statics/problem.py:System.of:23 True -> False",
    ],
    "published/test_equilibrium_buckling.py": [
        "statics/continuation.py:_is_singular:29 Mult -> Div",
        "statics/newton.py:_Iteration._settle:148 Gt -> LtE",
    ],
    "vibration/test_massless_motions.py": [
        "statics/small_motions.py:spectrum_of:122 1 -> 2",
    ],
}
WHOLE = {mutant: file for file, mutants in _BY_FILE.items() for mutant in mutants}

ARITHMETIC = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult}
ORDER = {
    ast.Lt: ast.GtE,
    ast.LtE: ast.Gt,
    ast.Gt: ast.LtE,
    ast.GtE: ast.Lt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
}
CALLS = {"max": "min", "min": "max", "maximum": "minimum", "minimum": "maximum"}
CALLS |= {"any": "all", "all": "any", "sin": "cos", "cos": "sin"}


class Mutant(NamedTuple):
    """A change of one node of a function: module, function, which node, what is done and how."""

    path: Path
    function: str
    node: int
    line: int
    words: str
    change: Callable[[Any], ast.AST]

    @property
    def name(self) -> str:
        """Module, function, number of the node: stays as long as the function does."""
        return f"{self.path.relative_to(CORE)}:{self.function}:{self.node} {self.words}"

    def code(self) -> CodeType:
        """Code of the changed module."""
        tree = ast.parse(self.path.read_text(encoding="utf-8"))
        target = list(numbers(dict(functions(tree))[self.function]))[self.node]
        _Put(target, self.change(copy.copy(target))).visit(tree)
        return compile(ast.fix_missing_locations(tree), str(self.path), "exec")


# -- making them --------------------------------------------------------------------------------


def changes(node: ast.AST) -> Iterator[tuple[str, Callable[[Any], ast.AST]]]:
    """What can be done to one node: words, and a function of its copy."""
    match node:
        case ast.BinOp(op=ast.MatMult()):
            yield "A @ B -> B @ A", _swapped
        case ast.BinOp() if type(node.op) in ARITHMETIC:
            other = ARITHMETIC[type(node.op)]
            yield f"{_name(node.op)} -> {other.__name__}", lambda n: _with(n, op=other())
        case ast.UnaryOp(op=ast.USub()):
            yield "sign", lambda n: n.operand
        case ast.UnaryOp(op=ast.Not()):
            yield "not", lambda n: n.operand
        case ast.Compare(ops=[op]):
            other = ORDER[type(op)]
            yield f"{_name(op)} -> {other.__name__}", lambda n: _with(n, ops=[other()])
        case ast.BoolOp():
            other = ast.Or if isinstance(node.op, ast.And) else ast.And
            yield f"{_name(node.op)} -> {other.__name__}", lambda n: _with(n, op=other())
        case ast.Constant(value=bool() as value):
            yield f"{value} -> {not value}", lambda n: ast.Constant(not n.value)
        case ast.Constant(value=int() | float() as value):
            changed = value + 1 if isinstance(value, int) else 2.0 * value or 1.0
            yield f"{value} -> {changed}", lambda _: ast.Constant(changed)
        case ast.Attribute(attr="T", ctx=ast.Load()):
            yield "transpose", lambda n: n.value
        case ast.Attribute(attr=name) if name in CALLS:
            yield f"{name} -> {CALLS[name]}", lambda n: _with(n, attr=CALLS[name])
        case ast.AugAssign():
            yield "statement", lambda _: ast.Pass()
        case ast.Expr(value=ast.Call()):
            yield "statement", lambda _: ast.Pass()


def _name(op: ast.AST) -> str:
    return type(op).__name__


def _with(node: Any, **fields: Any) -> Any:
    for key, value in fields.items():
        setattr(node, key, value)
    return node


def _swapped(node: ast.BinOp) -> ast.BinOp:
    node.left, node.right = node.right, node.left
    return node


def functions(tree: ast.Module) -> Iterator[tuple[str, ast.FunctionDef]]:
    """Functions of a module and methods of its classes, with their names."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            yield node.name, node
        elif isinstance(node, ast.ClassDef):
            own = [n for n in node.body if isinstance(n, ast.FunctionDef)]
            yield from ((f"{node.name}.{n.name}", n) for n in own)


def numbers(function: ast.AST) -> Iterator[ast.AST]:
    """Nodes of a function but for its words: messages, annotations, `repr`s and what is raised."""
    for child in ast.iter_child_nodes(function):
        words = (ast.Raise, ast.JoinedStr, ast.arguments, ast.Assert)
        if isinstance(child, words) or child is getattr(function, "returns", None):
            continue
        if isinstance(child, ast.Call) and getattr(child.func, "id", "") in {"Note", "super"}:
            continue
        yield child
        yield from numbers(child)


def mutants_of(path: Path) -> Iterator[Mutant]:
    """Every mutant of a module."""
    for name, function in functions(ast.parse(path.read_text(encoding="utf-8"))):
        if name.endswith((".__repr__", ".__str__", "._lines", ".plot", ".to_dict")):
            continue
        for k, node in enumerate(numbers(function)):
            for words, change in changes(node):
                line = getattr(node, "lineno", function.lineno)
                yield Mutant(path, name, k, line, words, change)


class _Put(ast.NodeTransformer):
    def __init__(self, old: ast.AST, new: ast.AST) -> None:
        self.old, self.new = old, new

    def visit(self, node: ast.AST) -> Any:
        """The new node for the old one."""
        return self.new if node is self.old else self.generic_visit(node)


def drawn(count: int, seed: int) -> list[Mutant]:
    """Mutants by lot: as many of each room, of a function at most two.

    The lot of a mutant depends on its name alone: a change elsewhere leaves the others drawn.
    """
    found = []
    for i, room in enumerate(ROOMS):
        every = [m for path in sorted((CORE / room).glob("*.py")) for m in mutants_of(path)]
        every.sort(key=lambda m: zlib.crc32(f"{seed} {m.name}".encode()))
        taken: Counter[tuple[Path, str]] = Counter()
        for mutant in every:
            if taken.total() == (count + i) // len(ROOMS):
                break
            if taken[mutant.path, mutant.function] < 2:
                taken[mutant.path, mutant.function] += 1
                found.append(mutant)
    return found


def put_in(mutant: Mutant) -> int:
    """Replace the code of a mutant's function wherever it is held; how many functions that are."""
    place = mutant.path.relative_to(PACKAGE.parent).with_suffix("")
    import_module(".".join(place.parts))
    module, name = mutant.code(), mutant.function.split(".")
    for part in name:
        module = next(c for c in module.co_consts if getattr(c, "co_name", "") == part)
    gc.unfreeze()  # what was collected is kept aside by conftest.py
    held = [
        f
        for f in gc.get_objects()
        if isinstance(f, FunctionType)
        and f.__code__.co_qualname == module.co_qualname
        and f.__code__.co_filename == str(mutant.path)
        and f.__code__.co_firstlineno == module.co_firstlineno
    ]
    for function in held:
        function.__code__ = module
    return len(held)


# -- running them -------------------------------------------------------------------------------


class Runner:
    """In place of pytest's own loop: the tests for each mutant, in a fork."""

    def __init__(self, mutants: list[Mutant], seconds: float) -> None:
        self.mutants, self.seconds = mutants, seconds
        self.learns = self.failed = False
        self.survived: list[Mutant] = []

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Learn what enters what, then run the mutants."""
        items = _some(session.items)
        kept = _kept()
        while unknown := [item for name, item in items.items() if name not in kept]:
            if _forked(lambda: self._learn(unknown)):
                kept = _kept()  # a slow test has ended it: the first that is not known
                _keep(next(name for name in items if name not in kept), 2.0 * SLOWEST, [])
            kept = _kept()
        tests: defaultdict[str, list[tuple[float, str]]] = defaultdict(list)
        for test, (seconds, entered) in kept.items():
            if seconds <= SLOWEST and test in items:
                for function in entered:
                    tests[function].append((seconds, test))
        for mutant in self.mutants:
            key = f"{mutant.path.relative_to(CORE)}:{mutant.function}"
            names = _within(sorted(tests[key]), self.seconds)
            chosen = [items[n] for n in names]
            killed = bool(chosen) and self._killed_by(mutant, chosen)
            if not killed and (file := WHOLE.get(mutant.name)):
                chosen = [item for item in session.items if f"{file}::" in item.nodeid]
                killed = self._killed_by(mutant, chosen)
            _say(mutant, killed, len(chosen), self)
        return True

    def _killed_by(self, mutant: Mutant, items: list[pytest.Item]) -> bool:
        def run() -> None:
            held = put_in(mutant)
            _quiet()
            for item in items:
                item.config.hook.pytest_runtest_protocol(item=item, nextitem=None)
            os._exit(0 if held or not items else 3)

        code = _forked(run)
        assert code != 3, f"{mutant.name}: nothing holds the function"
        return code != 0

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """A failure ends the fork of a mutant."""
        self.failed |= report.failed
        if report.failed and not self.learns:
            os._exit(1)

    def _learn(self, items: list[pytest.Item]) -> None:
        """Keep what tests enter; a test that takes longer than `SLOWEST` ends this process."""
        self.learns = True
        _quiet()
        core = tuple(f"{CORE / room}{os.sep}" for room in ROOMS)
        is_core: dict[CodeType, bool] = {}
        entered: set[CodeType] = set()

        def trace(frame: Any, *_: object) -> None:
            code = frame.f_code
            if code not in is_core:
                is_core[code] = code.co_filename.startswith(core)
            if is_core[code]:
                entered.add(code)

        for item in items:
            entered.clear()
            self.failed = False
            before = time.process_time()
            signal.setitimer(signal.ITIMER_PROF, SLOWEST)
            sys.settrace(trace)
            item.config.hook.pytest_runtest_protocol(item=item, nextitem=None)
            sys.settrace(None)
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            seconds = 2.0 * SLOWEST if self.failed else time.process_time() - before
            places = ((Path(code.co_filename).relative_to(CORE), code) for code in entered)
            names = {f"{file}:{c.co_qualname.partition('.<locals>')[0]}" for file, c in places}
            _keep(item.nodeid, seconds, sorted(names))


def _some(items: list[pytest.Item]) -> dict[str, pytest.Item]:
    """Two cases of each test that is not of `APART`."""
    taken: Counter[str] = Counter()
    found = {}
    for item in items:
        function = item.nodeid.partition("[")[0]
        taken[function] += 1
        if taken[function] <= 2 and not any(word in function for word in APART):
            found[item.nodeid] = item
    return found


def _kept() -> dict[str, tuple[float, list[str]]]:
    """Seconds of each test that is known, and the core's functions that it enters."""
    lines = KEPT.read_text(encoding="utf-8").splitlines() if KEPT.is_file() else []
    return {name: (seconds, names) for name, seconds, names in map(json.loads, lines)}


def _keep(test: str, seconds: float, entered: list[str]) -> None:
    KEPT.parent.mkdir(exist_ok=True)
    with KEPT.open("a", encoding="utf-8") as file:
        file.write(json.dumps([test, round(seconds, 4), entered]) + "\n")


def _within(tests: list[tuple[float, str]], seconds: float) -> list[str]:
    """The quickest tests that fit, one of each function first, at most 60."""
    first = {name.partition("[")[0]: (s, name) for s, name in reversed(tests)}
    order = sorted(first.values()) + [t for t in tests if t not in set(first.values())]
    spent, names = 0.0, []
    for time_, name in order[:40]:
        spent += time_
        if names and spent > seconds:
            break
        names.append(name)
    return names


def _forked(task: Callable[[], None]) -> int:
    """Exit code of a task in a fork, or of what ended it."""
    child = os.fork()
    if not child:
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(HANGS if task.__name__ == "run" else 0)
        try:
            task()
        except BaseException as error:  # a mutant may break pytest itself
            print(repr(error), file=sys.stderr, flush=True)
            os._exit(1)
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def _quiet() -> None:
    nothing = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 1)
    os.dup2(nothing, 2)


def _say(mutant: Mutant, killed: bool, tests: int, runner: Runner) -> None:
    reason = SAME.get(mutant.name)
    if not killed and reason is None:
        runner.survived.append(mutant)
    said = "killed" if killed else f"the same: {reason}" if reason else "SURVIVED"
    used = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    print(f"{said:8} {mutant.name} (line {mutant.line}; {tests} tests, {used:.0f} s)", flush=True)


def main() -> None:
    """Draw, run and count."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--count", type=int, default=120)
    parser.add_argument("--seed", type=int, default=72)
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--tests", nargs="*", default=TESTS, help="folders of tests, or files")
    parser.add_argument("--only", nargs="*", default=[], help="mutants whose names begin so")
    options = parser.parse_args()
    if options.only:
        every = [m for r in ROOMS for p in sorted((CORE / r).glob("*.py")) for m in mutants_of(p)]
        mutants = [m for m in every if m.name.startswith(tuple(options.only))]
    else:
        mutants = drawn(options.count, options.seed)
    runner = Runner(mutants, options.seconds)
    whole = sorted({WHOLE[m.name] for m in mutants if m.name in WHOLE})
    apart = [file for file in whole if not file.startswith(tuple(options.tests))]
    folders = [str(ROOT / "tests" / name) for name in (*options.tests, *apart)]
    words = [
        "-o",
        "addopts=",
        "--import-mode=importlib",
        "-p",
        "no:cacheprovider",
        "-p",
        "no:terminal",
    ]
    pytest.main([*words, *folders], plugins=[runner])
    print(f"{len(runner.survived)} of {len(mutants)} survived")
    sys.exit(bool(runner.survived))


if __name__ == "__main__":
    main()
