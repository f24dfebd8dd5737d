"""Machines with legs for `tools/fuzz.py`: layouts, legs by name, parameters, and their studies."""

from __future__ import annotations

import json
import random
from pathlib import Path
from typing import Any

from tools.fuzz_common import ROOT, command, mutated_data, nudged_data, odd, outcome

_BY_NAME = {
    "PUS": {"rail": "vertical", "rod": 0.5},
    "RUS": {"crank": 0.15, "rod": 0.5},
    "UPS": {},
    "SPS": {},
    "RPS": {},
    "PRS": {"rail": "vertical", "rod": 0.5},
}


def _named(rng: random.Random) -> dict[str, Any]:
    """A machine whose legs are named."""
    chain = rng.choice(sorted(_BY_NAME))
    circle = {} if chain in ("RPS", "PRS") else {"half_angle": rng.uniform(0.1, 0.9)}
    return {
        "kind": "parallel",
        "legs": {
            "chain": chain,
            "base": {"radius": rng.uniform(0.2, 0.5), **circle},
            "platform": {"radius": rng.uniform(0.1, 0.3), **circle},
            "stiffness": 10 ** rng.uniform(3, 9),
            **_BY_NAME[chain],
        },
        "pose": {"xyz": [0, 0, rng.uniform(0.3, 0.6)]},
    }


def _laid_out(rng: random.Random) -> dict[str, Any]:
    """A platform on line legs, by radii and angles, or cubic, with a parameter."""
    layout = {
        "base": {"radius": "=r", "half_angle": rng.uniform(0.1, 0.9)},
        "platform": {"radius": rng.uniform(0.1, 0.4), "half_angle": rng.uniform(0.1, 0.9)},
        "height": rng.uniform(0.1, 1.0),
    }
    if rng.random() < 0.3:
        layout = {"cubic": {"edge": "=2*r"}}
    legs: dict[str, Any] = {"stiffness": 10 ** rng.uniform(3, 9)}
    if rng.random() < 0.3:
        joint = {"axial": 1.2e8, "shear": 1e7, "bending": 10 ** rng.uniform(0, 4), "torsion": 236}
        legs = {"strut": {"axial": 2e7, "lower": joint, "upper": joint | {"offset": 0.01}}}
    elif rng.random() < 0.5:
        legs |= {"limits": [0.1, 1.5], "diameter": 0.02}
    return {
        "kind": "stewart-gough",
        "parameters": {"r": rng.uniform(0.2, 0.5)},
        "layout": layout,
        "legs": legs,
    }


def _bundled(rng: random.Random) -> dict[str, Any]:
    from ruamel.yaml import YAML

    name = rng.choice(
        [
            "3-prs",
            "3-rps",
            "4-rrr",
            "6-pus",
            "6-rus",
            "hexaglide",
            "hexapod",
            "inclined-hexapod",
            "orthoglide",
            "tricept",
            "cable-robot",
        ]
    )
    text = (ROOT / "robots" / f"{name}.yaml").read_text(encoding="utf-8")
    data: dict[str, Any] = YAML(typ="safe", pure=True).load(text)
    return data


def _study(rng: random.Random) -> dict[str, Any]:
    """A small study of designs."""
    method = rng.choice(
        [
            {"kind": "grid"},
            {"kind": "sobol", "designs": 4},
            None,
            {"kind": "latin-hypercube", "designs": 3},
        ]
    )
    data: dict[str, Any] = {
        "mechanism": "m.yaml",
        "variables": {"r": rng.choice([[0.2, 0.4], {"low": 0.2, "high": 0.4, "count": 2}])},
        "poses": {"grid": {"x": [-0.01, 0.01, 2], "z": [0, 0.02, 2]}, "about_home": True},
        "objectives": {"soft": {"quantity": rng.choice(["translation_held_min", "condition"])}},
        "constraints": {"width": {"value": "=2*r", "at_most": 0.9}},
    }
    return data | ({"method": method} if method else {})


_ASKED = [
    ["analyse", "m.yaml", "--pose", "0,0,0.45,0.05,0,0"],
    ["analyse", "m.yaml", "--load", "0,0,0,0,0,-50"],
    ["analyse", "m.yaml", "--actuate", "leg1/slide=0.001"],
    ["analyse", "m.yaml", "--set", "r=0.3"],
    ["equilibrium", "m.yaml", "--load", "0,0,0,0,0,-50"],
    ["assemble", "m.yaml"],
    ["assemble", "m.yaml", "--all"],
    ["workspace", "m.yaml", "--directions", "20", "--scan", "6"],
    ["workspace", "m.yaml", "--directions", "20", "--scan", "4", "--load", "0,0,0,0,0,-5"],
    ["frames", "m.yaml"],
    ["modes", "m.yaml"],
]


def platform(rng: random.Random) -> str:
    """A machine with legs, whole or damaged, and what is asked of it."""
    data = rng.choice([_named, _laid_out, _laid_out, _bundled])(rng)
    study = rng.random() < 0.15
    if study and "parameters" not in data:
        data = _laid_out(rng)
    chance = rng.random()
    if chance < 0.4:
        data = nudged_data(rng, data)
    elif chance < 0.7:
        data = mutated_data(rng, data)
    Path("m.yaml").write_text(json.dumps(data), encoding="utf-8", errors="replace")
    if study:
        asked = _study(rng)
        asked = mutated_data(rng, asked) if rng.random() < 0.5 else asked
        Path("s.yaml").write_text(json.dumps(asked), encoding="utf-8", errors="replace")
        return outcome(command(["design", "s.yaml", "--json"])[0])
    words = list(rng.choice(_ASKED))
    if rng.random() < 0.1:
        words[-1] = str(odd(rng)).replace("\ud800", "?")
    return outcome(command([*words, "--json"])[0])
