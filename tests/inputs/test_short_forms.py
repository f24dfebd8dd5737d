"""Short forms that people write in mechanism files: springs by name, one mass for a leg."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from ruamel.yaml import YAML
from tests.doors import read_yaml
from tests.identify.campaigns import random_campaign, table_of
from tests.inner import SerialFile, bare
from tests.support.commands import run
from tests.support.robots import bundled_files

import cartstiff
from cartstiff import InputError, analyse

SET = "kuka-kr210/gbt-adl-2023"
#: Its numbers, N m/rad.
PUBLISHED = [2207200.0, 3376720.0, 2775690.0, 2350160.0, 2157460.0, 467056.0]
ROWS = [{"d": 0.3, "alpha": 1.5}, {"a": 0.5}, {"a": 0.1, "alpha": 1.5}, {"d": 0.6, "alpha": -1.5}]
ROWS += [{"alpha": 1.5}, {"d": 0.1}]
POSTURE = {f"j{i}": x for i, x in enumerate((0.1, -0.7, 0.9, 0.3, 0.8, -0.2), start=1)}


def written(folder, **data):
    path = folder / "file.yaml"
    path.write_text(json.dumps(data), encoding="utf-8")
    return path


def arm(folder, **data):
    dh = {"convention": "standard", "joints": ROWS}
    return written(folder, kind="serial", dh=dh, q=POSTURE, **data)


def codes(elastic):
    return {note.code: note for note in elastic.notes}


# -- springs by name -------------------------------------------------------------------------------


def test_published_springs_in_a_file(tmp_path):
    elastic = cartstiff.load(arm(tmp_path, springs=SET))
    np.testing.assert_allclose(elastic.springs.stiffness, PUBLISHED)
    assert codes(elastic)["published-springs"].values["name"] == SET
    assert "stiffness-assumed" not in codes(elastic)
    by_option = cartstiff.load(arm(tmp_path), springs=SET)
    np.testing.assert_array_equal(analyse(elastic).B.matrix, analyse(by_option).B.matrix)


def test_a_table_of_springs_beside_the_file(tmp_path, monkeypatch):
    rows = "".join(f"j{i},{i}\n" for i in range(1, 7))
    folder = tmp_path / "sub"
    folder.mkdir()
    (folder / "own.csv").write_text(f"joint,stiffness [N m/arcmin]\n{rows}", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    elastic = cartstiff.load(arm(folder, springs="own.csv"))
    expected = np.arange(1, 7) * 60 * 180 / np.pi
    np.testing.assert_allclose(elastic.springs.stiffness, expected, rtol=1e-12)


def test_springs_that_are_given_replace_those_by_name(tmp_path):
    other = cartstiff.load(arm(tmp_path, springs=SET), stiffness={"j2": 5.0})
    assert other.springs.stiffness.tolist() == [PUBLISHED[0], 5.0, *PUBLISHED[2:]]


@pytest.mark.parametrize(
    ("springs", "words"),
    [
        ("kuka-kr2100", r"file.yaml, line 1, key springs: unknown springs.*kuka-kr210/gbt"),
        ("kuka-kr500/gbt-adl-2023", "key springs.*not to be used"),
        ("fanuc.csv", "fanuc.csv"),
        (7, "key springs: cannot be used"),
        ("kuka-kr270/klimchik-2013", None),
    ],
)
def test_names_that_do_not_fit(tmp_path, springs, words):
    if words is None:  # five values for six joints: the first keeps what it had
        note = codes(cartstiff.load(arm(tmp_path, springs=springs)))["published-springs"]
        assert note.values["without_value"] == ["j1"]
        return
    with pytest.raises(InputError, match=words):
        cartstiff.load(arm(tmp_path, springs=springs))


def test_legs_have_springs_by_joint(tmp_path):
    dh = {"convention": "standard", "joints": ROWS}
    leg = {"dh": dh, "q": POSTURE, "springs": SET}
    with pytest.raises(InputError, match="a name is read in kind serial and closed-chain"):
        cartstiff.load(written(tmp_path, kind="parallel", legs=[leg, leg]))


# -- masses of legs in one number ------------------------------------------------------------------

BASE = [[np.cos(a), np.sin(a), 0] for a in (0.0, 0.2, 2.1, 2.3, 4.2, 4.4)]
TOP = [[np.cos(a) / 2, np.sin(a) / 2, 0] for a in (5.4, 1.0, 1.2, 3.1, 3.3, 5.2)]
POSE = {"xyz": [0.02, -0.03, 0.8], "rpy": [0.05, 0.02, 0.1]}


def platform(folder, mass, **more):
    data = {"kind": "stewart-gough", "base": BASE, "platform": TOP, "pose": POSE}
    return cartstiff.load(
        written(
            folder,
            **data,
            body={"mass": 2.0},
            gravity=[0, 0, -9.81],
            legs={"stiffness": 1e5, "mass": mass},
            **more,
        )
    )


def test_a_leg_with_one_mass_is_a_uniform_bar(tmp_path):
    elastic = platform(tmp_path, 0.2)
    assert elastic.masses["legs"] == pytest.approx(1.2)
    T = elastic.mechanism.at(elastic.q).pose
    ends = np.array(TOP) @ T[:3, :3].T + T[:3, 3]
    # A uniform bar's centre is in its middle: so is that of both halves together.
    energy = 9.81 * (0.2 * (ends[:, 2] / 2).sum() + 2.0 * T[2, 3])
    at_rest = elastic.mechanism.at(elastic.q).gravity(np.array([0, 0, -9.81])).energy
    assert at_rest == pytest.approx(energy, rel=1e-12)
    assert codes(elastic)["leg-mass-spread"].values["mass"] == [0.2] * 6
    lengths = np.linalg.norm(ends - BASE, axis=1) / 4
    halves = {"fixed": 0.1, "moving": 0.1}
    spelt = platform(
        tmp_path, halves | {"fixed_com": lengths.tolist(), "moving_com": lengths.tolist()}
    )
    np.testing.assert_allclose(analyse(elastic).B.matrix, analyse(spelt).B.matrix, rtol=1e-12)
    one, other = cartstiff.modes(elastic), cartstiff.modes(spelt)
    np.testing.assert_allclose(one.frequencies, other.frequencies, rtol=1e-9)
    assert "leg-mass-spread" not in codes(spelt)


def test_one_mass_for_each_leg(tmp_path):
    each = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]
    assert platform(tmp_path, each).masses["legs"] == pytest.approx(sum(each))
    with pytest.raises(InputError, match=r"legs.mass: wrong count; expected one, or 6"):
        platform(tmp_path, [0.1, 0.2])
    with pytest.raises(InputError, match=r"legs.mass"):
        platform(tmp_path, "heavy")


# -- refusals that say what is allowed ------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"legs": {"stiffness": 1e5, "mass": {"fixd": 1}}}, "one of fixed, moving, fixed_com, "),
        ({"legs": {"stifness": 1e5}}, "one of stiffness, strut, .*closest: stiffness"),
        ({"pose": {"xyz": [0, 0, 1], "quat": [1, 0, 0, 0]}}, r"one of xyz, rpy, got 'quat'"),
        ({"plattform": TOP}, "one of name, .*closest: platform"),
        (
            {"legs": {"stiffness": 1e5, "rest_length": "200 mm"}},
            "rest_length: cannot be used; expected a number in the unit of the file.* '20 N/mm', "
            "got '200 mm'",
        ),
        ({"pose": {"xyz": [0, 0, "1.2 m"]}}, "a number in the unit of the file.*got '1.2 m'"),
        ({"pose": {"xyz": [0, 0, "high"]}}, "expected a number, got 'high'"),
    ],
)
def test_a_refusal_says_what_is_allowed(tmp_path, change, words):
    data = {"kind": "stewart-gough", "base": BASE, "platform": TOP, "pose": POSE}
    path = written(tmp_path, **{**data, "legs": {"stiffness": 1e5}, **change})
    with pytest.raises(InputError, match=words):
        cartstiff.load(path)


def test_keys_of_the_kind_of_leg_that_is_meant(tmp_path):
    ring = {"radius": 1.0}
    by_name = {"chain": "UPS", "base": ring, "platform": ring, "axes": "radial"}
    with pytest.raises(InputError, match="one of chain, base, platform, symmetry, "):
        cartstiff.load(written(tmp_path, kind="parallel", legs=by_name))
    described = {"model": "arm.urdf", "frame": "tip", "grib": {}}
    with pytest.raises(InputError, match=r"one of dh, model, .*closest: grip"):
        cartstiff.load(written(tmp_path, kind="parallel", legs=[described]))


def test_a_link_with_two_parents_names_the_way_out():
    joint = '<joint name="{}" type="revolute"><parent link="{}"/><child link="c"/></joint>'
    text = '<robot name="r"><link name="a"/><link name="b"/><link name="c"/>{}{}</robot>'
    urdf = text.format(joint.format("j1", "a"), joint.format("j2", "b"))
    with pytest.raises(InputError, match=r"two parent joints.*'closures'.*kind closed-chain"):
        cartstiff.load(urdf)


@pytest.mark.parametrize(
    "texts", [("1e5", "yes", "0x10"), ("1:30", "é", "3."), ("~", "a - b: c", "null")]
)
def test_a_file_with_springs_that_were_found_is_the_same_file_otherwise(tmp_path, texts):
    """What `identify -o` writes, also as an independent reader of YAML 1.2 has it."""
    name, joint, source = texts
    rows = [row | {"name": f"j{i}"} for i, row in enumerate(ROWS, start=1)]
    rows[5] |= {"name": joint, "limits": [-1e16, 3]}
    posture = {**dict(list(POSTURE.items())[:5]), joint: 1e-5}
    dh = {"convention": "standard", "joints": rows}
    path, found = tmp_path / "file.yaml", tmp_path / "found.yaml"
    data = {"kind": "serial", "name": name, "source": source, "dh": dh, "q": posture}
    path.write_text(json.dumps(data | {"springs": SET}))
    truth = [*PUBLISHED[:2], 2e6, *PUBLISHED[3:]]
    q, W, d = random_campaign(cartstiff.load(path), truth, 6, 1, sd=1e-9, force=2e3)
    table = table_of(tmp_path / "m.csv", q, W, d)
    table.write_text(table.read_text().replace("j6", joint, 1))
    run("identify", path, table, "--unknown j3 --axes base -o", found)
    written, _ = read_yaml(found)
    assert YAML(typ="safe", pure=True).load(found.read_text("utf-8")) == written
    springs = [written["springs"][one]["stiffness"] for one in posture]
    assert springs[2] == pytest.approx(2e6, rel=1e-3)
    assert springs[:2] + springs[3:] == pytest.approx(PUBLISHED[:2] + PUBLISHED[3:], rel=1e-12)
    assert {key: written[key] for key in data} == data


# -- files that need no model ----------------------------------------------------------------------

_VALUES = st.sampled_from(
    [0.0, -0.0, 2, -3.5, 1e12, 1e300, 1e400, True, None, "rigid", "", "~x", [1]]
)
_TRIPLES = st.lists(_VALUES | st.floats(), min_size=2, max_size=4)
_NAMES = st.sampled_from(["j1", "elbow", "", 3])
_SPRINGS = st.dictionaries(st.sampled_from(["stiffness", "rest", "damping"]), _VALUES, max_size=3)
_FILES = st.fixed_dictionaries(
    {"kind": st.just("serial"), "model": st.sampled_from(["ur5", "a.urdf", "~nobody/a", "", 3])},
    optional={
        "name": _VALUES | st.just("x" * 4001),
        "source": st.just("measured"),
        "gravity": _TRIPLES | st.none(),
        "q": st.dictionaries(_NAMES, _VALUES, max_size=2),
        "springs": st.dictionaries(_NAMES, _SPRINGS, max_size=2) | st.just("kuka"),
        "passive": st.just([]),
    },
)


def plainly(value):
    """Numbers and texts of a file's value, whatever holds them."""
    if isinstance(value, dict):
        return {name: plainly(entry) for name, entry in value.items()}
    if hasattr(value, "xyz"):
        return [*value.xyz], [*value.rpy]
    if hasattr(value, "polynomial"):
        keys = ("stiffness", "rest", "polynomial", "points", "table", "damping")
        return [repr(getattr(value, key)) for key in keys]
    return repr([*value] if isinstance(value, (list, tuple)) else value)


