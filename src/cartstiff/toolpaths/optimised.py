"""A path with the postures found for it, as a value."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cartstiff.arrays import csv_text
from cartstiff.geometry.se3 import Array
from cartstiff.loading.collisions import NOT_CHECKED
from cartstiff.maps.quantities import Quantity
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.other_units import shown
from cartstiff.notes import Note
from cartstiff.stiffness.applied_load import LoadKind, wrench_in_body
from cartstiff.stiffness.compute import SCHEMA
from cartstiff.stiffness.tensor import COMPONENTS
from cartstiff.toolpaths.tool_path import ToolPath


@dataclass(frozen=True, eq=False)
class ConstantChoice:
    """The best that one value of the free choices can do, held along the whole path.

    Attributes
    ----------
    choice : dict of str to float
        "angle": turn about the tool's axis from the path's own poses (rad); "position": of the
        redundant joint (rad or length).
    q : ndarray (m, n)
        Coordinates.
    values : ndarray (m,)
        The criterion along the path.
    """

    choice: dict[str, float]
    q: Array
    values: Array


@dataclass(frozen=True, eq=False)
class OptimisedPath:
    """Postures along a path, and the stiffness they have there.

    Attributes
    ----------
    elastic : ElasticMechanism
        The mechanism.
    path : ToolPath
        What was asked for.
    q : ndarray (m, n)
        Coordinates; joints that can turn further than once go on through whole turns.
    poses : ndarray (m, 4, 4)
        ``T_F_M`` that the body has.
    angles : ndarray (m,), or None
        Turn about the tool's axis from the path's own poses (rad), where it is free.
    values : ndarray (m,)
        The criterion along the path.
    ratios : ndarray (m,)
        Smallest over largest singular value of the length-scaled Jacobian.
    criterion : Quantity
        What `values` are.
    connection, loaded
        The stiffness that is read, and whether under the path's load.
    load : LoadKind
        What that load does while the body moves, and where it acts.
    free : str
        Rotation that was left free.
    joint : str or None
        Redundant joint that was sampled.
    constant : ConstantChoice or None
        None where there is nothing to choose, or no constant choice can follow the path.
    candidates : int
        Postures that were compared before the refinement.
    notes : tuple of Note
        From loading.
    collisions : dict or str
        What was tested (`cartstiff.loading.collisions.Collisions`), or that nothing was.
    off_singular : bool or None
        Whether steps through singularities were forbidden; None where there are more joints than
        motions, and configurations are connected without any.
    nearby : float or None
        How near (rad) all joints that turn stay to the posture that was asked for.
    """

    elastic: ElasticMechanism
    path: ToolPath
    q: Array
    poses: Array
    angles: Array | None
    values: Array
    ratios: Array
    criterion: Quantity
    connection: str
    loaded: bool
    load: LoadKind
    free: str
    joint: str | None
    constant: ConstantChoice | None
    candidates: int
    notes: tuple[Note, ...] = field(default=())
    collisions: dict[str, Any] | str = NOT_CHECKED
    off_singular: bool | None = True
    nearby: float | None = None

    @property
    def unit(self) -> str:
        """Unit of the criterion."""
        return self.criterion.unit_in(self.elastic.units)

    @property
    def worst(self) -> float:
        """The worst value along the path."""
        return self._worst(self.values)

    def _worst(self, values: Array) -> float:
        return float(values.max() if self.criterion.better == "smaller" else values.min())

    @property
    def steps(self) -> Array:
        """Change of the coordinates from each point to the next (m - 1, n)."""
        return np.diff(self.q, axis=0)

    def summary(self) -> dict[str, Any]:
        """Worst and mean of the criterion, with and without the free choice, and what limits."""
        largest = np.abs(self.steps).max(axis=0, initial=0.0)
        values: dict[str, Any] = {
            "worst": self.worst,
            "worst_point": int(np.flatnonzero(self.values == self.worst)[0]) + 1,
            "mean": float(self.values.mean()),
            "smallest_ratio": float(self.ratios.min()),
            "largest_step": dict(zip(self.elastic.names, largest.tolist(), strict=True)),
            "constant": None,
        }
        if self.constant is not None:
            values["constant"] = {
                **self.constant.choice,
                "worst": self._worst(self.constant.values),
                "mean": float(self.constant.values.mean()),
            }
        return values

    @property
    def configuration(self) -> str:
        """What is known of flips from one configuration to another, in words."""
        largest = np.abs(self.steps).max(axis=0, initial=0.0)
        j = int(np.argmax(largest))
        step, units = shown(self.elastic, largest)[j], self.elastic.units
        unit = (
            units.length if self.elastic.mechanism.coordinates[j].is_length else units.shown_angle
        )
        words = f"largest step from point to point {step:.3g} {unit} ({self.elastic.names[j]})"
        if self.off_singular:
            words += "; the configuration is kept: no step passes through a singularity"
        elif self.off_singular is None:
            words += "; with joints left over, configurations go over into each other"
        else:
            words += "; steps through singularities, where configurations meet, were allowed"
        if self.nearby is not None:
            words += f"; all joints within {np.degrees(self.nearby):.3g} deg of the given posture"
        return words

    def as_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "schema": SCHEMA,
            "mechanism": self.elastic.name,
            "joints": list(self.elastic.names),
            **self.elastic.mechanism.frames_as_dict(),
            "units": self.elastic.units.as_dict(),
            "criterion": {
                "name": self.criterion.name,
                "description": self.criterion.description,
                "unit": self.unit,
                "better": self.criterion.better,
                "connection": self.connection,
                "loaded": self.loaded,
                "load": {
                    "kind": self.load.kind,
                    "at": list(self.load.at),
                    "meaning": self.load.words,
                },
            },
            "free": self.free,
            "redundant_joint": self.joint,
            "q": self.q.tolist(),
            "poses": self.poses.tolist(),
            "angles": None if self.angles is None else self.angles.tolist(),
            "values": self.values.tolist(),
            "ratios": self.ratios.tolist(),
            "constant": None
            if self.constant is None
            else {
                **self.constant.choice,
                "q": self.constant.q.tolist(),
                "values": self.constant.values.tolist(),
            },
            "summary": self.summary(),
            "configuration": {
                "kept": self.off_singular,
                "largest_step": float(np.abs(self.steps).max(initial=0.0)),
                "near": self.nearby,
                "message": self.configuration,
            },
            "collisions": {"checked": False, "message": self.collisions}
            if isinstance(self.collisions, str)
            else self.collisions,
            "notes": [note.as_dict() for note in self.notes],
        }

    @property
    def wrenches(self) -> Array | None:
        """The path's wrenches (m, 6) about M's origin, along M's axes at each posture."""
        if self.path.wrenches is None:
            return None
        forces = np.array([self.path.wrench(i) for i in range(len(self.path))])
        axes: Any = "body" if self.path.turns_with_body else "world"
        return wrench_in_body(forces, self.poses, self.load.at, axes)

    def as_csv(self) -> str:
        """One line a point: coordinates, wrench, free angle, criterion, distance from singularity.

        `cartstiff equilibrium --path`, `view --trajectory`, `map --trajectory` and `poses` read it.
        """
        units, columns = self.elastic.units, [shown(self.elastic, self.q)]
        names = self.elastic.names_with_units
        if (W := self.wrenches) is not None:
            columns.append(W)
            names += [f"{c} [{u}]" for c, u in zip(COMPONENTS["wrench"], units.wrench, strict=True)]
        if self.angles is not None:
            angle = units.shown_angle
            columns.append(self.angles[:, None] * (180.0 / np.pi if angle == "deg" else 1.0))
            names.append(f"free_angle [{angle}]")
        columns.append(np.column_stack([self.values, self.ratios]))
        unit = f" [{self.unit}]" if self.unit not in ("", "1") else ""
        names += [f"{self.criterion.name}{unit}", "singular_ratio"]
        if self.constant is not None:
            columns.append(self.constant.values[:, None])
            names.append(f"{self.criterion.name}_constant{unit}")
        return csv_text(np.hstack(columns), names)
