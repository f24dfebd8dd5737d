"""Pieces for any meshcat scene, and what all pictures are made of: labels, scales, colours."""

from __future__ import annotations

import base64
import io
import subprocess
import sys
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from tests.inner import (
    Tension,
    ViewerNode,
    colours_of,
    extent,
    objects,
    page_style,
    rotation_to,
    round_number,
    scene_units,
    segment,
    swing_of,
    text_png,
    theme,
)
from tests.support import random_pose
from tests.support.pages import asking, source_of, state_of, tab_of
from tests.view.viewer import Viewer, meshcat

import cartstiff
from cartstiff import InputError, load, modes
from cartstiff.scene import (
    Linear,
    Logarithmic,
    RecordingWindow,
    Root,
    Scene,
    add_ellipsoid,
    add_path,
    add_points,
    add_wrench,
)

ROUNDING = 1e-9


@pytest.fixture
def window() -> RecordingWindow:
    return RecordingWindow()


@pytest.fixture
def vis(window: RecordingWindow) -> meshcat.Visualizer:
    return meshcat.Visualizer(window=window)


# -- in any meshcat scene -----------------------------------------------------------------------


def test_an_ellipsoid_in_a_meshcat_scene(vis, window):
    rng = np.random.default_rng(5)
    A = rng.normal(size=(3, 3))
    K, T = A @ A.T, random_pose(rng)
    facts = add_ellipsoid(vis["tool"], K, T, size=0.2, unit="N/m")
    viewer = Viewer(window.take())
    L = viewer.world("/meshcat/tool/ellipsoid/body", root="/meshcat/tool")
    scaled = T[:3, :3] @ K @ T[:3, :3].T / facts["scale"]["value_per_length"]
    np.testing.assert_allclose(L[:3, :3] @ L[:3, :3].T, scaled @ scaled, atol=ROUNDING)
    np.testing.assert_allclose(L[:3, 3], T[:3, 3], atol=ROUNDING)
    assert 0.1 < max(facts["radii"]) < 0.4
    material = viewer.places["/meshcat/tool/ellipsoid/body"].object["materials"][0]
    assert material["transparent"]
    assert not material["depthWrite"]  # what is inside stays visible


def test_blocks_of_a_six_by_six_matrix(vis):
    K = np.diag([1.0, 2, 3, 40, 50, 60])
    assert add_ellipsoid(vis["a"], K)["eigenvalues"] == [40, 50, 60]
    assert add_ellipsoid(vis["a"], K, freedom="rotation")["eigenvalues"] == [1, 2, 3]


def test_a_second_call_replaces_the_first(vis, window):
    vis["tool"].set_object(meshcat.geometry.Box([1.0, 1, 1]))
    add_ellipsoid(vis["tool"], np.diag([1.0, -1, 2]))
    add_ellipsoid(vis["tool"], np.eye(3), labels=False)
    viewer = Viewer(window.take())
    assert viewer.visible("/meshcat/tool")  # what was there stays
    assert viewer.visible("/meshcat/tool/ellipsoid/body")
    assert not [p for p in viewer.places if "value" in p]


def test_a_common_scale_compares(vis):
    for kind in (Linear, Root, Logarithmic):
        scale = kind.from_values([3.0, 4000.0], 0.2)
        one = add_ellipsoid(vis["a"], np.diag([1.0, 2, 3]), scale=scale)
        two = add_ellipsoid(vis["b"], np.diag([2.0, 4000, 3.5]), scale=scale)
        assert one["scale"] == two["scale"]
        if kind is Linear:
            assert two["radii"][2] == pytest.approx(4000 / 3 * one["radii"][2])
    log = add_ellipsoid(vis["c"], np.diag([1.0, 10, 100]), scale="log")
    assert np.diff(log["radii"]) == pytest.approx([log["scale"]["length_per_decade"]] * 2)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"matrix": np.ones((2, 2))}, "wrong shape"),
        ({"matrix": np.full((3, 3), np.nan)}, "finite"),
        ({"matrix": np.eye(3), "T": np.eye(3)}, "T has the wrong shape"),
        ({"matrix": np.eye(3), "size": 0.0}, "size cannot be used"),
        ({"matrix": np.eye(3), "scale": "cubic"}, "unknown scale"),
        ({"matrix": np.eye(6), "freedom": "both"}, "unknown freedom"),
    ],
)
def test_what_is_no_ellipsoid(vis, arguments, words):
    with pytest.raises(InputError, match=words):
        add_ellipsoid(vis, **arguments)


