"""Limits of forces beside what else a file says: mimics, couplings, units, parameters, locks."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
import yaml
from tests.laws.test_balance_of_bodies import EARTH, tree
from tests.laws.test_capacity import platform
from tests.support.commands import run

import cartstiff as cs

LOAD = np.array([30.0, -20.0, -50.0])


def work(model: pin.Model, frame: str, q: np.ndarray) -> float:
    """Potential of the weights and of a dead force on a frame."""
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    place = data.oMf[model.getFrameId(frame)].translation
    return pin.computePotentialEnergy(model, data, q) - LOAD @ place


def slope(of, x: np.ndarray, step: float = 1e-5) -> np.ndarray:
    each = step * np.eye(len(x))
    return np.array([(of(x + e) - of(x - e)) / (2.0 * step) for e in each])


@pytest.mark.parametrize("seed", range(6))
def test_a_drive_carries_what_its_followers_and_couplings_do(seed, tmp_path):
    """By the work of weight and load along the drives, with the followers' places by hand."""
    rng, n = np.random.default_rng(seed), 5
    names = tree(tmp_path / "r.urdf", rng, n)
    factor, offset = rng.uniform(-2.0, 2.0), rng.uniform(-0.3, 0.3)
    text = (tmp_path / "r.urdf").read_text()
    at = text.index(f'<joint name="{names[3]}"')
    end = text.index("</joint>", at)
    rule = f'<mimic joint="{names[1]}" multiplier="{factor!r}" offset="{offset!r}"/>'
    (tmp_path / "r.urdf").write_text(text[:end] + rule + text[end:])
    driven, tip = [names[i] for i in (0, 1, 2, 4)], f"b0l{n - 1}"
    file = {"kind": "serial", "model": "r.urdf", "frame": tip, "effort": {names[1]: [-7.0, 9.0]}}
    file["springs"] = {name: {"stiffness": float(rng.uniform(5e3, 5e4))} for name in driven}
    file["coupled_springs"] = [
        {"joints": {names[0]: 1.0, names[2]: -0.5}, "stiffness": 2e4, "name": "belt"}
    ]
    (tmp_path / "m.yaml").write_text(yaml.safe_dump(file))
    elastic = cs.load(str(tmp_path / "m.yaml")).with_gravity(EARTH)
    q = rng.uniform(-0.8, 0.8, 4)
    wrench = np.concatenate([np.zeros(3), LOAD])
    result = cs.analyse(elastic, q, wrench=wrench, load_axes="world")

    def energy(x: np.ndarray) -> float:
        full = np.array([x[0], x[1], x[2], factor * x[1] + offset, x[3]])
        return work(model, tip, full)

    plain = (tmp_path / "r.urdf").read_text().replace(rule, "")
    model = pin.buildModelFromXML(plain)
    model.gravity.linear = EARTH
    forces = {one.name: one.force for one in result.forces}
    # The coupling's spring, a tension, pulls on both of its joints.
    needed = slope(energy, q)
    own = np.array([forces[name] for name in driven])
    own -= forces["belt"] * np.array([1.0, 0.0, -0.5, 0.0])
    assert own == pytest.approx(needed, rel=1e-6, abs=1e-6 * np.abs(needed).max())
    limit = {one.name: (one.least, one.most) for one in result.forces}
    assert limit[names[1]] == (-7.0, 9.0)
    assert names[3] not in limit  # it follows, and has no drive


@pytest.mark.parametrize("cables", [False, True])
def test_units_of_a_file_change_no_share_of_a_limit(cables, tmp_path):
    file, *_ = platform(3, cables)
    (tmp_path / "m.yaml").write_text(yaml.safe_dump(file))
    body, legs = dict(file["body"]), dict(file["legs"])
    body["com"] = [1e3 * x for x in body["com"]]
    legs |= {"stiffness": 1e-6 * legs["stiffness"], "force": [1e-3 * x for x in legs["force"]]}
    if cables:
        legs["preload"] *= 1e-3
    other = file | {
        "units": {"length": "mm", "force": "kN"}, "legs": legs, "body": body,
        "base": (1e3 * np.array(file["base"])).tolist(),
        "platform": (1e3 * np.array(file["platform"])).tolist(),
        "pose": {"xyz": [1e3 * x for x in file["pose"]["xyz"]]},
    }  # fmt: skip
    (tmp_path / "mm.yaml").write_text(yaml.safe_dump(other))
    wrench, found = np.array([20.0, -10.0, 15.0, 90.0, 40.0, -60.0]), []
    for name, sizes in (("m", np.ones(6)), ("mm", np.repeat([1.0, 1e-3], 3))):
        elastic = cs.load(str(tmp_path / f"{name}.yaml")).with_gravity(EARTH)
        result = cs.analyse(elastic, wrench=wrench * sizes)
        held = cs.capacity(elastic, wrench=wrench * sizes)
        used = {one.name: one.used for one in result.forces}
        found.append((used, held, sizes[3]))
    (used, held, _), (used_too, held_too, force) = found
    assert used_too == pytest.approx(used, rel=1e-9)
    for one, two in (
        (held.linear, held_too.linear),
        (held.by_equilibrium, held_too.by_equilibrium),
    ):
        assert two.factor == pytest.approx(one.factor, rel=1e-6)
        assert (two.kind, two.names) == (one.kind, one.names)
    assert held_too.payload == pytest.approx(held.payload, rel=1e-9)
    way = np.random.default_rng(0).normal(size=(3, 40))
    far, far_too = (np.max(one.polytope @ way, axis=0) for one in (held, held_too))
    assert far_too == pytest.approx(force * far, rel=1e-9)


