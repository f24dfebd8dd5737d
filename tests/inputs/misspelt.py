"""Misspelt keywords that a type checker has to see: mypy reads this file, nothing runs it.

A comment that ignores no error is one itself, so a keyword that is passed on unseen fails here.
"""

import cartstiff
from cartstiff.maps import Grid, compute_map, map_of
from cartstiff.scene import Scene


def misspelt(arm: cartstiff.ElasticMechanism, where: Grid, scene: Scene) -> None:
    """One call of each function that passes keywords on, and two right ones."""
    map_of(arm, where, ["condition"], lenght=1.0)  # type: ignore[call-arg]
    map_of(arm, where, ["condition"], length="1")  # type: ignore[arg-type]
    compute_map(arm, where, ["condition"], "m.zarr", typo=1)  # type: ignore[call-arg]
    cartstiff.load("ur5", lockd={})  # type: ignore[call-arg]
    cartstiff.from_pinocchio(None, tpc=[0, 0, 1])  # type: ignore[call-arg]
    cartstiff.hexapod(legs=1e6, unit={})  # type: ignore[call-arg]
    cartstiff.parallel({}, actuators=[])  # type: ignore[call-arg]
    program = cartstiff.record(arm, loadd=True)  # type: ignore[call-arg]
    program(arm.q, stifness=[1.0])  # type: ignore[call-arg]
    program.many([arm.q], stifness=[1.0])  # type: ignore[call-arg]
    scene.points([], [], colour="x")  # type: ignore[call-arg]
    map_of(arm, where, ["condition"], wrench=[0.0] * 6, load_at=(0, 0, 1), chunk=3, damping=0.1)
    cartstiff.hexapod(legs=1e6, units={"length": "mm"}, gravity=[0, 0, -9.81], name="x")
