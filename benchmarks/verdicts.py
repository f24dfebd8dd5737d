"""Whether fast arithmetic gives the engine's verdicts and numbers at random postures; its speed.

Half of the postures of arms have some joints at multiples of a quarter turn, or 1e-14 to 1e-2
beside it, where ranks are lost. Chains that are closed begin at home with their motors elsewhere.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

import cartstiff
from cartstiff import analyse_many
from cartstiff.files.struts.flexure_struts import FlexureStruts

MECHANISMS = (
    "ur5",
    "panda",
    "stewart-gough",
    "cable-robot",
    "6-ups",
    "3-rps",
    "delta",
    "five-bar",
    "flexure-hexapod",
)
OUTPUTS = ("jacobian", "stiffness_A", "stiffness_B", "compliance_A", "compliance_B")
LOAD = np.array([1.0, -2.0, 3.0, 20.0, 30.0, -40.0])
SMALL = ("flexure-hexapod",)  # a third of the load, for a machine as large as a hand
CHUNK = 2000


def drawn(elastic: cartstiff.ElasticMechanism, count: int, rng: np.random.Generator) -> np.ndarray:
    """Random coordinates (count, n), some of them near a singularity."""
    chain, n = elastic.mechanism, elastic.q.size
    if isinstance(elastic.springs, FlexureStruts):
        away = rng.uniform(-1.0, 1.0, (count, 1)) * rng.uniform(0.0, 0.03)
        return elastic.q + away * rng.uniform(-1.0, 1.0, (count, n)) * chain.length
    if getattr(chain, "closures", ()) or chain.kind != "serial":
        moved = [j for j in getattr(chain, "held", ()) if j not in getattr(chain, "virtual", ())]
        moved = moved or list(range(n))
        away = rng.uniform(-1.0, 1.0, (count, 1)) * rng.uniform(0.0, 0.6)
        q = np.tile(elastic.q, (count, 1))
        sizes = chain.at(elastic.q).coordinate_lengths[moved]
        q[:, moved] += away * rng.uniform(-1.0, 1.0, (count, len(moved))) * sizes
        return q
    q = rng.uniform(-np.pi, np.pi, (count, n))
    special = rng.integers(-2, 3, (count, n)) * (np.pi / 2)
    special += 10.0 ** rng.uniform(-14, -2, (count, n)) * rng.choice([0.0, 1.0], (count, n))
    taken = (rng.random((count, n)) < 0.3) & (rng.random((count, 1)) < 0.5)
    return np.where(taken, special, q)


def _finite(condition: np.ndarray) -> np.ndarray:
    """Condition numbers, 1 where rank is lost."""
    return np.where(condition < 1e14, condition, 1.0)


def compared(name: str, loaded: bool, given: argparse.Namespace) -> dict[str, float]:
    """What was seen over ``given.count`` postures of a mechanism."""
    elastic, rng, count = cartstiff.load(name), np.random.default_rng(given.seed), given.count
    if given.preload:
        elastic = elastic.with_springs(rest=given.preload * rng.uniform(-1, 1, elastic.q.size))
    load = {"wrench": LOAD * (0.3 if name in SMALL else 1.0)} if loaded else {}
    seen = {"engine": 0.0, "fast": 0.0, "differ": 0, "by engine": 0, "worst": 0.0, "irregular": 0}
    path = "compiled"
    analyse_many(elastic, drawn(elastic, 8, rng), outputs=given.outputs, path=path, **load)
    done = 0
    while done < count:
        q = drawn(elastic, min(CHUNK, count - done), rng)
        start = time.perf_counter()
        fast = analyse_many(elastic, q, outputs=given.outputs, path=path, **load)
        middle = time.perf_counter()
        engine = analyse_many(elastic, q, outputs=given.outputs, path="engine", **load)
        seen["fast"] += middle - start
        seen["engine"] += time.perf_counter() - middle
        states = [np.array(found.codes)[found.state] for found in (fast, engine)]
        seen["differ"] += int((states[0] != states[1]).sum())
        usual = "fewer-than-six-freedoms" if elastic.q.size < 6 else "regular"
        seen["irregular"] += int((states[1] != usual).sum())
        seen["by engine"] += fast.fallback
        with np.errstate(all="ignore"):
            J = np.nan_to_num(engine["jacobian"])
            values = np.linalg.svd(J, compute_uv=False)
            condition = _finite(values[:, 0] / values[:, -1])
            for output in given.outputs:
                a, b = fast[output], engine[output]
                seen["differ"] += int((np.isnan(a) != np.isnan(b)).any(axis=(1, 2)).sum())
                own = condition
                if output.startswith("compliance"):
                    known = np.isfinite(b).all(axis=(1, 2))
                    own = np.ones(len(b))
                    own[known] = _finite(np.linalg.cond(b[known]))
                size = np.abs(b).max(axis=(1, 2))
                error = np.abs(a - b).max(axis=(1, 2)) / np.where(size > 0.0, size, 1.0) / own
                seen["worst"] = max(seen["worst"], float(np.nanmax(error, initial=0.0)))
        done += len(q)
    return seen


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=100_000, help="postures a row")
    parser.add_argument("--only", nargs="+", default=list(MECHANISMS), metavar="NAME")
    parser.add_argument("--outputs", nargs="+", default=list(OUTPUTS), metavar="NAME")
    parser.add_argument(
        "--preload",
        type=float,
        default=0.0,
        metavar="ANGLE",
        help="give rest positions of joints (rad), or lengths of legs, at random "
        "within this on either side of zero",
    )
    parser.add_argument("--seed", type=int, default=5, help="of the postures")
    given = parser.parse_args()
    if "jacobian" not in given.outputs:
        given.outputs.append("jacobian")  # tells the condition
    heads = (
        "mechanism",
        "load",
        "postures",
        "not regular",
        "by the engine",
        "verdicts that differ",
        "error / condition",
        "engine, us",
        "fast, us",
    )
    print("|", " | ".join(heads), "|")
    print("|---|---" + "|---:" * (len(heads) - 2) + "|")
    for name in given.only:
        for loaded in (False, True):
            if loaded and name in ("stewart-gough", "cable-robot"):
                continue  # they have rest lengths
            seen = compared(name, loaded, given)
            each = 1e6 / given.count
            cells = (
                name,
                "given" if loaded else "none",
                given.count,
                seen["irregular"],
                seen["by engine"],
                seen["differ"],
                f"{seen['worst']:.0e}",
                f"{seen['engine'] * each:.0f}",
                f"{seen['fast'] * each:.1f}",
            )
            print("|", " | ".join(map(str, cells)), "|", flush=True)


if __name__ == "__main__":
    main()
