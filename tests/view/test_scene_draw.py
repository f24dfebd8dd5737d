"""The picture against the matrices: ellipsoids, arrows, legs and lines are where they belong."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm
from tests.support import twist_matrix
from tests.support.pages import colour
from tests.support.read_units import read, si
from tests.view.viewer import Viewer, visualizer

import cartstiff
from cartstiff import InputError
from cartstiff.core.errors import UnknownNameError
from cartstiff.scene import Appearance, RecordingWindow, Scene, add_ellipsoid

ROOT = "/meshcat/cartstiff"
# Lengths go through a single division and square roots.
ROUNDING = 1e-9


class Drawing:
    """A scene and the viewer that looks at it."""

    def __init__(self, name: str, q: Any = None, wrench: Any = None) -> None:
        self.elastic = cartstiff.load(name)
        self.window = RecordingWindow()
        self.scene = Scene(visualizer(self.window), self.elastic)
        self.viewer = Viewer()
        self.result = cartstiff.analyse(self.elastic, q, wrench=wrench)

    def draw(self, **look: Any) -> dict[str, Any]:
        legend = self.scene.draw(self.result, Appearance(**look))
        self.viewer.feed(self.window.take())
        return legend

    def body(self, freedom: str, quantity: str = "stiffness") -> str:
        return f"{ROOT}/{freedom} ellipsoid/{quantity}/body"


def platform(wrench: Any = (3, -1, 2, 4, 5, 6)) -> Drawing:
    return Drawing("hexapod", [0.05, -0.02, 0.03, 0.1, -0.2, 0.3], wrench)


BLOCKS = {"rotation": slice(0, 3), "translation": slice(3, 6)}


@pytest.mark.parametrize("connection", ["A", "B", "K", "F", "+"])
@pytest.mark.parametrize("quantity", ["stiffness", "compliance"])
def test_ellipsoids_are_images_of_the_unit_ball(connection, quantity):
    """With the linear scale the drawn body is {K u / scale}: its L satisfies L L^T = (K / s)^2."""
    drawing = platform()
    legend = drawing.draw(connection=connection, quantity=quantity, scale="linear")
    source = drawing.result.matrices if quantity == "stiffness" else drawing.result.compliances
    M = source["A" if connection == "+" else connection]
    R = drawing.result.pose[:3, :3]
    for freedom, block in BLOCKS.items():
        facts = legend["ellipsoids"][freedom]
        assert facts["shown"]
        K = R @ (0.5 * (M + M.T))[block, block] @ R.T / facts["scale"]["value_per_length"]
        L = drawing.viewer.world(drawing.body(freedom, quantity))
        np.testing.assert_allclose(L[:3, :3] @ L[:3, :3].T, K @ K, atol=ROUNDING)
        np.testing.assert_allclose(L[:3, 3], drawing.result.pose[:3, 3], atol=ROUNDING)
        assert np.linalg.det(L[:3, :3]) > 0
        largest = max(facts["radii"]) / legend["length"]["size"]
        assert 0.05 < largest < 0.3


def test_freedoms_held_and_free():
    """Free stiffness is the inverse of the block of the compliance, and the other way round."""
    drawing = platform()
    K, C = drawing.result.matrices["B"], drawing.result.compliances["B"]
    for freedom, block in BLOCKS.items():
        for quantity, others, expected in (
            ("stiffness", "held", K[block, block]),
            ("stiffness", "free", np.linalg.inv(C[block, block])),
            ("compliance", "free", C[block, block]),
            ("compliance", "held", np.linalg.inv(K[block, block])),
        ):
            legend = drawing.draw(connection="B", quantity=quantity, others=others)
            np.testing.assert_allclose(
                legend["ellipsoids"][freedom]["eigenvalues"],
                np.linalg.eigvalsh(0.5 * (expected + expected.T)),
                rtol=1e-8,
            )


def test_logarithmic_radii_are_as_the_legend_says():
    drawing = platform()
    legend = drawing.draw(scale="log")
    for freedom in BLOCKS:
        facts = legend["ellipsoids"][freedom]
        scale = facts["scale"]
        values = np.array(facts["eigenvalues"])
        expected = np.log10(values / scale["zero_at"]) * scale["length_per_decade"]
        L = drawing.viewer.world(drawing.body(freedom))
        np.testing.assert_allclose(np.linalg.norm(L[:3, :3], axis=0), expected, atol=ROUNDING)
        # Each axis runs through the centre, as long as the ellipsoid, and says its value.
        for i in range(3):
            place = drawing.body(freedom).replace("body", f"axis {i + 1}")
            M = drawing.viewer.world(place)
            np.testing.assert_allclose(np.linalg.norm(M[:3, 0]), 2 * expected[i], atol=ROUNDING)
            np.testing.assert_allclose(M[:3, 3] + 0.5 * M[:3, 0], L[:3, 3], atol=ROUNDING)
            np.testing.assert_allclose(
                np.abs(M[:3, 0] @ L[:3, i]), 2 * expected[i] ** 2, atol=ROUNDING
            )
            text = drawing.viewer.text(place.replace("axis", "value"))
            words = text.removeprefix("softest ").removeprefix("stiffest ")
            assert text.startswith(("softest ", "", "stiffest ")[i])
            assert read(words) == pytest.approx(values[i] * si(facts["unit"]), rel=6e-3)


def test_the_reference_point_moves_the_ellipsoid_and_the_moment():
    """K at p by the change of twists at the end-effector: x = X x' with X of a translation."""
    drawing = platform()
    p = np.array([0.1, -0.05, 0.2])
    legend = drawing.draw(connection="B", scale="linear", point=tuple(p))
    P = np.array([[0, -p[2], p[1]], [p[2], 0, -p[0]], [-p[1], p[0], 0]])
    # v at M of a body turning about the point p: v = v_p - omega x p = v_p + p x omega.
    X = np.block([[np.eye(3), np.zeros((3, 3))], [P, np.eye(3)]])
    K = X.T @ drawing.result.matrices["B"] @ X
    for freedom, block in BLOCKS.items():
        np.testing.assert_allclose(
            legend["ellipsoids"][freedom]["eigenvalues"],
            np.linalg.eigvalsh(K[block, block]),
            rtol=1e-8,
        )
    at = drawing.result.pose[:3, 3] + drawing.result.pose[:3, :3] @ p
    L = drawing.viewer.world(drawing.body("translation"))
    np.testing.assert_allclose(L[:3, 3], at, atol=ROUNDING)
    W = drawing.result.wrench
    np.testing.assert_allclose(legend["wrench"]["wrench"], X.T @ W, rtol=1e-9, atol=1e-9)


