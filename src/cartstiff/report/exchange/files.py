"""A stiffness for other programs: Nastran, and a machine for MuJoCo.

Finite-element programs take one symmetric matrix of a node to the ground, rows and columns
(translation, rotation): K^B about the body frame's origin, here along the axes of F. What of the
tangent under a load is not symmetric follows from the load: a comment names it. A body's mass is in
the unit that goes with those of length, force and second.
"""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np

from cartstiff import numerics
from cartstiff.errors import InputError, UndefinedError, joined
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.contract import SI, Units, convert_length
from cartstiff.mechanisms.platform import Platform, PlatformPosture
from cartstiff.potentials.line_springs import LineSprings
from cartstiff.report.exchange.geometry import geometry_csv, large_field, legs_of_nastran
from cartstiff.report.exchange.mjcf import chain_of_mujoco, load_of_mujoco, numbers, quaternion
from cartstiff.stiffness.posture import PostureStiffness


def exchanged(result: PostureStiffness, ending: str) -> bytes:
    """What a file with an ending of `EXCHANGE` holds of a posture.

    Raises
    ------
    UndefinedError
        If there is no stiffness to write.
    InputError
        For a machine that the program cannot have.
    """
    return EXCHANGE[ending](result)


def _stiffness(result: PostureStiffness) -> Array:
    """K^B (6, 6), linear first, along the axes of F."""
    K = result.matrices["B"]
    if K is None:
        raise result.reduction.undefined()
    return _in_room(result, 0.5 * (K + K.T))


def _in_room(result: PostureStiffness, K: Array) -> Array:
    K = se3.to_linear_angular(se3.to_linear_angular(K, 0), 1)
    turned = np.kron(np.eye(2), result.pose[:3, :3])
    in_room = turned @ K @ turned.T
    size = np.sqrt(np.abs(np.diag(in_room)))
    noise = np.abs(in_room) <= numerics.ROUNDING * np.outer(size, size)
    return np.where(noise, 0.0, 0.5 * (in_room + in_room.T))


def _mass(result: PostureStiffness) -> Array | None:
    """Masses' matrix (6, 6) of a platform, as `_stiffness`, in the units of K times s^2."""
    posture = result.posture
    if not isinstance(posture, PlatformPosture):
        return None
    mass = posture.mass_matrix()
    if not mass.any():
        return None
    length, force = convert_length(Units(), result.elastic.units)
    return _in_room(result, mass * (force / length))


def _said(result: PostureStiffness) -> list[str]:
    """What a reader of the file must know."""
    units = result.elastic.units
    lines = [
        f"{result.elastic.name}: stiffness of {result.elastic.mechanism.frame} to the ground",
        f"units {units.force}, {units.length}, s; rad",
        "rows and columns: translation x y z, rotation x y z of the node, along the axes of F",
    ]
    if result.wrench is not None and np.any(result.wrench):
        load = ", ".join(f"{x:.6g}" for x in result.wrench)
        lines.append(f"under the wrench (moment, force; body axes) {load}: K^B, the symmetric part")
    # A name that ended the line would be read as what follows the comment.
    return [joined([line]).encode("ascii", "replace").decode() for line in lines]


def _nastran(result: PostureStiffness) -> bytes:
    """A grid point with its matrices as direct input (DMIG), in large fields."""

    def matrix(name: str, K: Array) -> list[str]:
        lines = [f"DMIG    {name:<8}{0:>8}{6:>8}{2:>8}{0:>8}"]
        for j in range(6):
            entries = [(i + 1, float(K[i, j])) for i in range(j, 6) if K[i, j] != 0.0]
            if entries:
                lines.append(f"{'DMIG*':<8}{name:<16}{1:>16}{j + 1:>16}{'':16}")
                lines += [f"{'*':<8}{1:>16}{i:>16}{large_field(x)}{'':16}" for i, x in entries]
        return lines

    mass = _mass(result)
    x, y, z = map(large_field, result.pose[:3, 3])
    lines = [
        *[f"$ {line}" for line in _said(result)],
        "$ in case control: K2GG=KBODY" + ("" if mass is None else ", M2GG=MBODY"),
        f"{'GRID*':<8}{1:>16}{'':16}{x}{y}",
        f"{'*':<8}{z}",
        *matrix("KBODY", _stiffness(result)),
        *([] if mass is None else matrix("MBODY", mass)),
    ]
    return ("\n".join(line.rstrip() for line in lines) + "\n").encode()


