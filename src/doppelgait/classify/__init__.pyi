"""What type checkers and editors know of ``doppelgait.classify``: the names that are imported on first use."""

from doppelgait.classify.c_code import CSettings as CSettings
from doppelgait.classify.decide import Decision as Decision
from doppelgait.classify.decide import classify as classify
from doppelgait.classify.evaluation import Evaluation as Evaluation
from doppelgait.classify.evaluation import evaluate as evaluate
from doppelgait.classify.export import export_model as export_model
from doppelgait.classify.model import Model as Model
from doppelgait.classify.model_file import find_shipped_model as find_shipped_model
from doppelgait.classify.model_file import load_model as load_model
from doppelgait.classify.model_file import load_shipped_model as load_shipped_model
from doppelgait.classify.model_file import open_model as open_model
from doppelgait.classify.model_file import read_model_cards as read_model_cards
from doppelgait.classify.model_file import save_model as save_model
from doppelgait.classify.report import write_report as write_report
from doppelgait.classify.timeline import TrackDecision as TrackDecision
from doppelgait.classify.timeline import classify_over_time as classify_over_time
from doppelgait.classify.timeline import join_decisions as join_decisions
from doppelgait.processing.patches import Patch as Patch
from doppelgait.processing.patches import levels as levels
from doppelgait.processing.patches import patch as patch
