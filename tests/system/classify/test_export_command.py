"""``doppelgait model export`` as a command."""

import json
from importlib.util import find_spec

import pytest

from command import run
from doppelgait.classify import save_model
from doppelgait.core.errors import ConfigError, DatasetError
from export_models import export_model_of, require


def export(*words):
    return run("model", "export", *words).stdout


@pytest.fixture
def file(tmp_path):
    return save_model(export_model_of("ensemble"), tmp_path / "model.npz")


@pytest.mark.parametrize(
    ("form", "files"),
    [
        ("c", {"doppelgait_model.h", "doppelgait_model.c", "selftest.c", "golden.bin"}),
        ("numpy", {"model.npz", "scorer.py"}), ("onnx", {"model.onnx"}),
    ],
)  # fmt: skip
def test_every_form_is_a_folder_with_the_facts_of_the_model(file, tmp_path, form, files):
    if form == "onnx":
        require(find_spec("onnx"), "onnx: pip install 'doppelgait[export]'")
    found = json.loads(export(file, "--form", form, "-o", tmp_path / "out", "--json"))
    assert set(found["files"]) == files
    assert {path.name for path in (tmp_path / "out").iterdir()} == {*files, "export.json"}
    facts = json.loads((tmp_path / "out" / "export.json").read_text(encoding="utf-8"))
    assert facts["form"] == form
    assert facts["model"]["classes"] == ["a", "b"]
    export(file, "--form", form, "-o", tmp_path / "out")  # an earlier export is replaced


def test_size_and_work_are_printed(file, tmp_path):
    text = export(file, "--form", "c", "--int8", "--window-s", "1", "--bins", "4", "-o", tmp_path / "out")
    for words in ("flash table bytes", "ram bytes", "multiply adds network per window", "int8 largest difference"):
        assert words in text


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--form", "tflite"], "allowed are c, numpy, onnx"),
        (["--form", "onnx", "--int8"], "has no settings of a radar or device"),
        (["--form", "c", "--prf-hz", "100"], "the model was trained on 500 to 500"),
    ],
)
def test_what_cannot_be_exported_is_refused(file, tmp_path, arguments, words):
    with pytest.raises(ConfigError, match=words):
        export(file, *arguments, "-o", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_other_files_are_not_replaced(file, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "firmware.c").write_text("int main(void) { return 0; }")
    with pytest.raises(ConfigError, match=r"firmware\.c"):
        export(file, "--form", "numpy", "-o", tmp_path / "out")


def test_a_file_that_is_no_model_is_refused(tmp_path):
    (tmp_path / "model.npz").write_bytes(b"nothing")
    with pytest.raises(DatasetError):
        export(tmp_path / "model.npz", "--form", "numpy", "-o", tmp_path / "out")
