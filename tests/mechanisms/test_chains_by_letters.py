"""Legs by letters: every chain closes and comes back from its poses; what cannot be is refused."""

import numpy as np
import pytest
from scipy.optimize import brentq
from tests.support import absolute_error

import cartstiff

EXACT = 1e-10
SIX = {
    "base": {"radius": 0.3, "half_angle": 0.25},
    "platform": {"radius": 0.12, "half_angle": 0.25},
    "stiffness": 1e6,
}
THREE = {
    "base": {"radius": 0.3},
    "platform": {"radius": 0.15},
    "stiffness": 1e6,
}
ROD = {"rod": 0.5}
CRANK = {"crank": 0.2, "rod": 0.5, "mode": "minus"}
#: Legs, height, and how many freedoms the body has.
CHAINS = {
    "UPS": (SIX, 0.5, 6),
    "SPS": (SIX, 0.5, 6),
    "UCU": (SIX, 0.5, 6),
    "PUS": ({**SIX, **ROD, "rail": [-1, 0.3, 1]}, 0.5, 6),
    "PSS": ({**SIX, **ROD}, 0.5, 6),
    "RUS": ({**SIX, **CRANK, "axis": "radial"}, 0.5, 6),
    "RSS": ({**SIX, **CRANK, "axis": [0.5, 1, 0.2]}, 0.5, 6),
    "RPS": (THREE, 0.5, 3),
    "SPR": (THREE, 0.5, 3),
    "UPU": (THREE, 0.5, 3),
    "PRS": ({**THREE, **ROD}, 0.5, 3),
    "PSR": ({**THREE, **ROD}, 0.5, 3),
    "PUU": ({**THREE, **ROD}, 0.5, 3),
    "RUU": ({**THREE, **CRANK}, 0.5, 3),
    "RRS": ({**THREE, **CRANK}, 0.5, 3),
    "RRR": ({**THREE, "crank": 0.2, "rod": 0.2}, 0.0, 3),
    "RPR": ({**THREE, "platform": {"radius": 0.1, "angles": [0.4]}, "symmetry": 3}, 0.0, 3),
    "PRR": ({**THREE, "rod": 0.25, "rail": "tangential"}, 0.0, 3),
    "RUU skew": ({**THREE, **CRANK, "end_axis": [0, 1, 0.5]}, 0.5, 3),
}


@pytest.mark.parametrize("chain", CHAINS)
def test_chains_close_and_come_back_from_their_poses(chain):
    legs, height, freedoms = CHAINS[chain]
    machine = cartstiff.parallel({"chain": chain.split()[0], **legs}, [0, 0, height, 0, 0, 0])
    m = machine.mechanism
    home = cartstiff.analyse(machine)
    assert absolute_error(home.pose[:3, 3], [0, 0, height]) < EXACT
    C = home.compliances["B"]
    assert np.linalg.matrix_rank(C, tol=1e-9 * np.abs(C).max()) == freedoms
    rng = np.random.default_rng(5)
    sizes = np.where(m.is_length, 0.03, 0.1)
    q = m.closed(machine.q + sizes * rng.standard_normal(machine.q.size), hold=[]).q
    T = m.at(q).pose
    assert absolute_error(T, home.pose) > 1e-3
    back = np.full(q.size, np.nan)
    for leg in m.legs:
        x, missed = leg.shape.inverse((T @ leg.T_M_end)[None], leg.mode(q, T))
        assert missed[0] < EXACT
        back[list(leg.columns)] = x[0]
    posture = m.at(back)
    assert np.abs(posture.residual).max() < EXACT
    assert absolute_error(posture.pose, T) < EXACT
    driven = [leg.driven for leg in m.legs]
    assert np.abs(np.angle(np.exp(1j * (back - q)))[driven]).max() < EXACT


def test_struts_are_the_lines_of_a_platform():
    """A hexapod's legs as UPS chains, with springs along them only, are its line springs."""
    lines = cartstiff.load("hexapod")
    legs = {
        "chain": "UPS",
        "base": {"points": lines.mechanism.anchors},
        "platform": {"points": lines.mechanism.points_P},
        "stiffness": 2.0e6,
    }
    struts = cartstiff.parallel(legs, lines.q, name="struts")
    W = [30.0, -25.0, 18.0, 200.0, -300.0, -500.0]
    a, b = cartstiff.analyse(lines, wrench=W), cartstiff.analyse(struts, wrench=W)
    for name in "ABKF":
        size = np.abs(a.matrices[name]).max()
        assert absolute_error(a.matrices[name], b.matrices[name]) < 1e-9 * size