def test_an_indefinite_matrix_has_no_ellipsoid():
    """The paper's platform: its rotational stiffness is indefinite; its axes are still shown."""
    drawing = Drawing("stewart-gough")
    legend = drawing.draw(scale="linear")
    facts = legend["ellipsoids"]["rotation"]
    assert not facts["shown"]
    assert facts["definiteness"] == "indefinite"
    assert "indefinite, softest -511" in facts["reason"]
    viewer, body = drawing.viewer, drawing.body("rotation")
    assert not viewer.visible(body)
    parts = [body.replace("body", f"axis {i}") for i in (1, 3)]
    negative, positive = (
        viewer.places[f"{part}/{sign}"].object["materials"][0]["color"]
        for part, sign in zip(parts, ("minus", "plus"), strict=True)
    )
    assert viewer.visible(f"{parts[0]}/minus")
    assert not viewer.visible(f"{parts[0]}/plus")
    assert negative == colour("negative")
    assert positive != negative
    assert viewer.text(body.replace("body", "value 1")) == "-511 N cm/rad"
    assert viewer.visible(drawing.body("translation"))


def test_a_singular_matrix_is_a_disc_or_a_rod():
    drawing = Drawing("grasp")
    facts = drawing.draw()["ellipsoids"]["rotation"]
    assert facts["definiteness"] == "positive semidefinite"
    assert "one principal value is zero: drawn as a disc" in facts["reason"]
    assert facts["radii"][0] == 0.0
    body = drawing.body("rotation")
    assert drawing.viewer.visible(body)
    lengths = np.linalg.norm(drawing.viewer.world(body)[:3, :3], axis=0)
    assert 0 < lengths[0] < 0.2 * lengths[1]
    assert lengths[1:] == pytest.approx(facts["radii"][1:])
    rod = add_ellipsoid(visualizer(RecordingWindow()), np.diag([0.0, 3.0, 0.0]))
    assert rod["shown"]
    assert "two principal values are zero: drawn as a rod" in rod["reason"]