def test_nothing_to_draw_on():
    with pytest.raises(InputError, match=r"expected a meshcat\.Visualizer"):
        add_ellipsoid("vis", np.eye(3))


def test_a_wrench_in_a_meshcat_scene(vis, window):
    T = random_pose(np.random.default_rng(6))
    W = np.array([0.0, 0, 2, 3, 0, -4])
    facts = add_wrench(vis["tool"], W, T, size=0.3)
    viewer = Viewer(window.take())
    force = viewer.world("/meshcat/tool/wrench/force/arrow", root="/meshcat/tool")
    length = 0.3 * np.log10(1 + 5 / 1e-3) / 4
    assert facts["force"] == pytest.approx(length)
    np.testing.assert_allclose(force[:3, 0], length * T[:3, :3] @ W[3:] / 5, atol=ROUNDING)
    assert viewer.text("/meshcat/tool/wrench/force/label") == "5 N"
    # The stiffness of springs leaves such moments beside a pure force.
    facts = add_wrench(vis["tool"], np.array([1e-12, 0, 0, 0, 0, -100.0]), T)
    assert (facts["moment"], facts["force"] > 0) == (0.0, True)
    add_wrench(vis["tool"], np.zeros(6), T)
    assert not Viewer(window.snapshot()).below("/meshcat/tool")


def _array(data):
    kind = {"Float32Array": np.float32, "Uint8Array": np.uint8}[data["type"]]
    return np.frombuffer(data["array"].data, kind).reshape(-1, data["itemSize"])


def test_points_of_a_map(vis, window):
    rng = np.random.default_rng(7)
    p, v = rng.normal(size=(50, 3)), np.linspace(1.0, 2.0, 50)
    v[3] = np.nan
    facts = add_points(vis["map"], p, v, label="stiffness", unit="N/m")
    shown = Viewer(window.take()).places["/meshcat/map"].object
    data = shown["geometries"][0]["data"]
    np.testing.assert_allclose(_array(data["attributes"]["position"]), p, atol=1e-6)
    colours = _array(data["attributes"]["color"]).astype(int)
    assert (facts["count"], facts["without_value"], facts["kind"]) == (50, 1, "sequential")
    assert (facts["lower"], facts["upper"], facts["unit"]) == (1.0, 2.0, "N/m")
    material = shown["materials"][0]  # hides nothing behind it
    assert material["opacity"] < 0.7
    assert material["transparent"]
    assert not material["depthWrite"]
    assert len(set(colours[3])) == 1  # grey
    assert f"#{theme.hex_of(colours[0]):06x}" == facts["stops"][0]
    assert f"#{theme.hex_of(colours[-1]):06x}" == facts["stops"][-1]


def test_points_carry_numbers_and_are_drawn_in_units_of_the_scene(vis, window):
    node = ViewerNode.of(vis)["map"]
    node.enlarged = 1e-3
    q = np.random.default_rng(1).normal(size=(3, 7))
    add_points(node, np.eye(3), [1.0, 2.0, 3.0], size=8.0, carried={"q": q})
    told = Viewer(window.take()).places["/meshcat/map"].object
    assert told["materials"][0]["size"] == pytest.approx(8e-3)
    carried = told["geometries"][0]["data"]["attributes"]
    both = _array(carried["q"]).astype(float) + _array(carried["q rest"])
    assert np.abs(both - q).max() < 2.0**-46


def test_points_of_both_signs_and_of_many_decades(vis):
    p = np.zeros((3, 3))
    both = add_points(vis["m"], p, [-1.0, 0.5, 4.0])
    assert (both["kind"], both["lower"], both["upper"]) == ("diverging", -4.0, 4.0)
    wide = add_points(vis["m"], p, [1.0, 100.0, 1e4])
    assert wide["log"]
    assert not add_points(vis["m"], p, [1.0, 2.0, 3.0])["log"]
    assert add_points(vis["m"], p, [np.nan] * 3)["kind"] == "none"
    assert add_points(vis["m"], p, [2.0] * 3)["lower"] == 2.0
    assert add_points(vis["m"], np.zeros((0, 3)), [])["count"] == 0


