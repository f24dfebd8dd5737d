"""Links that have an inertia and no mass: rotors, as files of drives and of the Puma give them."""

import numpy as np
import pytest

import cartstiff

WHEEL, SPRING = 0.02, 50.0  # kg m^2, N m/rad

URDF = f"""<robot name="drive"><link name="base"/><link name="shaft"/><link name="wheel">
<inertial><mass value="0"/>
<inertia ixx="{WHEEL}" iyy="{WHEEL}" izz="{WHEEL}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="turn" type="continuous"><parent link="base"/><child link="shaft"/><axis xyz="0 0 1"/>
</joint>
<joint name="hub" type="fixed"><parent link="shaft"/><child link="wheel"/></joint></robot>"""


@pytest.fixture
def drive(tmp_path):
    path = tmp_path / "drive.urdf"
    path.write_text(URDF)
    return path


def test_a_wheel_without_mass_swings_on_its_spring(drive):
    (frequency,) = cartstiff.modes(cartstiff.load(drive, stiffness=SPRING)).frequencies
    assert frequency == pytest.approx(np.sqrt(SPRING / WHEEL) / (2 * np.pi), rel=1e-12)


def test_it_does_beyond_a_link_that_gives(drive):
    stiffness = np.diag([30.0, 30.0, 30.0, 1e9, 1e9, 1e9]).tolist()
    path = drive.with_name("drive.yaml")
    path.write_text(
        "kind: serial\nmodel: drive.urdf\nframe: wheel\n"
        f"springs: {{turn: {{stiffness: {SPRING}}}}}\n"
        f"flexible: {{shaft: {{stiffness: {stiffness}}}}}\n"
    )
    frequencies = cartstiff.modes(cartstiff.load(path)).frequencies
    # About z both springs are in a row; about x and y there is only the link's own.
    in_a_row = 1 / (1 / SPRING + 1 / 30.0)
    expected = np.sqrt(np.array([in_a_row, 30.0, 30.0]) / WHEEL) / (2 * np.pi)
    assert frequencies[:3] == pytest.approx(expected, rel=1e-9)
