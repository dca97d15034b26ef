"""The wheel and the source archive as they are released: what is in them, and that the wheel works on its own."""

import json
import os
import subprocess
import sys
import tarfile
import venv
import zipfile
from importlib.metadata import Distribution, distribution, distributions
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import doppelgait
import processes
from checkout import ROOT

pytestmark = pytest.mark.release
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


def closure(wheel: Path) -> dict[str, Distribution]:
    """What pip would install with a wheel, by name, as it is installed here: no extras, every release allowed."""
    (facts,) = distributions(path=[str(wheel)])
    found: dict[str, Distribution] = {}
    left = [facts]
    while left:
        of = left.pop()
        for line in of.requires or ():
            needed = Requirement(line)
            name = canonicalize_name(needed.name)
            if needed.marker is not None and not needed.marker.evaluate({"extra": ""}):
                continue
            there = distribution(name)
            assert needed.specifier.contains(there.version, prereleases=True), f"{line}: {there.version} is installed"
            if name not in found:
                found[name] = there
                left.append(there)
    return found


def link(package: Distribution, place: Path) -> None:
    """Let an environment have an installed package: links to all that stands at the top of its list of files."""
    tops = {path.parts[0] for path in package.files or () if path.parts[0] not in ("..", "__pycache__")}
    assert tops, f"{package.name}: no list of files"
    for top in tops:
        if not (place / top).exists():
            (place / top).symlink_to(Path(str(package.locate_file(top))))


PLAN = """
[dataset]
name = "tiny"
examples_per_class = 2
fractions = { train = 0.5, test = 0.5 }
[scene]
duration_s = 1.0
[target]
range_m = 4.0
[[classes]]
label = "human"
motion = { kind = "boulic", speed_mps = { uniform = [0.8, 1.6] } }
[[classes]]
label = "dog"
motion = { kind = "quadruped", gait = "trot" }
"""


@pytest.fixture(scope="module")
def run(built, tmp_path_factory):
    """Run a command of an environment that has the wheel and what it asks for, nothing else and not this checkout.

    pip would fetch and unpack the same again; the folder is that in which all of them run.
    """
    if os.name == "nt":
        pytest.skip("needs links")
    wheel, _ = built
    folder = tmp_path_factory.mktemp("alone")
    environment = folder / "env"
    venv.create(environment, symlinks=True)
    packages = environment / "lib" / f"python{sys.version_info.major}.{sys.version_info.minor}" / "site-packages"
    needed = closure(wheel)
    assert {"numpy", "xarray", "typer"} < needed.keys()
    assert not {"numba", "llvmlite"} & needed.keys()
    for package in needed.values():
        link(package, packages)

    def run(*command: str, code: int = 0) -> str:
        outside = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "VIRTUAL_ENV")}
        done = processes.run(
            [str(environment / "bin" / command[0]), *command[1:]], cwd=folder, env=outside, check=False,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=SLOW_S,
        )  # fmt: skip
        assert done.returncode == code, done.stdout
        return done.stdout

    pip = [sys.executable, "-m", "pip", "--python", str(environment / "bin" / "python"), "install", "--quiet"]
    alone = ["--no-deps", "--no-index", "--no-compile", "--disable-pip-version-check", str(wheel)]
    installed = processes.run([*pip, *alone], capture_output=True, text=True, check=False, timeout=SLOW_S)
    assert installed.returncode == 0, installed.stdout + installed.stderr
    place = run("python", "-c", "import doppelgait; print(doppelgait.__file__)")
    assert Path(place.strip()).is_relative_to(environment)
    run.folder = folder
    return run


def test_the_wheel_works_in_an_environment_of_its_own(run):
    assert run("doppelgait", "--version").strip() == doppelgait.__version__
    assert "No module named 'uvicorn'" in run("python", "-c", "import uvicorn", code=1)
    assert "7.29" in run("doppelgait", "radar", "list")
    assert "torso_velocity_mps" in run("doppelgait", "demo", "-o", "shown")
    assert (run.folder / "shown" / "recording.h5").stat().st_size > 1_000_000
    names = {path.name for path in (run.folder / "shown").glob("*.png")}
    assert {"0-human-overview.png", "1-dog-signature.png", "1-dog-cadence-velocity.png"} <= names
    assert len(names) > 10
    assert "doppelgait[viewer]" in run("doppelgait", "view", "shown/recording.h5", "--no-browser", code=2)


def test_the_wheel_builds_a_dataset_and_decides_with_its_models(run):
    (run.folder / "plan.toml").write_text(PLAN)
    run("doppelgait", "dataset", "build", "plan.toml", "-o", "tiny", "--executor", "serial")
    assert "passed" in run("doppelgait", "dataset", "verify", "tiny")
    code = "import doppelgait as dg; print(dg.open_dataset('tiny').arrays('signature', as_='picture').values.shape)"
    assert run("python", "-c", code).strip() == "(4, 64, 64)"
    person = ["--motion", "human", "--label", "human", "--range", "4", "--speed", "1.3", "--set", "radar.prf_hz=640"]
    run("doppelgait", "simulate", *person, "--duration", "4", "-o", "person.h5")
    out = run("doppelgait", "classify", "person.h5", "--json")
    decided = json.loads(out[out.index("{") : out.rindex("}") + 1])  # notes are before or behind it
    assert decided["model"]["dataset"].startswith("home-alarm-life-x4")  # the network of tracks
    assert [track["decision"] for track in decided["tracks"]] == ["human"]
