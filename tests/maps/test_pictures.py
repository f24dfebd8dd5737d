"""Pictures of maps: what is on them, and what they refuse."""

from dataclasses import replace

import numpy as np
import pytest
import xarray
from tests.doors import assumed_stiffness, figure_content
from tests.maps.machines import arm

import cartstiff
from cartstiff.core.errors import UnknownNameError
from cartstiff.maps import Axis, Grid, RandomPostures, compute_map, draw_map, map_of, slice_map

QUANTITY = "translation_free_min"


@pytest.fixture(scope="module")
def cube(tmp_path_factory):
    """Three dimensions of an arm, among them its straight elbow."""
    elastic = arm()
    names = elastic.names
    axes = {names[i]: Axis(-0.4, 0.4, n) for i, n in ((1, 4), (2, 5), (3, 3))}
    file = tmp_path_factory.mktemp("cube") / "m.zarr"
    return compute_map(elastic, Grid(axes, names, elastic.q), [QUANTITY, "condition"], file)


def _made_up(values, state=None, better="larger"):
    """A map of two dimensions with given values and states."""
    values = np.array(values, float)
    state = np.zeros(values.shape, np.uint8) if state is None else np.array(state, np.uint8)
    data = xarray.Dataset(
        {
            "stiffness": (("a", "b"), values),
            "state": (("a", "b"), state),
            "position": (("a", "b", "xyz"), np.random.default_rng(0).random((*values.shape, 3))),
            "q": (("a", "b", "joint"), np.zeros((*values.shape, 2))),
        },
        {
            "a": np.arange(float(values.shape[0])),
            "b": np.arange(float(values.shape[1])),
            "joint": ["a", "b"],
            "xyz": ["x", "y", "z"],
        },
    )
    data["stiffness"].attrs = {"units": "N/m", "long_name": "stiffness", "better": better}
    data["a"].attrs["units"] = data["b"].attrs["units"] = "rad"
    data["state"].attrs = {
        "flag_values": [0, 1, 255],
        "flag_meanings": "regular serial-singularity not-computed",
    }
    data.attrs = {"mechanism": "made up", "length_unit": "m"}
    return data


def _texts(figure):
    legends = [t.get_text() for legend in figure.legends for t in legend.get_texts()]
    labels = [text for a in figure.axes for text in (a.get_xlabel(), a.get_ylabel())]
    return legends, labels


@pytest.mark.parametrize("ending", [".png", ".svg"])
def test_pictures_are_written(cube, ending):
    assert len(figure_content(draw_map(cube, QUANTITY), ending)) > 5000


def test_the_kind_follows_the_dimensions(cube):
    a, b, c = cube[QUANTITY].dims
    three = draw_map(cube, QUANTITY)
    assert [ax.get_title() for ax in three.axes[:3]] == [
        f"{c} = {v:.4g} rad" for v in cube[c].values
    ]
    two = draw_map(slice_map(cube, **{c: 0.0}), QUANTITY)
    _, labels = _texts(two)
    assert labels[:2] == [f"{b} [rad]", f"{a} [rad]"]
    assert any("[N/m]" in text for text in labels)
    assert "0 rad" in two.axes[0].get_title()
    one = draw_map(slice_map(cube, **{c: 0.0, b: 0.2}), QUANTITY)
    assert one.axes[0].get_xlabel() == f"{a} [rad]"
    drawn = one.axes[0].lines[0].get_ydata()
    np.testing.assert_array_equal(drawn, slice_map(cube, **{c: 0.0, b: 0.2})[QUANTITY])


def test_heat_map_shows_the_numbers_and_names_the_rest():
    data = _made_up(
        [[1, 2, 3], [4, np.nan, 6], [np.nan, np.inf, 9]], [[0, 0, 0], [0, 1, 0], [0, 0, 0]]
    )
    figure = draw_map(data, "stiffness")
    mesh = figure.axes[0].collections[0]
    assert mesh.get_cmap().name == "cividis"
    shown = mesh.get_array()
    np.testing.assert_array_equal(shown.mask, [[0, 0, 0], [0, 1, 0], [1, 1, 0]])
    assert shown[0, 1] == 2
    assert shown[2, 2] == 9
    assert _texts(figure)[0] == ["infinite", "serial-singularity", "undefined"]
    hatched = [c for c in figure.axes[0].collections if getattr(c, "hatches", None)]
    assert len(hatched) == 3
    assert mesh.norm.vmin == 1
    assert mesh.norm.vmax == 9


