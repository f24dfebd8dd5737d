"""A second tool, in plain NumPy: serial arms and platforms without load, from the inputs alone."""

import numpy as np


def answers(inputs, folder):
    """Stiffness, compliance or manipulability of what `inputs` describes, for each asked name."""
    if inputs.get("kind") not in ("serial", "platform"):
        return {}
    at = np.array(inputs.get("at", [0, 0, 0]), float)
    # Rows of J: moment and direction of a line (platform), or of a joint's motion (serial arm).
    if inputs["kind"] == "platform":
        base, points = np.array(inputs["base"], float), np.array(inputs["platform"], float)
        s = (points - base) / np.linalg.norm(points - base, axis=1)[:, None]
        lines = np.hstack([np.cross(points - at, s), s])  # rate of each length, by the twist
        k = np.broadcast_to(np.array(inputs["stiffness"], float), len(lines))
        stiffness = lines.T @ (k[:, None] * lines)
        given = {"stiffness": stiffness, "compliance": np.linalg.inv(stiffness)}
    else:
        axes, points = np.array(inputs["axes"], float), np.array(inputs["points"], float)
        J = np.vstack([axes.T, np.cross(axes, at - points).T])  # twist at `at`, by the joint rates
        given = {"manipulability": np.sqrt(np.linalg.det(J @ J.T))}
        if "stiffness" in inputs:
            k = np.broadcast_to(np.array(inputs["stiffness"], float), len(axes))
            compliance = J @ (J / k).T
            given |= {"compliance": compliance, "stiffness": np.linalg.inv(compliance)}
    found = {}
    for name, wish in inputs["asked"].items():
        value = given.get(wish["quantity"])
        if value is not None:
            if wish["order"] == "linear-angular":
                value = value[np.ix_([3, 4, 5, 0, 1, 2], [3, 4, 5, 0, 1, 2])]
            found[name] = value.tolist() if np.ndim(value) else float(value)
    return found
