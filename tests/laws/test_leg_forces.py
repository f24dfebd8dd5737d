"""The force of every leg under weight and load, by statics of the body, in every command."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from tests.doors import LoadKind, Margins, with_rest_balancing
from tests.mechanisms.machines import write_file
from tests.support.pages import message_of, source_of, tab_of
from tests.view.conftest import NoPicture

import cartstiff
from cartstiff.geometry import se3
from cartstiff.maps import Trajectory, compute_map, open_map

FIELD, MASS, COM = np.array([0.0, 0.0, -9.81]), 40.0, np.array([0.03, -0.02, 0.05])
STRUT = {"fixed": 3.0, "moving": 2.0, "fixed_com": 0.2, "moving_com": 0.15}
LOAD = np.array([2.0, -3.0, 1.0, 50.0, -20.0, 90.0])
Q = [0.02, -0.03, 0.61, 0.05, -0.04, 0.1]
LAYOUT = {
    "base": {"radius": 0.5, "half_angle": 0.15},
    "platform": {"radius": 0.25, "half_angle": 0.2},
    "height": 0.6,
}
ACTING = {"weight": (True, False), "load": (False, True), "both": (True, True)}


def _file(kind: str, weighs: bool, forces) -> dict:
    legs = {"stiffness": 1e6, "limits": [0.3, 2.0], "force": forces}
    if kind == "struts":
        legs["mass"] = STRUT
    file = {
        "kind": "stewart-gough",
        "layout": LAYOUT,
        "legs": legs,
        "body": {"mass": MASS, "com": COM.tolist(), "inertia": np.eye(3).tolist()},
    }
    if kind == "cables":  # from above: the same machine upside down
        up = [[x, y, 1.2] for x, y in _ring(0.5, 0.15)]
        points = [[x, y, 0.0] for x, y in _ring(0.25, 0.2, np.pi / 3)]
        body = file["body"]
        legs = {"stiffness": 1e6, "force": forces}
        order = [5, 0, 1, 2, 3, 4]
        points = [points[i] for i in order]
        file = {"kind": "springs", "base": up, "platform": points, "legs": legs, "body": body}
        file["pose"] = {"xyz": Q[:3], "rpy": Q[3:]}
        file["unilateral"] = True
    return file | ({"gravity": FIELD.tolist()} if weighs else {})


def _ring(radius, half, turn=0.0):
    angles = [turn + 2 * np.pi / 3 * k + s * half for k in range(3) for s in (-1, 1)]
    return radius * np.column_stack([np.cos(angles), np.sin(angles)])


def _forces(elastic, pose, wrench_F, weighs):
    """Tensions at a pose from forces and moments about F's origin; a bar's ends share its weight.

    A bar between two ball joints, of mass m at a share s of the way to the body, is held across
    itself by its ends as a lever; along itself the drive is between the two bars.
    """
    platform = elastic.mechanism
    R, p = pose[:3, :3], pose[:3, 3]
    b = platform.points @ R.T + p
    along = b - platform.anchors
    L = np.linalg.norm(along, axis=1)
    u = along / L[:, None]
    m, f = wrench_F[:3] + np.cross(p, wrench_F[3:]), wrench_F[3:]
    if weighs:
        f = f + MASS * FIELD
        m = m + np.cross(R @ COM + p, MASS * FIELD)
    if weighs and platform.struts is not None:
        for k in range(6):
            across = FIELD - (FIELD @ u[k]) * u[k]
            on_body = STRUT["moving"] * (FIELD @ u[k]) * u[k]  # the upper bar hangs on the body
            lever = STRUT["fixed"] * STRUT["fixed_com"] + STRUT["moving"] * (
                L[k] - STRUT["moving_com"]
            )
            on_body = on_body + across * lever / L[k]
            f, m = f + on_body, m + np.cross(b[k], on_body)
    rows = np.vstack([u.T, np.cross(b, u).T])
    return np.linalg.solve(rows, np.concatenate([f, m]))


@pytest.mark.parametrize("acting", ACTING)
@pytest.mark.parametrize("kind", ["legs", "struts", "cables"])
def test_every_command_has_the_forces_of_statics(tmp_path, kind, acting):
    weighs, is_loaded = ACTING[acting]
    W = LOAD if is_loaded else None
    if kind == "cables" and is_loaded:
        W = LOAD * [1, 1, 1, 0.5, 0.5, -4.0]  # one that cables from above can hold
    path = write_file(tmp_path, **_file(kind, weighs, [-1e5, 1e5]))
    elastic = cartstiff.load(path)
    pose = elastic.mechanism.at(Q).pose
    in_room = (
        np.zeros(6) if W is None else np.concatenate([pose[:3, :3] @ W[:3], pose[:3, :3] @ W[3:]])
    )
    expected = _forces(elastic, pose, in_room, weighs)
    if kind != "cables" and acting == "weight":
        assert (expected < 0.0).all()  # legs below the body push, which is no tension
    if kind == "cables":
        assert (expected > 0.0).all()

    near = {"rel": 1e-9, "abs": 1e-9 * np.abs(expected).max()}
    result = cartstiff.analyse(elastic, Q, wrench=W)
    found = result.elastic.springs.tensions(result.posture.lines.lengths)
    assert found == pytest.approx(expected, **near)

    # Limits a hair around each force are kept, and limits around its opposite are not.
    room = 1e-6 * np.abs(expected).max()
    load = None if W is None else (LoadKind(), in_room, "world")
    for sign, state in ((1.0, "regular"), (-1.0, "beyond-limits")):
        if kind == "cables" and sign < 0.0:
            continue  # cables that push are refused
        bounds = np.sort(sign * np.stack([expected - room, expected + room], 1)).tolist()
        limited = cartstiff.load(write_file(tmp_path, **_file(kind, weighs, bounds)))
        margins = Margins(limited, load)
        values = dict(zip(margins.names, margins.at(pose[None])[0], strict=True))
        if kind == "cables":
            assert values["tensions"] > 0.0
            assert margins.distribution(pose)["at_centre"] == pytest.approx(expected, **near)
        else:
            for i, t in enumerate(expected):
                least = values[f"force of leg{i + 1}, least"]
                most = values[f"force of leg{i + 1}, most"]
                assert [least + bounds[i][0], bounds[i][1] - most] == pytest.approx([t, t], **near)
        file = tmp_path / f"{state}.zarr"
        compute_map(limited, Trajectory(np.array([Q])), ["translation_held_min"], file, wrench=W)
        states = open_map(file).load()["state"]
        assert states.attrs["flag_meanings"].split()[int(states.values.ravel()[0])] == state

    # The page states a load along the room's axes, unless it is told otherwise.
    session = tab_of(source_of(elastic), NoPicture)
    for named, given in (({}, in_room), ({"load_axes": "body"}, W)):
        load = None if W is None else given.tolist()
        state = session.start.model_dump() | {"q": list(Q), "load": load} | named
        message = json.dumps({"id": 1, "do": "numbers", "state": state})
        legs = session.answer(message_of(message)).data["numbers"]["legs"]
        assert [leg["tension"] for leg in legs] == pytest.approx(expected, **near)

    # At rest the load has the axes of the start, and the legs their lengths there.
    chosen = with_rest_balancing(elastic, Q, wrench=W if kind == "cables" and not weighs else None)
    rest = cartstiff.equilibrium(chosen, q=Q, wrench=W, limits=False)
    at_rest = chosen.springs.tensions(rest.posture.lines.lengths)
    assert at_rest == pytest.approx(
        _forces(elastic, rest.pose, in_room, weighs), rel=1e-6, abs=1e-5
    )

    if kind != "cables":
        mode = cartstiff.assemble(elastic, q=Q, wrench=W, every=False).modes[0]
        assert np.allclose(mode.q, Q, atol=1e-9)
        exerted = mode.result.elastic.springs.tensions(mode.result.posture.lines.lengths)
        assert exerted == pytest.approx(expected, rel=1e-6, abs=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize(("forces", "is_within"), [([-400, 100], True), ([-100, 400], False)])
def test_legs_below_a_heavy_body_push(tmp_path, forces, is_within):
    """100 kg on six legs, 194 N of thrust in each: volume as of a grid of 110^3 positions."""
    file = _file("legs", True, forces)
    file["layout"] = LAYOUT | {
        "base": {"radius": 0.5, "half_angle": 0.1},
        "platform": {"radius": 0.25, "half_angle": 0.1},
    }
    file["legs"]["limits"] = [0.5, 1.2]
    file["body"] = {"mass": 100, "com": [0, 0, 0]}
    found = cartstiff.workspace(cartstiff.load(write_file(tmp_path, **file)), fits=False)
    assert found.volume == pytest.approx(0.1422 if is_within else 0.0, abs=0.001)
    assert (found.margin > 0.0) == is_within


def test_cables_hang_below_their_anchors(tmp_path):
    cell = cartstiff.load(write_file(tmp_path, **_file("cables", True, [1.0, 2000.0])))
    found = cartstiff.workspace(cell, directions=60, scan=16, radius=1.5, fits=False)
    heights = found.boundary[:, 2]
    assert found.volume > 0.0
    assert heights.max() < 1.2
    pushed = replace(cell, gravity=-cell.gravity)
    assert cartstiff.workspace(pushed, directions=60, scan=16, radius=0.5, fits=False).margin < 0.0
    assert se3.inverse(found.pose)[:3, 3] == pytest.approx(-np.array(Q[:3]) @ found.pose[:3, :3])


def test_legs_that_are_potentials_are_as_stiff_and_have_no_tensions():
    elastic = cartstiff.load("stewart-gough")
    known = cartstiff.analyse(elastic)
    legs = replace(elastic, springs=None, potentials=(known.elastic.springs,))
    result = cartstiff.analyse(legs)
    np.testing.assert_allclose(result.matrices["B"], known.matrices["B"], rtol=1e-9)
    np.testing.assert_allclose(result.wrench, known.wrench, rtol=1e-9, atol=1e-9)
    assert "force-limits" not in [note.code for note in result.notes]
