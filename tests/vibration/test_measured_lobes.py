"""Lobes of a measured response: one mode, by the closed form that is written out here."""

import numpy as np
import pytest
from scipy.io import savemat
from scipy.optimize import brentq
from tests.support.commands import answer, run

import cartstiff
from cartstiff.vibration.chatter import MeasuredReceptance, Milling, lobes

HERTZ, ZETA, K = 600.0, 0.04, 8.0e6
KT, KR, TEETH = 7.0e8, 0.25, 3
SLOT = Milling(KT, KR, TEETH, 0.0, np.pi)
COMMAND = ("modes", "stewart-simscape", "--milling", "7e8,0.25,3,0,3.1416", "--lobes")


def receptance(f):
    r = np.asarray(f) / HERTZ
    return 1.0 / (K * (1.0 - r**2 + 2j * ZETA * r))


def written(path, f, G, head="frequency [Hz],real [um/N],imaginary [um/N]"):
    rows = [f"{a!r},{z.real!r},{z.imag!r}" for a, z in zip(f.tolist(), G.tolist(), strict=True)]
    path.write_text("\n".join([head, *rows]) + "\n", "utf-8")
    return path


@pytest.fixture(scope="module")
def tip(tmp_path_factory):
    """Along the feed one mode, across it nothing."""
    folder, f = tmp_path_factory.mktemp("tip"), np.arange(300.0, 1500.0, 0.25)
    feed = written(folder / "x.csv", f, 1e6 * receptance(f))
    return feed, written(folder / "y.csv", f, 0.0 * receptance(f))


def test_heads_in_round_brackets(tmp_path):
    """As spreadsheets have them; units with brackets of their own are in square ones."""
    f, own = np.arange(300.0, 900.0, 1.0), (2j * np.pi * np.arange(300.0, 900.0, 1.0)) ** 2
    heads = "f (Hz),re (mm/N),im (mm/N)", "f [Hz],re [(m/s^2)/N],im [(m/s^2)/N]"
    for head, size in zip(heads, (1e3, own), strict=True):
        path = written(tmp_path / "tip.csv", f, receptance(f) * size, head)
        G = MeasuredReceptance.read(path).matrices[:, 0, 0]
        np.testing.assert_allclose(G, receptance(f), rtol=1e-12)


def by_hand(speed):
    """The least depth over all lobes: ``a = 2 pi / (N K_t alpha Re G)``, Tlusty's phase."""
    alpha = -KR * np.pi  # a slot: half of -2 K_r pi
    depths = []
    for waves in range(30):

        def missed(f, waves=waves):
            G = receptance(f)
            turned = (3 * np.pi + 2 * np.arctan2(G.imag, G.real)) / (2 * np.pi)
            return f * 60.0 / (speed * TEETH) - waves - turned

        low, high = HERTZ * (1.0 + 1e-9), 1499.0
        if missed(low) * missed(high) < 0.0:
            f = brentq(missed, low, high)
            depths.append(2 * np.pi / (TEETH * KT * alpha * receptance(f).real))
    return min(depths)


@pytest.mark.parametrize("speed", [2600.0, 4100.0, 7000.0, 11500.0])
def test_lobes_of_one_mode(tip, speed):
    """Depth at a speed, and the depth that is stable at every speed."""
    curve = lobes(MeasuredReceptance.read(*tip), SLOT, [speed])
    assert curve.depths[0] == pytest.approx(by_hand(speed), rel=2e-3)
    least = 8 * np.pi * K * ZETA * (1 + ZETA) / (TEETH * KT * KR * np.pi)
    assert curve.least == pytest.approx(least, rel=1e-4)


