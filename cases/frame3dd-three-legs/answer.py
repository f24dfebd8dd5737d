"""The bars of cartstiff under their thrust, added up as the source does; and the frame at rest."""

import numpy as np

import cartstiff
from cartstiff.geometry import se3


def answers(inputs, folder):
    return {"second_order": _second_order(inputs, folder), "at_rest": _at_rest(inputs, folder)}


def _bar(folder, section, length, thrust):
    """Wrenches (moment, force) on both ends of a bar along x, for small motions of both ends."""
    bar = cartstiff.load(folder / "bar.yaml", parameters={"length": length, **section})
    f = np.array([thrust, 0.0, 0.0])
    far = cartstiff.equilibrium(bar, cartstiff.DeadForce(f)).stiffness.A.matrix
    r, zero, one = se3.skew(np.array([length, 0.0, 0.0])), np.zeros((3, 3)), np.eye(3)
    # Both ends moved as one body: the force at the far end turns with the bar.
    as_one, turned = np.block([[one, zero], [-r, one]]), np.zeros((6, 6))
    turned[3:, :3] = -se3.skew(f)
    rows = np.hstack([turned - far @ as_one, far])
    # What the near end bears for the balance of the moved bar.
    near = -rows
    near[:3] += -r @ rows[3:] + se3.skew(f) @ np.hstack([zero, -one, zero, one])
    return np.vstack([near, rows])


def _second_order(inputs, folder):
    nodes = np.array(inputs["nodes"])
    K, force = np.zeros((72, 72)), np.zeros((12, 6))
    for (i, j), thrust in zip(inputs["bars"], inputs["thrusts"], strict=True):
        along = nodes[j - 1] - nodes[i - 1]
        length = np.linalg.norm(along)
        leg = inputs["leg"] if i in inputs["feet"] else inputs["beam"]
        x = along / length
        y = np.cross([0.0, 0.0, 1.0], x) if abs(x[2]) < 0.5 else np.array([0.0, 1.0, 0.0])
        axes = np.kron(np.eye(4), np.array([x, y, np.cross(x, y)]))
        rows = np.r_[6 * i - 6 : 6 * i, 6 * j - 6 : 6 * j]
        K[np.ix_(rows, rows)] += axes.T @ _bar(folder, leg, length, thrust) @ axes
    for node, wrench in zip(inputs["loaded"], inputs["loads"], strict=True):
        force[node - 1] = wrench
    free = np.array([6 * (n - 1) + k for n in inputs["shown"] for k in range(6)])
    moved = np.linalg.solve(K[np.ix_(free, free)], force.ravel()[free]).reshape(-1, 6)
    return moved[:, [3, 4, 5, 0, 1, 2]]


def _at_rest(inputs, folder):
    frame, q = cartstiff.load(folder / "mechanism.yaml"), None
    for share in (0.2, 0.4, 0.6, 0.8, 1.0):
        loads = [
            cartstiff.DeadWrench(share * np.array(wrench), frame_b=f"node{node}")
            for node, wrench in zip(inputs["loaded"], inputs["loads"], strict=True)
        ]
        rest = cartstiff.equilibrium(frame, q, *loads)
        q = rest.q
    return [
        rest.posture.relative("world", f"node{n}")[0][:3, 3] - inputs["nodes"][n - 1]
        for n in inputs["shown"]
    ]
