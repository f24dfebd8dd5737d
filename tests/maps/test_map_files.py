"""Maps in files: right numbers at the right labels, complete or not, and none of another map's."""

import json
import os
import warnings
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import xarray
from tests.maps.machines import arm, platform, softest
from tests.support.commands import refuses
from tests.support.maps import BegunMap, job_of, layout_of, summary_of_file

import cartstiff
from cartstiff import InputError
from cartstiff.core.errors import UnknownNameError
from cartstiff.maps import (
    Axis,
    CartesianGrid,
    Grid,
    RandomPostures,
    Trajectory,
    best,
    compute_map,
    open_map,
    slice_map,
    summary,
)

# Another order of the same operations, matrices of condition up to 1e6.
SAME = 1e-8
QUANTITY = "translation_free_min"


@pytest.fixture(scope="module")
def elastic():
    return arm()


def _grid(elastic, first=4, second=5):
    names = elastic.names
    return Grid(
        {names[1]: Axis(-0.5, 0.7, first), names[3]: Axis(0.2, 1.1, second)}, names, elastic.q
    )


# -- numbers ------------------------------------------------------------------------------------


def test_grid_holds_the_analysis_of_each_posture(elastic, tmp_path):
    wrench = [0.1, 0.2, -0.3, 4, 5, -6]
    a, b = elastic.names[1], elastic.names[3]
    data = compute_map(
        elastic, _grid(elastic), [QUANTITY, "force"], tmp_path / "m.zarr", wrench=wrench, chunk=6
    )
    assert data[QUANTITY].dims == (a, b)
    assert data[QUANTITY].attrs["units"] == "N/m"
    assert data[a].attrs["units"] == "rad"
    assert data.attrs["chunks_done"] == data.attrs["chunks"] == 4
    assert data["force"].values == pytest.approx(np.linalg.norm(wrench[3:]), rel=SAME)
    for x in np.linspace(-0.5, 0.7, 4):
        for y in np.linspace(0.2, 1.1, 5):
            q = elastic.q.copy()
            q[[1, 3]] = x, y
            cell = data.sel({a: x, b: y}, method="nearest")
            assert float(cell[QUANTITY]) == pytest.approx(softest(elastic, q, wrench), rel=SAME)
            np.testing.assert_allclose(cell["q"].values, q, atol=1e-15)
            pose = elastic.mechanism.at(q).pose
            np.testing.assert_allclose(cell["position"].values, pose[:3, 3], atol=1e-12)
            assert int(cell["state"]) == 0
    np.testing.assert_array_equal(
        data["q"].values, _grid(elastic).postures((slice(0, 4), slice(0, 5))).reshape(4, 5, 6)
    )
    assert [str(j) for j in data["joint"].values] == list(elastic.names)


@pytest.mark.parametrize("chunk", [1, 7, 1000])
def test_result_does_not_depend_on_the_parts(elastic, tmp_path, chunk):
    sampling = RandomPostures(40, 5, elastic.q - 0.3, elastic.q + 0.3)
    whole = compute_map(elastic, sampling, [QUANTITY], tmp_path / "w.zarr")
    parts = compute_map(elastic, sampling, [QUANTITY], tmp_path / "p.zarr", chunk=chunk)
    # The matrices of a posture may be multiplied in another order in another block.
    np.testing.assert_allclose(parts[QUANTITY], whole[QUANTITY], rtol=1e-12)
    np.testing.assert_array_equal(parts["q"], whole["q"])


def test_random_postures_do_not_depend_on_the_box():
    sampling = RandomPostures(5000, 3, [0.0, -2.0, 1.0], [1.0, 2.0, 1.0])
    whole = sampling.postures((slice(0, 5000),))
    for start, stop in ((0, 1), (1023, 1025), (4999, 5000), (100, 4100)):
        np.testing.assert_array_equal(sampling.postures((slice(start, stop),)), whole[start:stop])
    assert np.unique(whole[:, 0]).size == 5000
    assert (whole[:, 2] == 1.0).all()
    assert whole[:, 0].min() >= 0
    assert whole[:, 0].max() <= 1
    # Mean and spread of a uniform distribution, within four standard errors.
    assert abs(whole[:, 1].mean()) < 4 * (4 / np.sqrt(12)) / np.sqrt(5000)
    other = RandomPostures(5000, 4, [0.0, -2.0, 1.0], [1.0, 2.0, 1.0])
    assert not np.array_equal(other.postures((slice(0, 9),)), whole[:9])


