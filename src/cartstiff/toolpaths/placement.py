"""Placement of the workpiece: the place at which the worst stiffness along a path is best."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cartstiff.arrays import Array, checked_array, plain_dict
from cartstiff.checked_call import checked
from cartstiff.errors import (
    InputError,
    UndefinedError,
    check_name,
    checked_kind,
    imported,
)
from cartstiff.figures import new_axes
from cartstiff.geometry import se3
from cartstiff.mechanisms.elastic import ElasticMechanism, checked_elastic
from cartstiff.results import LabelledResult
from cartstiff.stiffness.compute import SCHEMA
from cartstiff.toolpaths.optimise import OptimisedPath, optimise_path
from cartstiff.toolpaths.tool_path import ToolPath

#: Names of a workpiece's coordinates: translation, and rotation about F's z axis (rad).
COORDINATES = ("x", "y", "z", "yaw")


def workpiece_pose(place: Mapping[str, float]) -> Array:
    """Return the pose ``T_F_P`` of a workpiece from its coordinates; missing ones are zero."""
    x, y, z, yaw = (float(place.get(name, 0.0)) for name in COORDINATES)
    return se3.from_roll_pitch_yaw([x, y, z], [0.0, 0.0, yaw])


@dataclass(frozen=True, eq=False, repr=False)
class Placement(LabelledResult):
    """Comparison of places of the workpiece, and the best one.

    Attributes
    ----------
    axes : dict of str to ndarray
        Values of each coordinate on the grid.
    worst : ndarray
        Worst value of the criterion along the path, on the grid; NaN where it cannot be followed.
    codes : ndarray of str
        Reason on the grid why the path cannot be followed; "" where it can.
    points : ndarray of int
        The point of the path (from 1) where it breaks; 0 if it can be followed.
    place : dict of str to float
        The best place, after the search around the best of the grid.
    path : OptimisedPath
        The path there.
    """

    axes: dict[str, Array]
    worst: Array
    codes: NDArray[np.str_]
    points: NDArray[np.int_]
    place: dict[str, float]
    path: OptimisedPath

    @property
    def pose(self) -> Array:
        """``T_F_P`` of the best place."""
        return workpiece_pose(self.place)

    def counts(self) -> dict[str, int]:
        """Return the number of unusable places of the grid by reason."""
        return _counted(self.codes)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON; the grid's last axis runs fastest."""
        data = {
            "schema": SCHEMA,
            "axes": self.axes,
            "worst": self.worst.ravel(),
            "codes": [None if not c else str(c) for c in self.codes.ravel()],
            "points": [int(p) or None for p in self.points.ravel()],
            "unusable": self.counts(),
            "place": self.place,
            "path": self.path.to_dict(),
            "notes": self.path.notes,
        }
        return plain_dict(data)

    def to_dataset(self) -> Any:
        """The grid as an xarray Dataset, with units as attributes.

        Raises
        ------
        MissingDependencyError
            Without xarray.
        """
        xarray = imported("xarray", "xarray", "labelled arrays", "maps")
        dims, units = tuple(self.axes), self.path.elastic.units
        about = {"long_name": f"worst along the path: {self.path.criterion.description}"}
        return xarray.Dataset(
            {
                "worst": (dims, self.worst, {"units": self.path.unit, **about}),
                "code": (dims, self.codes),
                "point": (dims, self.points),
            },
            coords={
                name: (name, values, {"units": "rad" if name == "yaw" else units.length})
                for name, values in self.axes.items()
            },
            attrs={
                "mechanism": self.path.elastic.name,
                "criterion": self.path.criterion.name,
                "connection": self.path.connection,
                "load_kind": self.path.load.kind,
                "load_at": list(self.path.load.at),
                **{f"best_{name}": value for name, value in self.place.items()},
            },
        )

    def plot(self) -> Any:
        """Draw the worst value of the criterion over one or two coordinates of the places.

        For more coordinates it is the slice of the grid nearest to the best place. Crosses mark
        places from which the path cannot be followed.

        Raises
        ------
        MissingDependencyError
            Without matplotlib.
        """
        names = [n for n, values in self.axes.items() if len(values) > 1]
        shown, units = names[:2], self.path.elastic.units
        index = tuple(
            slice(None) if n in shown else int(np.argmin(np.abs(v - self.place[n])))
            for n, v in self.axes.items()
        )
        worst = self.worst[index]
        label = f"worst {self.path.criterion.name} [{self.path.unit}]"
        titles = [f"workpiece {n} [{'rad' if n == 'yaw' else units.length}]" for n in shown]
        figure, axes = new_axes(6.4, 4.6)
        if len(shown) < 2:
            values = self.axes[shown[0]] if shown else np.zeros(1)
            axes.plot(values, np.atleast_1d(worst), "o-")
            for value in values[np.isnan(np.atleast_1d(worst))]:
                axes.axvline(value, color="0.8")
            axes.set_ylabel(label)
        else:
            x, y = (self.axes[n] for n in shown)
            mesh = axes.pcolormesh(
                x, y, np.ma.masked_invalid(worst.T), shading="nearest", cmap="cividis"
            )
            figure.colorbar(mesh, ax=axes, label=label)
            i, j = np.nonzero(np.isnan(worst))
            axes.plot(x[i], y[j], "x", color="0.4", label="cannot be followed")
            axes.plot(
                self.place[shown[0]],
                self.place[shown[1]],
                "*",
                color="C3",
                markersize=14,
                label="best place",
            )
            axes.set_ylabel(titles[1])
            figure.legend(loc="outside lower center", ncols=2)
        axes.set_xlabel(titles[0] if titles else "workpiece")
        axes.set_title(self.path.elastic.name)
        return figure


