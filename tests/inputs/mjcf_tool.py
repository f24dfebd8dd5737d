"""The comparison of tools/mjcf_against_mujoco.py, for tests."""

import importlib.util
import sys
from pathlib import Path

_FILE = Path(__file__).resolve().parents[2] / "tools" / "mjcf_against_mujoco.py"
_SPEC = importlib.util.spec_from_file_location("mjcf_against_mujoco", _FILE)
assert _SPEC is not None
assert _SPEC.loader is not None
_TOOL = importlib.util.module_from_spec(_SPEC)
sys.modules["mjcf_against_mujoco"] = _TOOL
_SPEC.loader.exec_module(_TOOL)

SEEDS, compile_here, mutant, verdict = (
    _TOOL.SEEDS,
    _TOOL.compile_here,
    _TOOL.mutant,
    _TOOL.verdict,
)
