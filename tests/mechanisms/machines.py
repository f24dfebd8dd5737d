"""Small machines written to files: URDF text from a few joints, mechanism files from keys."""

import io

import numpy as np
from ruamel.yaml import YAML

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