@pytest.mark.parametrize(
    ("positions", "values", "words"),
    [
        (np.zeros((2, 2)), [1.0, 2.0], "shape"),
        (np.full((2, 3), np.inf), [1.0, 2.0], "finite"),
        (np.zeros((2, 3)), [1.0], "wrong count"),
    ],
)
def test_points_that_are_none(vis, positions, values, words):
    with pytest.raises(InputError, match=words):
        add_points(vis, positions, values)


def test_a_path(vis, window):
    p = np.cumsum(np.ones((5, 3)), axis=0)
    assert add_path(vis["p"], p)["count"] == 5
    assert add_path(vis["p"], p, np.arange(5.0), unit="N")["upper"] == 4.0
    place = Viewer(window.take()).places["/meshcat/p"]
    assert place.object["object"]["type"] == "Line"
    with pytest.raises(InputError, match="at least two points"):
        add_path(vis["p"], p[:1])


# -- labels, scales, colours --------------------------------------------------------------------


def test_a_label_is_a_readable_png(vis, window):
    png, aspect = text_png("1.5e4 N/m", theme.LIGHT.text, theme.LIGHT.paper)
    image = Image.open(io.BytesIO(png))
    image.load()
    assert image.width / image.height == pytest.approx(aspect)
    grey = np.asarray(image.convert("RGBA").convert("L")).astype(int)
    assert grey.max() == 255  # paper
    assert grey.min() < 60  # ink
    longer, _ = text_png("1.5e4 N/m and more", theme.LIGHT.text, theme.LIGHT.paper)
    assert Image.open(io.BytesIO(longer)).width > image.width
    dark = Image.open(io.BytesIO(text_png("x", theme.DARK.text, theme.DARK.paper)[0]))
    assert np.asarray(dark.convert("RGBA").convert("L")).max() > 200
    add_ellipsoid(vis["e"], np.diag([1.0, 2, 3]), unit="N/m")
    url = Viewer(window.take()).places["/meshcat/e/ellipsoid/value 1"].object["images"][0]["url"]
    head, data = url.split(",")
    assert head == "data:image/png;base64"
    Image.open(io.BytesIO(base64.b64decode(data))).verify()


_sizes = st.floats(1e-12, 1e12)


@given(_sizes)
def test_round_numbers(x):
    r = round_number(x)
    assert r <= x * (1 + 1e-9)
    assert x < 2.5 * r * (1 + 1e-9)
    assert f"{r:.0e}"[0] in "125"
    assert float(f"{r:.0e}") == r


@given(_sizes, st.floats(1e-8, 1), st.floats(1e-8, 1), _sizes)
def test_whatever_comes_is_drawn_in_a_useful_size(largest, a, b, usual):
    """With any usual value the largest keeps near the target, and order is kept."""
    values = np.array([largest * a * b, largest * a, largest])
    for kind, low in ((Linear, 0.0099), (Root, 0.028), (Logarithmic, 0.1)):
        for reference in ([], [usual]):
            scale = kind.from_values(values, 0.2, reference)
            lengths = [*map(scale.length, values.tolist())]
            assert low < lengths[2] <= 0.51
            assert np.all(np.diff(lengths) >= 0)
            # A value that is no rounding has a length in the picture.
            assert kind is not Logarithmic or lengths[0] > 0 or a * b < 1e-9
            assert kind.from_legend(scale.legend()) == scale


@pytest.mark.parametrize("kind", [Linear, Root])
def test_a_scale_keeps_to_what_it_refers_to(kind):
    """Within a factor of ten, a longer axis is a larger value."""
    values = np.array([30.0, 90.0, 130.0, 150.0])
    scales = [kind.from_values([x], 0.2, [100.0]) for x in values]
    assert len(set(scales)) == 1
    assert np.all(np.diff([*map(scales[0].length, values.tolist())]) > 0)


def test_scales_of_nothing():
    for kind in (Linear, Root, Logarithmic):
        scale = kind.from_values(np.zeros(3), 1.0, [2.0])
        assert scale.length(0.0) == scale.length(2.0) == 0.0
        assert None in scale.legend().values()
    assert Tension.from_values([0.0] * 3).share(0.0) == 0.0


@given(_sizes)
def test_tension_limits_are_round_and_hold_everything(t):
    tension = Tension.from_values([-t, 0.3 * t])
    assert tension.limit >= t * (1 - 1e-12)
    assert tension.limit < 8 * t
    assert f"{tension.limit:.0e}"[0] in "1245"


def _lightness(colours):
    """Relative luminance, as the eye sees it."""
    c = np.asarray(colours, float) / 255
    linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    return linear @ [0.2126, 0.7152, 0.0722]