def test_decades_are_shown_on_a_logarithmic_scale():
    from matplotlib.colors import LogNorm

    figure = draw_map(_made_up([[1, 10], [100, 1000]]), "stiffness")
    assert isinstance(figure.axes[0].collections[0].norm, LogNorm)
    negative = draw_map(_made_up([[-1, 10], [100, 1000]]), "stiffness")
    assert not isinstance(negative.axes[0].collections[0].norm, LogNorm)


def test_line_has_gaps_where_nothing_is():
    data = _made_up([[1, 2, np.nan, 4]], [[0, 0, 255, 0]])
    figure = draw_map(data, "stiffness")
    assert np.isnan(figure.axes[0].lines[0].get_ydata()[2])
    assert _texts(figure)[0] == ["not-computed"]
    span = figure.axes[0].collections[0].get_paths()[0].get_extents()
    assert (span.x0, span.x1) == pytest.approx((1.5, 2.5))


def test_histogram_of_random_postures_counts_every_number(tmp_path):
    elastic = arm()
    sampling = RandomPostures(2500, 1, elastic.q - 0.1, elastic.q + 0.1)
    data = compute_map(elastic, sampling, [QUANTITY], tmp_path / "r.zarr").load()
    for numbers in (2500, 2493):
        data[QUANTITY][: 2500 - numbers] = np.nan
        figure = draw_map(data, QUANTITY)
        assert figure.axes[0].patches[0].get_data().values.sum() == numbers
        assert "of 2500 postures" in figure.axes[0].get_title()


def test_a_map_without_numbers_is_drawn_too():
    nothing = _made_up(np.full((3, 3), np.nan), np.ones((3, 3)))
    more = {"c": [0.0, 1.0], "d": [0.0, 1.0]}  # of four dimensions the histogram is drawn
    assert draw_map(nothing.expand_dims(more), "stiffness").axes
    assert _texts(draw_map(nothing, "stiffness"))[0] == ["serial-singularity"]
    flat = _made_up(np.full((3, 3), 5.0))
    for data in (flat, flat.expand_dims(more)):
        assert draw_map(data, "stiffness").axes


def test_refusals(cube):
    with pytest.raises(UnknownNameError, match="quantity"):
        draw_map(cube, "softness")


def test_positions_stand_as_in_the_room():
    """x to the right, z up, as long as wide."""
    data = _made_up([[1, 2, 3], [2, 3, 4]]).rename(a="x", b="z")
    axis = draw_map(data, "stiffness").axes[0]
    assert (axis.get_xlabel(), axis.get_ylabel()) == ("x [rad]", "z [rad]")
    assert axis.get_aspect() == 1.0
    assert axis.get_xlim() == (-0.5, 1.5)


def test_positions_are_in_millimetres():
    data = _made_up([[1, 2, 3], [2, 3, 4]]).rename(a="x", b="z")
    data["x"].attrs["units"] = data["z"].attrs["units"] = "m"
    axis = draw_map(data, "stiffness").axes[0]
    assert (axis.get_xlabel(), axis.get_ylabel()) == ("x [mm]", "z [mm]")
    assert axis.get_xlim() == (-500.0, 1500.0)


def test_a_picture_says_that_its_springs_are_assumed():
    """The line lies in the picture, beside its diagrams, also in the file."""
    ur5 = cartstiff.load("ur5")
    words, one = "Springs illustrative, not measured", "5 of 6 springs illustrative, not measured"
    note = assumed_stiffness(1e4, ur5.names[:2], ur5.names)
    for elastic, told in (
        (ur5, words),
        (ur5.with_springs(stiffness={"elbow_joint": 1e4}), one),
        (ur5.with_springs(stiffness=np.full(6, 1e4)), ""),
        (replace(ur5, source="", notes=(note,)), "2 of 6 springs assumed"),
        (cartstiff.load("cubic"), words),
    ):
        figures = [cartstiff.analyse(elastic).plot()]
        if elastic.name == "ur5":
            sampling = RandomPostures(5, 1, elastic.q - 0.1, elastic.q + 0.1)
            figures.append(draw_map(map_of(elastic, sampling, ["condition"]), "condition"))
        for figure in figures:
            said = [text for text in figure.texts if "spring" in text.get_text().lower()]
            assert [text.get_text() for text in said] == [told] * bool(told)
            figure.canvas.draw()
            for text in said:
                box = text.get_window_extent()
                assert figure.bbox.x1 >= box.x1
                assert all(box.x0 >= axes.get_tightbbox().x1 for axes in figure.axes)
    assert words in figure_content(cartstiff.analyse(ur5).plot(), ".svg").decode()