def test_command_line_in_other_units_and_files(tip, tmp_path):
    """Receptance, accelerance, and MAT: the same depths; no damping asked."""
    words = (*COMMAND, "6000:9000:4")
    told = answer(*words, "--measured", tip[0], "--measured", tip[1])["lobes"]
    assert told["depths"][1] == pytest.approx(by_hand(7000.0), rel=2e-3)
    assert "measured" in told["assumed"]
    f = np.arange(300.0, 1500.0, 0.25)
    G = receptance(f)
    rates = -((2 * np.pi * f) ** 2) * G
    files = [
        written(tmp_path / "a.csv", f, rates, "f [Hz],re [m/s^2/N],im [m/s^2/N]"),
        written(tmp_path / "b.csv", 1e-3 * f, 1e6 * G, "f [kHz],re [mm/kN],im [mm/kN]"),
    ]
    savemat(
        tmp_path / "m.mat",
        {"tap": np.stack([f, 1e6 * G.real, 1e6 * G.imag], axis=1), "units": "Hz, um/N, um/N"},
    )
    for file in (*files, tmp_path / "m.mat"):
        other = answer(*words, "--measured", file, "--measured", tip[1])["lobes"]
        assert other["depths"] == pytest.approx(told["depths"], rel=1e-9)
    for idle in (("--damping", "0.02"), ("--tip", "0,0,0.1"), ("--normal", "0,1,0")):
        refused = run(*words, "--measured", tip[0], *idle, code=2)
        assert f"--measured: has its own directions, point and damping, got {idle[0]}" in refused
    once = run(*words, "--measured", tip[0])
    assert "the same along feed and normal" in once
    assert "spindle, holder and tool are rigid" in run(*words, "--damping", "0.02")


def test_joints_alone(tmp_path):
    """What is rigid is said; a table without units, or of magnitudes, is refused in a line."""
    arm = cartstiff.load("stewart-simscape")
    curve = lobes(cartstiff.modes(arm), SLOT, [9000.0], 0.02)
    assert curve.assumed.startswith("joints alone give way; spindle, holder and tool are rigid")
    f = np.arange(300.0, 320.0)
    G = receptance(f)
    words = (*COMMAND, "6000:9000:4", "--measured")
    bare = written(tmp_path / "a.csv", f, G, "frequency,real,imaginary")
    run(*words, bare, code=2, said="real [um/N]")
    phase = written(tmp_path / "b.csv", f, G, "frequency [Hz],size [um/N],phase [deg]")
    assert "no frequency response with units" in run(*words, phase, code=2)
    savemat(tmp_path / "m.mat", {"tap": np.ones((4, 3))})
    assert "units" in run(*words, tmp_path / "m.mat", code=2)
    (tmp_path / "n.mat").write_bytes(b"MATLAB 5.0" + b"\0" * 300)
    assert "MAT" in run(*words, tmp_path / "n.mat", code=2)
    shorter = written(tmp_path / "c.csv", f[:9], 1e6 * G[:9])
    whole = written(tmp_path / "d.csv", f, 1e6 * G)
    assert "frequencies" in run(*words, whole, "--measured", shorter, code=2)


def test_frequencies_that_cannot_be_used_are_named_by_file_and_row(tmp_path):
    """Rows that do not ascend, one row alone; in CSV by line, in MAT by row."""
    words, f = (*COMMAND, "6000:9000:4", "--measured"), np.array([0.0, 300.0, 320.0, 310.0])
    file = written(tmp_path / "a.csv", f, receptance(f))
    assert "a.csv, line 5: measured frequencies" in (told := run(*words, file, code=2))
    assert "got 310 Hz" in told
    savemat(tmp_path / "b.mat", {"tap": np.stack([f, f, f], 1), "units": "Hz, um/N, um/N"})
    assert "b.mat, row 4: measured frequencies" in run(*words, tmp_path / "b.mat", code=2)
    below = written(tmp_path / "c.csv", -f[1:], receptance(f[1:]))
    assert "c.csv, line 2" in run(*words, below, code=2)
    alone = written(tmp_path / "d.csv", f[:2], receptance(f[:2]))
    assert "d.csv, line 1: measured frequencies" in run(*words, alone, code=2)
