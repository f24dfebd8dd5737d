"""Results are plain data, labelled arrays, a few lines, and a picture where they have one."""

import importlib
import inspect
import json
import pkgutil

import numpy as np
import pytest
from tests.doors import LabelledResult
from tests.support.commands import refuses

import cartstiff
from cartstiff.vibration import impedance

xarray = pytest.importorskip("xarray")
Figure = pytest.importorskip("matplotlib.figure").Figure
W = [0.0, 0.0, 0.0, 10.0, 0.0, -50.0]


@pytest.fixture(scope="module")
def results():
    arm, platform = cartstiff.load("ur5"), cartstiff.load("stewart-gough")
    weight = cartstiff.DeadForce([0.0, 0.0, -50.0])
    found = [
        cartstiff.analyse(arm, wrench=W),
        cartstiff.analyse(platform),
        cartstiff.equilibrium(arm, wrench=W),
        cartstiff.load_curve(arm, wrench=W),
        cartstiff.compensate(arm, [arm.q] * 6, [[weight]] * 6),
        cartstiff.modes(arm),
        cartstiff.assemble(platform),
        cartstiff.sensitivities(cartstiff.modes(arm)),
        cartstiff.accuracy(cartstiff.modes(arm), cartstiff.analysis.Tolerances(stiffness=0.05)),
        impedance(cartstiff.modes(arm), np.diag([50.0, 50, 50, 2000, 2000, 800])),
    ]
    return {f"{i} {type(r).__name__}": r for i, r in enumerate(found)}


def _numbers(value):
    """All numbers in plain data without notes, which become texts, and main contributors."""
    if isinstance(value, dict):
        value = [v for key, v in value.items() if key not in ("notes", "main")]
    if isinstance(value, list):
        return [x for v in value for x in _numbers(v)]
    return [float(value)] if isinstance(value, (int, float)) else []


def test_a_dataset_has_the_numbers_of_the_plain_data(results):
    for name, result in results.items():
        data, dataset = json.loads(json.dumps(result.to_dict())), result.to_dataset()
        kept = [
            dataset[v].values.ravel() for v in dataset.variables if dataset[v].dtype.kind != "U"
        ]
        kept = np.concatenate([k.astype(float) for k in kept])
        kept = kept[np.isfinite(kept)]
        np.testing.assert_array_equal(np.sort(kept), np.sort(_numbers(data)), err_msg=name)


def test_dimensions_have_names(results):
    of_arm, curve, path, modes = (list(results.values())[i].to_dataset() for i in (0, 3, 4, 5))
    K = of_arm["stiffness.K"]
    assert (K.dims, K.attrs["long_name"]) == (
        ("row", "column"),
        "6x6, kinematic connection; null where it does not exist",
    )
    assert of_arm.sel(joint="elbow_joint").q.item() == pytest.approx(1.4)
    assert of_arm.attrs["units.force"] == "N"
    assert curve.q.dims == ("point", "joint")
    assert curve.factor.dims == curve.stable.dims == ("point",)
    assert path.error_before.dims[0] == path.stable.dims[0] == "point"
    assert modes["nodal_axes.point"].dims[0] == "nodal_axes"
    modes = results["6 AssemblyModes"].to_dataset()
    assert modes["modes.notes"].dims == ("modes",)
    assert modes["modes.notes"][0].item().startswith("the actuators hardly hold")


def test_results_show_themselves_in_a_few_lines(results):
    for name, result in results.items():
        assert isinstance(result, LabelledResult)
        lines = repr(result).splitlines()
        assert len(lines) < 40, name
        assert "array(" not in repr(result), name
        assert result._repr_html_().startswith("<pre>"), name


