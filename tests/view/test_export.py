"""The exported page: the same numbers, nothing from outside, the same bytes every time."""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
import re
from typing import Any

import numpy as np
import pytest
import umsgpack
from tests.support import read_mesh
from tests.support.pages import page_text, scripts, source_of, state_of, tab_of
from tests.support.robots import visuals_of
from tests.view.conftest import unpacked

import cartstiff


def held(page: str) -> tuple[dict[str, Any], list[bytes]]:
    """The data in a page: its object and the binary parts."""
    (text,) = re.findall(r'<script type="text/plain" id="data">([^<]*)</script>', page)
    return unpacked(gzip.decompress(base64.b64decode(text)))


@pytest.fixture(scope="module")
def platform_page() -> str:
    return page_text(source_of(cartstiff.load("stewart-gough")))


def test_nothing_comes_from_outside(platform_page):
    policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]*)"', platform_page)
    assert policy is not None
    rules = policy.group(1)
    assert rules.startswith("default-src 'none'; script-src 'sha256-")
    assert "unsafe-eval" not in rules
    assert "http" not in rules
    without_data = re.sub(r'<script type="text/plain"[^<]*</script>', "", platform_page)
    addresses = set(
        re.findall(r"(?:https?:)?//[a-z0-9.]+", re.sub(r"(?m)^\s*//.*$", "", without_data))
    )
    assert addresses <= {"http://www.w3.org"}, "the name of SVG is no request"
    assert not re.search(r"<(?:link|img|iframe|script)[^>]+(?:src|href)=\"(?!data:)", without_data)
    # The policy lets in just the two scripts that the page brings along.
    (script,) = re.findall(r'<script type="module">(.*?)</script>', platform_page, re.DOTALL)
    (zipped,) = re.findall(r'id="viewer">([^<]*)<', platform_page)
    for text in (script.encode(), gzip.decompress(base64.b64decode(zipped))):
        digest = base64.b64encode(hashlib.sha256(text).digest()).decode()
        assert f"'sha256-{digest}'" in rules


def test_the_same_page_twice_is_the_same_bytes(platform_page):
    assert page_text(source_of(cartstiff.load("stewart-gough"))) == platform_page


@pytest.mark.parametrize("name", ["grasp", "cable-robot"])
def test_a_mechanism_that_the_browser_cannot_compute_is_one_posture(name):
    elastic = cartstiff.load(name)
    q = elastic.q.copy()
    q[0] += 0.02 * (name == "cable-robot")
    data, _ = held(page_text(source_of(elastic, q)))
    result = cartstiff.analyse(elastic, q)
    posture = data["posture"]
    assert posture["result"] == json.loads(json.dumps(result.to_dict()))
    assert posture["why"] in (
        "a closed chain whose drives have no names is assembled posture by posture",
        "its cables may be slack",
    )
    assert posture["numbers"]["result"]["q"] == result.q.tolist()
    assert "program" not in data
    assert "frames" not in data


def test_the_state_of_a_tab_is_exported():
    arm = cartstiff.load("cubic")
    state = state_of(
        q=[0.01, 0, 0, 0, 0, 0.1],
        stiffness=[2e6] * 6,
        connection="A",
        theme="dark",
        load=(0, 0, 0, 0, 0, -500),
        point=(0.0, 0.0, 0.1),
    )
    data, _ = held(page_text(source_of(arm), state=state))
    springs = arm.with_springs(2e6)
    expected = cartstiff.analyse(springs, state.q, wrench=state.load, load_at=state.point)
    shown = data["hello"]["state"]
    assert shown["q"] == pytest.approx(expected.q, abs=1e-15)
    kept = ("stiffness", "connection", "load", "theme")
    assert [shown[key] for key in kept] == [[2e6] * 6, "A", [0, 0, 0, 0, 0, -500], "dark"]
    assert shown["point"] == [0.0, 0.0, 0.1]
    assert data["made"]["state"]["theme"] == "dark"
    # The words of its analysis are of that state.
    assert "K^A" in data["analysis"]["title"]
    assert f"{expected.matrices['A'][5, 5]:.4g}"[:4] in data["analysis"]["text"].replace(",", "")


def test_meshes_are_on_a_fine_grid():
    """A corner of a link differs from that of its file by half a step; the steps compress well."""
    arm = cartstiff.load("ur5")
    picture = tab_of(source_of(arm)).picture
    picture.draw(cartstiff.analyse(arm), state_of(q=arm.q.tolist()))
    packed = picture.by_path()[
        "set_object", "/meshcat/cartstiff/mechanism/joint 3/3 forearm_link", ""
    ]
    sent = umsgpack.unpackb(packed)["object"]["geometries"][0]["data"]["attributes"]["position"]
    positions = np.frombuffer(sent["array"].data, "<f4").reshape(-1, 3)
    (link,) = [piece for piece in visuals_of(arm.mechanism)[0] if piece.link == "forearm_link"]
    exact = read_mesh(link.shape.path).positions
    size = np.ptp(exact, axis=0).max()
    grid = 2.0 ** np.floor(np.log2(size)) / 4096
    assert np.abs(positions - exact).max() <= 0.51 * grid
    assert np.array_equal(np.round(positions / grid) * grid, positions)


@pytest.mark.parametrize("name", ["ur5", "five-bar", "3-rps", "6-ups", "delta"])
def test_the_file_of_an_arm_or_a_closed_chain_computes(name):
    page = page_text(source_of(cartstiff.load(name)))
    data, _ = held(page)
    assert "posture" not in data
    assert len(page.encode()) < 1.8e6
    rules = re.search(r'Content-Security-Policy" content="([^"]*)"', page)
    assert rules is not None
    assert "unsafe-eval" not in rules.group(1)
    assert page == page_text(source_of(cartstiff.load(name)))


def test_the_modules_fit_into_one_script():
    script = scripts()
    assert not re.search(r"^(import|export) ", script, re.MULTILINE)
    names = re.findall(r"^(?:async )?(?:function|const|let|class) (\w+)", script, re.MULTILINE)
    assert len(names) == len(set(names)), sorted({n for n in names if names.count(n) > 1})
    assert script.index("class Store") < script.index("function build(source)")


def test_the_file_of_a_commanded_machine_is_of_its_springs_as_told():
    machine = cartstiff.load("cubic")
    source = source_of(machine, command=[1e-4, 0.0, 0.0, -1e-4, 0.0, 0.0])
    assert tab_of(source).start.q == machine.q.tolist()
    data, _ = held(page_text(source))
    rest = cartstiff.after_command(machine, {"leg1": 1e-4, "leg4": -1e-4})
    shown = data["hello"]["state"]
    assert np.abs(np.array(shown["q"]) - rest.q).max() < 1e-12
    assert shown["command"] is None
