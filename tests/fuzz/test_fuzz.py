"""A short run of the fuzzer: all findings of earlier rounds, and some damage; ``make fuzz`` has more."""

import json
import sys
from pathlib import Path

import pytest

import processes
from checkout import ROOT

FUZZ = Path(__file__).with_name("fuzz.py")
pytestmark = pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="the limits of a process are those of Linux"
)
DOUBLES = """
import os
from readers import Target


def seeds(folder):
    (folder / "0").mkdir(parents=True)
    (folder / "0" / "a.bin").write_bytes(bytes(100))


def once(bad):  # the seed itself is good
    return lambda folder: (folder / "a.bin").read_bytes() == bytes(100) or bad()


def hang():
    while True:
        pass


def fail():
    raise AssertionError("no")


sizes = iter(range(0, 1_700_000_000, 95_000_000))  # each peak a little above the last


TARGETS = {
    "growing": Target(seeds, lambda folder: bytearray(b"a") * next(sizes), share=850),
    "hang": Target(seeds, once(hang)),
    "crash": Target(seeds, once(os.abort)),
    "memory": Target(seeds, once(lambda: bytearray(b"a") * 1_500_000_000)),
    "foreign": Target(seeds, once(lambda: {}["key"])),
    "nonsense": Target(seeds, once(fail)),
}
"""


def found_by(*options: str, fuzz: Path = FUZZ) -> list[dict[str, str]]:
    """Bad cases of a run."""
    done = processes.run([sys.executable, str(fuzz), "--together", *options], capture_output=True, text=True)
    assert "| all" in done.stdout, done.stderr[-2000:]
    return [json.loads(line) for line in done.stderr.splitlines() if line.startswith("  {")]


MEANWHILE = "--meanwhile --cases 600 --target radar-own,radar-dca1000"
MORE = [pytest.param(options, marks=pytest.mark.release) for options in ("", "--meanwhile --cases 1500")]


@pytest.mark.parametrize("options", ["--target attacks", MEANWHILE, *MORE])
def test_findings_of_earlier_rounds_and_damage_end_in_sense_or_one_of_our_errors(options: str) -> None:
    """``attacks`` stands for all findings, of which there are fewer than cases."""
    assert found_by("--cases", "3000", *options.split()) == []


@pytest.mark.release
def test_the_fuzzer_finds_what_it_should(tmp_path: Path) -> None:
    """A hang, a crash, a gigabyte, also of a growing sequence, a foreign error and nonsense, each by a target of its own."""
    place = tmp_path / "fuzz"
    place.mkdir()
    (tmp_path / "support").symlink_to(ROOT / "tests" / "support")
    for name in ("fuzz.py", "mutators.py", "attacks.py", "readers.py"):
        (place / name).write_text(FUZZ.with_name(name).read_text(encoding="utf-8"), encoding="utf-8")
    (place / "models.py").write_text(DOUBLES)
    bad = found_by("--target", "growing,hang,crash,memory,foreign,nonsense", "--cases", "22", fuzz=place / "fuzz.py")
    assert [one["case"] for one in bad if one["target"] == "growing"] == list(range(10, 17))  # from 1,045 MB
    faults = {str(one["target"]): str(one["fault"]) for one in bad}
    assert faults.pop("growing").endswith("MB of memory")
    assert faults.pop("memory").endswith("MB of memory")
    line = DOUBLES[: DOUBLES.index("once(lambda: {}")].count("\n") + 1
    assert faults == {
        "hang": "more than 15 s", "crash": "ended by signal 6", "foreign": f"KeyError: 'key' (models.py:{line})",
        "nonsense": "nonsense: no",
    }  # fmt: skip
