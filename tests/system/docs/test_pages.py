"""The pages made from the code say all that the code has, and the equations that docstrings cite are there."""

import ast
import calendar
import importlib
import json
import pkgutil
import re
import runpy
import sys

import h5py
import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import doppelgait
from checkout import ROOT
from doppelgait.classify.model import BLOCKING
from doppelgait.cli.app import app
from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import DoppelgaitError
from doppelgait.core.readers import OTHER_FILES
from doppelgait.motion.readers import MOTION_READERS, list_other_files
from doppelgait.radar import readers as radar_readers

DOCS = ROOT / "docs"
PAGES = sorted(path for path in DOCS.glob("**/*.md") if not {"_build", "reference"} & set(path.relative_to(DOCS).parts))
LABEL = re.compile(r"(?<![\w.-])E-\d\d[a-z]?\b")
INTERNAL = {
    "FrozenModel", "Path",  # bases of what users write
    "Conditions",  # the lists of a scene file, which stand at its top
    "Parquet", "WebDataset", "Zarr",  # options of an export
    "RowSpec", "ExampleSpec", "EmptySceneOptions", "Run",  # what configurations are resolved to
    "Facts", "Patch", "Training", "Holder",  # inside a model file, and a lock
    "A111Settings", "Settings", "Subsweep", "ExpmapSkeleton",  # inside records of other programs
}  # fmt: skip
"""Models whose keys no user writes into a file."""

SAID_BY_THEIR_NAME = {"analysis", "at_m", "classes", "dataset", "label", "name", "pause_s", "split", "tracking"}
"""Keys without words of their own: tables of another section, or told by the section's first line."""

pytestmark = pytest.mark.skipif(not DOCS.is_dir(), reason="the documentation is not part of a wheel")


@pytest.fixture(scope="module")
def pages():
    pytest.importorskip("sphinx")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(DOCS / "_ext")
        yield importlib.import_module("reference_pages").pages()


