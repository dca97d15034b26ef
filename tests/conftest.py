"""Fixtures and the rule for tests that need the shared recordings."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from checkout import SHARED


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    if SHARED.is_dir():
        return
    reason = "the shared test data is not beside this checkout (../shared)"
    for item in items:
        if item.get_closest_marker("shared"):
            if os.environ.get("CI", "").lower() == "true":
                item.add_marker(pytest.mark.usefixtures("_shared_data_required"))
            else:
                item.add_marker(pytest.mark.skip(reason=reason))


@pytest.fixture
def _shared_data_required() -> None:
    pytest.fail("CI needs the shared test data beside the checkout (../shared)")


@pytest.fixture(scope="session")
def shared() -> Path:
    """Folder of the shared test data; only tests marked ``shared`` may ask for it."""
    return SHARED
