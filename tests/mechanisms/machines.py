"""Small machines written to files: URDF text from a few joints, mechanism files from keys."""

import io

import numpy as np
from ruamel.yaml import YAML
from scipy.spatial.transform import Rotation

from cartstiff import analyse, load

Z = (0, 0, 1)


def joint(
    name,
    parent,
    child,
    at=(0, 0, 0),
    axis=Z,
    kind="continuous",
    rpy=(0, 0, 0),
):
    """One joint and the link it carries."""
    limit = '<limit lower="-100" upper="100" effort="0" velocity="0"/>'
    words = [" ".join(repr(float(x)) for x in v) for v in (at, rpy, axis)]
    return (
        f'<link name="{child}"/><joint name="{name}" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{child}"/><origin xyz="{words[0]}" rpy="{words[1]}"/>'
        f'<axis xyz="{words[2]}"/>{limit if kind == "prismatic" else ""}</joint>'
    )


def masses(urdf, **mass):
    """The same URDF with point masses at the origins of links."""
    for link, m in mass.items():
        body = (
            f'<link name="{link}"><inertial><origin xyz="0.05 0.02 0.01"/><mass value="{m}"/>'
            '<inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link>'
        )
        urdf = urdf.replace(f'<link name="{link}"/>', body)
    return urdf


def write_urdf(folder, *joints, name="machine", root="base"):
    path = folder / f"{name}.urdf"
    path.write_text(f'<robot name="{name}"><link name="{root}"/>{"".join(joints)}</robot>')
    return path


def _plain(value):
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_plain(v) for v in value]
    return float(value) if isinstance(value, (np.floating, np.integer)) else value


def write_file(folder, name="machine", **content):
    """A mechanism file; numbers keep all their digits."""
    text = io.StringIO()
    yaml = YAML(typ="safe")
    yaml.dump(_plain(content), text)
    path = folder / f"{name}.yaml"
    path.write_text(text.getvalue(), encoding="utf-8")
    return path


def codes(result):
    """Codes of a result's notes, without the chart's."""
    return [n.code for n in result.notes if n.code != "kf-undefined"]


def note(result, code):
    """The first note with a code."""
    found = [n for n in result.notes if n.code == code]
    assert found, f"{code} not among {[n.code for n in result.notes]}"
    return found[0]


def six_chains(folder, tilt=0.0, passive=None, spins=False, spin=None):
    """The hexapod's legs as chains: universal joint, slide, ball at the platform.

    Their bases are turned by up to `tilt`; `passive` is a spring in the universal joints. `spins`
    adds a turn of each leg about its own line, and `spin` is the spring of that.
    """
    mechanism, pose = load("hexapod").mechanism, analyse(load("hexapod")).pose
    turn = [joint("spin", "y", "cylinder")] if spins else []
    leg = write_urdf(
        folder,
        joint("u1", "base", "x", axis=(1, 0, 0)),
        joint("u2", "x", "y" if spins else "cylinder", axis=(0, 1, 0)),
        *turn,
        joint("slide", "cylinder", "rod", kind="prismatic"),
        name="leg",
    )
    legs, rng = [], np.random.default_rng(6)
    for a, b in zip(mechanism.anchors, mechanism.points, strict=True):
        rpy = tilt * rng.uniform(-1, 1, 3)
        base = Rotation.from_euler("xyz", rpy).as_matrix()
        x, y, z = base.T @ (pose[:3, :3] @ b + pose[:3, 3] - a)
        length = float(np.sqrt(x * x + y * y + z * z))
        u1, u2 = np.arctan2(-y, z), np.arcsin(x / length)
        # The ball starts at zero where the contact frame stands as the leg does.
        grip = pose[:3, :3].T @ base @ Rotation.from_euler("XY", [u1, u2]).as_matrix()
        springs = {"slide": {"stiffness": 2.0e6}}
        for k, (name, q) in enumerate((("u1", u1), ("u2", u2)), 1) if passive else ():
            springs[name] = {"stiffness": passive * k, "rest": q - 0.1 * k}
        if spin is not None:
            springs["spin"] = spin
        legs.append(
            {
                "model": leg.name,
                "frame": "rod",
                "contact": "point",
                "base": {"xyz": a, "rpy": rpy},
                "grip": {"xyz": b, "rpy": Rotation.from_matrix(grip).as_euler("xyz")},
                "q": {"u1": u1, "u2": u2, "slide": length},
                "springs": springs,
                "passive": [n for n in ("u1", "u2", "spin")[: 2 + spins] if n not in springs],
            }
        )
    slides = [f"leg{i + 1}/slide" for i in range(6)]
    return load(write_file(folder, kind="parallel", legs=legs, actuated=slides))