@checked
def best_placement(
    elastic: ElasticMechanism,
    path: ToolPath,
    region: Mapping[str, ArrayLike],
    *,
    halvings: int = 4,
    progress: Callable[[int, int], None] | None = None,
    **options: Any,
) -> Placement:
    """Place of the workpiece at which the worst stiffness along a path is best.

    Every place of a grid is rated by the best path there (`optimise_path`). Then the best place
    moves along each coordinate by half a step of the grid, a quarter, and so on. The result is a
    local optimum, not proven to be the best of all places.

    Parameters
    ----------
    elastic : ElasticMechanism
        The mechanism.
    path : ToolPath
        Poses in the workpiece's frame P. Wrenches and directions in world axes stay in them.
    region : mapping of {"x", "y", "z", "yaw"} to array_like
        Increasing values of P's coordinates in F; missing coordinates are zero.
    halvings : int
        Number of steps of the search around the best place of the grid.
    progress : callable, optional
        Called with (done, total) places of the grid.
    **options
        As in `optimise_path`; only the best place is refined continuously.

    Raises
    ------
    UnknownNameError
        For another coordinate.
    InputError
        For values that do not increase, or input that `optimise_path` refuses.
    UndefinedError
        Code ``"no-placement"`` if the path can be followed from no place of the grid.
    """
    checked_elastic(elastic)
    checked_kind(path, ToolPath, "path", "a ToolPath")
    axes = _axes(checked_kind(region, Mapping, "region", "names and values"))
    refine = bool(options.pop("refine", True))
    shape = tuple(len(values) for values in axes.values())
    worst = np.full(shape, np.nan)
    codes = np.full(shape, "", dtype="<U24")
    points = np.zeros(shape, int)

    def at(place: Mapping[str, float], last: bool = False) -> OptimisedPath:
        return optimise_path(
            elastic, path.moved(workpiece_pose(place)), refine=last and refine, **options
        )

    best: tuple[float, dict[str, float]] | None = None
    total = int(np.prod(shape))
    for done, index in enumerate(product(*map(range, shape))):
        place = {name: float(axes[name][i]) for name, i in zip(axes, index, strict=True)}
        try:
            optimised = at(place)
        except UndefinedError as error:
            codes[index], points[index] = error.code, int(str(error.values.get("point", 0)))
        else:
            worst[index] = optimised.worst
            cost = _cost(optimised)
            if best is None or cost < best[0]:
                best = cost, place
        if progress is not None:
            progress(done + 1, total)
    if best is None:
        counts = _counted(codes)
        shown = ", ".join(f"{n} {code}" for code, n in counts.items())
        raise UndefinedError(
            f"the path can be followed from none of the {total} places ({shown})",
            code="no-placement",
            values={"places": total, "codes": counts},
        )
    place = _around(best, axes, at, halvings)
    return Placement(axes, worst, codes, points, place, at(place, last=True))


def _counted(codes: NDArray[np.str_]) -> dict[str, int]:
    names, numbers = np.unique(codes[codes != ""], return_counts=True)
    return dict(zip(names.tolist(), numbers.tolist(), strict=True))


def _axes(region: Mapping[str, ArrayLike]) -> dict[str, Array]:
    if not region:
        raise InputError("a region needs a coordinate", expected=", ".join(COORDINATES))
    axes = {}
    for name in region:
        check_name("coordinate of the workpiece", name, COORDINATES)
    for name in (n for n in COORDINATES if n in region):
        values = checked_array(region[name], ("m",), f"list of values of {name}")
        if np.any(np.diff(values) <= 0):
            raise InputError(f"values of {name} must rise", got=values.tolist())
        axes[name] = values
    return axes


def _cost(path: OptimisedPath) -> float:
    return path.worst if path.criterion.better == "smaller" else -path.worst


def _around(
    best: tuple[float, dict[str, float]],
    axes: Mapping[str, Array],
    at: Callable[[Mapping[str, float]], OptimisedPath],
    halvings: int,
) -> dict[str, float]:
    """Return a better place near the best one, within the grid's ends."""
    cost, place = best
    steps = {n: float(np.diff(v).min()) for n, v in axes.items() if len(v) > 1}
    for level in range(1, halvings + 1):
        for name, spacing in steps.items():
            for side in (1.0, -1.0):
                value = place[name] + side * spacing * 0.5**level
                if not axes[name][0] <= value <= axes[name][-1]:
                    continue
                try:
                    other = _cost(at({**place, name: value}))
                except UndefinedError:
                    continue
                if other < cost:
                    cost, place = other, {**place, name: value}
                    break
    return place