def test_trajectory(elastic, tmp_path):
    columns = {elastic.names[2]: [0.1, 0.2, 0.4], "time": [0.0, 0.5, 1.5]}
    sampling = Trajectory.from_table(columns, elastic, elastic.q)
    data = compute_map(elastic, sampling, [QUANTITY], tmp_path / "t.zarr", chunk=2)
    np.testing.assert_array_equal(data["time"], columns["time"])
    np.testing.assert_array_equal(data["q"][:, 2], columns[elastic.names[2]])
    for i in range(3):
        expected = softest(elastic, data["q"].values[i])
        assert float(data[QUANTITY][i]) == pytest.approx(expected, rel=SAME)


def test_platform_in_its_own_units(tmp_path):
    stewart = platform()
    sampling = Grid({"x": Axis(-0.5, 0.5, 3), "yaw": Axis(-0.1, 0.1, 2)}, stewart.names, stewart.q)
    data = compute_map(stewart, sampling, ["translation_held_min"], tmp_path / "s.zarr")
    assert data["translation_held_min"].attrs["units"] == "N/cm"
    assert data["x"].attrs["units"] == data["position"].attrs["units"] == "cm"
    assert data["yaw"].attrs["units"] == "rad"
    K = cartstiff.analyse(stewart, [0.5, 0, 0, 0, 0, -0.1]).matrices["B"]
    assert float(data["translation_held_min"][2, 0]) == pytest.approx(
        np.linalg.eigvalsh(K[3:, 3:])[0], rel=SAME
    )


def test_closed_chain_is_assembled_at_the_map_s_own_coordinates(tmp_path):
    linkage = cartstiff.load("five-bar")
    axes = {"left_motor": Axis(1.0, 3.1, 4), "right_motor": Axis(-0.5, 1.2, 4)}
    sampling = Grid(axes, linkage.names, linkage.q)
    data = compute_map(
        linkage, sampling, ["compliance_translation_free_max"], tmp_path / "f.zarr", chunk=5
    )
    states = summary(data)["states"]
    assert set(states) == {"fewer-than-six-freedoms", "not-assembled"}
    there = np.isfinite(data["compliance_translation_free_max"].values)
    assert there.sum() == states["fewer-than-six-freedoms"]
    q = data["q"].values[there]
    left, right = np.meshgrid(data["left_motor"], data["right_motor"], indexing="ij")
    motors = [linkage.names.index(n) for n in axes]
    np.testing.assert_allclose(q[:, motors], np.stack([left[there], right[there]], 1), atol=1e-9)
    for i, value in enumerate(data["compliance_translation_free_max"].values[there]):
        posture = linkage.mechanism.at(q[i])
        assert np.abs(posture.residual).max() < 1e-9
        C = cartstiff.analyse(linkage, q[i]).compliances["B"]
        assert value == pytest.approx(np.linalg.eigvalsh(C[3:, 3:])[-1], rel=1e-6)
    assert np.isnan(data["q"].values[~there]).all()


def test_postures_of_another_mechanism_are_refused(elastic):
    other, n = cartstiff.load("panda"), len(elastic.names)
    names = [f"joint{i}" for i in range(n)]
    for sampling, got in (
        (Trajectory([other.q]), "7 coordinates"),
        (RandomPostures(3, 0, other.q, other.q), "7 coordinates"),
        (Grid({names[1]: (0, 1, 3)}, names, elastic.q), "joint0, joint1"),
    ):
        with pytest.raises(InputError, match=f"postures are of another mechanism; .* got {got}"):
            cartstiff.maps.map_of(elastic, sampling, ["condition"])


def test_parts_of_another_size_are_refused(elastic, tmp_path):
    asked = elastic, Trajectory([elastic.q] * 9), ["condition"], tmp_path / "m.zarr"
    compute_map(*asked, chunk=4)
    (tmp_path / "m.zarr" / "condition" / "zarr.json").unlink()
    with pytest.raises(InputError, match=r"parts of another size; .* or 4, got 3"):
        compute_map(*asked, chunk=3)
    found = compute_map(*asked)  # the parts of the file
    assert (found.attrs["chunks"], found.attrs["chunks_done"]) == (3, 3)
    with pytest.raises(InputError, match="size of chunks"):
        cartstiff.maps.map_of(*asked[:3], chunk=1.5)


