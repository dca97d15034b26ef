"""
A dataset and a classifier
==========================

A plan, a folder of labelled examples and a classifier, on one page.
"""

import tempfile
from pathlib import Path

import doppelgait as dg
from doppelgait import viz

# %%
# **The plan** is a scene file with distributions instead of numbers. All other parameters have the same distributions
# in every class.

PLAN = """
[dataset]
name = "garden-gate"
seed = 7
examples_per_class = 24

[radar]
preset = "x4"
prf_hz = 1300

[scene]
duration_s = 2.0

[target]
range_m = { uniform = [4.5, 5.0] }
aspect_deg = { uniform = [-30, 30] }
rcs = { total_m2 = { log_uniform = [0.1, 1.6] } }

[noise]
kind = "snr"
snr_db = { uniform = [5, 25] }

[[classes]]
label = "human"
motion = { kind = "human", speed_mps = { uniform = [0.6, 1.9] }, height_m = { normal = [1.7, 0.1] } }

[[classes]]
label = "dog"
motion = { kind = "quadruped", gait = "auto", froude = { uniform = [0.1, 1.2] }, withers_m = { uniform = [0.3, 0.6] } }
"""
folder = Path(tempfile.mkdtemp())
(folder / "plan.toml").write_text(PLAN)
plan, _ = dg.dataset.load_plan(folder / "plan.toml")

# %%
# **Build.** ``doppelgait dataset build`` uses all processors; here the dataset is built in this process. No subject is
# in two splits.

report = dg.dataset.build_dataset(plan, folder / "garden-gate", executor="serial")
dataset = dg.open_dataset(folder / "garden-gate")
print(f"{len(dataset)} examples, {report.bytes / 1e6:.1f} MB")
print(dataset.index.groupby(["split", "label"]).size().unstack())

# %%
# **Examples** are labelled arrays, as ``analyze`` returns them.

shown = [dataset[name] for name in ("human-000000", "human-000001", "dog-000000", "dog-000001")]
figure = viz.contact_sheet([example.signature for example in shown], titles=[example.id for example in shown])

# %%
# **A classifier** from scikit-learn. It accepts undetermined features (NaN).

from sklearn.ensemble import HistGradientBoostingClassifier  # noqa: E402
from sklearn.metrics import balanced_accuracy_score, confusion_matrix  # noqa: E402

X, y, _ = dataset["train"].features()
X_test, y_test, _ = dataset["test"].features()
model = HistGradientBoostingClassifier(min_samples_leaf=5, random_state=0).fit(X, y)
print("balanced accuracy", round(balanced_accuracy_score(y_test, model.predict(X_test)), 3), "on", len(y_test), "rows")
print(confusion_matrix(y_test, model.predict(X_test), labels=["human", "dog"]))

# %%
# **What to look at.** So few rows, from the same models as the training data, prove little. ``doppelgait evaluate``
# states intervals, compares with chance and with a leakage test, and writes a report.

table = dataset.index.rename(columns=lambda name: name.removeprefix("feature_"))
figure = viz.feature_scatter(table, x="torso_velocity_mps", y="step_length_m")