def test_what_does_not_exist_has_its_reason():
    drawing = Drawing("five-bar")
    legend = drawing.draw(centres=True)
    for facts in (legend["ellipsoids"]["translation"], legend["centres"]):
        assert facts["shown"] is False
        assert "cannot move in 4 of 6 directions" in facts["reason"]
    assert "six" in Drawing("cable-robot").draw(connection="F")["ellipsoids"]["rotation"]["reason"]


def test_switched_off_means_gone():
    drawing = platform()
    drawing.draw(centres=True, deflection=True)
    legend = drawing.draw(translation=False, rotation=False, wrench=False, frames=False, grid=False)
    shown = [p for p in drawing.viewer.below(ROOT) if not p.startswith(f"{ROOT}/mechanism")]
    assert shown == []
    assert legend["ellipsoids"] == {"translation": None, "rotation": None}
    assert legend["wrench"] is legend["deflection"] is legend["centres"] is None


def test_wrench_arrows_start_at_the_body_and_follow_the_wrench():
    drawing = platform()
    legend = drawing.draw()
    R, W = drawing.result.pose[:3, :3], drawing.result.wrench
    for kind, part in (("force", W[3:]), ("moment", W[:3])):
        M = drawing.viewer.world(f"{ROOT}/wrench/{kind}/arrow")
        scale, size = legend["wrench"]["scale"][kind], np.linalg.norm(part)
        length = scale["length_per_decade"] * np.log10(1 + size / scale["zero_at"])
        np.testing.assert_allclose(M[:3, 0], length * R @ part / size, atol=ROUNDING)
        np.testing.assert_allclose(M[:3, 3], drawing.result.pose[:3, 3], atol=ROUNDING)
        assert np.linalg.det(M[:3, :3]) > 0  # a mirrored ring would turn the wrong way
        size = float(drawing.viewer.text(f"{ROOT}/wrench/{kind}/label").split(" ")[0])
        assert size == pytest.approx(np.linalg.norm(part), rel=6e-3)


def test_a_larger_load_never_has_a_shorter_arrow_or_deflection():
    drawing = Drawing("ur5")
    lengths = []
    for size in 10.0 ** np.arange(-3, 6, 0.05):
        drawing.result = cartstiff.analyse(drawing.elastic, wrench=[0, size / 9, 0, 0, 0, -size])
        facts = drawing.draw(deflection=True)
        arrows = [
            np.linalg.norm(drawing.viewer.world(f"{ROOT}/{path}/arrow")[:3, 0])
            for path in ("wrench/force", "wrench/moment", "deflection/displacement")
        ]
        moved = facts["deflection"]
        assert arrows[2] == pytest.approx(moved["exaggeration"] * moved["displacement"])
        lengths.append(arrows)
        if size > 1e3:  # the springs of this arm buckle under more
            break
    lengths = np.array(lengths)
    assert (np.diff(lengths, axis=0) > 0).all()
    assert lengths[-1].max() < 0.3  # of an arm that reaches 0.85 m


@pytest.mark.parametrize(("force", "is_covered"), [((0, 0, -100), True), ((60, 0, -80), False)])
def test_a_displacement_is_drawn_beside_a_force_that_would_cover_it(force, is_covered):
    drawing = Drawing("ur5" if not is_covered else "cubic")
    drawing.result = cartstiff.analyse(drawing.elastic, wrench=[0, 0, 0, *force])
    drawing.draw(deflection=True)
    paths = (f"{ROOT}/wrench/force/arrow", f"{ROOT}/deflection/displacement/arrow")
    pushed, moved = (drawing.viewer.world(path) for path in paths)
    away = moved[:3, 3] - pushed[:3, 3]
    along = pushed[:3, 0] / np.linalg.norm(pushed[:3, 0])
    assert abs(away @ along) < 1e-12
    heads = 3 * 0.022 * sum(np.linalg.norm(T[:3, 0]) for T in (pushed, moved))
    assert (np.linalg.norm(away) > heads) == is_covered


def test_a_load_that_is_rounding_is_no_arrow():
    drawing = Drawing("delta")
    assert np.abs(drawing.result.wrench).max() < 1e-9
    legend = drawing.draw()
    assert legend["wrench"]["force"] == legend["wrench"]["moment"] == 0.0
    assert drawing.viewer.below(f"{ROOT}/wrench") == []