# -- Cartesian grids ----------------------------------------------------------------------------


def test_places_do_not_depend_on_those_solved_with_them(elastic):
    here = elastic.mechanism.at(elastic.q).pose[:3, 3]
    axes = {name: Axis(here[i] - 0.1, here[i] + 0.1, 3) for i, name in enumerate("xy")}
    sampling = CartesianGrid(axes, elastic, elastic.q, branches=3, starts=8, free="rotation")
    boxes = [(slice(i, i + 1), slice(0, 3), slice(0, 1), slice(0, 3)) for i in range(3)]
    q, found = sampling.solve((slice(0, 3), slice(0, 3), slice(0, 1), slice(0, 3)), elastic)
    alone = [sampling.solve(box, elastic) for box in boxes]
    np.testing.assert_array_equal(q, np.concatenate([some for some, _ in alone]))
    np.testing.assert_array_equal(found, np.concatenate([number for _, number in alone]))
    assert found.sum() > 9


def test_cartesian_grid_reaches_its_places_by_several_branches(elastic, tmp_path):
    here = elastic.mechanism.at(elastic.q).pose
    x = Axis(here[0, 3] - 0.05, here[0, 3] + 0.05, 2)
    far = Axis(here[2, 3], here[2, 3] + 50.0, 2)
    sampling = CartesianGrid({"x": x, "z": far}, elastic, elastic.q, branches=4, starts=12)
    data = compute_map(elastic, sampling, [QUANTITY], tmp_path / "c.zarr", chunk=4)
    assert data[QUANTITY].dims == ("x", "y", "z", "branch")
    assert data[QUANTITY].shape == (2, 1, 2, 4)
    assert data["branches"].dims == ("x", "y", "z")
    near = data.isel(y=0, z=0)
    assert (near["branches"] >= 1).all()
    assert int(near["branches"].max()) >= 2
    assert (data.isel(z=1)["branches"] == 0).all()
    names = data["state"].attrs["flag_meanings"].split()
    assert {names[s] for s in data.isel(z=1)["state"].values.ravel()} == {"unreachable"}
    for i in range(2):
        kept = min(4, int(near["branches"][i]))
        q = near["q"].values[i]
        assert np.isfinite(q[:kept]).all()
        assert np.isnan(q[kept:]).all()
        for k in range(kept):
            T = elastic.mechanism.at(q[k]).pose
            np.testing.assert_allclose(T[:3, :3], here[:3, :3], atol=1e-7)
            np.testing.assert_allclose(T[:3, 3], [x.values[i], here[1, 3], here[2, 3]], atol=1e-7)
            assert float(near[QUANTITY][i, k]) == pytest.approx(softest(elastic, q[k]), rel=1e-6)
        for k in range(1, kept):
            assert np.abs(q[k] - q[:k]).max(axis=1).min() > 1e-4


def test_redundancy_is_resolved_towards_the_best(tmp_path):
    seven = arm("RRRRRRR", 5)
    found = {}
    for redundancy in ("nearest", "best"):
        sampling = CartesianGrid({}, seven, seven.q, branches=3, starts=3, redundancy=redundancy)
        data = compute_map(
            seven,
            sampling,
            ["deflection"],
            tmp_path / f"{redundancy}.zarr",
            deflect=[0, 0, 0, 1, 2, 3],
            wrench=np.zeros(6),
        )
        found[redundancy] = data.load()
    nearest, best_ = found["nearest"], found["best"]
    np.testing.assert_allclose(nearest["q"].values[0, 0, 0, 0], seven.q, atol=1e-4)
    assert float(best_["deflection"].min()) <= float(nearest["deflection"].min()) * (1 + 1e-6)
    assert float(best_["deflection"].min()) < 0.999 * float(nearest["deflection"][0, 0, 0, 0])


# -- files --------------------------------------------------------------------------------------