def test_colours_are_ordered_by_lightness():
    """For those who see no hue: sequential rises; diverging is lightest in the middle."""
    assert np.all(np.diff(_lightness(theme.sequential(np.linspace(0, 1, 40)))) > 0)
    both = _lightness(theme.diverging(np.linspace(-1, 1, 41)))
    assert np.all(np.diff(both[:21]) > 0)
    assert np.all(np.diff(both[20:]) < 0)


#: What eyes without one kind of cone see, on linear RGB: Machado, Oliveira and Fernandes 2009,
#: severity 1 (protanopia, deuteranopia, tritanopia).
SEEN = np.array(
    [
        np.eye(3),
        [
            [0.152286, 1.052583, -0.204868],
            [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998],
        ],
        [
            [0.367322, 0.860646, -0.227968],
            [0.280085, 0.672501, 0.047413],
            [-0.011820, 0.042940, 0.968881],
        ],
        [
            [1.255528, -0.076749, -0.178779],
            [-0.078411, 0.930809, 0.147602],
            [0.004733, 0.691367, 0.303900],
        ],
    ]
)


def _lab(colour: int) -> np.ndarray:
    """CIE L*a*b* (4, 3) of a colour as each kind of eye sees it."""
    c = np.array([colour >> shift & 0xFF for shift in (16, 8, 0)]) / 255
    linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    to_xyz = np.array(
        [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    )
    xyz = np.clip(SEEN @ linear, 0, 1) @ to_xyz.T / [0.9505, 1.0, 1.089]
    x, y, z = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116).T
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=1)


def test_no_two_meanings_have_one_hue():
    """Distances in L*a*b*, of which a trained eye sees 2.3; what is set side by side lies apart."""
    labs = {name: _lab(colour) for name, colour in theme.COLOURS.items()}
    for a, b in combinations(labs, 2):
        apart = np.linalg.norm(labs[a] - labs[b], axis=1).min()
        assert apart > 14, (a, b)
    for a, b in (
        ("translation", "rotation"),
        ("positive", "negative"),
        ("tension", "compression"),
    ):
        assert np.linalg.norm(labs[a] - labs[b], axis=1).min() > 30, (a, b)


def test_the_page_reads_the_table_of_colours():
    served = page_style()
    for name, colour in theme.COLOURS.items():
        assert served.count(f"--{name}:") == 1
        assert f"--{name}: #{colour:06x};" in served


@pytest.mark.parametrize("look", [theme.LIGHT, theme.DARK])
def test_labels_can_be_read(look):
    """Contrast of 4.5 between letters and paper, tinted ones too (WCAG 2.1, level AA)."""
    paper = _lightness(255 * np.array(theme.fractions(look.paper)))
    for colour in (None, *theme.COLOURS.values()):
        letters = look.text if colour is None else look.tinted(colour)
        ink = _lightness(255 * np.array(theme.fractions(letters)))
        light, dark = max(ink, paper), min(ink, paper)
        assert (light + 0.05) / (dark + 0.05) > 4.5


def test_rotations_to_any_direction():
    rng = np.random.default_rng(8)
    for v in [*rng.normal(size=(200, 3)), *np.eye(3), *-np.eye(3)]:
        R = rotation_to(v)
        np.testing.assert_allclose(R.T @ R, np.eye(3), atol=ROUNDING)
        assert np.linalg.det(R) > 0
        np.testing.assert_allclose(R[:, 0] * np.linalg.norm(v), v, atol=ROUNDING)
    assert np.all(np.isfinite(segment(np.ones(3), np.ones(3))))


@pytest.mark.parametrize(
    ("size", "unit", "scale"),
    [
        (1.0, "m", 1.0),
        (23.0, "cm", 0.1),
        (120.0, "cm", 0.01),
        (40.0, "mm", 0.01),
        (30.0, "m", 0.1),
        (0.5, "parsec", 1.0),
        (0.0, "m", 1.0),
    ],
)
def test_scene_units(size, unit, scale):
    assert scene_units(size, unit) == pytest.approx(scale)


