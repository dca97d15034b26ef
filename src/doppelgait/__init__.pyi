"""What type checkers and editors know of ``doppelgait``: the names that are imported on first use."""

from doppelgait import classify as classify
from doppelgait import core as core
from doppelgait import data as data
from doppelgait import dataset as dataset
from doppelgait import features as features
from doppelgait import motion as motion
from doppelgait import pipeline as pipeline
from doppelgait import processing as processing
from doppelgait import radar as radar
from doppelgait import scene as scene
from doppelgait import testing as testing
from doppelgait import viewer as viewer
from doppelgait import viz as viz
from doppelgait.classify.live import live as live
from doppelgait.core.config import FrozenModel as FrozenModel
from doppelgait.core.errors import ConfigError as ConfigError
from doppelgait.core.errors import DoppelgaitError as DoppelgaitError
from doppelgait.core.errors import DoppelgaitWarning as DoppelgaitWarning
from doppelgait.core.plugins import plugin as plugin
from doppelgait.core.rng import Streams as Streams
from doppelgait.core.rng import rng as rng
from doppelgait.dataset.open import open_dataset as open_dataset
from doppelgait.pipeline.analyze import analyze as analyze
from doppelgait.pipeline.radar_table import Conditions as Conditions
from doppelgait.pipeline.radar_table import Noise as Noise
from doppelgait.pipeline.result import Result as Result
from doppelgait.pipeline.run import Run as Run
from doppelgait.pipeline.simulate import simulate as simulate
from doppelgait.processing.config import Analysis as Analysis
from doppelgait.processing.gate import Gate as Gate
from doppelgait.radar.parameters import Radar as Radar
from doppelgait.radar.recording import Recording as Recording
from doppelgait.radar.recording import concat as concat
from doppelgait.scene.scene import Scene as Scene
from doppelgait.scene.scene import Target as Target
from doppelgait.viewer.server import view as view

__version__: str
PLUGIN_ROOMS: tuple[str, ...]
