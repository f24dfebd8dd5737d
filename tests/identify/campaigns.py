"""Arms, and campaigns made by differences of poses: nothing here asks for a Jacobian.

Besides, a loop with forty unknowns, whose campaign the program makes itself.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from tests.doors import candidates, read_yaml, unknowns_of
from tests.inner import keys_to_write, mechanism_file, model_of, plan_plan
from tests.support.robots import bundled_files

import cartstiff
from cartstiff.geometry import se3
from cartstiff.identify import Measurements

#: The rows of a table that tell most.
plan = plan_plan

_JOINTS = {
    # name: (type, origin, axis) of each joint
    "elbow": [
        ("revolute", (0, 0, 0.3), (0, 0, 1)),
        ("revolute", (0.05, 0, 0.1), (0, 1, 0)),
        ("revolute", (0, 0, 0.45), (0, 1, 0)),
        ("revolute", (0.1, 0, 0.2), (1, 0, 0)),
        ("revolute", (0.2, 0, 0), (0, 1, 0)),
        ("revolute", (0.08, 0, 0), (1, 0, 0)),
    ],
    "scara": [
        ("revolute", (0, 0, 0.4), (0, 0, 1)),
        ("revolute", (0.3, 0, 0), (0, 0, 1)),
        ("prismatic", (0.25, 0, 0), (0, 0, 1)),
        ("revolute", (0, 0, -0.1), (0, 0, 1)),
    ],
    "seven": [
        ("revolute", (0, 0, 0.3), (0, 0, 1)),
        ("revolute", (0, 0, 0), (0, 1, 0)),
        ("revolute", (0, 0, 0.35), (0, 0, 1)),
        ("revolute", (0.07, 0, 0), (0, 1, 0)),
        ("revolute", (-0.07, 0, 0.35), (0, 0, 1)),
        ("revolute", (0, 0, 0), (0, 1, 0)),
        ("revolute", (0.08, 0, 0.1), (0, 0, 1)),
    ],
}

SPRINGS = {
    "elbow": (4.0e4, 2.5e4, 1.5e4, 6.0e3, 4.0e3, 3.0e3),
    "scara": (3.0e4, 1.2e4, 8.0e5, 2.0e3),
    "seven": (3.0e4, 3.0e4, 1.5e4, 1.5e4, 6.0e3, 5.0e3, 2.0e3),
}


def arm(name: str, folder: Path, *, springs: tuple[float, ...] | None = None, extra: str = ""):
    """A mechanism file of an arm (its path); joints are j1, j2, ..., tool 0.05 m off the last."""
    links, joints = ['<link name="base"/>'], []
    for i, (kind, xyz, axis) in enumerate(_JOINTS[name], start=1):
        links.append(
            f'<link name="l{i}"><inertial><mass value="{8.0 / i:.3f}"/>'
            '<origin xyz="0.03 0.01 0.02"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" '
            'ixz="0" iyz="0"/></inertial></link>'
        )
        joints.append(
            f'<joint name="j{i}" type="{kind}"><parent link="{"base" if i == 1 else f"l{i - 1}"}"/>'
            f'<child link="l{i}"/><origin xyz="{" ".join(map(str, xyz))}"/>'
            f'<axis xyz="{" ".join(map(str, axis))}"/>'
            '<limit lower="-2.9" upper="2.9" effort="1" velocity="1"/></joint>'
        )
    last = len(_JOINTS[name])
    links.append('<link name="tool"/>')
    joints.append(
        f'<joint name="flange" type="fixed"><parent link="l{last}"/><child link="tool"/>'
        '<origin xyz="0.05 0.02 0.09"/></joint>'
    )
    (folder / f"{name}.urdf").write_text(
        f'<robot name="{name}">{"".join(links)}{"".join(joints)}</robot>', "utf-8"
    )
    k = SPRINGS[name] if springs is None else springs
    entries = "".join(f"  j{i + 1}: {{stiffness: {value!r}}}\n" for i, value in enumerate(k))
    path = folder / f"{name}.yaml"
    path.write_text(
        f"kind: serial\nmodel: {name}.urdf\nframe: tool\nsprings:\n{entries}{extra}", "utf-8"
    )
    return path


def jacobian(elastic, q, h=1e-4):
    """World-axes Jacobian (rotation, translation) at M's origin, by differences of poses."""
    q = np.asarray(q, float)
    columns = []
    for j in range(len(q)):
        total = np.zeros(6)
        for steps, weight in ((1, 8.0), (2, -1.0)):
            e = np.zeros(len(q))
            e[j] = steps * h
            a, b = elastic.mechanism.at(q + e).pose, elastic.mechanism.at(q - e).pose
            turn = se3.log(np.vstack([np.c_[a[:3, :3] @ b[:3, :3].T, np.zeros(3)], [0, 0, 0, 1]]))
            total += weight * np.r_[turn[:3], a[:3, 3] - b[:3, 3]]
        columns.append(total / (12.0 * h))
    return np.array(columns).T


