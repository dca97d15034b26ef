"""The harness of the studies, and the pages that they write."""

from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from checkout import ROOT
from doppelgait.dataset.finish import DATA_VERSION

PAGES = sorted(path for path in (ROOT / "docs" / "evidence").glob("*.md") if path.stem not in ("index", "reliability"))
DOC = """Sizes of things.

    python studies/sizes.py FOLDER --page

Question: how large are they (``size``, :func:`measure`)? It takes 2 minutes of
one core.

Not shown: small things.
"""


def test_jobs_that_are_there_are_not_run_again(study: ModuleType, tmp_path: Path) -> None:
    ran: list[int] = []

    def run(job: int) -> list[dict[str, object]]:
        ran.append(job)
        return [{"job": job, "value": np.float64(job) / 3, "missing": None, "right": np.bool_(job > 1)}]

    rows = tmp_path / "rows.jsonl"
    first = study.run_jobs(run, [1, 2], rows=rows)
    with rows.open("a") as file:
        file.write('{"job": "3", "ro')  # a run that was stopped
    lines = rows.read_text().splitlines()
    rows.write_text("\n".join(lines[:-1]) + "\n")
    assert study.run_jobs(run, [2, 3, 1], rows=rows) == [first[1], *run(3), first[0]]
    assert ran == [1, 2, 3, 3]
    assert study.run_jobs(run, [5]) == run(5)


def test_a_cut_line_is_left_out(study: ModuleType, tmp_path: Path) -> None:
    (tmp_path / "rows.jsonl").write_text('{"job": "1", "rows": []}\n{"job": "2", "ro')
    assert study.read_lines(tmp_path / "rows.jsonl") == [{"job": "1", "rows": []}]


def test_the_interval_of_a_mean_counts_groups(study: ModuleType) -> None:
    values = np.random.default_rng(1).normal(size=400)
    low, high = study.bootstrap_interval(values)
    assert (high - low) / 2 == pytest.approx(1.96 * values.std() / 20, rel=0.15)
    wide = study.bootstrap_interval(np.repeat(values[:20], 20), np.repeat(np.arange(20), 20))
    assert wide[1] - wide[0] > 2 * (high - low)


def test_matches_are_the_nearest_pairs_within_the_limit(study: ModuleType) -> None:
    distance = np.array([[0.1, 0.2], [0.15, 0.9], [0.0, 5.0]])
    assert study.match(distance, 1.0) == [(0, 1), (2, 0)]
    assert study.match(distance, 0.12) == [(2, 0)]
    assert study.match(np.zeros((0, 2)), 1.0) == []


def test_a_page_is_made_of_the_docstring(study: ModuleType) -> None:
    page = study.format_page(DOC, {"Table": study.markdown(("a", "b"), [("x", 1.0), ("y", np.nan)])}, date="today")
    assert page.startswith(
        f"# Sizes of things\n\nData version {DATA_VERSION}. Measured on today by\n\n    python studies"
    )
    assert "(`size`, `measure`)" in page
    assert "## Table\n\n| a | b |\n| --- | ---: |\n| x | 1.00 |\n| y | - |" in page
    assert page.endswith("## What it does not show\n\nSmall things.\n")
    assert study.read_text(DOC).time == "2 minutes of one core"


def test_the_index_lists_every_study(study: ModuleType) -> None:
    index = (ROOT / "docs" / "evidence" / "index.md").read_text(encoding="utf-8")
    assert index == study.format_index(), "python studies/harness.py writes it again"
    for stem in study.list_studies():
        assert f"({stem}.md)" in index or f"`studies/{stem}.py`" in index


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_states_its_data_version_and_belongs_to_a_study(study: ModuleType, page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert int(study.VERSION.findall(text)[0]) <= DATA_VERSION
    script = study.list_studies()[page.stem]
    assert script.command
    assert script.time
    assert script.limits
    assert text.split("\n")[0] == f"# {script.title}"