@pytest.mark.parametrize(
    ("connection", "exaggeration"), [("A", None), ("A", 123.0), ("+", None), ("K", None)]
)
def test_deflection_is_enlarged_by_the_factor_stated(connection, exaggeration):
    drawing = platform((300, -100, 200, 4000, 5000, 6000))
    added = np.array([20.0, -10, 5, 300, 100, -500])
    facts = drawing.draw(
        connection=connection, deflection=True, added=tuple(added), exaggeration=exaggeration
    )["deflection"]
    A = drawing.result.matrices["A"]
    K = {"A": A, "+": A.T, "K": drawing.result.matrices["K"]}[connection]
    twist = np.linalg.solve(K, added)
    factor = facts["exaggeration"]
    if exaggeration is not None:
        assert factor == exaggeration
    np.testing.assert_allclose(facts["twist"], twist, rtol=1e-8)
    T = drawing.result.pose
    np.testing.assert_allclose(
        drawing.viewer.world(f"{ROOT}/deflection/frame"),
        T @ expm(twist_matrix(factor * twist)),
        atol=1e-8,
    )
    arrow = drawing.viewer.world(f"{ROOT}/deflection/displacement/arrow")
    np.testing.assert_allclose(arrow[:3, 0], factor * T[:3, :3] @ twist[3:], atol=1e-8)


def test_legs_join_their_points_and_show_their_tension():
    drawing = Drawing("stewart-gough")
    legend = drawing.draw()
    plate = drawing.elastic.mechanism
    T = drawing.result.pose
    lengths = []
    for i in range(6):
        M = drawing.viewer.world(f"{ROOT}/mechanism/legs/line {i + 1}/rod")
        np.testing.assert_allclose(M[:3, 3], plate.anchors[i], atol=ROUNDING)
        end = T[:3, :3] @ plate.points[i] + T[:3, 3]
        np.testing.assert_allclose(M[:3, 3] + M[:3, 0], end, atol=ROUNDING)
        lengths.append(np.linalg.norm(end - plate.anchors[i]))
    tension = np.array([10, 20, 30, 40, 50, 60]) * (lengths - np.arange(11.0, 17.0))
    np.testing.assert_allclose(legend["tension"]["values"], tension, rtol=1e-9)
    low, high = legend["tension"]["limits"]
    assert -low == high >= np.abs(tension).max()
    # Pulling is green, pushing is pink.
    for i, t in enumerate(tension):
        r, g, _, a = drawing.viewer.places[f"{ROOT}/mechanism/legs/line {i + 1}/rod"].properties[
            "color"
        ]
        assert a == 1.0
        assert (g > r) == (t > 0.05 * high) or abs(t) < 0.05 * high
    body = drawing.viewer.world(f"{ROOT}/mechanism/body")
    np.testing.assert_allclose(body, T, atol=ROUNDING)


def test_slack_cables_are_dashed_and_grey():
    q = [0.1, 0.05, 0.6, 0, 0, 0]
    drawing = Drawing("cable-robot")
    drawing.draw()
    rods = [f"{ROOT}/mechanism/legs/line {i + 1}/rod" for i in range(8)]
    whole = [drawing.viewer.places[rod].object["geometries"][0]["type"] for rod in rods]
    assert set(whole) == {"CylinderGeometry"}
    # With rest positions kept, moving aside slackens the cables on that side.
    springs = cartstiff.analyse(drawing.elastic).elastic
    drawing.result = cartstiff.analyse(springs, q)
    slack = drawing.draw()["tension"]["slack"]
    (note,) = (n for n in drawing.result.notes if n.code == "slack")
    assert slack == note.values["slack"]
    for i, rod in enumerate(rods, start=1):
        place = drawing.viewer.places[rod]
        dashed = place.object["geometries"][0]["type"] == "BufferGeometry"
        assert dashed == (i in slack)
        r, g, b, _ = place.properties["color"]
        assert (r == g == b) == (i in slack)
    # And back again.
    drawing.result = cartstiff.analyse(springs)
    assert drawing.draw()["tension"]["slack"] == []
    assert drawing.viewer.places[rods[slack[0] - 1]].object["geometries"][0]["type"] == whole[0]