def _mujoco(result: PostureStiffness) -> bytes:
    """A platform on lines as a free body on spatial tendons; chains joint by joint; in SI units."""
    elastic, posture = result.elastic, result.posture
    platform, springs = elastic.mechanism, elastic.springs
    if isinstance(platform, Chain):
        return chain_of_mujoco(result)
    if not isinstance(platform, Platform) or not isinstance(posture, PlatformPosture):
        raise InputError(
            "MuJoCo's file is of platforms on lines and of joints",
            where=elastic.name,
            got=f"kind {platform.kind}",
        )
    if type(springs) is not LineSprings or elastic.potentials or not springs.is_complete:
        more = "other springs or loads besides" if elastic.potentials else "legs that bend"
        raise InputError(
            "MuJoCo's file holds line springs alone",
            where=elastic.name,
            expected="no energy but that of straight legs",
            got=more,
        )
    if platform.struts is not None and platform.struts.mass:
        raise InputError("tendons have no mass", expected="legs without mass", where="legs.mass")
    length, force = convert_length(elastic.units, SI)
    inertia = platform.body_inertia
    mass, centre = platform.mass, platform.mass_centre * length
    arm = se3.skew(platform.mass_centre)
    about = (inertia[:3, :3] + mass * arm @ arm) * length**2
    if mass <= 0.0 or np.linalg.eigvalsh(about)[0] <= 0.0:
        raise UndefinedError(
            "MuJoCo needs a mass and moments of inertia of the body",
            code="no-mass",
            values={"mass": mass},
        )

    T = result.pose
    t = springs.tensions(posture.lines.lengths)
    rest = (posture.lines.lengths - t / springs.stiffness) * length
    k = springs.stiffness * force / length
    anchors, points = springs.anchors * length, springs.points * length
    sites = [f'<site name="a{i + 1}" pos="{numbers(a)}"/>' for i, a in enumerate(anchors)]
    ends = [f'<site name="b{i + 1}" pos="{numbers(b)}"/>' for i, b in enumerate(points)]
    tendons = [
        f'<spatial name="leg{i + 1}" stiffness="{float(k[i])!r}" springlength='
        f'"{"0 " if springs.unilateral else ""}{float(rest[i])!r}">'
        f'<site site="a{i + 1}"/><site site="b{i + 1}"/></spatial>'
        for i in range(len(k))
    ]
    gravity = np.zeros(3) if elastic.gravity is None else elastic.gravity
    load, room, pushes = load_of_mujoco(
        result, f'pos="{numbers(np.array(result.load.at) * length)}"'
    )
    I = about  # noqa: E741
    full = numbers(np.array([I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]]))
    quat = quaternion(T[:3, :3])
    name = re.sub(r"[^A-Za-z0-9_.-]", "_", elastic.name)
    lines = [
        f'<mujoco model="{name}">',
        '<compiler angle="radian"/>',
        f'<option gravity="{numbers(gravity)}"/>',
        "<worldbody>",
        *room,
        *sites,
        f'<body name="platform" pos="{numbers(T[:3, 3] * length)}" quat="{numbers(quat)}">',
        "<freejoint/>",
        f'<inertial pos="{numbers(centre)}" mass="{mass!r}" fullinertia="{full}"/>',
        *ends,
        *load,
        "</body>",
        "</worldbody>",
        "<tendon>",
        *tendons,
        "</tendon>",
        *pushes,
        "</mujoco>",
    ]
    return ("\n".join(lines) + "\n").encode()


#: By the ending of the file.
EXCHANGE: dict[str, Callable[[PostureStiffness], bytes]] = {
    ".nas": _nastran,
    ".bdf": _nastran,
    ".xml": _mujoco,
    ".dat": legs_of_nastran,
    ".csv": geometry_csv,
}