def random_campaign(elastic, truth, rows, seed, sd=2e-5, force=80.0, moment=0.0):
    """Postures, wrenches in F and displacements (rotation, translation) with noise."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1.5, 1.5, (rows, len(truth)))
    W = np.hstack([rng.normal(size=(rows, 3)) * moment, rng.normal(size=(rows, 3)) * force])
    motion = []
    for one, load in zip(q, W, strict=True):
        J = jacobian(elastic, one)
        motion.append(J @ ((J.T @ load) / np.asarray(truth)))
    return q, W, np.array(motion) + rng.normal(size=(rows, 6)) * sd


def simulated(elastic, rows, spread, *, seed=0, loaded=False, tell_deviations=False):
    """Rows with the numbers of the program's own model, and noise; `spread` is by column."""
    count = len(rows)
    sds = {name: np.full(count, s) for name, s in spread.items()}
    blank = replace(rows, values={n: np.zeros(count) for n in spread}, deviations=sds, session=())
    unknowns = unknowns_of(elastic, ("all",))
    model = model_of(unknowns, blank, loaded)
    y, seen = model.at(unknowns.nominal)[0], model.observations
    # The target of a position of zero is less the rigid one.
    y = y + np.random.default_rng(seed).normal(size=len(seen)) * seen.deviation
    y = y - np.where(seen.is_absolute, seen.target, 0.0)
    values = {n: y[np.array(seen.column) == n] for n in spread}
    told = sds if tell_deviations else {n: np.full(count, np.nan) for n in spread}
    return replace(rows, values=values, deviations=told)


def written(result, source, folder, frame=None):
    """The mechanism of the file that a result is written into, from one folder further down."""
    out = folder / "sub" / "known.yaml"
    out.parent.mkdir(exist_ok=True)
    keys = keys_to_write(result.unknowns, str(source), frame, out)
    out.write_bytes(mechanism_file(result, keys, "test"))
    return load(out)


def write_table(path: Path, columns: dict[str, np.ndarray]) -> Path:
    """A table of named columns; NaN is an empty cell."""
    lines = [",".join(columns)]
    for row in zip(*columns.values(), strict=True):
        lines.append(
            ",".join(
                ""
                if isinstance(x, float) and np.isnan(x)
                else (x if isinstance(x, str) else repr(float(x)))
                for x in row
            )
        )
    path.write_text("\n".join(lines) + "\n", "utf-8")
    return path


def table_of(path, q, W, d, *, measured=("dx", "dy", "dz"), sd=None) -> Path:
    """A table in SI."""
    columns = {f"j{j + 1}": q[:, j] for j in range(q.shape[1])}
    columns |= dict(zip(("mx", "my", "mz", "fx", "fy", "fz"), W.T, strict=True))
    every = dict(zip(("drx", "dry", "drz", "dx", "dy", "dz"), d.T, strict=True))
    columns |= {name: every[name] for name in measured}
    if sd is not None:
        columns |= {f"sd_{name}": np.full(len(q), sd) for name in measured}
    return write_table(path, columns)


