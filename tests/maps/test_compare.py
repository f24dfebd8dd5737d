"""Two maps against each other, and the branches that an arm can keep."""

from __future__ import annotations

import json

import numpy as np
import pytest
import xarray
from tests.maps.test_pictures import _made_up
from tests.support.commands import answer, run

from cartstiff.errors import InputError, UnknownNameError
from cartstiff.maps.across import compare_maps, compared, single_branch
from cartstiff.maps.pictures import draw_map
from cartstiff.maps.reading import share_within, state_names


def _branched():
    """Two sheets over 1 x 4 places; the second is better but breaks off at the third place.

    From the third place on a jump of a joint separates what is there from what came before.
    """
    values = np.array([[[3.0, 1.0], [3.0, 1.0], [3.0, 1.0], [3.0, np.nan]]])
    joint = np.array([[[0.0, 2.0], [0.1, 2.1], [0.2, 5.0], [0.3, 0.0]]])
    data = xarray.Dataset(
        {
            "stiffness": (
                ("x", "z", "branch"),
                values,
                {"units": "m", "better": "smaller", "long_name": "give"},
            ),
            "state": (
                ("x", "z", "branch"),
                np.zeros((1, 4, 2), np.uint8),
                {"flag_values": [0, 255], "flag_meanings": "regular not-computed"},
            ),
            "q": (("x", "z", "branch", "joint"), joint[..., None]),
        },
        {"x": [0.0], "z": [0.0, 1.0, 2.0, 3.0], "joint": ["j"]},
    )
    data.attrs = {"mechanism": "made up", "length_unit": "m"}
    return data


def test_ratio_and_difference_are_those_of_the_numbers():
    a = _made_up([[1, 2, 3], [2, np.nan, 4]])
    b = _made_up([[2, 4, 3], [1, 3, 0]], state=[[0, 0, 0], [0, 0, 1]])
    ratio = compare_maps(a, b, "stiffness")
    np.testing.assert_array_equal(ratio["stiffness"], [[0.5, 0.5, 1], [2, np.nan, np.nan]])
    less = compare_maps(a, b, "stiffness", "difference")
    np.testing.assert_array_equal(less["stiffness"], [[-1, -2, 0], [1, np.nan, 4]])
    assert (ratio["stiffness"].attrs["units"], less["stiffness"].attrs["units"]) == ("1", "N/m")
    told = compared(ratio, "stiffness")
    assert (told["places"], told["of"], told["smallest"], told["largest"]) == (4, 6, 0.5, 2.0)
    assert told["mean"] == pytest.approx((0.5 * 0.5 * 1 * 2) ** 0.25)
    assert told["first_is_better"] == 0.25
    assert draw_map(ratio, "stiffness").axes


def test_what_else_differs_is_said():
    a, b = _made_up([[1, 2]]), _made_up([[1, 2]])
    b.attrs["frame"] = "flange"
    assert compare_maps(a, b, "stiffness").attrs["differs"] == ["frame: None and flange"]


def test_loads_springs_weights_and_held_joints_that_differ_are_said(tmp_path):
    grid = "map ur5 --grid elbow_joint=0.5:1:2 --quantity condition --length 0.2 -o"
    answer(grid, tmp_path / "a.zarr", "--load 0,0,0,0,0,-100")
    for more, said in (
        ("--load 0,0,0,0,0,-200", "load: [0.0, 0.0, 0.0, 0.0, 0.0, -100.0] and"),
        ("--load 0,0,0,0,0,-100 --world", "axes of the load: body and world"),
        ("--load 0,0,0,0,0,-100 --stiffness 1e4", "other springs"),
        ("--load 0,0,0,0,0,-100 --gravity 0,0,-9.81", "other gravity"),
        ("--load 0,0,0,0,0,-100 --q shoulder_pan_joint=1", "fixed_shoulder_pan_joint: 0.3 and 1.0"),
    ):
        answer(grid, tmp_path / f"{said[:8]}.zarr", more)
        both = f"file://{tmp_path}/a.zarr", tmp_path / f"{said[:8]}.zarr"
        assert any(line.startswith(said) for line in answer("compare", *both)["differs"]), said


def test_settings_that_the_quantity_asks_for_are_said():
    a, b = _made_up([[1, 2]]), _made_up([[1, 2]])
    for data, length, direction in ((a, 0.1, [0, 0, 1]), (b, 0.2, [1, 0, 0])):
        settings = {"length": length, "direction": direction, "told": None}
        data.attrs["description"] = json.dumps(settings)
    for name, said in (
        ("minimum", ["characteristic length: 0.1 and 0.2"]),
        ("along_free", ["direction: [0, 0, 1] and [1, 0, 0]"]),
        ("translation_condition", []),
    ):
        both = (data.rename({"stiffness": name}) for data in (a, b))
        assert compare_maps(*both, name).attrs["differs"] == said


