"""How close two bodies can be before they are one target.

    python studies/close_bodies.py [--runs 20] [--seed 0]

Two people walk in line or abreast, or a person and a dog, one behind the other, towards an X4 in an empty room (the
conditions of ``everyday.py``). Counted are runs with two targets, with one that is flagged ``more_than_one_body`` or
``more_than_one_rhythm``, and with one that is silent. Prints markdown.
"""

from __future__ import annotations

import argparse
import warnings
from collections import Counter

import numpy as np
from everyday import observe
from everyday_scenes import companions

import doppelgait as dg
from doppelgait.pipeline import analyze

APART_M = (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 1.0, 1.2, 1.5)
PAIRS = {
    "in line": {"side_m": 0.0, "ahead_m": -1.0},
    "abreast": {"side_m": 1.0, "ahead_m": 0.0},
    "dog ahead": {"side_m": 0.0, "ahead_m": 1.0, "walks_dog": True},
}


def outcome(places: dict[str, float], apart_m: float, seed: tuple[int, ...]) -> str:
    """Return "two", "flagged" or "silent" for one recording."""
    scaled = {name: value * apart_m if name.endswith("_m") else value for name, value in places.items()}
    setup = companions(np.random.default_rng(seed), **scaled)
    recording, _ = observe(setup, dg.rng(int(np.random.default_rng(seed).integers(2**31))))
    results = analyze(recording)
    if len(results) >= 2:
        return "two"
    return "flagged" if any(flag.startswith("more_than_one") for one in results for flag in one.flags) else "silent"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    print("| two / flagged / silent |", " | ".join(f"{apart_m:g} m" for apart_m in APART_M), "|")
    print("| --- |" + " ---: |" * len(APART_M))
    for number, (name, places) in enumerate(PAIRS.items()):
        cells = []
        for place, apart_m in enumerate(APART_M):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                seen = Counter(outcome(places, apart_m, (options.seed, number, place, k)) for k in range(options.runs))
            cells.append(f"{seen['two']}/{seen['flagged']}/{seen['silent']}")
        print(f"| {name} |", " | ".join(cells), "|", flush=True)


if __name__ == "__main__":
    main()