def test_springs_between_links(tmp_path):
    file = tmp_path / "arm.yaml"
    file.write_text(
        "kind: serial\nmodel: ur5\nframe: tool0\n"
        "q: {shoulder_lift_joint: -1.1, elbow_joint: 1.4, wrist_2_joint: 0.5}\n"
        "lines:\n"
        "  - {frames: [base_link, forearm_link], points: [[0, -0.3, 0.1], [0.2, 0, 0]],"
        " stiffness: 2000, preload: 100}\n",
        encoding="utf-8",
    )
    try:
        drawing = Drawing(str(file))
    except cartstiff.core.errors.MissingDependencyError:
        pytest.skip("example-robot-data is not installed")
    (group,) = drawing.draw()["tension"]["lines"]
    assert group["values"] == pytest.approx([100.0])
    M = drawing.viewer.world(f"{ROOT}/mechanism/springs 1/line 1/rod")
    for frame, point, end in (
        ("base_link", [0, -0.3, 0.1], M[:3, 3]),
        ("forearm_link", [0.2, 0, 0], M[:3, 3] + M[:3, 0]),
    ):
        T = drawing.result.posture.relative("world", frame)[0]
        np.testing.assert_allclose(end, T[:3, :3] @ point + T[:3, 3], atol=ROUNDING)


def test_centres_of_a_decoupled_platform_share_a_label():
    drawing = Drawing("cubic")
    found = drawing.draw(centres=True)["centres"]
    assert all(entry["shown"] for entry in found.values())
    labels = [p for p in drawing.viewer.below(f"{ROOT}/centres") if p.endswith("label")]
    assert len(labels) == 1
    assert drawing.viewer.text(labels[0]).count(",") == 3
    M = drawing.viewer.world(f"{ROOT}/centres/stiffness")
    T = drawing.result.pose
    np.testing.assert_allclose(
        M[:3, 3], T[:3, :3] @ found["stiffness"]["point"] + T[:3, 3], atol=ROUNDING
    )


def triangles_of(place) -> np.ndarray:
    """Corners (m, 3, 3) of the triangles of a drawn body."""
    data = place.object["geometries"][0]["data"]
    points = np.frombuffer(data["attributes"]["position"]["array"].data, np.float32)
    index = np.frombuffer(data["index"]["array"].data, np.uint16)
    return points.reshape(-1, 3).astype(float)[index.astype(int)].reshape(-1, 3, 3)


def test_forces_that_drives_hold_are_a_body_about_the_tip():
    """Each corner, as a force on the tip, uses some motors wholly and none more."""
    drawing = Drawing("ur5", wrench=[0, 0, 0, 20.0, -30.0, 50.0])
    drawing.draw()
    assert not drawing.viewer.below(f"{ROOT}/held forces")
    facts = drawing.draw(held_forces=True)["held_forces"]
    place = f"{ROOT}/held forces"
    triangles = triangles_of(drawing.viewer.places[f"{place}/body"])
    T, J = drawing.result.pose, drawing.result.jacobian
    np.testing.assert_allclose(drawing.viewer.world(place)[:3, 3], T[:3, 3], atol=ROUNDING)
    limits = np.array([drawing.elastic.efforts[name][1] for name in drawing.elastic.names])
    for corner in triangles.reshape(-1, 3):
        force = facts["per_length"] * corner
        used = np.abs(J[3:].T @ T[:3, :3].T @ force) / limits
        assert used.max() == pytest.approx(1.0, rel=1e-4)
        assert np.count_nonzero(used > 1.0 - 1e-4) >= 3
    # The triangles close a body: its volume is the same about any point.
    about = np.array([[0, 0, 0], [3.0, -1.0, 2.0]])
    signed = np.sign(np.linalg.det(triangles - triangles.mean(axis=(0, 1))))
    whole = [np.abs((signed * np.linalg.det(triangles - p)).sum()) for p in about]
    assert whole[0] == pytest.approx(whole[1], rel=1e-4)
    ball = drawing.viewer.world(f"{place}/load")[:3, 3] - T[:3, 3]
    np.testing.assert_allclose(facts["per_length"] * ball, T[:3, :3] @ [20.0, -30.0, 50.0])
    drawing.draw()
    assert not drawing.viewer.below(place)


