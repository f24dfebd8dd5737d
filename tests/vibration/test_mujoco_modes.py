"""Frequencies under load against MuJoCo: arms, platforms, closed chains."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.mechanisms.machines import write_file
from tests.vibration.mujoco_peer import Vibrating

from cartstiff import DeadForce, equilibrium, load, modes

mujoco = pytest.importorskip("mujoco")

#: Required; differences of forces give 1e-8 of omega^2.
FREQUENCIES = 1e-6
G = "0 0 -9.81"


def _numbers(values):
    return " ".join(f"{x:.12g}" for x in np.ravel(values))


def arm_xml(kinds, seed):
    """A chain of hinges H and slides S with random axes, offsets, masses and springs."""
    rng = np.random.default_rng(seed)
    text, closing, springs = "", "", {}
    for i, kind in enumerate(kinds):
        axis = rng.normal(size=3)
        hinge = kind == "H"
        k = rng.uniform(300, 900) * (1.0 if hinge else 20.0)
        ref = rng.uniform(-0.8, 0.8) * (1.0 if hinge else 0.1)
        springs[f"j{i}"] = {"stiffness": float(f"{k:.12g}"), "rest": float(f"{ref:.12g}")}
        moments = rng.uniform(0.4, 0.7, 3) * 0.1
        text += (
            f'<body name="b{i}" pos="{_numbers(rng.uniform(-0.2, 0.3, 3))}">'
            f'<inertial pos="{_numbers(rng.uniform(-0.1, 0.1, 3))}" '
            f'mass="{rng.uniform(0.5, 3):.12g}" diaginertia="{_numbers(moments)}"/>'
            f'<joint name="j{i}" type="{"hinge" if hinge else "slide"}" '
            f'axis="{_numbers(axis / np.linalg.norm(axis))}" stiffness="{k:.12g}" '
            f'springref="{ref:.12g}" armature="{0.05 * (i % 3):.12g}"/>'
        )
        closing += "</body>"
    text += '<site name="tip" pos="0.1 0.02 -0.03"/>' + closing
    head = f'<mujoco><compiler angle="radian" autolimits="true"/><option gravity="{G}"/>'
    return f"{head}<worldbody>{text}</worldbody></mujoco>", springs


def _loaded(folder, xml, **file):
    (folder / "model.xml").write_text(xml, encoding="utf-8")
    entries = {"model": "model.xml", "frame": "tip", "gravity": [0.0, 0.0, -9.81], **file}
    return load(write_file(folder, "model", **entries))


def _qpos(peer, names, values):
    q = peer.model.qpos0.copy()
    for name, value in zip(names, values, strict=True):
        q[peer.model.joint(name).qposadr[0]] = value
    return q


@pytest.mark.parametrize(
    ("kinds", "seed"),
    [("HHHHHH", 1), ("HHHHHHH", 2), ("HHSHHH", 3), ("HHHH", 4), ("SHHHHHH", 5), ("HHHHHH", 6)],
)
def test_arms(tmp_path, kinds, seed):
    xml, springs = arm_xml(kinds, seed)
    force = [20.0, -15.0, -40.0]
    q = {name: entry["rest"] for name, entry in springs.items()}
    elastic = _loaded(tmp_path, xml, kind="serial", springs=springs, q=q)
    state = equilibrium(elastic, DeadForce(force))
    peer = Vibrating(mujoco, xml, force)
    squares, left = peer.squares(_qpos(peer, elastic.names, state.q))
    assert left < 1e-9
    found = modes(state)
    assert np.abs(np.sqrt(squares) / np.sqrt(found.squares) - 1).max() < FREQUENCIES
    # The load is felt: other frequencies than without it, at the same posture.
    bare, _ = Vibrating(mujoco, xml).squares(_qpos(peer, elastic.names, state.q))
    assert np.abs(np.sqrt(bare / squares) - 1).max() > 100 * FREQUENCIES


# -- platforms ------------------------------------------------------------------------------------

BASE = [[np.cos(a), np.sin(a), 0.0] for a in np.deg2rad([5, 115, 125, 235, 245, 355])]
TOP = [
    [0.5 * np.cos(a), 0.5 * np.sin(a), 0.02 * i]
    for i, a in enumerate(np.deg2rad([50, 70, 170, 190, 290, 310]))
]
BODY = {
    "mass": 8.0,
    "com": [0.02, -0.01, 0.05],
    "inertia": [[0.3, 0.01, 0.0], [0.01, 0.4, 0.02], [0.0, 0.02, 0.6]],
}
STIFFNESS = [9e3, 8e3, 11e3, 7e3, 10e3, 12e3]
FIXED, MOVING = (0.6, 0.2), (0.4, 0.15)  # kg, m
STRUTS = {"fixed": 0.6, "moving": 0.4, "fixed_com": 0.2, "moving_com": 0.15}


def _platform(folder, **legs):
    return load(
        write_file(
            folder,
            "platform",
            kind="stewart-gough",
            base=BASE,
            platform=TOP,
            body=BODY,
            pose={"xyz": [0.05, -0.03, 0.9], "rpy": [0.05, -0.1, 0.2]},
            gravity=[0.0, 0.0, -9.81],
            legs={"stiffness": STIFFNESS, "rest_length": 1.0, **legs},
        )
    )


def _body_xml(sites):
    a = np.array(BODY["inertia"])
    full = [a[0, 0], a[1, 1], a[2, 2], a[0, 1], a[0, 2], a[1, 2]]
    points = "".join(
        f'<site name="{name}" pos="{_numbers(p)}"/>' for name, p in [("tip", [0, 0, 0]), *sites]
    )
    return (
        '<body name="platform"><freejoint/>'
        f'<inertial pos="{_numbers(BODY["com"])}" mass="{BODY["mass"]}" '
        f'fullinertia="{_numbers(full)}"/>{points}</body>'
    )


def _free(q):
    """MuJoCo's coordinates of a free body at x, y, z, roll, pitch, yaw."""
    x, y, z, w = Rotation.from_euler("xyz", q[3:]).as_quat()
    return [*q[:3], w, x, y, z]


