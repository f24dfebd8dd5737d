"""Derivatives of a 6-PUS, a Delta whose forearms give, and a cable robot, in 50 digits.

The oracle closes the legs anew for every parameter, with its own poses of joints, and adds up the
legs: each is a row of springs, a joint without one passing no wrench.
"""

import mpmath as mp
import numpy as np
import pytest
from tests.oracles.test_sensitivities_fifty_digits import (
    DIGITS,
    EXACT,
    check,
    derivative,
    moved_placement,
    transform,
    vector,
)
from tests.support import absolute_error, relative_error
from tests.support.digits import skew, turned

import cartstiff


def inverse(T):
    R = T[:3, :3].T
    return transform(R, -R * T[:3, 3])


def motion(T):
    """Twists in the frame that T leads from, of those in the frame that it leads to."""
    Ad = mp.zeros(6)
    Ad[:3, :3] = Ad[3:, 3:] = T[:3, :3]
    Ad[3:, :3] = skew(T[:3, 3]) * T[:3, :3]
    return Ad


class Legs:
    """A body on legs with its drives held."""

    def __init__(self, elastic):
        chain = elastic.mechanism
        tree, self.names = chain.tree, list(elastic.names)
        exact = [mp.matrix(T.tolist()) for T in tree.placements()]
        self.screws = [vector(np.round(s, 13)) for s in tree.screws()]
        self.q = [mp.mpf(float(x)) for x in elastic.q]
        k = dict(zip(elastic.spring_names, elastic.springs.stiffness, strict=True))
        self.k = {n: mp.mpf(float(x)) for n, x in k.items() if x}
        frames = ["body of leg 1", *(c.frame_b for c in chain.closures)]
        self.grips = [mp.matrix(chain.placement(f).T_j_f.tolist()) for f in frames]
        self.legs = [
            [i for i, n in enumerate(self.names) if n.startswith(f"leg{j}/") and "." not in n]
            for j in range(1, len(frames) + 1)
        ]
        self.places, self.beams = {}, {}
        for i, T in enumerate(exact):
            if "." in self.names[i]:  # part of a link that gives: as long, while nothing loads it
                self.places[-1] = self.places.get(-1, mp.eye(4)) * T
            else:
                self.places[i] = self.places.pop(-1, mp.eye(4)) * T
        self.passive = [i for leg in self.legs for i in leg if self.names[i] not in self.k]
        for beam in elastic.potentials:
            # Its far end, as the wrist's own joint stands there.
            i = self.names.index(beam.link.replace("forearm", "wrist_tilt"))
            self.beams[i] = cantilever(beam)
        self.q = self.closed(self.places, 3)

    def leg(self, leg, grip, places, q):
        """Pose of the body by one leg; twists of its joints, and of its beam, in M."""
        T, poses, far = mp.eye(4), [], None
        for i in leg:
            T = T * places[i]
            if i in self.beams:
                far = T, self.beams[i]
            poses.append(T)
            w, v = self.screws[i][:3], self.screws[i][3:]
            T = T * transform(turned(q[i] * w), q[i] * v)
        end = inverse(T * grip)
        J, C = mp.zeros(6, len(leg)), mp.zeros(6)
        for c, (i, pose) in enumerate(zip(leg, poses, strict=True)):
            J[:, c] = motion(end * pose) * self.screws[i]
        if far is not None:
            Ad = motion(end * far[0])
            C = Ad * far[1] * Ad.T
        return T * grip, J, C

    def closed(self, places, steps=2):
        """Coordinates with which all legs hold one body."""
        q, rows = list(self.q), {i: c for c, i in enumerate(self.passive)}
        for _ in range(steps):
            every = [
                self.leg(leg, grip, places, q)
                for leg, grip in zip(self.legs, self.grips, strict=True)
            ]
            A, b = mp.zeros(len(rows)), mp.zeros(len(rows), 1)
            for j in range(1, len(self.legs)):
                T = inverse(every[0][0]) * every[j][0]
                at = 6 * (j - 1)
                turn = (T[:3, :3] - T[:3, :3].T) / 2
                b[at], b[at + 1], b[at + 2] = turn[2, 1], turn[0, 2], turn[1, 0]
                b[at + 3 : at + 6, 0] = T[:3, 3]
                for sign, which in ((1, 0), (-1, j)):
                    for c, i in enumerate(self.legs[which]):
                        if i in rows:
                            A[at : at + 6, rows[i]] = sign * every[which][1][:, c]
            step = mp.lu_solve(A, b)
            for i, c in rows.items():
                q[i] += step[c]
        assert mp.norm(b) < mp.mpf(10) ** -25  # of the last but one
        return q

    def stiffness(self, name, x):
        """K of the body with one number changed by x."""
        kind, _, rest = name.partition(".")
        where, _, axis = rest.rpartition(".")
        k, places, q = dict(self.k), dict(self.places), self.q
        if kind == "stiffness":
            k[rest] += x
        else:
            i = self.names.index(where)
            places[i] = moved_placement(places[i], axis, x)
            q = self.closed(places)
        K = mp.zeros(6)
        for leg, grip in zip(self.legs, self.grips, strict=True):
            _, J, C = self.leg(leg, grip, places, q)
            n = len(leg)
            whole = mp.zeros(n + 6)
            for c, i in enumerate(leg):
                whole[c, c] = k.get(self.names[i], mp.mpf(0))
            whole[:n, n:], whole[n:, :n], whole[n:, n:] = J.T, J, -C
            K -= mp.inverse(whole)[n:, n:]
        return K