def test_differences_of_pure_numbers_are_no_ratios():
    """Isotropy is "geometric over arithmetic mean": its differences were judged against 1."""
    a, b = _made_up([[0.5, 0.9]]), _made_up([[0.4, 0.5]])
    for data in (a, b):
        words = "geometric over arithmetic mean of the eigenvalues of K"
        data["stiffness"].attrs |= {"units": "1", "better": "larger", "long_name": words}
    told = compared(compare_maps(a, b, "stiffness", "difference"), "stiffness")
    assert (told["first_is_better"], told["mean_kind"]) == (1.0, "arithmetic")
    assert told["mean"] == pytest.approx(0.25)


def _shifted(data):
    return data.assign_coords(a=data["a"] + 0.5)


def _in_other_units(data):
    data["stiffness"].attrs["units"] = "N/mm"
    return data


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (_shifted, "axis a differs"),
        (lambda d: d.isel(b=[0]), "axis b differs"),
        (lambda d: d.rename(a="c"), "axes differ"),
        (_in_other_units, "units of stiffness differ"),
        (lambda d: d.drop_vars("a"), "without axes"),
    ],
)
def test_maps_of_other_places_are_refused(change, match):
    a, b = _made_up([[1, 2], [3, 4]]), change(_made_up([[1, 2], [3, 4]]))
    with pytest.raises(InputError, match=match):
        compare_maps(a, b, "stiffness")


def test_words_that_are_none():
    a = _made_up([[1, 2]])
    with pytest.raises(UnknownNameError, match="comparison"):
        compare_maps(a, a, "stiffness", "sum")
    with pytest.raises(UnknownNameError, match="quantity"):
        compare_maps(a, a, "softness")


def test_a_single_branch_is_what_hangs_together():
    data = _branched()
    longest = single_branch(data, "stiffness")
    np.testing.assert_array_equal(longest["stiffness"], [[3, 3, 3, 3]])
    best = single_branch(data, "stiffness", 2.0)
    np.testing.assert_array_equal(best["stiffness"], [[1, 1, np.nan, np.nan]])
    names = state_names(best)
    assert [names[int(s)] for s in best["state"].values[0]] == ["regular"] * 2 + [
        "other-branch"
    ] * 2
    assert share_within(data, "stiffness", 2.0)["within"] == 3
    assert share_within(best, "stiffness", 2.0)["within"] == 2
    # The same configuration on the other side: where even the best is too soft, none is better.
    again = single_branch(data, "stiffness", 2.0, below=False)
    np.testing.assert_array_equal(again["stiffness"], best["stiffness"])
    assert share_within(data, "stiffness", 2.0, below=False)["within"] == 1
    assert share_within(again, "stiffness", 2.0, below=False)["within"] == 0
    flat = data.isel(branch=0, drop=True)
    assert single_branch(flat, "stiffness") is flat


def test_the_command(tmp_path):
    a, b, picture = tmp_path / "a.zarr", tmp_path / "b.zarr", tmp_path / "p.png"
    grid = "map hexapod --grid x=-0.01:0.01:2,y=-0.01:0.01:2 --quantity translation_free_min"
    for file, stiffness in ((a, "1e5"), (b, "2e5")):
        answer(grid, "--stiffness", stiffness, "-o", file)
    told = answer("compare", a, b, "--picture", picture)
    assert told["smallest"] == pytest.approx(0.5)
    assert told["largest"] == pytest.approx(0.5)
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert "mean 0.5" in run("compare", a, b)
    assert "unknown quantity" in run("compare", a, b, "--quantity x", code=2)
    assert "c.zarr" in run("compare", a, tmp_path / "c.zarr", code=2)
    single = "map hexapod --grid x=-0.01:0.01:2 --quantity condition --single-branch -o"
    assert "--single-branch" in run(single, tmp_path / "d.zarr", code=2)


def test_the_place_of_a_slice_is_told(tmp_path):
    maps, cut = (tmp_path / "a.zarr", tmp_path / "b.zarr"), "--slice elbow_joint=0.85"
    grid = "map ur5 --grid elbow_joint=0.2:2:4,wrist_1_joint=0:1:3 --quantity condition -o"
    told = "nearest places to the slice: elbow_joint 0.8 rad"
    for file in maps:
        assert told in run(grid, file, cut)
    assert told in run("compare", *maps, cut)
