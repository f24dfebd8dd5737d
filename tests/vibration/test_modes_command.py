"""The command `cartstiff modes` as a user runs it."""

from tests.support.commands import answer, run


def test_the_load_stands_beside_none():
    data = answer("modes five-bar --load 0,0,0,0,-300,0")
    assert data["load"]["given"]
    assert data["frequencies"] != data["unloaded"]["frequencies"]
    text = run("modes five-bar --load 0,0,0,0,-300,0")
    assert "under its dead load" in text
    assert "unloaded" in text


def test_everything_at_once(tmp_path):
    csv, plot = tmp_path / "h.csv", tmp_path / "h.png"
    arguments = (
        "modes five-bar --sensitivities --tolerance 0.1 --response 0:50:20 "
        f"--damping 0.02 --direction 1,0,0 -o {csv} -o {plot}"
    )
    data = answer(arguments)
    assert {"sensitivities", "intervals", "response"} <= set(data)
    assert len(csv.read_text().splitlines()) == 21
    assert plot.read_bytes().startswith(b"\x89PNG")
    text = run(arguments)
    for words in ("Sensitivities", "Intervals that hold 95", "Response"):
        assert words in text


def test_no_masses_is_a_state():
    data = answer("modes cubic")
    assert data["frequencies"] == []
    assert data["notes"][0]["code"] == "no-mass"
    assert "has a mass" in run("modes cubic --strict", code=3)


def test_weight_that_only_a_load_balances():
    """Forearms bend under a payload: without a load, rest positions balance its weight alone."""
    data = answer("modes delta --payload 3 --load 0,0,0,0,0,-10")
    zero = answer("modes delta --payload 3 --load 0,0,0,0,0,0")
    assert data["unloaded"]["frequencies"] == zero["frequencies"]
    assert data["frequencies"] != zero["frequencies"]
    assert "--load 0,0,0,0,0,0" in run("modes delta --payload 3")


def test_files_without_modes_are_refused(tmp_path):
    file = tmp_path / "h.csv"
    assert "has a mass" in run(f"modes cubic --response 1:2:3 -o {file}", code=3)
    assert not file.exists()
