import pytest

import doppelgait as dg
from doppelgait.core import plugins


@pytest.fixture
def register(monkeypatch):
    """Register plug-ins for one test."""
    for group in plugins.list_plugin_groups().values():
        len(group)  # built-in ones first
    monkeypatch.setattr(plugins, "_REGISTERED", {group: dict(items) for group, items in plugins._REGISTERED.items()})
    return dg.plugin
