"""What ``--profile`` tells: shares that do not contain each other, and all postures in them."""

from __future__ import annotations

import json
import threading
import time

import numpy as np
import pytest
from tests.support.commands import answer, run

import cartstiff
from cartstiff.batch.postures import analyse_many
from cartstiff.batch.work import BY_REFERENCE, Work, describe, explained, timed, watched
from cartstiff.report.json_schema import json_schema


def _work(seconds: float) -> None:
    end = time.thread_time() + seconds
    while time.thread_time() < end:
        pass


def test_shares_do_not_contain_each_other():
    with watched() as work, timed("outside", 5):
        _work(0.002)
        for _ in range(2):
            with timed("inside", 1):
                _work(0.02)
    outside, inside = work.shares["outside"], work.shares["inside"]
    assert (outside.postures, inside.postures) == (5, 2)
    assert inside.seconds >= 0.04
    assert 0.002 <= outside.seconds < 0.04
    with timed("later"):
        pass
    assert "later" not in work.shares


def test_threads_count_into_the_same_shares():
    def one() -> None:
        with timed("thread", 1):
            _work(0.005)

    with watched() as work:
        threads = [threading.Thread(target=one) for _ in range(3)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert work.shares["thread"].postures == 3
    assert work.shares["thread"].seconds >= 0.015


@pytest.mark.parametrize("path", ["compiled", "portable", "engine"])
def test_every_posture_has_its_way(path):
    if path == "compiled":
        pytest.importorskip("llvmlite")
    elastic = cartstiff.load("hexapod")
    q = elastic.q + np.random.default_rng(0).uniform(-0.01, 0.01, (40, 6))
    with watched() as work:
        found = analyse_many(elastic, q, path=path)
    counts = {what: share.postures for what, share in work.shares.items() if share.postures}
    assert counts.pop(BY_REFERENCE, 0) == found.fallback
    if path == "engine":
        assert not counts
        return
    ((way, count),) = counts.items()
    assert count == 40
    assert ("machine code" in way) == (path == "compiled")
    share = work.shares[way]
    assert share.bytes >= 8 * 36
    assert share.operations > 500


def test_limits_are_those_of_the_largest_share():
    pytest.importorskip("llvmlite")
    work = Work()
    with watched() as watched_work, timed("little"):
        _work(0.001)
    work.shares |= watched_work.shares
    told = explained(work, 1.0, 0.5)
    assert told["limit"] == "all else"
    assert told["shares"][-1]["seconds"] == pytest.approx(0.5, abs=0.1)
    assert told["machine"]["operations"] > 1e8
    json.dumps(told, allow_nan=False)
    assert any("Gflop/s" in line for line in describe(told))


def test_map_explains_itself(tmp_path):
    pytest.importorskip("llvmlite")
    pytest.importorskip("zarr")
    words = "map hexapod --grid x=-0.01:0.01:60 --grid y=-0.01:0.01:50 --profile"
    quantity = "--quantity translation_free_min -o", tmp_path / "m.zarr"
    told = answer(words, *quantity)["explained"]
    by_name = {share["what"]: share for share in told["shares"]}
    ways = ("machine code", "recorded arithmetic")
    assert sum(s["postures"] for name, s in by_name.items() if name.startswith(ways)) == 3000
    assert "writing the file" in by_name
    assert "other processes" in run(words, "--dask tcp://127.0.0.1:1", *quantity, code=2)


def test_cartesian_map_tells_what_its_places_took(tmp_path):
    pytest.importorskip("zarr")
    words = "map ur5 --cartesian x=0.3:0.4:3,y=0:0.1:2,z=0.4:0.4:1 --branches 1 --profile"
    told = answer(words, "--quantity condition -o", tmp_path / "m.zarr")["explained"]
    counts = {share["what"]: share["postures"] for share in told["shares"]}
    assert counts["inverse kinematics of the places"] == 6


def test_analyse_explains_itself():
    jsonschema = pytest.importorskip("jsonschema")
    told = answer("analyse cubic --profile")
    jsonschema.validate(told, json_schema("analyse"))
    names = [share["what"] for share in told["explained"]["shares"]]
    assert names[0] == "reading the mechanism"
    assert any(name.startswith("engine") for name in names)
    assert "what limits" in run("analyse cubic --profile")