def test_delta_by_name_is_the_delta_of_links():
    """Cranks and forearms that give, against the bundled machine made of a URDF."""
    links = cartstiff.load("delta")
    beam = {
        "E": 7.0e10,
        "G": 5.0e9,
        "length": 0.45,
        "area": 3.45575e-05,
        "Iy": 5.27002e-10,
        "Iz": 5.27002e-10,
        "J": 1.054e-09,
    }
    pose = links.mechanism.at(links.q).pose
    legs = {
        "chain": "RUU",
        "base": {"radius": 0.15},
        "platform": {"radius": 0.05},
        "crank": 0.2,
        "rod": 0.45,
        "stiffness": 1500.0,
        "flexible": {"rod": {"beam": beam}},
    }
    named = cartstiff.parallel(legs, [0, 0, pose[2, 3], 0, 0, 0])
    W = [0.0, 0.0, 0.0, 5.0, -3.0, -40.0]
    for wrench in (None, W):
        a, b = (cartstiff.analyse(m, wrench=wrench) for m in (links, named))
        for name in "ABK":
            size = np.abs(a.matrices[name]).max()
            # The forearm's length is that of the file to ten digits.
            assert absolute_error(a.matrices[name], b.matrices[name]) < 1e-7 * size


def test_lengths_in_other_units_and_a_tool():
    legs = {"chain": "RUS", **SIX, **CRANK, "axis": "radial"}
    machine = cartstiff.parallel(legs, [0, 0, 0.5, 0.1, 0, 0])
    from cartstiff.extend import in_units

    small = in_units(machine, "mm")
    T = small.mechanism.at(small.q).pose
    for leg in small.mechanism.legs:
        x, _ = leg.shape.inverse((T @ leg.T_M_end)[None], leg.mode(small.q, T))
        assert absolute_error(x[0], small.q[list(leg.columns)]) < EXACT * 1e3


@pytest.mark.parametrize("mode", ["minus", "plus", None])
@pytest.mark.parametrize(
    "axis", ["tangential", [0.0, -1.0, 0.0], [0.0, 1.0, 0.0], [0.1, 0.9, 0.05]]
)
def test_modes_of_cranks_are_angles_between_minus_pi_and_pi(mode, axis):
    """Both roots by bisection on |B - C(t)| = rod, C on a circle that starts outwards."""
    radius, crank, rod, z = 0.3, 0.15, 0.42, 0.38
    legs = {
        "chain": "RUS",
        "base": {"radius": radius},
        "platform": {"radius": 0.12},
        "axis": axis,
        "crank": crank,
        "rod": rod,
        "stiffness": 3000.0,
    } | ({} if mode is None else {"mode": mode})
    elastic = cartstiff.parallel(legs, [0.02, -0.01, z, 0, 0, 0])
    own = np.array([0, -1, 0] if isinstance(axis, str) else axis, float)
    own /= np.linalg.norm(own)
    level = np.cross([0, 0, 1], own) / np.linalg.norm(np.cross([0, 0, 1], own))
    level *= np.sign(level[0])
    for k, azimuth in enumerate(2 * np.pi * np.arange(3) / 3):
        c, s = np.cos(azimuth), np.sin(azimuth)
        R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        B = R @ [0.12, 0, 0] + [0.02, -0.01, z]
        out, up = R @ level, R @ np.cross(own, level)

        def gap(t, R=R, B=B, out=out, up=up):
            C = R @ [radius, 0, 0] + crank * (np.cos(t) * out + np.sin(t) * up)
            return float(np.linalg.norm(B - C) - rod)

        ts = np.linspace(-np.pi, np.pi, 721)
        values = [gap(t) for t in ts]
        roots = [
            brentq(gap, a, b)
            for a, b, x, y in zip(ts[:-1], ts[1:], values[:-1], values[1:], strict=True)
            if x * y < 0
        ]
        assert len(roots) == 2
        wanted = {"minus": min(roots), "plus": max(roots), None: min(roots, key=abs)}[mode]
        at = elastic.q[elastic.names.index(f"leg{k + 1}/crank")]
        assert at == pytest.approx(wanted, abs=1e-9)