def test_platform_on_lines(tmp_path):
    elastic = _platform(tmp_path)
    force = [120.0, -80.0, -300.0]
    state = equilibrium(elastic, DeadForce(force))
    world = "".join(f'<site name="a{i}" pos="{_numbers(p)}"/>' for i, p in enumerate(BASE))
    tendons = "".join(
        f'<spatial stiffness="{k}" springlength="1"><site site="a{i}"/><site site="b{i}"/>'
        "</spatial>"
        for i, k in enumerate(STIFFNESS)
    )
    xml = (
        f'<mujoco><option gravity="{G}"/><worldbody>{world}'
        f"{_body_xml([(f'b{i}', p) for i, p in enumerate(TOP)])}</worldbody>"
        f"<tendon>{tendons}</tendon></mujoco>"
    )
    squares, left = Vibrating(mujoco, xml, force).squares(np.array(_free(state.q)))
    assert left < 1e-9
    assert np.abs(np.sqrt(squares / modes(state).squares) - 1).max() < FREQUENCIES


def test_platform_on_struts_with_masses(tmp_path):
    """Six legs of two bars with joints of their own, closed at the platform."""
    elastic = _platform(tmp_path, mass=STRUTS)
    force = [120.0, -80.0, -300.0]
    state = equilibrium(elastic, DeadForce(force))
    R = Rotation.from_euler("xyz", state.q[3:]).as_matrix()
    rods, coordinates, ties = "", [], ""
    for i, (a, b) in enumerate(zip(BASE, TOP, strict=True)):
        along = R @ b + state.q[:3] - a
        length = np.linalg.norm(along)
        x, y, z = along / length
        coordinates += [np.arctan2(-y, z), np.arcsin(x), length]
        bars = [
            f'<inertial pos="0 0 {sign * c}" mass="{m}" diaginertia="{m * c * c / 3:.15g} '
            f'{m * c * c / 3:.15g} 1e-10"/>'
            for m, c, sign in ((*FIXED, 1), (*MOVING, -1))
        ]
        rods += (
            f'<body name="u{i}" pos="{_numbers(a)}"><joint axis="1 0 0"/><joint axis="0 1 0"/>'
            f'{bars[0]}<body name="p{i}"><joint type="slide" axis="0 0 1" '
            f'stiffness="{STIFFNESS[i]}" springref="1"/>{bars[1]}<site name="e{i}"/></body></body>'
        )
        ties += f'<connect site1="e{i}" site2="b{i}"/>'
    xml = (
        f'<mujoco><compiler angle="radian"/><option gravity="{G}"/><worldbody>{rods}'
        f"{_body_xml([(f'b{i}', p) for i, p in enumerate(TOP)])}</worldbody>"
        f"<equality>{ties}</equality></mujoco>"
    )
    q = np.array([*coordinates, *_free(state.q)])
    squares, left = Vibrating(mujoco, xml, force).squares(q)
    assert left < 1e-9
    assert np.abs(np.sqrt(squares / modes(state).squares) - 1).max() < FREQUENCIES