def test_file_says_what_it_is(elastic, tmp_path):
    data = compute_map(
        elastic,
        _grid(elastic),
        ["along_free"],
        tmp_path / "m.zarr",
        direction=[0, 0, 2],
        world=True,
        connection="K",
        command="cartstiff map ...",
    )
    a = data.attrs
    assert a["mechanism"] == elastic.name
    assert (a["frame"], a["connection"], a["length_unit"]) == ("tip", "K", "m")
    assert a["cartstiff_version"] == cartstiff.__version__
    assert a["command"] == "cartstiff map ..."
    described = json.loads(a["description"])
    assert described["direction"] == [0, 0, 1]
    assert described["sampling"]["kind"] == "grid"
    assert data["along_free"].attrs["long_name"].startswith("stiffness along")


def test_other_readers_of_zarr(elastic, tmp_path):
    """Labels, units and numbers without this library, nothing else, and no warning."""
    file = tmp_path / "m.zarr"
    data = compute_map(elastic, _grid(elastic), [QUANTITY], file, chunk=5).load()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        plain = xarray.open_zarr(file, chunks=None)
        assert set(plain.data_vars) == {QUANTITY, "state", "position"}
        for name in plain.variables:
            xarray.testing.assert_identical(plain[name].variable, data[name].variable)
    assert plain["state"].attrs["flag_meanings"].split()[0] == "regular"
    # A changed bit of the numbers is an error to them, too.
    chunk = file / QUANTITY / "c" / "0" / "0"
    changed = bytearray(chunk.read_bytes())
    changed[-9] ^= 1
    chunk.write_bytes(bytes(changed))
    with pytest.raises(ValueError, match="checksum"):
        xarray.open_zarr(file, chunks=None).load()


def test_a_map_goes_to_netcdf(elastic, tmp_path):
    data = compute_map(elastic, _grid(elastic), [QUANTITY], tmp_path / "m.zarr")
    data.to_netcdf(tmp_path / "m.nc", engine="scipy")
    with xarray.open_dataset(tmp_path / "m.nc", engine="scipy") as back:
        np.testing.assert_array_equal(back[QUANTITY], data[QUANTITY])
        np.testing.assert_array_equal(back["q"], data["q"])
        assert back.attrs["command"] == data.attrs["command"]


def test_what_is_known_of_the_parts_is_what_would_be_read(elastic, tmp_path):
    file = tmp_path / "m.zarr"
    begun = BegunMap(elastic, _grid(elastic), [QUANTITY], file, chunk=5, length=0.3)
    begun.compute(1)
    assert summary_of_file(file) == summary(open_map(file))
    assert begun.go_on() == len(begun.file.parts) - 1
    assert summary_of_file(file) == summary(open_map(file))


def test_nothing_is_computed_twice(elastic, tmp_path):
    file = tmp_path / "m.zarr"
    options = {"chunk": 5, "length": 0.3}
    begun = BegunMap(elastic, _grid(elastic), [QUANTITY], file, **options)
    begun.compute(0, 3)
    partial = open_map(file)
    assert partial.attrs["chunks_done"] == 2
    left = 20 - begun.file.count(0) - begun.file.count(3)
    assert summary(partial)["states"]["not-computed"] == left
    before = _stamps(file)
    begun = BegunMap(elastic, _grid(elastic), [QUANTITY], file, **options)
    assert begun.go_on() == len(begun.file.parts) - 2
    after = _stamps(file)
    assert before.items() <= after.items()  # nothing that was there has been written again
    assert begun.go_on() == 0
    whole = compute_map(elastic, _grid(elastic), [QUANTITY], tmp_path / "w.zarr", **options)
    np.testing.assert_array_equal(open_map(file)[QUANTITY], whole[QUANTITY])


def _stamps(folder):
    """Identity and time of every file of a map's arrays."""
    files = [p for p in folder.rglob("*") if p.is_file()]
    return {str(p): (p.stat().st_ino, p.stat().st_mtime_ns) for p in files}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"quantities": ["condition"]}, "quantities differs"),
        ({"length": 0.4}, "length differs"),
        ({"connection": "K"}, "connection differs"),
        ({"wrench": [0, 0, 0, 1, 0, 0]}, "load differs"),
        ({"elastic": arm().with_springs(123.0)}, "another mechanism"),
        ({"sampling": _grid(arm(), 4, 6)}, "differs"),
        ({"sampling": RandomPostures(9, 1, arm().q, arm().q)}, "differs"),
    ],
)
def test_another_map_s_file_is_refused(elastic, tmp_path, change, words):
    given = {
        "elastic": elastic,
        "sampling": _grid(elastic),
        "quantities": [QUANTITY],
        "file": tmp_path / "m.zarr",
        "length": 0.3,
    }
    compute_map(**given)
    before = _stamps(tmp_path)
    with pytest.raises(InputError, match=words) as refusal:
        compute_map(**(given | change))
    assert "m.zarr" in str(refusal.value)
    assert _stamps(tmp_path) == before