def measurements(q, W, values, *, sd=1e-6, axes="base", mass=None, session=(), **more):
    """Measurements as a table gives them; `values` (by column) all with one deviation."""
    n = len(q)
    return Measurements(
        np.asarray(q),
        np.asarray(W),
        np.zeros(n) if mass is None else mass,
        np.zeros(n),
        axes,
        values,
        {name: np.full(n, sd) for name in values},
        more.pop("direction", np.full((n, 3), np.nan)),
        session,
        np.full(n, np.nan),
        **more,
    )


def load(path: Path):
    """The mechanism of a file."""
    return cartstiff.load(str(path))


# Turns about x, y, z [N m/rad] and shifts along them [N/m] of each link of a planar 3-RRR.
_LINK = (4.0e3, 1.0e4, 5.0e3, 1.4e7, 1.5e5, 3.5e5)
_LINKS = ("crank", "coupler")
_LOOP_SPREAD = {"dx": 2e-6, "dy": 2e-6, "dz": 2e-6, "drx": 2e-5, "dry": 2e-5, "drz": 2e-5}

#: 34 parameters: three motors, one of them with a third power, and five axes of each of six links.
#: The sixth is that of the motors, in series with them.
LOOP_UNKNOWNS = (
    "joints",
    "leg1/motor",
    *(f"leg{i}/{link}:rx,ry,px,py,pz" for i in (1, 2, 3) for link in _LINKS),
)


def _loop(path: Path, factors: np.ndarray):
    """The bundled 3-RRR with stiffnesses times some factors (40,)."""
    from ruamel.yaml import YAML

    own = bundled_files()["3-rrr"]
    data, _ = read_yaml(own)
    left = iter(factors.tolist())
    for i, leg in enumerate(data["legs"]):
        leg["model"] = str(own.with_name("rrr-leg.urdf"))
        spring = {"stiffness": 2.0e4 * next(left)}
        if i == 0:
            spring = {"polynomial": [spring["stiffness"], 0.0, 4.0e6 * next(left)]}
        leg["springs"] = {"motor": spring}
        leg["flexible"] = {
            link: {"stiffness": np.diag([k * next(left) for k in _LINK]).tolist()}
            for link in _LINKS
        }
    with path.open("w", encoding="utf-8") as file:
        YAML(typ="safe").dump(data, file)
    return load(path)


def bent_loop(folder: Path, rows: int):
    """A guess of the 3-RRR, the truth, and poses under large loads.

    The guess is off by up to a factor of two at the motors and by a fifth at the links.
    """
    rng = np.random.default_rng(0)
    guess = _loop(folder / "guess.yaml", np.ones(40))
    per_leg = [
        (2.0 ** rng.uniform(-1, 1, n), 1 / (1 + 0.2 * rng.normal(size=12))) for n in (2, 1, 1)
    ]
    for _, of_links in per_leg:
        of_links[[2, 8]] = 1.0
    true = _loop(folder / "true.yaml", np.concatenate([x for pair in per_leg for x in pair]))
    motors = {f"leg{i}/motor": true.q[true.names.index(f"leg{i}/motor")] for i in (1, 2, 3)}
    ranges = {name: (at - 0.35, at + 0.35) for name, at in motors.items()}
    offered = candidates(true, _LOOP_SPREAD, count=rows, force=200.0, seed=1, ranges=ranges)
    offered.wrench[:, :3] = rng.normal(size=(rows, 3)) * 30.0
    measured = simulated(true, offered, _LOOP_SPREAD, loaded=True, tell_deviations=True, seed=2)
    return guess, true, measured