# -- closed chains --------------------------------------------------------------------------------

FIVE_BAR = f"""<mujoco><compiler angle="radian" autolimits="true"/><option gravity="{G}"/>
<worldbody>
<body name="left" pos="-0.15 0 0"><inertial pos="0.15 0 0" mass="2" diaginertia=".02 .03 .02"/>
<joint name="left" axis="0 -1 0" stiffness="400" springref="1.9"/>
<body name="bar" pos="0.3 0 0"><inertial pos="0.2 0 0" mass="1" diaginertia=".02 .02 .03"/>
<joint name="elbow" axis="0 -1 0" stiffness="30" springref="-1.2"/>
<site name="tip" pos="0.45 0 0.05"/></body></body>
<body name="right" pos="0.15 0 0"><inertial pos="0.15 0 0" mass="2" diaginertia=".03 .02 .02"/>
<joint name="right" axis="0 -1 0" stiffness="300" springref="1.2"/>
<body name="rod" pos="0.3 0 0"><inertial pos="0.2 0 0" mass="1" diaginertia=".02 .02 .02"/>
<joint name="wrist" axis="0 -1 0" stiffness="20" springref="1.0"/></body></body>
</worldbody>
<equality><connect body1="bar" body2="rod" anchor="0.4 0 0"/></equality></mujoco>"""

# Two legs of three joints in space that share a point.
TRIPOD = f"""<mujoco><compiler angle="radian" autolimits="true"/><option gravity="{G}"/>
<worldbody>
<body name="a1" pos="-0.3 0 0"><inertial pos="0 0 0.1" mass="2" diaginertia=".02 .03 .02"/>
<joint name="a1" axis="0 0 1" stiffness="250" springref="0.1"/>
<body name="a2" pos="0 0 0.2"><inertial pos="0.15 0.02 0" mass="1" diaginertia=".02 .02 .03"/>
<joint name="a2" axis="0 -1 0" stiffness="220" springref="0.9"/>
<body name="a3" pos="0.35 0 0"><inertial pos="0.1 0 0.01" mass="1" diaginertia=".01 .02 .02"/>
<joint name="a3" axis="0 -1 0.2" stiffness="180" springref="-0.8"/>
<site name="tip" pos="0.3 0.05 0.02"/></body></body></body>
<body name="c1" pos="0.3 0.1 0"><inertial pos="0 0 0.1" mass="2" diaginertia=".02 .03 .02"/>
<joint name="c1" axis="0 0 1" stiffness="200" springref="-0.1"/>
<body name="c2" pos="0 0 0.2"><inertial pos="-0.15 0 0" mass="1" diaginertia=".02 .02 .02"/>
<joint name="c2" axis="0 1 0.1" stiffness="260" springref="0.8"/>
<body name="c3" pos="-0.35 0 0"><inertial pos="-0.1 0 0" mass="1" diaginertia=".02 .02 .01"/>
<joint name="c3" axis="0 1 0" stiffness="150" springref="-0.7"/></body></body></body>
</worldbody>
<equality><connect body1="a3" body2="c3" anchor="0.25 0.02 0"/></equality></mujoco>"""


@pytest.mark.parametrize(
    ("xml", "force"),
    [(FIVE_BAR, [30.0, 0.0, -60.0]), (TRIPOD, [20.0, -12.0, -30.0])],
    ids=["five bar", "two legs in space"],
)
def test_closed_chains(tmp_path, xml, force):
    peer = Vibrating(mujoco, xml, force)
    names = [peer.model.joint(j).name for j in range(peer.model.njnt)]
    springs = {
        n: {
            "stiffness": float(peer.model.joint(n).stiffness[0]),
            "rest": float(peer.model.qpos_spring[peer.model.joint(n).qposadr[0]]),
        }
        for n in names
    }
    q = {n: s["rest"] for n, s in springs.items()}
    elastic = _loaded(tmp_path, xml, kind="closed-chain", springs=springs, q=q)
    state = equilibrium(elastic, DeadForce(force))
    squares, left = peer.squares(_qpos(peer, elastic.names, state.q))
    assert left < 1e-8
    found = modes(state)
    assert found.squares.size == peer.model.nv - (2 if xml is FIVE_BAR else 3)
    assert np.abs(np.sqrt(squares / found.squares) - 1).max() < FREQUENCIES
