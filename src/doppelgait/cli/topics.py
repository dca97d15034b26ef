"""List what can be configured: topics and their models."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from pydantic import BaseModel

from doppelgait.dataset.config import (
    ClassSection,
    DatasetSection,
    EpisodeSection,
    FieldSpec,
    ImportConfig,
    PlanConfig,
    SourceSection,
    SplitSection,
)
from doppelgait.dataset.motions import FolderMotion
from doppelgait.motion.hybrid import Hybrid
from doppelgait.motion.models import MOTION_MODELS
from doppelgait.motion.paths import PATHS, StopSpec
from doppelgait.motion.retime import Variation
from doppelgait.pipeline import Tracking
from doppelgait.pipeline.pictures import PictureSettings
from doppelgait.pipeline.radar_table import Noise
from doppelgait.processing import Analysis
from doppelgait.processing.breathing import BreathingSettings
from doppelgait.processing.detect.config import Detector
from doppelgait.processing.track.live import Tracker
from doppelgait.processing.track_segments import SegmentationSettings
from doppelgait.radar import WAVEFORMS
from doppelgait.radar.antenna import Antenna
from doppelgait.radar.impairments import IMPAIRMENTS
from doppelgait.radar.parameters import Radar
from doppelgait.radar.readers.arrays import ArrayFacts
from doppelgait.radar.readers.dca1000 import ChirpConfig
from doppelgait.scene.environment import ENVIRONMENT, Dielectric
from doppelgait.scene.rcs import RCS, RcsSpec
from doppelgait.scene.scene import Scene, Target

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

TABLES: dict[str, type[BaseModel]] = {
    "dataset": DatasetSection,
    "dataset.split": SplitSection,
    "classes": ClassSection,
    "sources": SourceSection,
    "target": Target,
    "targets": Target,
    "noise": Noise,
    "tracking": Tracking,
    "tracking.detector": Detector,
}
"""Model of every table of a file that has another name than its topic."""

Models = list[tuple[str, type[BaseModel]]]


def models_of(topic: str) -> Models:
    """Return headings and models of a topic."""
    waveforms = [entry for entry in WAVEFORMS.values() if entry.parameters and len(entry.parameters.model_fields) > 1]
    own_rcs = [entry for entry in RCS.values() if entry.parameters is not RcsSpec]
    models: dict[str, Models] = {
        "scene": [*_name(Scene, Target, RcsSpec), *_list_kinds("rcs", own_rcs), *_name(Variation, Noise)],
        "motion": [
            *_list_kinds("motion", MOTION_MODELS.values()),
            *_list_kinds("path", PATHS.values()),
            *_name(StopSpec),
        ],
        "radar": [*_name(Radar, Antenna), *_list_kinds("waveform", waveforms)],
        "surroundings": [
            *_list_kinds("environment", ENVIRONMENT.values()),
            *_name(Dielectric),
            *_list_kinds("impairments", IMPAIRMENTS.values()),
        ],
        "analysis": _name(Analysis, Tracking, Detector, Tracker, SegmentationSettings, BreathingSettings),
        "plan": _name(
            PlanConfig,
            DatasetSection,
            FieldSpec,
            SplitSection,
            ClassSection,
            SourceSection,
            FolderMotion,
            Hybrid,
            ImportConfig,
            EpisodeSection,
        ),
        "files": _name(ArrayFacts, ChirpConfig, PictureSettings),
    }
    return models[topic] if topic in models else [(topic, TABLES[topic])]


def _name(*models: type[BaseModel]) -> Models:
    return [(model.__name__, model) for model in models]


def _list_kinds(key: str, plugins: Iterable[Any]) -> Models:
    return [(f'{key}, kind = "{plugin.name}"', plugin.parameters) for plugin in plugins]