def test_forces_of_few_motors_are_flat_and_unknown_ones_are_said(tmp_path):
    from tests.laws.test_drive_forces import TWO

    (tmp_path / "two.urdf").write_text(TWO)
    drawing = Drawing.__new__(Drawing)
    drawing.elastic = cartstiff.load(str(tmp_path / "two.urdf"), frame="tip", stiffness=3e3)
    drawing.window, drawing.viewer = RecordingWindow(), Viewer()
    drawing.scene = Scene(visualizer(drawing.window), drawing.elastic)
    drawing.result = cartstiff.analyse(drawing.elastic, [0.2, 0.5])
    assert drawing.draw(held_forces=True)["held_forces"]["shown"]
    triangles = triangles_of(drawing.viewer.places[f"{ROOT}/held forces/body"])
    assert triangles.shape == (2, 3, 3)
    assert np.abs(triangles[..., 1]).max() <= 1e-6  # motors about y
    assert not drawing.viewer.visible(f"{ROOT}/held forces/load")
    assert platform().draw(held_forces=True)["held_forces"] == {
        "shown": False,
        "reason": "no limit of a drive's force is known",
    }


@pytest.mark.parametrize("name", ["stewart-gough", "five-bar", "cable-robot"])
def test_a_step_sends_transforms_only(name):
    """Besides labels whose text changes and legs whose colour changes."""
    drawing = Drawing(name)
    # Moved already: a load that was not there before is an arrow that was not.
    drawing.result = cartstiff.analyse(drawing.elastic, drawing.elastic.q + 1e-4)
    drawing.draw(labels=False)
    drawing.viewer.kinds.clear()
    for k in range(5):
        q = drawing.elastic.q + 1e-4 * (k + 2)
        drawing.result = cartstiff.analyse(drawing.elastic, q)
        drawing.draw(labels=False)
    kinds = drawing.viewer.kinds
    assert set(kinds) <= {"set_transform", "set_property"}
    assert len(kinds) / 5 < 40
    assert kinds.count("set_property") <= 5 * 8


def test_the_same_posture_sends_no_objects_and_no_properties():
    drawing = platform()
    drawing.draw(centres=True)
    drawing.viewer.kinds.clear()
    drawing.draw(centres=True)
    assert set(drawing.viewer.kinds) == {"set_transform"}


def test_a_scale_stays_while_it_serves():
    """Small changes keep the scale, so that sizes can be compared; large ones change it."""
    drawing = platform(None)
    scales = []
    for factor in (1.0, 1.2, 0.85, 1e3):
        drawing.result = cartstiff.analyse(
            drawing.elastic.with_springs(stiffness=factor * drawing.elastic.springs.stiffness)
        )
        legend = drawing.draw(scale="linear")
        scales.append(legend["ellipsoids"]["translation"]["scale"]["value_per_length"])
    assert scales[0] == scales[1] == scales[2] != scales[3]


def test_a_theme_dresses_everything_anew():
    drawing = platform()
    drawing.draw()
    light = drawing.viewer.places["/Background"].properties["top_color"]
    drawing.draw(ghost=(0.0, 0.1, 0.02, 0.0, 0.1, 0.0))
    drawing.draw(theme="dark", centres=True, ghost=(0.0, 0.1, 0.02, 0.0, 0.1, 0.0))
    dark = drawing.viewer.places["/Background"].properties["top_color"]
    assert sum(dark) < 1.0 < sum(light)
    fresh = platform()
    fresh.draw(theme="dark", centres=True, ghost=(0.0, 0.1, 0.02, 0.0, 0.1, 0.0))
    assert fresh.viewer.below(f"{ROOT}/ghost")
    for path in fresh.viewer.below(ROOT):
        assert drawing.viewer.visible(path)
        assert drawing.viewer.places[path].object == fresh.viewer.places[path].object
    assert sorted(drawing.viewer.below(ROOT)) == sorted(fresh.viewer.below(ROOT))


@pytest.mark.parametrize(
    ("name", "unit", "scale"), [("stewart-gough", "cm", 0.1), ("cable-robot", "m", 1.0)]
)
def test_units_of_the_scene(name, unit, scale):
    """A platform of 23 cm is drawn ten times as large as it is; a room of metres as it is."""
    drawing = Drawing(name)
    length = drawing.draw()["length"]
    assert (length["unit"], length["scene_units_per_unit"]) == (unit, pytest.approx(scale))
    root = drawing.viewer.places[ROOT].matrix
    np.testing.assert_allclose(root[:3, :3], scale * np.eye(3), rtol=1e-12)
    # The viewer's camera turns about the origin: the mechanism's middle is there.
    plate = drawing.elastic.mechanism
    T = drawing.result.pose
    points = np.vstack([plate.anchors, plate.points @ T[:3, :3].T + T[:3, 3]])
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    np.testing.assert_allclose(root @ [*middle, 1], [0, 0, 0, 1], atol=ROUNDING)