def test_a_loaded_result_shows_the_tangent_under_the_load():
    arm = cartstiff.load("ur5")
    loaded = cartstiff.analyse(arm, wrench=[0, 0, 0, 0, 0, -300])
    change = np.abs(loaded.tangent - loaded.matrices["B"])
    most = np.unravel_index(change.argmax(), (6, 6))
    for K, is_shown in ((loaded.tangent, True), (loaded.matrices["B"], False)):
        entry = f"{K[most]:.6g}"
        assert (entry in repr(loaded)) is is_shown
        assert (entry in loaded._repr_html_()) is is_shown
    assert "under the load" not in repr(cartstiff.analyse(arm))


def test_the_outline_reaches_as_far_as_any_unit_force_moves_the_body(results):
    result = results["0 PostureStiffness"]
    reach = np.linalg.norm(np.linalg.inv(result.tangent)[3:, 3:], axis=1)
    for axes, (i, j) in zip(result.plot().axes, ((0, 1), (0, 2), (1, 2)), strict=True):
        x, y = axes.lines[0].get_data()
        assert [x.max(), y.max()] == pytest.approx([reach[i], reach[j]], rel=1e-3)
        assert axes.get_xlabel() == f"{'xyz'[i]} of M [m/N]"


def test_every_result_draws_itself(results):
    """In a figure of its own, or in the place of one's own axes beside others."""
    for name, result in results.items():
        own = result.plot()
        assert own.axes, name
        whole = Figure(layout="constrained")
        left, right = whole.subplots(1, 2)
        part = result.plot(ax=left)
        assert [a.get_xlabel() for a in whole.axes if a is not right] == [
            a.get_xlabel() for a in own.axes
        ], name
        assert right in whole.axes
        assert not right.has_data()
        assert part is whole or part in whole.subfigs
        whole.canvas.draw()
    modes = results["5 Modes"]
    assert modes.plot(ax=right) is whole
    assert right.has_data()
    refuses("axes of no grid", results["0 PostureStiffness"].plot, Figure().add_axes((0, 0, 1, 1)))


def test_bars_have_the_names_and_numbers_of_the_result(results):
    modes, rates = results["6 AssemblyModes"], results["7 Sensitivities"]
    (axis,) = modes.plot().axes
    softest = [mode["smallest_eigenvalue"] for mode in modes.to_dict()["modes"]]
    assert [bar.get_width() for bar in axis.patches] == softest
    (axis,) = rates.plot().axes
    first, most = axis.get_yticklabels()[0].get_text(), axis.patches[0].get_width()
    changes = {
        r["name"]: np.abs(r["for_one_per_cent"] or 0.0).max()
        for r in rates.to_dict()["parameters"]
        if r["value"]
    }
    assert changes[first] == most == max(changes.values())
    spread = results["8 Accuracy"]
    axis = next(a for a in spread.plot().axes if a.get_xlabel().endswith("frequencies"))
    np.testing.assert_array_equal(
        [b.get_width() for b in axis.patches], spread.deviations["frequencies"]
    )
    left, right = results["9 Impedance"].plot().axes
    assert [label.get_text() for label in left.get_yticklabels()] == list(
        cartstiff.load("ur5").names
    )
    K = results["9 Impedance"].joint_stiffness
    assert [bar.get_width() for bar in left.patches] == list(np.diag(K))
    assert right.get_xlabel() == "damping of the joint"


def test_every_class_of_results_has_a_picture():
    """Those of parts of a command as well, such as intervals of frequencies."""
    for module in pkgutil.walk_packages(cartstiff.__path__, "cartstiff."):
        if ".cli" not in module.name and not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    for one in LabelledResult.__subclasses__():
        assert "ax" in inspect.signature(one.plot).parameters, one
    modes = cartstiff.modes(cartstiff.load("ur5"))
    spread = cartstiff.accuracy(modes, cartstiff.analysis.Tolerances(stiffness=0.05)).interval
    (lines,) = spread.plot().axes[0].collections
    assert [end[0] for end in lines.get_segments()[0]] == [spread.low[0], spread.high[0]]