def test_leftovers_and_strangers(elastic, tmp_path):
    with pytest.raises(InputError, match=r"expected \.zarr"):
        compute_map(elastic, _grid(elastic), [QUANTITY], tmp_path / "m.nc")
    with pytest.raises(InputError, match="no such folder"):
        compute_map(elastic, _grid(elastic), [QUANTITY], tmp_path / "none" / "m.zarr")
    (tmp_path / "f.zarr").write_text("x")
    with pytest.raises(InputError, match="is a file"):
        compute_map(elastic, _grid(elastic), [QUANTITY], tmp_path / "f.zarr")
    (tmp_path / "d.zarr").mkdir()
    with pytest.raises(InputError, match="is not a map"):
        compute_map(elastic, _grid(elastic), [QUANTITY], tmp_path / "d.zarr")
    with pytest.raises(InputError, match="is not a map"):
        open_map(tmp_path / "nothing.zarr")
    # What a killed process had begun to write goes, and the map is whole.
    begun = BegunMap(elastic, _grid(elastic), [QUANTITY], tmp_path / "m.zarr")
    rest = begun.file.address / QUANTITY / "c" / "0" / "0.123.partial"
    rest.parent.mkdir(parents=True)
    rest.write_bytes(b"half")
    assert begun.go_on() == 1
    assert not rest.exists()


def test_two_processes_do_not_compute_one_map(elastic, tmp_path):
    begun = BegunMap(elastic, _grid(elastic), [QUANTITY], tmp_path / "m.zarr")
    with begun.file.locked(), pytest.raises(InputError, match="another process"):
        begun.go_on(anew=True)
    assert begun.go_on() == 1
    assert os.path.isdir(begun.file.address)  # noqa: PTH112


# Filters of warnings are not those of one thread alone, and Zarr warns of what it is asked for.
@pytest.mark.filterwarnings("ignore:Consolidated metadata")
def test_threads_that_begin_one_map_at_once(elastic, tmp_path):
    """Each computes it, or is told that another one does; nothing else is left in the folder."""
    for name in range(2):
        file = tmp_path / str(name) / "m.zarr"
        file.parent.mkdir()

        def begin(_, file=file):
            try:
                compute_map(elastic, _grid(elastic), [QUANTITY], file, length=0.3)
            except InputError as error:
                return str(error)
            return ""

        with ThreadPoolExecutor(4) as pool:
            said = list(pool.map(begin, range(4)))
        assert "" in said
        assert all(not words or "or thread is computing this map" in words for words in said)
        assert [path.name for path in file.parent.iterdir()] == ["m.zarr"]
        assert open_map(file).attrs["chunks_done"] == open_map(file).attrs["chunks"]


