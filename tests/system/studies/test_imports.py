"""Every study can be imported: its names exist in the package and in the other studies."""

from importlib import import_module

import pytest

from checkout import ROOT

STUDIES = sorted(path.stem for path in (ROOT / "studies").glob("*.py"))


@pytest.mark.parametrize("name", STUDIES)
def test_a_study_can_be_imported(name: str) -> None:
    assert import_module(name).__doc__
