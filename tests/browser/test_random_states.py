"""Random states of a page and of its file are what the API says, titles and units included.

Keys are pressed and states are wished for faster than answers come. Every answer that is shown
is compared with an analysis of the state that the page says it is of.
"""

import json

import numpy as np
import pytest
from tools.screenshot import settled

import cartstiff
from cartstiff.geometry import se3
from tests.support.pages import page_text, source_of

#: What is pressed between wishes: undo and redo, quantity, connections, angles, states, Escape.
KEYS = ["u", "U", "s", "s", "1", "2", "3", "4", "6", "d", "a", "b", "Escape"]
#: Wish, press, and wait for the answer of every third state only; all that is shown is recorded.
RUN = """async ([wishes, presses]) => {
    const store = window.cartstiff;
    const text = (what) => document.querySelector(what).textContent;
    const found = [];
    const listener = () => {
        const { shown, numbers } = store;
        found.push({ shown, q: numbers.result.q, pose: numbers.result.pose,
            matrix: store.matrix(shown.connection),
            title: text("#matrix-title"), heading: text(".principal-card h2"),
            whose: text(".principal thead td"), unit: text(".block-unit"), place: text(".place") });
    };
    store.addEventListener("numbers", listener);
    const isIdle = () => store.busy === null && !store.wanted;
    const rest = (done) => (isIdle() ? done() : setTimeout(rest, 3, done));
    const refused = [];
    for (const [i, wish] of wishes.entries()) {
        store.change(wish);
        for (const key of presses[i]) {
            document.body.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true }));
        }
        if (i % 3 === 2) await new Promise(rest);
        else await new Promise((done) => setTimeout(done, i % 2));
        if (store.refused !== null) refused.push(text("#verdict-text"));
    }
    await new Promise(rest);
    store.removeEventListener("numbers", listener);
    return { found, refused, state: store.state, shown: store.shown, isRefused: store.refused };
}"""
SUPERSCRIPTS = {"A": "ᴬ", "B": "ᴮ", "K": "ᴷ", "F": "ꟳ", "+": "⁺", "load": " under the load"}


def wishes_of(elastic, draw, count, refuses):
    """Random patches of a state; now and then one without an answer."""
    q0, lower, upper = elastic.q, *np.array([(-1.0, 1.0)] * len(elastic.q)).T
    found = []
    for _ in range(count):
        scale = 0.6 if elastic.mechanism.coordinates[0].is_length is False else 0.01
        wish = {"q": (q0 + scale * draw.uniform(lower, upper)).tolist(), "moved": None}
        if draw.random() < 0.6:
            wish["load"] = (draw.normal(size=6) * [5, 5, 5, 60, 60, 60]).tolist()
            wish["load_axes"] = str(draw.choice(["body", "world"]))
            wish["load_kind"] = str(draw.choice(["dead", "follower", "conservative"]))
            wish["load_at"] = None if draw.random() < 0.5 else draw.normal(0, 0.1, 3).tolist()
        if draw.random() < 0.5:
            wish["point"] = draw.normal(0, 0.1, 3).tolist() if draw.random() < 0.7 else [0, 0, 0]
            wish["axes"] = str(draw.choice(["body", "world"]))
        if draw.random() < 0.4:
            wish["quantity"] = str(draw.choice(["stiffness", "compliance"]))
            wish["connection"] = str(draw.choice(["load", "A", "B", "K", "F"]))
            wish["others"] = str(draw.choice(["free", "held"]))
        wish["stiffness"] = None
        if draw.random() < 0.3:
            k = elastic.springs.stiffness * draw.uniform(0.5, 2, len(elastic.springs.stiffness))
            if refuses and draw.random() < 0.3:
                k[1] = 0.0
            wish["stiffness"] = k.tolist()
        found.append(wish)
    return found


