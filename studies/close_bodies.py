"""How close two bodies can be before they are one target.

    python studies/close_bodies.py --page

Question: from which distance on are two bodies two targets, and is one target of two bodies flagged?

Two people walk in line or abreast, or a person and a dog, one behind the other, towards an X4 in an empty room (the
conditions of [everyday scenes](everyday.md)). A cell has four counts of runs: two targets / one that is flagged
`more_than_one_body` or `more_than_one_rhythm` / one without a flag / an analysis that ends with an error. It takes
about 2 minutes of one core.

Not shown: people who walk at different speeds or cross, who are in the everyday scenes.
"""

from __future__ import annotations

from collections import Counter
from itertools import product
from typing import Any

import numpy as np
from everyday import observe
from everyday_scenes import companions
from harness import finish, make_parser, markdown, quiet, run_jobs

import doppelgait as dg
from doppelgait.core.errors import DoppelgaitError
from doppelgait.pipeline import analyze

APART_M = (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 1.0, 1.2, 1.5)
PAIRS = {
    "in line": {"side_m": 0.0, "ahead_m": -1.0},
    "abreast": {"side_m": 1.0, "ahead_m": 0.0},
    "dog ahead": {"side_m": 0.0, "ahead_m": 1.0, "walks_dog": True},
}

OUTCOMES = ("two", "flagged", "silent", "refused")


def outcome(places: dict[str, float], apart_m: float, seed: tuple[int, ...]) -> str:
    """Return "two", "flagged" or "silent" for one recording."""
    scaled = {name: value * apart_m if name.endswith("_m") else value for name, value in places.items()}
    setup = companions(np.random.default_rng(seed), **scaled)
    recording, _ = observe(setup, dg.rng(int(np.random.default_rng(seed).integers(2**31))))
    try:
        results = analyze(recording)
    except DoppelgaitError:
        return "refused"
    if len(results) >= 2:
        return "two"
    return "flagged" if any(flag.startswith("more_than_one") for one in results for flag in one.flags) else "silent"


def run_pair(job: tuple[str, float, int]) -> list[dict[str, Any]]:
    """Simulate and analyse one pair."""
    quiet()
    name, apart_m, run = job
    seed = (0, list(PAIRS).index(name), APART_M.index(apart_m), run)
    return [{"pair": name, "apart_m": apart_m, "outcome": outcome(PAIRS[name], apart_m, seed)}]


def main() -> None:
    """Run all pairs and write the table."""
    parser = make_parser(__doc__)
    parser.add_argument("--runs", type=int, default=10)
    options = parser.parse_args()
    jobs = list(product(PAIRS, APART_M, range(options.runs)))
    rows = run_jobs(run_pair, jobs, rows=options.rows, processes=options.processes)
    count = Counter((row["pair"], row["apart_m"], row["outcome"]) for row in rows)
    cells = [
        (name, *("/".join(str(count[name, apart_m, word]) for word in OUTCOMES) for apart_m in APART_M))
        for name in PAIRS
    ]
    table = markdown(("distance", *(f"{apart_m:g} m" for apart_m in APART_M)), cells)
    title = f"Two / flagged / silent / refused, {options.runs} runs a cell"
    finish(__file__, __doc__, {title: table}, page=options.page)


if __name__ == "__main__":
    main()