def assert_same(short, model):
    own = {*vars(short)}
    assert {*SerialFile.model_fields} == own - {"model_fields_set", "named_folders"} | {"kind"}
    for key in SerialFile.model_fields:
        assert plainly(getattr(short, key)) == plainly(getattr(model, key)), key
    assert short.model_fields_set - {"kind"} == model.model_fields_set - {"kind"}


@given(_FILES)
def test_a_short_file_is_read_as_its_model_reads_it(data):
    """What the short way accepts, the model accepts, with the same values."""
    if (short := bare.short_file(data)) is not None:
        assert_same(short, SerialFile.model_validate(data))


def test_bundled_arms_are_short_files():
    found = set()
    for name, path in bundled_files().items():
        data, _ = read_yaml(path)
        if (short := bare.short_file(data)) is not None:
            assert_same(short, SerialFile.model_validate(data))
            found.add(name)
    assert {"ur5", "ur10", "panda", "xarm7"} <= found


def test_a_robot_alone_has_the_defaults_of_a_file():
    """With overrides of frame, tool, gravity and packages in the same places."""
    alone, model = bare.Bare(model="ur5"), SerialFile.model_construct(kind="serial", model="ur5")
    assert_same(alone, model)
    more = {"locked": {"elbow_joint": 1.0}, "gravity": [0.0, 0.0, -9.81]}
    assert_same(alone.model_copy(update=more), model.model_copy(update=more))
    ros = {"a": "1"}, ["/folder"]
    assert_same(alone.with_ros(*ros), model.with_ros(*ros))
    assert alone.with_ros(*ros).named_folders == model.with_ros(*ros).named_folders