def analysed(elastic, shown):
    """The numbers of the API in the frame of the state."""
    if shown["stiffness"] is not None:
        elastic = elastic.with_springs([np.inf if k is None else k for k in shown["stiffness"]])
    load = {}
    if shown["load"] is not None:
        at = shown["point"] if shown["load_at"] is None else shown["load_at"]
        load = {"wrench": shown["load"], "load_axes": shown["load_axes"]}
        load |= {"load_kind": shown["load_kind"], "load_at": at}
    result = cartstiff.analyse(elastic, shown["q"], **load)
    R = result.pose[:3, :3].T if shown["axes"] == "world" else np.eye(3)
    return result, result.at(se3.pose(rotation=R, translation=shown["point"]))


def compare(elastic, one):
    """One shown answer against the API."""
    shown = one["shown"]
    result, here = analysed(elastic, shown)
    stiff, name = shown["quantity"] == "stiffness", shown["connection"]
    assert np.allclose(one["pose"], result.pose, rtol=0, atol=1e-12 * np.abs(result.pose).max())
    M = (here.matrices if stiff else here.compliances).get(name)
    if M is None:
        assert one["matrix"] is None
    else:
        assert np.abs(np.array(one["matrix"]) - M).max() <= 1e-9 * np.abs(M).max()
    acts = shown["load"] if shown["load"] is not None else result.wrench
    is_loaded = acts is not None and np.any(acts)
    symbol = ("K" if stiff else "C") + (SUPERSCRIPTS[name] if name != "load" or is_loaded else "")
    assert one["title"] == symbol
    assert one["whose"] == f"of {symbol}"
    assert one["heading"] == f"Principal {'stiffness' if stiff else 'compliance'}"
    assert one["unit"].endswith("/rad") if stiff else "rad/" in one["unit"]
    assert ("room axes" in one["place"]) == (shown["axes"] == "world")
    assert ("offset" in one["place"]) == any(shown["point"])


def run(page, elastic, seed, count):
    """Wish and press; returns the number of states that were shown and compared."""
    draw = np.random.default_rng(seed)
    refuses = page.url.startswith("http")
    wishes = wishes_of(elastic, draw, count, refuses)
    presses = [[str(k) for k in draw.choice(KEYS, draw.integers(0, 4))] for _ in wishes]
    told = page.evaluate(RUN, [wishes, presses])
    for one in told["found"]:
        compare(elastic, one)
    assert all(words.startswith("Last valid posture: ") for words in told["refused"])
    if told["isRefused"] is None:
        keys = ("load", "stiffness", "point", "axes", "quantity", "connection", "others")
        assert [told["state"][key] for key in keys] == [told["shown"][key] for key in keys]
    settled(page)
    # Undo and redo lead back to where they began.
    before = page.evaluate("() => JSON.stringify(window.cartstiff.state)")
    for key in ("u", "u", "U", "U"):
        page.keyboard.press(key)
    settled(page)
    after = json.loads(page.evaluate("() => JSON.stringify(window.cartstiff.state)"))
    apart = {k for k, x in json.loads(before).items() if x != after[k]}
    assert apart <= {"moved", "theme"}
    return len(told["found"])


@pytest.fixture
def opened(serve, pages, tmp_path_factory):
    def open_page(kind, name):
        if kind == "live":
            return pages.shared(serve(name).url)
        file = tmp_path_factory.getbasetemp() / f"random-{name}.html"
        if not file.exists():
            file.write_text(page_text(source_of(cartstiff.load(name))), encoding="utf-8")
        return pages.shared(file.as_uri())

    return open_page


@pytest.mark.parametrize(("kind", "name"), [("live", "ur5"), ("file", "hexapod")])
def test_random_states_are_those_of_the_api(opened, kind, name):
    assert run(opened(kind, name), cartstiff.load(name), 46, 24) >= 8


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["ur5", "hexapod", "panda"])
@pytest.mark.parametrize("kind", ["live", "file"])
def test_300_random_states_are_those_of_the_api(opened, kind, name):
    page, elastic = opened(kind, name), cartstiff.load(name)
    assert sum(run(page, elastic, seed, 100) for seed in (1, 2)) >= 60
