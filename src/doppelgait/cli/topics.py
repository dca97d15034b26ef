"""List what can be configured: topics and their models."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from pydantic import BaseModel

TOPICS = {
    "scene": "Scene file",
    "motion": "Motion models and paths",
    "radar": "Radar",
    "surroundings": "Environment and impairments",
    "analysis": "Analysis and tracking",
    "plan": "Dataset plan and import",
    "files": "Settings next to recording files",
}
"""Titles of the topics; each topic is a page of the documentation."""

TABLES = {
    "dataset": "doppelgait.dataset.config:DatasetSection",
    "dataset.split": "doppelgait.dataset.config:SplitSection",
    "classes": "doppelgait.dataset.config:ClassSection",
    "sources": "doppelgait.dataset.config:SourceSection",
    "target": "doppelgait.scene.scene:Target",
    "targets": "doppelgait.scene.scene:Target",
    "noise": "doppelgait.pipeline.conditions:Noise",
    "tracking": "doppelgait.pipeline:Tracking",
    "tracking.detector": "doppelgait.processing.detect.config:Detector",
}
"""Model of every table of a file that has another name than its topic."""


def models_of(topic: str) -> list[tuple[str, type[BaseModel]]]:
    """Return headings and models of a topic."""
    made = {
        "scene": _scene_models,
        "motion": _motion_models,
        "radar": _radar_models,
        "surroundings": _list_models,
        "analysis": _analysis_models,
        "plan": _plan_models,
        "files": _file_models,
    }
    return made[topic]() if topic in made else [(topic, _get(TABLES[topic]))]


def _get(place: str) -> Any:
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)


def _models(*places: str) -> list[tuple[str, type[BaseModel]]]:
    return [(place.partition(":")[2], _get(place)) for place in places]


def _radar_models() -> list[tuple[str, type[BaseModel]]]:
    waveforms = _get("doppelgait.radar:WAVEFORMS").values()
    own = [plugin for plugin in waveforms if set(plugin.parameters.model_fields) != {"kind"}]
    models = _models("doppelgait.radar.parameters:Radar", "doppelgait.radar.antenna:Antenna")
    return [*models, *((f'waveform, kind = "{plugin.name}"', plugin.parameters) for plugin in own)]


def _scene_models() -> list[tuple[str, type[BaseModel]]]:
    shared = _get("doppelgait.scene.rcs:RcsSpec")
    own = [plugin for plugin in _get("doppelgait.scene.rcs:RCS").values() if plugin.parameters is not shared]
    models = _models("doppelgait.scene.scene:Scene", "doppelgait.scene.scene:Target")
    models += [("RcsSpec", shared), *((f'rcs, kind = "{plugin.name}"', plugin.parameters) for plugin in own)]
    return [*models, *_models("doppelgait.motion.retime:Variation", "doppelgait.pipeline.conditions:Noise")]


def _motion_models() -> list[tuple[str, type[BaseModel]]]:
    models, paths = _get("doppelgait.motion.models:MOTION_MODELS"), _get("doppelgait.motion.paths:PATHS")
    found = [(f'motion, kind = "{name}"', models[name].parameters) for name in models]
    found += [(f'path, kind = "{name}"', paths[name].parameters) for name in paths]
    return [*found, *_models("doppelgait.motion.paths:StopSpec")]


def _list_models() -> list[tuple[str, type[BaseModel]]]:
    effects, impairments = (
        _get("doppelgait.scene.environment:ENVIRONMENT"),
        _get("doppelgait.radar.impairments:IMPAIRMENTS"),
    )
    found = [(f'environment, kind = "{name}"', effects[name].parameters) for name in effects]
    found += _models("doppelgait.scene.environment:Dielectric")
    return found + [(f'impairments, kind = "{name}"', impairments[name].parameters) for name in impairments]


def _analysis_models() -> list[tuple[str, type[BaseModel]]]:
    return _models(
        "doppelgait.processing:Analysis",
        "doppelgait.pipeline:Tracking",
        "doppelgait.processing.detect.config:Detector",
        "doppelgait.processing.track.live:Tracker",
        "doppelgait.processing.track_segments:SegmentationSettings",
        "doppelgait.processing.breathing:BreathingSettings",
    )


def _plan_models() -> list[tuple[str, type[BaseModel]]]:
    config = "doppelgait.dataset.config"
    return _models(
        f"{config}:PlanConfig",
        f"{config}:DatasetSection",
        f"{config}:FieldSpec",
        f"{config}:SplitSection",
        f"{config}:ClassSection",
        f"{config}:SourceSection",
        "doppelgait.dataset.motions:FolderMotion",
        "doppelgait.motion.hybrid:Hybrid",
        "doppelgait.dataset.config:ImportConfig",
        "doppelgait.classify.alarm:Day",
        "doppelgait.classify.alarm:EpisodeSection",
    )


def _file_models() -> list[tuple[str, type[BaseModel]]]:
    return _models(
        "doppelgait.radar.readers.arrays:ArrayFacts",
        "doppelgait.radar.readers.dca1000:ChirpConfig",
        "doppelgait.pipeline.pictures:PictureSettings",
    )