def test_every_equation_is_there_once_and_cited_and_no_other_is_cited():
    labels = [label for page in PAGES for label in re.findall(r"\\tag\{(E-[^}]*)\}", page.read_text())]
    assert len(labels) == len(set(labels)) >= 40
    cited = set()  # in docstrings, words below constants and messages
    for path in (*(ROOT / "src").rglob("*.py"), *(ROOT / "packages").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                cited |= set(LABEL.findall(node.value))
    assert set(labels) == cited
    for path in [*PAGES, *(ROOT / "src").rglob("*.py")]:  # comments, too
        assert set(LABEL.findall(path.read_text())) <= set(labels), path


def help_of(words):
    return CliRunner().invoke(app, [*words, "--help"], env={"COLUMNS": "200"}).output


def listed(text):
    """Commands that a help text names below "Commands:"."""
    after = text.partition("Commands:")[2]
    return re.findall(r"^  ([a-z][\w-]*) ", after, flags=re.MULTILINE)


def test_every_command_and_option_of_the_help_is_on_the_page(pages):
    sections = dict(re.findall(r"^## (.*?)\n(.*?)(?=^## |\Z)", pages["commands.md"], flags=re.MULTILINE | re.DOTALL))
    commands = []
    for word in listed(help_of([])):
        below = listed(help_of([word]))
        commands += [[word, name] for name in below] if below else [[word]]
    assert len(commands) >= 19
    for words in commands:
        section = sections.pop(f"doppelgait {' '.join(words)}")
        heads = re.findall(r"^  (-.*?)(?:  |<|$)", help_of(words).partition("Options:")[2], flags=re.MULTILINE)
        options = {flag for head in heads for flag in re.findall(r"--?[a-z][\w-]*", head)} - {"--help", "-h"}
        cells = re.findall(r"^\| (`-.*?) \|", section, flags=re.MULTILINE)
        assert {flag for cell in cells for flag in re.findall(r"`(.*?)`", cell)} == options, words
    assert set(sections) == {"doppelgait"}


def models():
    """Every parameter model of the package; modules for torch have none, and are not there without it."""
    for module in pkgutil.walk_packages(doppelgait.__path__, "doppelgait."):
        if "__main__" not in module.name:
            try:
                importlib.import_module(module.name)
            except DoppelgaitError as error:
                if "torch is not installed" not in str(error):
                    raise
    found, new = set(), {FrozenModel}
    while new:
        found |= new
        new = {kind for one in new for kind in one.__subclasses__() if kind.__module__.startswith("doppelgait")} - found
    return found


def test_every_key_of_every_model_is_on_a_page_with_words(pages):
    from setting_pages import groups

    from doppelgait.core.keys import parameter_words

    shown = {model for _, _, tables in groups().values() for _, model in tables}
    with_keys = {model for model in models() if set(model.model_fields) - {"kind"}}
    assert {model.__name__ for model in with_keys - shown} | {"FrozenModel"} == INTERNAL
    for name, (_, _, tables) in groups().items():
        sections = re.split(r"^## ", pages[f"configuration/{name}.md"], flags=re.MULTILINE)[1:]
        assert len(sections) == len(tables)
        for section, (heading, model) in zip(sections, tables, strict=True):
            assert section.startswith(heading + "\n")
            assert re.findall(r"^\| `(\w+)` \|", section, flags=re.MULTILINE) == list(model.model_fields)
            assert set(model.model_fields) - set(parameter_words(model)) <= SAID_BY_THEIR_NAME, model


def test_every_public_name_is_documented_once(pages):
    from api_pages import PACKAGES

    documented = re.findall(
        r"^\.\. auto(?:class|function|data|exception):: (\S+)", "\n".join(pages.values()), re.MULTILINE
    )
    assert len(documented) == len(set(documented))
    assert "doppelgait.scene.Scene" in documented, "by its package, not by the short name in the top package"
    paths = [path for folder in ("src", "packages") for path in (ROOT / folder).rglob("__init__.py")]
    initials = [path for path in paths if "\n__all__ = " in path.read_text()]
    listing = {".".join(path.parent.parts[path.parts.index("src") + 1 :]) for path in initials}
    assert listing - {"doppelgait.viewer"} == set(PACKAGES)
    for place in PACKAGES:
        module = importlib.import_module(place)
        for name in set(module.__all__) - {"__version__"}:
            full, listed_here = f"{place}.{name}", pages[f"api/{place}.rst"]
            is_package = f"{place}.{name}" in sys.modules and full not in documented
            assert full in documented or is_package or re.search(rf"\.{name}`", listed_here), full


def test_imports_of_examples_exist_also_where_no_test_runs_them():
    found = 0
    for page in sorted(DOCS.rglob("*.md")):
        for place, names in re.findall(r"^ *from (doppelgait[\w.]*) import ([\w, ]+)$", page.read_text(), re.MULTILINE):
            for name in names.split(", "):
                found += 1
                assert hasattr(importlib.import_module(place), name.split(" as ")[0]), f"{page}: {place}, {name}"
    assert found > 20


def test_formats_and_other_files_on_the_page_are_those_of_the_program():
    page = (DOCS / "howto" / "formats.md").read_text()
    rows = sorted(line.strip("| ").split(" | ") for line in page.split("\n") if line.startswith("| `"))
    readers = [*MOTION_READERS.values(), *radar_readers.RADAR_READERS.values()]
    others = [*list_other_files(), *radar_readers.list_other_files(), *OTHER_FILES]
    expected = [(f"`{reader.name}`", quote_names(reader.facts["suffixes"])) for reader in readers]
    expected += [(quote_names(other.suffixes), other.what) for other in others]
    assert [tuple(row[:2]) for row in rows] == sorted(expected)
    assert {other.remedy for other in others if isinstance(other.remedy, str)} <= {row[2] for row in rows}
    for room, stated in zip(("motion", "radar"), re.findall(r"(\d+) (?:lines )?for", page), strict=True):
        sources = (ROOT / "src" / "doppelgait" / room / "readers").glob("*.py")
        assert int(stated) == pytest.approx(sum(path.read_text().count("\n") for path in sources), rel=0.15), room


CITED = r"\b([A-Z][\w-]+)(?:(?:,| and) [A-Z][\w-]+)*(?: et al\.)?,? \(?((?:19[3-9]|20[0-2])\d)\b(?!-)"
CITED_VOLUME = r"[(;] ?([A-Z][\w-]+)[^();]{,70}?, ((?:19|20)\d\d)[,)]"
DATES = {*calendar.month_name, "Seed"}


def test_every_work_cited_by_author_and_year_is_in_the_references():
    rows = [line for line in (DOCS / "references.md").read_text().split("\n") if line.startswith("| ")]
    code = [path for room in ("src", "packages", "native") for path in (ROOT / room).rglob("*")]
    cited = set()
    for path in [ROOT / "README.md", *PAGES, *(path for path in code if path.suffix in (".py", ".toml", ".cpp"))]:
        text = re.sub(r"\s+(#|//)?\s*", " ", path.read_text())
        cited |= {*re.findall(CITED, text), *re.findall(CITED_VOLUME, text)}
    assert len(cited) > 45
    assert not [work for work in cited if work[0] not in DATES and not any(all(map(row.count, work)) for row in rows)]
    bib = (DOCS / "_static" / "references.bib").read_text()
    assert set(re.findall(r"\[doi:(.*?)\]", "".join(rows))) == set(re.findall(r"doi = \{(.*?)\}", bib))


def quote_names(names):
    return ", ".join(f"`{name}`" for name in names)


def test_names_in_the_glossary_exist():
    source = "\n".join(path.read_text() for path in (ROOT / "src").rglob("*.py"))
    words = set(re.findall(r"\w+", source))
    rows = [line.split("|")[2] for line in (DOCS / "glossary.md").read_text().split("\n") if line.startswith("| $")]
    quoted = [text for cell in rows for text in re.findall(r"`([^`]*)`", cell)]
    names = set(re.findall(r"\b[A-Za-z]\w+", "\n".join(quoted)))
    assert len(names) >= 40
    assert names <= words


def test_the_thresholds_on_the_page_are_those_of_the_program():
    page = (DOCS / "howto" / "confidence.md").read_text()
    rows = re.findall(r"^\| `(\w+)\.?(\w*)` \| (\S+) \| [^|]+ \| `([\w.]+)` \|", page, flags=re.MULTILINE)
    assert len(rows) > 60
    for name, key, value, module in rows:
        found = getattr(importlib.import_module(f"doppelgait.{module}"), name)
        if key:
            found = found[key] if isinstance(found, dict) else found.model_fields[key].default
        assert found == float(value), f"{name} {key}"
    flags = page.partition("Flags that block a decision:")[2].partition("\n\n")[0]
    assert tuple(re.findall(r"`([^`]+)`", flags)) == BLOCKING


def test_the_dataset_is_read_without_us_as_the_page_says(dataset, mixed, monkeypatch):
    """Stacked rows in full precision, and rows of several shapes in half."""
    code = re.search(r"```python\n(.*?)```", (DOCS / "dataset-format.md").read_text(), flags=re.DOTALL)
    for read in (dataset, mixed):
        folder = read.directory
        monkeypatch.chdir(folder.parent)
        names: dict = {}
        exec(code.group(1).replace('Path("home-alarm")', f"Path({folder.name!r})"), names)
        assert "doppelgait" not in code.group(1)
        example = read[names["row"].id]
        np.testing.assert_allclose(names["signature"], example.signature.values, rtol=1e-6)
        np.testing.assert_array_equal(names["doppler_hz"], example.signature["doppler"].values)
        assert names["signature"].shape == (names["time_s"].size, names["doppler_hz"].size)
        assert list(names["features"].columns) == [f"feature_{name}" for name in names["about"]["features"]]
        assert names["row"].id in names["train"] or names["row"].split != "train"


def test_every_column_field_and_key_of_a_dataset_is_on_the_page(folder, pages):
    page = (DOCS / "dataset-format.md").read_text() + pages["fields.md"] + pages["extended.md"]
    named = set(re.findall(r"`([^`\n]*)`", page))
    for column in pd.read_parquet(folder / "index.parquet").columns:
        family = f"{column.partition('_')[0]}_*"
        assert column in named or family in {"feature_*", "sd_*"} & named, column
    assert set(json.loads((folder / "dataset.json").read_text())) <= named
    with h5py.File(next((folder / "shards").glob("*.h5"))) as shard:
        assert set(shard) - {"id"} <= named


def test_links_between_pages_lead_somewhere():
    """On GitHub as in the built pages: files, and headings in them."""
    pages = {
        *ROOT.glob("*.md"),
        *PAGES,
        *(p for d in ("examples", "studies", "tools") for p in (ROOT / d).rglob("*.md")),
    }
    assert len(pages) > 25
    for page in sorted(pages):
        for target in re.findall(r"\]\(([^)\s]+)\)", re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)):
            if target.startswith("http"):
                continue
            name, _, anchor = target.partition("#")
            file = (page.parent / name).resolve() if name else page
            assert file.exists(), f"{page.name}: {target} is not in a clone"
            if anchor and file.suffix == ".md":
                headings = [line.lstrip("#").strip() for line in file.read_text().split("\n") if line.startswith("#")]
                anchors = [re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings]
                assert anchor in anchors, target


def test_publishing_keeps_the_versions_and_names_the_newest(tmp_path):
    publish = runpy.run_path(str(DOCS / "publish.py"))["publish"]
    html, site = tmp_path / "html", tmp_path / "site"
    html.mkdir()
    site.mkdir()
    with pytest.raises(SystemExit, match=r"no index\.html"):
        publish(html, site, version="0.1.0", base="/d/")
    (html / "index.html").write_text("first")
    for version in ("0.9.0", "0.10.0", "1.0.0.dev1", "0.9.0"):
        publish(html, site, version=version, base="/d/")
    versions = json.loads((site / "versions.json").read_text())
    assert [entry["version"] for entry in versions] == ["1.0.0.dev1", "0.10.0", "0.9.0"]
    assert [entry["url"] for entry in versions if entry["preferred"]] == ["/d/0.10.0/"]
    assert "0.10.0/" in (site / "index.html").read_text()
    assert {path.name for path in site.iterdir()} == {"0.10.0", "0.9.0", "1.0.0.dev1", "index.html", "versions.json"}