def cantilever(beam):
    """Compliance (6, 6) of a slender beam's end, along its own x axis."""
    L, s = mp.mpf(beam.length), beam.section
    y, z = (mp.mpf(float(b)) for b in s.bending)
    C = mp.diag(
        [L / mp.mpf(s.torsion), L / y, L / z, L / mp.mpf(s.axial), L**3 / 3 / z, L**3 / 3 / y]
    )
    C[2, 4] = C[4, 2] = L**2 / 2 / z
    C[1, 5] = C[5, 1] = -(L**2) / 2 / y
    return C


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("6-pus", ["leg1/slide.x", "leg2/slide.ry", "leg3/s1.x"]),
        (
            "delta",
            [
                "leg1/motor.x",
                "leg2/motor.rx",
                "leg1/elbow_swing.x",
                "leg3/elbow_tilt.rx",
                "leg2/wrist_swing.rz",
                "leg3/wrist_swing.y",
            ],
        ),
    ],
)
def test_bodies_on_legs(name, parameters):
    elastic = cartstiff.load(name)
    result = cartstiff.analyse(elastic)
    known = cartstiff.sensitivities(result)
    with mp.workdps(DIGITS):
        legs = Legs(elastic)
        drive = next(iter(legs.k))
        whole = np.array(legs.stiffness(f"stiffness.{drive}", mp.mpf(0)).tolist(), float)
        assert relative_error(result.B.matrix, whole) < 1e-10
        for parameter in [f"stiffness.{drive}", *(f"placement.{p}" for p in parameters)]:
            wanted = derivative(lambda x, p=parameter: legs.stiffness(p, x), mp.mpf(0))
            off = absolute_error(known.stiffness["B"][known.index(parameter)], wanted)
            # Turning a rod's own axis changes nothing: there the rounding of K is left.
            assert off < EXACT * max(np.abs(wanted).max(), 1e-3 * np.abs(whole).max()), parameter


def cables(values, R, place):
    """Rows (8, 6) of cables on the body, and their stiffnesses per tension and per elongation."""
    G, each = mp.zeros(8, 6), []
    for i in range(8):
        a, b = (
            mp.matrix([values[f"{body}.leg{i + 1}.{x}"] for x in "xyz"])
            for body in ("base", "platform")
        )
        along = b - R.T * (a - place)
        length = mp.sqrt(mp.fdot(along, along))
        u, D, turning = along / length, mp.zeros(3, 6), mp.zeros(6)
        D[:, :3], D[:, 3:] = -skew(b), mp.eye(3)
        G[i, :] = u.T * D
        # The last term of K^A: u . (w_j x (w_i x b + v_i)) = w_j . ((w_i x b + v_i) x u).
        turning[:, :3] = (-skew(u) * D).T
        each.append(D.T * (mp.eye(3) - u * u.T) * D / length + turning)
    return G, each


def test_cables():
    """Cables at a held pose; their tensions change least, and carry the load."""
    result = cartstiff.analyse(cartstiff.load("cable-robot"))
    known = cartstiff.sensitivities(result)
    with mp.workdps(DIGITS):
        R, place = mp.matrix(result.pose[:3, :3].tolist()), vector(result.pose[:3, 3])
        nominal = {n: mp.mpf(x) for n, x in zip(known.names, known.values.tolist(), strict=True)}
        assert len(nominal) == 8 * 8  # a stiffness, a preload and two points of each
        preload = mp.ones(8, 1) * 200
        load = cables(nominal, R, place)[0].T * preload

        def stiffness(name, x):
            values = nominal | {name: x}
            G, each = cables(values, R, place)
            t = preload + G * mp.lu_solve(G.T * G, load - G.T * preload)
            k = mp.diag([values[f"stiffness.leg{i}"] for i in range(1, 9)])
            return sum((t[i] * each[i] for i in range(8)), G.T * k * G)

        for name in ("stiffness.leg3", "base.leg1.x", "base.leg6.z", "platform.leg4.y"):
            wanted = derivative(lambda y, n=name: stiffness(n, y), nominal[name])
            check(known.stiffness["A"][known.index(name)], wanted)
