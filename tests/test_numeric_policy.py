"""Every threshold stands in `cartstiff.core.numerics`, with its reason; nobody has an own one."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import cartstiff
from tests.doors import numerics, tree

PACKAGE = Path(cartstiff.__file__).parent
#: Smaller numbers, and larger ones, are thresholds, unless they stand here with their reason.
SMALL, LARGE = 1e-3, 1e5
ALLOWED = {
    "shown/cli/view.py": "bytes to megabytes",
    "files/postures.py": "joints without limits",
    "files/pinocchio_model.py": "efforts that stand for none",
    "files/mesh_worker.py": "metres of which no robot has so many",
    "files/mjcf/worker.py": "a mass in kg that stands for none",
    "files/visuals.py": "metres of which no robot has so many",
    "recorded/algebra.py": "the largest angle that the sine of the fast code takes",
    "recorded/vector_code.py": "coefficients of sine and cosine",
    "files/plain_joints.py": "limits that stand for none",
    "shown/page/api.py": "bytes to megabytes",
    "shown/page/guides.py": "metres that a guide allows",
    "wings/identify/measurements.py": "metres that no robot moves under a newton",
    "wings/identify/identification.py": "the error of a zero whose effect is reported",
    "core/choices.py": "the largest number that is taken",
    "shown/scene/arrows.py": "the smallest loads and motions that are drawn",
    "shown/scene/ellipsoids.py": "the thinnest body that is drawn",
    "shown/scene/appearance.py": "the largest exaggeration that is drawn",
    "shown/scene/environment.py": "units",
    "core/units.py": "units",
    "core/statics/newton.py": "the longest step: no bound",
}
FILES = sorted(p.relative_to(PACKAGE).as_posix() for p in PACKAGE.rglob("*.py"))


def thresholds(parsed: ast.Module) -> list[int]:
    """Lines on which a number decides."""
    found = []
    for node in ast.walk(parsed):
        value = node.value if isinstance(node, ast.Constant) else None
        is_extreme = isinstance(value, float) and (
            0.0 < abs(value) < SMALL or LARGE <= abs(value) < float("inf")
        )
        if is_extreme or (isinstance(node, ast.Attribute) and node.attr == "finfo"):
            found.append(node.lineno)
    return found


def test_no_module_has_a_threshold_of_its_own():
    found = {
        name: thresholds(tree(PACKAGE / name))
        for name in FILES
        if not name.startswith("core/numerics/")
    }
    wrong = {name: lines for name, lines in found.items() if lines and name not in ALLOWED}
    assert not wrong, f"name the numbers on these lines in cartstiff.core.numerics: {wrong}"
    needless = [name for name in ALLOWED if not found.get(name)]
    assert not needless, f"these need no exception any more: {needless}"


def test_thresholds_are_seen():
    source = "x = 1e-9\ny = 2.0\nz = np.finfo(float).eps\nif a > 1e8: pass"
    assert thresholds(ast.parse(source)) == [1, 4, 3]


def test_each_threshold_has_its_reason():
    for name in ("policy", "criteria"):
        text = (PACKAGE / "core" / "numerics" / f"{name}.py").read_text(encoding="utf-8")
        lines = text.splitlines()
        named = [i for i, line in enumerate(lines) if re.match(r"[A-Z_]+: Final", line)]
        assert len(named) > 10
        for i in named:
            told = lines[i - 1].startswith("#:") or re.match(r"[A-Z_]+: Final", lines[i - 1])
            assert told, f"{name}.py:{i + 1} has no reason"


def test_the_page_has_the_same_thresholds():
    folder = PACKAGE / "shown" / "page" / "static"
    text = (folder / "numerics.js").read_text(encoding="utf-8")
    found = re.findall(r"^export const (\w+) = (\S+);$", text, re.MULTILINE)
    assert len(found) == text.count("export") > 3
    for name, value in found:
        assert float(value) == getattr(numerics, name), name
    for path in folder.glob("*.js"):
        if path.name != "numerics.js":
            own = re.findall(
                r"[ (]-?\d(?:\.\d+)?e-(?:[4-9]|\d\d)", path.read_text(encoding="utf-8")
            )
            assert not own, path.name