def test_limits_of_legs_by_name_are_those_of_their_own_keys(tmp_path):
    file, *_ = platform(1, cables=False)
    force = file["legs"].pop("force")
    legs = file["legs"] | {"limits": {"length": [0.2, 2.0], "force": [force[0], "=most"]}}
    path = tmp_path / "named.yaml"
    path.write_text(yaml.safe_dump(file | {"legs": legs, "parameters": {"most": force[1]}}))
    legs = file["legs"] | {"limits": [0.2, 2.0], "force": force}
    (tmp_path / "own.yaml").write_text(yaml.safe_dump(file | {"legs": legs}))
    named, own = (cs.load(str(tmp_path / f"{name}.yaml")) for name in ("named", "own"))
    assert named.force_limits == own.force_limits
    assert named.limits == own.limits
    words = f"analyse {path} --load 0,0,0,0,0,-400"
    few, more = (run(f"{words} --set most={x}") for x in ("10", "900"))
    assert "until leg" in few
    assert few.split("Holds")[1] != more.split("Holds")[1]
    for wrong, said in (
        ({"forces": [-1, 1]}, "unknown key of limits"),
        ({"force": [2, 1]}, "the wrong way round"),
    ):
        path.write_text(yaml.safe_dump(file | {"legs": file["legs"] | {"limits": wrong}}))
        run(f"analyse {path}", code=2, said=said)
    legs = file["legs"] | {"limits": {"force": [-1, 1]}, "force": [-1, 1]}
    path.write_text(yaml.safe_dump(file | {"legs": legs}))
    run(f"analyse {path}", code=2, said="give force or limits.force, not both")


def test_a_locked_joint_is_said_not_to_be_compared_and_a_rigid_one_is(tmp_path):
    names = tree(tmp_path / "r.urdf", np.random.default_rng(2), 3)
    file = {"kind": "serial", "model": "r.urdf", "frame": "b0l2"}
    springs = {name: {"stiffness": 1e4} for name in names if name != names[1]}
    locked = file | {"springs": springs, "locked": {names[1]: 0.3}}
    rigid = file | {"springs": springs | {names[1]: {"stiffness": "rigid"}}}
    found = []
    for name, one in (("locked", locked), ("rigid", rigid)):
        (tmp_path / f"{name}.yaml").write_text(yaml.safe_dump(one))
        elastic = cs.load(str(tmp_path / f"{name}.yaml"))
        q = [0.0, 0.0] if name == "locked" else [0.0, 0.3, 0.0]
        wrench = np.concatenate([np.zeros(3), LOAD])
        found.append(cs.analyse(elastic, q, wrench=wrench))
    said = [[note.values for note in r.notes if note.code == "locked-drives"] for r in found]
    assert said == [[{"joints": [names[1]]}], []]
    forces, more = ({one.name: one for one in result.forces} for result in found)
    assert names[1] not in forces
    assert more[names[1]].most == 40.0
    for name in forces:
        assert forces[name].force == pytest.approx(more[name].force, rel=1e-9)


def test_an_allowed_displacement_has_a_unit_of_its_own_and_orders_change_nothing(tmp_path):
    file, *_ = platform(2, cables=False)
    del file["legs"]["force"]
    (tmp_path / "m.yaml").write_text(yaml.safe_dump(file))
    words = f"analyse {tmp_path}/m.yaml --load 0,0,0,0,0,-400"
    lines = []
    for more in ("1e-4", "0.1mm", "100um --order linear-angular", "0.1mm --axes base"):
        text = run(f"{words} --allowed-displacement {more}")
        lines.append(next(line for line in text.splitlines() if "Holds" in line))
    assert len(set(lines)) == 1
    assert "until the allowed displacement is reached" in lines[0]
    result = cs.analyse(cs.load(str(tmp_path / "m.yaml")), wrench=[0, 0, 0, 0, 0, -400.0])
    held = cs.capacity(result.elastic_as_given, wrench=result.wrench, displacement=1e-4)
    far = np.linalg.norm((result.compliances["load"] @ result.wrench)[3:])
    assert held.linear.factor == pytest.approx(1e-4 / far, rel=1e-2)
    assert f"Holds {held.factor:.3g} times" in lines[0]


def test_the_search_goes_at_least_as_far_as_the_load(tmp_path):
    """The paper's platform buckles to first order at a three-hundredth of this load, at rest at a
    third of it, where its load curve turns."""
    elastic, wrench = cs.load("stewart-gough"), [0, 0, 0, 10.0, 20.0, -50.0]
    found = cs.capacity(elastic, wrench=wrench)
    turn = next(one for one in cs.load_curve(elastic, wrench=wrench, to=1.0).critical)
    assert found.by_equilibrium.kind == "buckling"
    assert found.factor == pytest.approx(turn.factor, rel=1e-6)


def test_weight_that_springs_balance_is_said_so(tmp_path):
    text = run("analyse ur5 --load 0,0,0,0,0,-100 --world --gravity 0,0,-9.81")
    assert "before the load the springs balance it at the posture" in text