def test_drawing_loads_no_window_of_meshcat():
    """The pieces speak meshcat's protocol; its servers are not started or even imported."""
    code = (
        "import sys; from cartstiff.scene import RecordingWindow, Scene, add_ellipsoid; "
        "from cartstiff.shown.scene.viewer import ViewerNode; w = RecordingWindow(); "
        "add_ellipsoid(ViewerNode(w, '/a'), [[1,0,0],[0,2,0],[0,0,3]]); assert w.take(); "
        "bad = [m for m in ('meshcat', 'zmq', 'tornado', 'trimesh', 'matplotlib') "
        "if m in sys.modules]; sys.exit(str(bad) if bad else 0)"
    )
    source = str(Path(cartstiff.__file__).parents[1])
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=False,
        env={"PYTHONPATH": source},
    )
    assert done.returncode == 0, done.stderr


def test_one_shade_is_that_of_many():
    values = np.concatenate([np.linspace(-1.2, 1.2, 997), [-1.0, -0.5, 0.0, 0.5, 1.0]])
    expected = [theme.hex_of(colour) for colour in theme._between(theme.FORCES, 0.5 + 0.5 * values)]
    assert [theme.force_colour(x) for x in values.tolist()] == expected


@pytest.mark.parametrize(
    ("name", "has_one"), [("ur5", True), ("hexapod", True), ("delta", False), ("five-bar", False)]
)
def test_a_mechanism_that_stands_on_its_base_has_a_shadow(name, has_one):
    """Hung from above, or flat on the ground, it has none."""
    arm = cartstiff.load(name)
    window = RecordingWindow()
    scene = Scene(ViewerNode(window, "/meshcat"), arm)
    scene.draw(cartstiff.analyse(arm))
    paths = {path for kind, path, _ in window.by_path() if kind == "set_object"}
    assert ("/meshcat/cartstiff/ground/shadow" in paths) == has_one


@pytest.mark.parametrize("name", ["ur5", "stewart-simscape", "five-bar"])
def test_a_step_goes_along_the_mode_as_far_as_it_says(name):
    elastic = load(name)
    found = modes(elastic)
    step, far = swing_of(found, 1)
    mechanism = elastic.mechanism
    ends = [mechanism.at(mechanism.displaced(found.q, x * step)) for x in (-1e-5, 1e-5)]
    corners = [extent(elastic, end) for end in ends]
    moved = np.linalg.norm(corners[1] - corners[0], axis=1).max()
    assert moved == pytest.approx(2e-5 * far, rel=1e-3)
    way = ends[1].pose[:3, 3] - ends[0].pose[:3, 3]
    twist = found.posture.pose[:3, :3] @ found.twists[3:, 0]
    assert abs(way @ twist) == pytest.approx(np.linalg.norm(way) * np.linalg.norm(twist), rel=1e-3)


@pytest.mark.parametrize("name", ["ur5", "five-bar"])
def test_the_ghost_of_a_mode_is_one_end_of_its_swing(name):
    """A tenth of the size away for what moves most, along the mode."""
    elastic = load(name)
    session = tab_of(source_of(elastic))
    state = state_of(q=elastic.q.tolist(), mode=1)
    away = session.answer(asking("draw", state)).data["legend"]["rest"]
    assert away["mode"] == 1
    found = modes(elastic)
    _, far = swing_of(found, 1)
    size = session.picture._scene.size
    assert away["enlarged"] * far <= 0.14 * size * (1 + 1e-9)
    assert 0.05 * size < away["enlarged"] * far or away["enlarged"] > 0.2
    without = state.model_copy(update={"mode": None})
    assert session.answer(asking("draw", without)).data["legend"]["rest"] is None


def test_rare_kinds_of_points_are_others():
    words = np.array([f"limit {i:02}" for i in range(20) for _ in range(20 - i)])
    colours, facts = colours_of(words)
    *listed, others = facts["kinds"]
    assert [one["name"] for one in listed] == [f"limit {i:02}" for i in range(16)]
    assert (others["name"], others["count"]) == ("4 others", 4 + 3 + 2 + 1)
    assert sum(one["count"] for one in facts["kinds"]) == len(words)
    for one, at in ((listed[3], words == "limit 03"), (others, words > "limit 15")):
        assert {"#" + bytes(c.tolist()).hex() for c in colours[at]} == {one["colour"]}
    assert len({one["colour"] for one in facts["kinds"]}) == 17


def test_a_mesh_is_sent_small():
    positions, faces = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0]], "f4"), np.array([[0, 1, 2]])
    geometry = objects.mesh(positions, faces, np.array([[0, 0, 127]] * 3, "i1"), None)
    assert geometry["data"]["index"]["type"] == "Uint16Array"
    assert geometry["data"]["attributes"]["normal"]["normalized"]
