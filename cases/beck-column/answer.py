"""First critical follower load for 4, 8 and 16 segments, extrapolated twice."""

import cartstiff


def answers(inputs, folder):
    push, loads = cartstiff.FollowerWrench([0, 0, 0, -1, 0, 0]), []
    for file in ("mechanism.yaml", "mechanism-8.yaml", "mechanism-16.yaml"):
        curve = cartstiff.load_curve(cartstiff.load(folder / file), push, to=26.0)
        loads.append(next(c.factor for c in curve.critical if c.kind == "flutter"))
    four, eight, many = loads
    first, second = eight + (eight - four) / 3, many + (many - eight) / 3
    return {"load": second + (second - first) / 15}
