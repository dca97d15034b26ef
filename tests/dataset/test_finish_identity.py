"""A dataset's identity holds the plug-ins of other packages that its plan uses, and no others."""

import pytest

from dataset_plans import tiny_plan
from doppelgait.core import plugins
from doppelgait.core.config import FrozenModel
from doppelgait.dataset.finish import dataset_id, plan_header, plugin_identities


class Nothing(FrozenModel):
    kind: str = "gaitlab_clutter"


@pytest.fixture
def foreign(monkeypatch):
    """Register a plug-in of a package that is not doppelgait."""
    monkeypatch.setattr(plugins, "_REGISTERED", {group: dict(found) for group, found in plugins._REGISTERED.items()})

    def register(group, name, version="1"):
        item = plugins.Plugin(group, name, None, Nothing, version, "gaitlab")
        plugins._REGISTERED.setdefault(group, {})[name] = item

    return register


def test_only_plugins_that_are_used_change_the_identity(foreign, tmp_path):
    plan = tiny_plan()
    own = dataset_id(plan, tmp_path)
    foreign("impairment", "gaitlab_clutter")
    assert dataset_id(plan, tmp_path) == own
    assert "plugins" not in plan_header(plan, own).describe({}, complete=False)
    foreign("motion_model", "boulic-of-gaitlab")
    used = {"kind": "boulic-of-gaitlab", "speed_mps": 1.0}
    assert [item["name"] for item in plugin_identities({"motion": used})] == ["boulic-of-gaitlab"]
    assert [item["name"] for item in plugin_identities({"choice": [{"a": "gaitlab_clutter"}]})] == ["gaitlab_clutter"]


def test_features_and_readers_of_files_are_used_without_a_name(foreign, tmp_path):
    plan = tiny_plan()
    own = dataset_id(plan, tmp_path)
    foreign("motion_reader", "steps")
    assert dataset_id(plan, tmp_path) == own
    assert [item["group"] for item in plugin_identities({"motion": {"kind": "file"}})] == ["motion_reader"]
    foreign("feature", "sway")
    first = dataset_id(plan, tmp_path)
    assert first != own
    (entry,) = plan_header(plan, first).describe({}, complete=False)["plugins"]
    assert entry == {"group": "feature", "name": "sway", "version": "1", "package": "gaitlab", "release": ""}
    foreign("feature", "sway", version="2")
    assert dataset_id(plan, tmp_path) not in (own, first)
