"""The documentation site as published: every page built, every example of the gallery run, every link followed."""

import shutil
import sys

import pytest

import processes
from checkout import ROOT

DOCS = ROOT / "docs"
MADE = ("_build", "auto_gallery", "reference", "__pycache__")


@pytest.mark.release
def test_the_site_builds_without_a_warning_with_every_example_run_and_no_broken_link(tmp_path):
    pytest.importorskip("sphinx_gallery", reason="the documentation needs pip install 'doppelgait[docs]'")
    source, site = tmp_path / "docs", tmp_path / "site"
    shutil.copytree(DOCS, source, ignore=shutil.ignore_patterns(*MADE))
    shutil.copytree(DOCS.parent / "examples", tmp_path / "examples")
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", str(source), str(site)]
    built = processes.run(command, capture_output=True, text=True, check=False, timeout=280)
    assert built.returncode == 0, built.stdout + built.stderr
    examples = sorted(path.stem for path in (DOCS / "gallery").glob("plot_*.py"))
    shown = site / "auto_gallery"
    assert len(examples) >= 10
    assert all(list((site / "_images").glob(f"sphx_glr_{name}_001.*")) for name in examples)
    assert all((shown / f"{name}.html").is_file() for name in examples)
    checked = processes.run(
        [sys.executable, str(DOCS / "check_links.py"), str(site)], capture_output=True, text=True, check=False
    )
    assert checked.returncode == 0, checked.stdout + checked.stderr
