"""OpenSees (openseespy) as an independent program; tests that need it are skipped without it."""

from __future__ import annotations

import ctypes
import importlib
import importlib.util
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

#: Libraries that the Linux wheel brings and does not find by itself, in the order of their needs.
_LIBRARIES = ("quadmath.so.0", "gfortran.so.4", "gomp.so.1", "blas.so.3", "lapack.so.3")


def opensees() -> Any:
    """The interpreter, wiped clean."""
    found = importlib.util.find_spec("openseespylinux")
    if found is not None and found.origin is not None:
        folder = Path(found.origin).parent / "lib"
        for name in _LIBRARIES:
            if (path := folder / f"lib{name}").exists():
                ctypes.CDLL(str(path), mode=ctypes.RTLD_GLOBAL)
    try:
        ops = importlib.import_module("openseespy.opensees")
    except (ImportError, RuntimeError):
        pytest.skip("openseespy is not installed, or not usable here")
    ops.wipe()
    return ops


def space_frame() -> Any:
    """A model in space with a corotational transformation 1 (local z along the room's z)."""
    ops = opensees()
    ops.model("basic", "-ndm", 3, "-ndf", 6)
    ops.geomTransf("Corotational", 1, 0.0, 0.0, 1.0)
    return ops


def frame_bar(
    ops: Any, nodes: list[int], section: dict[str, float], first: int, transformation: int = 1
) -> None:
    """Elastic beam elements between successive nodes."""
    for i, (a, b) in enumerate(pairwise(nodes)):
        ops.element(
            "elasticBeamColumn",
            first + i,
            a,
            b,
            section["area"],
            section["E"],
            section["G"],
            section["J"],
            section["Iy"],
            section["Iz"],
            transformation,
        )


def solved(ops: Any, steps: int = 10, tolerance: float = 1e-10) -> None:
    """Static analysis with the loads of pattern 1 put on in steps."""
    ops.system("FullGeneral")
    ops.constraints("Transformation")
    ops.numberer("Plain")
    ops.test("NormDispIncr", tolerance, 100, 0)
    ops.algorithm("Newton")
    ops.integrator("LoadControl", 1.0 / steps)
    ops.analysis("Static")
    assert ops.analyze(steps) == 0


def extrapolated(coarse: Any, fine: Any, order: float = 2.0) -> np.ndarray:
    """Limit of a result of that order, from one mesh and one with half its size."""
    coarse, fine = np.asarray(coarse, float), np.asarray(fine, float)
    return fine + (fine - coarse) / (2**order - 1)
