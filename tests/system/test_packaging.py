"""The wheel and the source archive as they are released: what is in them, and that the wheel works on its own."""

from __future__ import annotations

import os
import sys
import tarfile
import venv
import zipfile
from pathlib import Path

import pytest

import doppelgait
import processes
from checkout import ROOT

SLOW_S = 280.0
PACKAGE = ROOT / "src" / "doppelgait"


@pytest.fixture(scope="module")
def built(tmp_path_factory) -> tuple[Path, Path]:
    """Wheel and source archive, made with the installed hatchling."""
    folder = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(folder), str(ROOT)]
    done = processes.run(command, capture_output=True, text=True, check=False, timeout=SLOW_S)
    assert done.returncode == 0, done.stdout + done.stderr
    (wheel,), (source,) = folder.glob("*.whl"), folder.glob("*.tar.gz")
    return wheel, source


def test_the_wheel_holds_every_file_of_the_package_and_nothing_else(built):
    wheel, _ = built
    names = set(zipfile.ZipFile(wheel).namelist())
    wanted = {
        f"doppelgait/{path.relative_to(PACKAGE).as_posix()}"
        for path in PACKAGE.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    info = f"doppelgait-{doppelgait.__version__}.dist-info/"
    assert wanted <= names
    assert all(name.startswith(info) for name in names - wanted), sorted(names - wanted)
    assert "doppelgait/viewer/static/index.html" in names
    assert f"{info}licenses/LICENSE" in names


def test_the_source_archive_has_what_its_tests_and_docs_need_and_nobodys_data(built):
    _, source = built
    with tarfile.open(source) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    for needed in (
        "pyproject.toml",
        "LICENSE",
        "CHANGELOG.md",
        "docs/conf.py",
        "tests/conftest.py",
        "examples/walk.toml",
    ):
        assert needed in names
    assert not [name for name in names if name.endswith((".h5", ".c3d", ".bvh", ".dat", ".parquet", ".pyc"))]
    assert not [name for name in names if name.startswith(("docs/_build", "docs/auto_", "home-alarm", ".venv"))]


@pytest.mark.slow
def test_the_wheel_works_in_an_environment_of_its_own(built, tmp_path):
    wheel, _ = built
    environment = tmp_path / "env"
    venv.create(environment, with_pip=True)
    scripts = environment / ("Scripts" if os.name == "nt" else "bin")

    def run(*command: str, code: int = 0) -> str:
        outside = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "VIRTUAL_ENV")}
        outside["NUMBA_OPT"] = "0"  # compiled once and thrown away
        done = processes.run(
            [str(scripts / command[0]), *command[1:]], cwd=tmp_path, env=outside, capture_output=True, text=True,
            check=False, timeout=SLOW_S,
        )  # fmt: skip
        assert done.returncode == code, done.stdout + done.stderr
        return done.stdout + done.stderr

    run("python", "-m", "pip", "install", "--quiet", "--no-compile", str(wheel))
    assert run("doppelgait", "--version").strip() == doppelgait.__version__
    place = run("python", "-c", "import doppelgait; print(doppelgait.__file__)")
    assert Path(place.strip()).is_relative_to(environment)
    run("doppelgait", "simulate", "--motion", "boulic", "--label", "human", "--duration", "2", "-o", "walk.h5")
    assert (tmp_path / "walk.h5").stat().st_size > 1_000_000
    assert "7.29" in run("doppelgait", "radar", "show", "x4")
    assert "doppelgait[viewer]" in run("doppelgait", "view", "walk.h5", "--no-browser", code=2)