def test_chunks_are_near_cubes_and_keep_branches_whole(elastic):
    names = elastic.names
    cube = Grid({n: Axis(0, 1, 100) for n in names[:3]}, names, elastic.q)

    def shape_of(sampling):
        return layout_of(elastic, sampling, [QUANTITY]).chunk

    shape = shape_of(cube)
    assert max(shape) <= 2 * min(shape)
    assert np.prod(shape) <= 100**3 // 32
    grid = CartesianGrid({"x": Axis(0, 1, 50), "y": Axis(0, 1, 50)}, elastic, elastic.q)
    assert shape_of(grid)[3] == 8
    for count, expected in ((10**9, 11 * 2**16), (10**6, 10**6 // 32), (10**5, 8192), (99, 99)):
        drawn = RandomPostures(count, 0, elastic.q - 0.1, elastic.q + 0.1)
        assert shape_of(drawn) == (expected,)
    # One posture after the other takes so long that a small part outweighs its own work.
    for count, expected in ((10**9, 11 * 2**16), (10**5, 10**5 // 128), (99, 64)):
        drawn = RandomPostures(count, 0, elastic.q - 0.1, elastic.q + 0.1)
        job = job_of(elastic, drawn, [QUANTITY])
        assert replace(job, path="engine").usual_chunk == expected


# -- reading ------------------------------------------------------------------------------------


def test_best(elastic, tmp_path):
    sampling = _grid(elastic, 6, 7)
    data = compute_map(elastic, sampling, [QUANTITY, "condition"], tmp_path / "m.zarr", chunk=4)
    for name, order in ((QUANTITY, -1), ("condition", 1)):
        values = np.sort(data[name].values.ravel())[::order]
        np.testing.assert_array_equal(best(data, name, 5)[name], values[:5])
    top = best(data, QUANTITY)
    assert float(top[QUANTITY][0]) == pytest.approx(softest(elastic, top["q"].values[0]), rel=SAME)
    assert best(data, QUANTITY, 1000).sizes["rank"] == 42
    with pytest.raises(UnknownNameError, match="quantity of the map"):
        best(data, "state")


def test_best_leaves_out_what_has_no_number():
    data = xarray.Dataset(
        {"k": ("posture", [3.0, np.nan, 1.0, 2.0]), "state": ("posture", [0, 1, 0, 0])}
    )
    data["k"].attrs["better"] = "larger"
    np.testing.assert_array_equal(best(data, "k", 9)["k"], [3, 2, 1])
    np.testing.assert_array_equal(best(data.chunk({"posture": 3}), "k", 2)["k"], [3, 2])
    del data["k"].attrs["better"]
    with pytest.raises(InputError, match="neither end"):
        best(data, "k")


def test_slices(elastic, tmp_path):
    a, b = elastic.names[1], elastic.names[3]
    data = compute_map(elastic, _grid(elastic), [QUANTITY], tmp_path / "m.zarr")
    part = slice_map(data, **{a: 0.35})
    assert part[QUANTITY].dims == (b,)
    assert float(part[a]) == pytest.approx(0.3)
    with pytest.raises(InputError, match="outside the map"):
        slice_map(data, **{a: 2.0})
    with pytest.raises(UnknownNameError, match="axis"):
        slice_map(data, joint=1.0)


def test_summary_counts_everything(elastic, tmp_path):
    data = compute_map(elastic, _grid(elastic), [QUANTITY], tmp_path / "m.zarr", chunk=3)
    found = summary(data)
    values = data[QUANTITY].values
    assert found["states"] == {"regular": 20}
    entry = found["quantities"][QUANTITY]
    assert entry["smallest"] == values.min()
    assert entry["largest"] == values.max()
    assert entry["mean"] == pytest.approx(values.mean())
    assert entry["undefined"] == 0


def test_bad_samplings(elastic):
    names = elastic.names
    with pytest.raises(UnknownNameError, match="coordinate"):
        Grid({"elbow": Axis(0, 1, 2)}, names, elastic.q)
    with pytest.raises(InputError, match="must rise"):
        Axis(1, 0, 2)
    assert Grid({names[0]: (0, 1, 2)}, names, elastic.q).axes == {names[0]: Axis(0, 1, 2)}
    for axis in ((0, 1), (0, 1, 2.5), "abc", 3):
        with pytest.raises(InputError, match="expected low, high, count"):
            Grid({names[0]: axis}, names, elastic.q)  # type: ignore[dict-item]
    refuses("1 to 10000000", Axis, 0, 1, 0)
    refuses("finite", Axis, 0, np.inf, 3)
    refuses("no limits", RandomPostures.within_limits, arm("RRPRRR", 4), 5)
    with pytest.raises(UnknownNameError, match="coordinate"):
        RandomPostures.within_limits(elastic, 5, ranges={"elbow": (0, 1)})
    refuses("1 or more", RandomPostures, 0, 0, [0.0], [1.0])
    refuses("finite", Trajectory, [[0.0, np.nan]])
    refuses("no column", Trajectory.from_table, {"time": [1.0]}, elastic, elastic.q)
    with pytest.raises(UnknownNameError, match="axis"):
        CartesianGrid({"w": Axis(0, 1, 2)}, elastic, elastic.q)
    with pytest.raises(UnknownNameError, match="redundancy"):
        CartesianGrid({}, elastic, elastic.q, redundancy="least")
    with pytest.raises(InputError, match="not a rotation"):
        CartesianGrid({}, elastic, elastic.q, 2 * np.eye(3))
