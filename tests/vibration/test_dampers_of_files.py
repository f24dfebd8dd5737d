"""Dampers that a URDF or an MJCF file has."""

import numpy as np
import pytest
from tests.doors import poles

import cartstiff
from cartstiff.vibration import Damping, frequency_response

BODY = '<inertial><mass value="2"/><origin xyz="0.5 0 0"/>' + (
    '<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>'
)


def joint(name, parent, child, more=""):
    """A hinge about z."""
    return (
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="1 0 0"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" '
        f'velocity="1"/><dynamics damping="3.5"/>{more}</joint>'
    )


URDF = (
    f'<robot name="a"><link name="b"/><link name="c">{BODY}</link><link name="d">{BODY}</link>'
    + joint("one", "b", "c")
    + joint("two", "c", "d", '<mimic joint="one" multiplier="2"/>')
    + "</robot>"
)
MJCF = """<mujoco><worldbody><body name="c"><joint name="one" type="hinge" axis="0 0 1"
stiffness="500" damping="2.5"/><geom type="sphere" size="0.1" mass="2" pos="0.5 0 0"/></body>
</worldbody></mujoco>"""


def test_a_urdf_s_dampers_act_and_followers_add_theirs(tmp_path):
    file = tmp_path / "a.urdf"
    file.write_text(URDF)
    elastic = cartstiff.load(file, frame="d")
    assert elastic.damping == pytest.approx([3.5 * (1 + 2**2)])
    found = cartstiff.modes(elastic)
    m, k = found.mass[0, 0], found.stiffness[0, 0]
    wanted = 17.5 / (2 * np.sqrt(m * k))
    assert poles(found, Damping())[1] == pytest.approx([wanted])
    response = frequency_response(found, [1.0])
    assert [note.code for note in response.notes] == ["dampers-act"]
    assert response.notes[0].values == {"one": 17.5}
    still = frequency_response(found, [1.0], Damping(dampers=False))
    assert [note.code for note in still.notes] == ["undamped-response"]


def test_a_mechanism_file_has_the_last_word(tmp_path):
    (tmp_path / "a.urdf").write_text(URDF)
    file = tmp_path / "a.yaml"
    file.write_text(
        "kind: serial\nmodel: a.urdf\nframe: d\nsprings: {one: {stiffness: 100, damping: 0}}\n"
    )
    assert cartstiff.load(file).damping is None


@pytest.mark.parametrize(("flag", "wanted"), [("enable", [2.5]), ("disable", None)])
def test_an_mjcf_s_dampers_act_unless_it_switches_them_off(tmp_path, flag, wanted):
    pytest.importorskip("mujoco")
    file = tmp_path / "a.xml"
    option = f'<option><flag damper="{flag}"/></option>'
    file.write_text(MJCF.replace("<worldbody>", option + "<worldbody>"))
    elastic = cartstiff.load(file)
    assert elastic.damping is None if wanted is None else elastic.damping == pytest.approx(wanted)


def test_an_mjcf_s_balls_are_damped_about_each_turn(tmp_path):
    """A ball on springs, in the file's orientation: MuJoCo damps all turns alike."""
    pytest.importorskip("mujoco")
    (tmp_path / "a.xml").write_text(
        MJCF.replace(
            'type="hinge" axis="0 0 1"\nstiffness="500" damping="2.5"', 'type="ball" damping="0.5"'
        )
    )
    names = cartstiff.load(tmp_path / "a.xml").names
    assert len(names) == 3
    springs = ", ".join(f"{name}: {{stiffness: 80}}" for name in names)
    file = tmp_path / "a.yaml"
    file.write_text(f"kind: serial\nmodel: a.xml\nframe: c\nsprings: {{{springs}}}\n")
    elastic = cartstiff.load(file)
    assert elastic.damping == pytest.approx([0.5] * 3)
    found = cartstiff.modes(elastic)
    wanted = 0.5 / (2 * np.sqrt(80 * np.diag(found.full_mass)))
    assert np.sort(poles(found, Damping())[1]) == pytest.approx(np.sort(wanted))
