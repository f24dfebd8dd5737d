"""Assembly modes and boundaries of workspaces as tables for programs."""

from __future__ import annotations

from cartstiff.core.arrays import csv_rows, plain
from cartstiff.wings.reach.assembly import AssemblyModes
from cartstiff.wings.reach.workspace import Workspace


def assembly_csv(modes: AssemblyModes) -> str:
    """Write one row per mode; a cell is empty if its number does not exist."""
    most = max(
        (0 if m.frequencies is None else len(m.frequencies) for m in modes), default=0
    )
    units = modes.elastic.units
    head = [
        *modes.elastic.names_with_units,
        f"residual [{units.length}]",
        "multiplicity",
        f"smallest_eigenvalue [{units.stiffness['translation']}]",
        "stable",
        "determinant",
        *(f"frequency_{i + 1} [Hz]" for i in range(most)),
    ]
    rows = []
    for mode in modes:
        own = [] if mode.frequencies is None else plain(mode.frequencies)
        rows.append(
            [
                *mode.q.tolist(),
                mode.residual,
                mode.multiplicity,
                mode.eigenvalue,
                mode.stable,
                mode.determinant,
                *own,
                *[None] * (most - len(own)),
            ]
        )
    return csv_rows(head, rows)


def boundary_csv(reached: Workspace) -> str:
    """Write one row per boundary position: the coordinates,
    and the limit that is reached.
    """
    limits = [] if reached.positions is None else reached.positions.limit.tolist()
    rows = (
        [*xyz, limit]
        for xyz, limit in zip(reached.boundary.tolist(), limits, strict=True)
    )
    return csv_rows([*reached.axes_with_units, "limit"], rows)