def test_views():
    """The camera's frame has y up: a point (x, y, z) of the room is (x, z, -y) there."""
    drawing = platform()
    drawing.draw()
    eyes = {}
    for view in ("iso", "front", "side", "top", "fit"):
        drawing.scene.camera(view)
        drawing.viewer.feed(drawing.window.take())
        x, z, y = drawing.viewer.places["/Cameras/default/rotated"].own["position"]
        eyes[view] = np.array([x, -y, z])
    assert eyes["fit"].tolist() == eyes["iso"].tolist()
    assert np.argmax(np.abs(eyes["front"])) == 0
    assert np.argmax(np.abs(eyes["side"])) == 1
    assert np.argmax(eyes["top"]) == 2
    with pytest.raises(UnknownNameError, match=r"unknown view.*'back'"):
        drawing.scene.camera("back")


def test_a_ghost_of_a_platform_and_one_that_cannot_be():
    drawing = platform()
    q = (0.0, 0.1, 0.02, 0.0, 0.1, 0.0)
    drawing.draw(ghost=q)
    np.testing.assert_allclose(
        drawing.viewer.world(f"{ROOT}/ghost/body"),
        drawing.elastic.mechanism.at(q).pose,
        atol=ROUNDING,
    )
    drawing.draw()
    assert drawing.viewer.below(f"{ROOT}/ghost") == []
    with pytest.raises(InputError, match="ghost has the wrong count"):
        drawing.draw(ghost=(1.0, 2.0))
    chain = Drawing("five-bar")
    legend = chain.draw(ghost=(0.0, 0.0, 3.0, 0.0))
    if not chain.viewer.below(f"{ROOT}/ghost"):
        assert "the reference posture cannot be assembled" in legend["notes"]


@pytest.mark.parametrize(
    ("look", "words"),
    [
        ({"connection": "Q"}, "unknown connection"),
        ({"scale": "cubic"}, "unknown scale"),
        ({"theme": "pink"}, "unknown theme"),
        ({"quantity": "mass"}, "unknown quantity"),
        ({"exaggeration": 0.0}, "exaggeration"),
    ],
)
def test_what_a_look_cannot_be(look, words):
    with pytest.raises(InputError, match=words):
        Appearance(**look)


@pytest.mark.parametrize("added", [(1.0, 2.0), (np.nan,) * 6])
def test_added_wrenches_are_checked(added):
    with pytest.raises(InputError, match="added wrench"):
        platform().draw(deflection=True, added=added)


def test_a_stiff_axis_near_a_singularity_is_cut_and_the_soft_one_is_seen():
    """Lengths by hand: square roots over a round scale, at most sqrt(2.5) times 0.17 sizes."""
    drawing = Drawing("ur5", [0.3, -1.1, 2e-3, -0.7, 0.9, 0.2])
    legend = drawing.draw(connection="B", others="held")
    facts, size = legend["ellipsoids"]["translation"], legend["length"]["size"]
    K = drawing.result.matrices["B"][3:, 3:]
    values = np.linalg.eigvalsh(0.5 * (K + K.T))
    assert values[2] > 1e4 * values[1]
    per = facts["scale"]["value_per_length"]
    assert facts["radii"][:2] == pytest.approx(np.sqrt(values[:2] / per))
    assert facts["radii"][2] == pytest.approx(0.17 * size * np.sqrt(2.5))
    assert facts["radii"][1] > 0.02 * size
    assert facts["cut"]
    place = drawing.body("translation").replace("body", "axis {}")
    shown = [drawing.viewer.visible(place.format(i) + "/cut") for i in (1, 2, 3)]
    assert shown == [False, False, True]
    assert drawing.viewer.text(place.replace("axis", "value").format(3)).endswith(" (cut)")
    for i, radius in enumerate(facts["radii"], start=1):
        half = 0.5 * np.linalg.norm(drawing.viewer.world(place.format(i))[:3, 0])
        assert half == pytest.approx(max(radius, 0.015 * size), rel=1e-9)
    # Away from it nothing is cut.
    drawing.result = cartstiff.analyse(drawing.elastic)
    facts = drawing.draw(connection="B", others="held")["ellipsoids"]["translation"]
    assert not facts["cut"]
    assert facts["radii"] == pytest.approx(
        np.sqrt(np.array(facts["eigenvalues"]) / facts["scale"]["value_per_length"])
    )
