"""The dataset browser's server side: filters, sorting, scatter, contact sheet, and what an opened example shows."""

import json
import shutil
from collections import Counter
from dataclasses import replace
from decimal import Decimal
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from doppelgait.core.errors import ConfigError, DatasetError
from doppelgait.core.labels import read_axis
from doppelgait.dataset import Dataset, Example, PlanConfig, build_dataset, open_dataset
from doppelgait.dataset.shard_files import ShardFiles
from doppelgait.pipeline import analyze
from doppelgait.processing import Analysis
from doppelgait.viewer.browse import MOST_POINTS, Browser, find_strongest
from doppelgait.viewer.examples import ExampleRuns, build_stored_view
from doppelgait.viewer.payload import as_json, remove_folders
from doppelgait.viewer.settings import Settings
from doppelgait.viewer.source import OpenedSource
from tiny_dataset import WALK
from viewer_client import unpack

N_ROWS = 3000
FLAGS = ("", "low_confidence", "step_length_m:uncertain", "low_confidence;harmonic_ratio_2:no_peak")


def made_up_index(n_rows=N_ROWS):
    """Rows whose classes take turns, with unknown numbers and texts among them."""
    rng = np.random.default_rng(5)
    aspect_deg = rng.uniform(0, 90, n_rows)
    aspect_deg[rng.random(n_rows) < 0.2] = np.nan
    labels = np.array(["human", "dog"])[np.arange(n_rows) % 2]
    return pd.DataFrame({
        "id": [f"{label}-{number:06d}" for number, label in enumerate(labels)],
        "label": labels,
        "split": rng.choice(["train", "validation", "test"], n_rows, p=[0.7, 0.2, 0.1]),
        "truth_gait": pd.Series(rng.choice(["walk", "trot", None], n_rows), dtype="str"),
        "truth_ground_speed_mps": rng.uniform(0.3, 3.0, n_rows),
        "snr_frame_db": rng.normal(15, 5, n_rows).round(),
        "truth_aspect_deg": aspect_deg,
        "feature_step_length_m": rng.uniform(0.2, 1.0, n_rows),
        "quality_flags": rng.choice(FLAGS, n_rows),
        "shard": "train-00000-of-00001",
        "row": np.arange(n_rows),
    })  # fmt: skip


@pytest.fixture(scope="module")
def index():
    return made_up_index()


@pytest.fixture(scope="module")
def browser(index, tmp_path_factory):
    return browser_of(index, tmp_path_factory.mktemp("nothing"))


def browser_of(index, folder):
    description = {"name": "made-up", "id": "0", "classes": {"human": 0, "dog": 1}, "fields": {}}
    return Browser(Dataset(folder, description, index, ShardFiles(folder)))


def ids_of(browser, query):
    """All ids that a query gives, page by page."""
    found, offset = [], 0
    while True:
        answer = browser.rows([*query, ("offset", str(offset)), ("limit", "499")])
        found += [row["id"] for row in answer["rows"]]
        offset += 499
        if offset >= answer["n_matching"]:
            assert len(found) == answer["n_matching"]
            return found


FILTERS = [
    ([("label", "dog")], lambda i: i.label == "dog"),
    ([("label", "dog"), ("label", "human"), ("split", "test")], lambda i: i.split == "test"),
    ([("split", "test"), ("split", "train")], lambda i: i.split != "validation"),
    ([("truth_aspect_deg.min", "30")], lambda i: i.truth_aspect_deg >= 30),
    ([("truth_aspect_deg.max", "30.5")], lambda i: i.truth_aspect_deg <= 30.5),
    ([("snr_frame_db.min", "12"), ("snr_frame_db.max", "14")], lambda i: i.snr_frame_db.between(12, 14)),
    ([("truth_gait", "(none)")], lambda i: i.truth_gait.isna()),
    ([("truth_gait", "trot"), ("truth_gait", "(none)")], lambda i: i.truth_gait.isna() | (i.truth_gait == "trot")),
    ([("flag", "low_confidence")], lambda i: i["quality_flags"].str.contains("low_confidence")),
    ([("flag", "harmonic*"), ("flag", "low_confidence")], lambda i: i["quality_flags"] == FLAGS[3]),
    ([("flag", "*")], lambda i: i["quality_flags"] != ""),
    ([("no_flag", "*:*")], lambda i: i["quality_flags"].isin(["", "low_confidence"])),
    ([("no_flag", "low_confidence"), ("no_flag", "step*")], lambda i: i["quality_flags"] == ""),
    ([("text", "DOG-0001")], lambda i: i.id.str.startswith("dog-0001")),
    ([("text", "a.*")], lambda i: i.id == "no expression"),
]  # fmt: skip


@pytest.mark.parametrize(("query", "condition"), FILTERS, ids=[str(query) for query, _ in FILTERS])
def test_filters_mean_the_rows_that_pandas_finds(browser, index, query, condition):
    wanted = index[condition(index)]
    assert len(wanted) < N_ROWS
    assert ids_of(browser, query) == wanted.id.tolist()
    counts = browser.balance(query)
    table = pd.crosstab(wanted.label, wanted.split).reindex(
        index=["human", "dog"], columns=counts["splits"], fill_value=0
    )
    assert counts["counts"] == {label: row.tolist() for label, row in table.iterrows()}


def test_the_summary_tells_columns_flags_and_balance(browser, index):
    summary = browser.summary()
    columns = {column["name"]: column for column in summary["columns"]}
    kinds = [columns[name]["kind"] for name in ("id", "split", "quality_flags")]
    assert kinds == ["text", "category", "text"]
    assert columns["split"]["values"] == ["train", "validation", "test"]
    assert columns["truth_gait"]["values"] == ["(none)", "trot", "walk"]
    aspect = columns["truth_aspect_deg"]
    assert (aspect["low"], aspect["high"]) == (index.truth_aspect_deg.min(), index.truth_aspect_deg.max())
    assert (aspect["words"], aspect["unit"], aspect["group"]) == ("aspect", "°", "truth")
    assert not {"shard", "row"} & set(columns)
    assert summary["filters"] == ["label", "split", "truth_ground_speed_mps", "snr_frame_db", "truth_aspect_deg"]
    flags = index["quality_flags"].str.split(";").explode()
    assert summary["flags"] == flags[flags != ""].value_counts().to_dict()
    assert summary["balance"]["dog"] == pd.crosstab(index.label, index.split).loc["dog", summary["splits"]].tolist()


@pytest.mark.parametrize("name", ["snr_frame_db", "truth_aspect_deg", "truth_gait", "id", "quality_flags"])
@pytest.mark.parametrize("descending", [False, True])
def test_sorting_is_stable_and_puts_unknown_values_last(browser, index, name, descending):
    known = index.assign(truth_gait=index.truth_gait.fillna("").replace("", None))
    if name == "quality_flags":
        known["quality_flags"] = known["quality_flags"].replace("", None)
    wanted = known.sort_values(name, ascending=not descending, kind="stable", na_position="last")
    assert ids_of(browser, [("sort", name), ("descending", str(int(descending)))]) == wanted.id.tolist()


def test_scatter_is_an_even_choice_that_is_always_the_same(browser, index, tmp_path):
    large = made_up_index(20_000)
    query = [("x", "truth_aspect_deg"), ("y", "feature_step_length_m"), ("split", "train")]
    payload = browser_of(large, tmp_path).scatter(query)
    assert payload == browser_of(large, tmp_path).scatter(query)
    facts, arrays = unpack(payload)
    train = large[large.split == "train"]
    known = train[train.truth_aspect_deg.notna()]
    assert (facts["n_matching"], facts["n_known"]) == (len(train), len(known))
    chosen = large.iloc[arrays["row"]]
    assert len(chosen) == MOST_POINTS < len(known)
    assert (np.diff(arrays["row"]) > 0).all()  # no class is drawn over another
    assert set(chosen.id) <= set(known.id)
    np.testing.assert_array_equal(arrays["x"], chosen.truth_aspect_deg.to_numpy(dtype=np.float32))
    np.testing.assert_array_equal(arrays["y"], chosen.feature_step_length_m.to_numpy(dtype=np.float32))
    assert [facts["classes"][number] for number in arrays["class"]] == chosen.label.tolist()
    for label, count in known.label.value_counts().items():  # every class by its share, every part of the index, too
        assert Counter(chosen.label)[label] == pytest.approx(MOST_POINTS * count / len(known), abs=1)
    counts, even = np.histogram(arrays["row"], 10, (0, 20_000))[0], MOST_POINTS / 10
    assert np.abs(counts - even).max() < 5 * np.sqrt(even)


@pytest.mark.parametrize(("ask", "query", "words"), [
    ("rows", [("lable", "dog")], "'lable' is not known here; near in spelling: label"),
    ("rows", [("label", "cow")], "label: no row has 'cow'; there are dog, human"),
    ("rows", [("id", "dog-000001")], "'id' is not known here"),
    ("rows", [("snr_frame_db.min", "loud")], "snr_frame_db.min: 'loud' is not allowed"),
    ("rows", [("snr_frame_db.min", "nan")], "snr_frame_db.min: 'nan' is not allowed"),
    ("rows", [("snr_frame_db.min", "3"), ("snr_frame_db.min", "4")], "snr_frame_db.min: comes twice"),
    ("rows", [("snr_frame_db.min", "3"), ("snr_frame_db.max", "2")], "snr_frame_db.min: 3 is above snr_frame_db.max"),
    ("rows", [("split.min", "3")], "split.min: 'split' is no number column"),
    ("rows", [("sort", "speed")], "sort: 'speed' is no number or category or text column"),
    ("rows", [("limit", "501")], "limit: '501' is not allowed; it must be a whole number from 1 to 500"),
    ("rows", [("offset", "-1")], "offset: '-1' is not allowed"),
    ("rows", [("limit", "5"), ("limit", "5")], "limit: comes twice"),
    ("rows", [("text", "a"), ("text", "b")], "text: comes twice"),
    ("balance", [("sort", "id")], "'sort' is not known here"),
    ("scatter", [("x", "snr_frame_db")], "y: is missing"),
    ("scatter", [("x", "snr_frame_db"), ("y", "label")], "y: 'label' is no number column"),
    ("make_sheet", [("limit", "97")], "limit: '97' is not allowed"),
])  # fmt: skip
def test_what_is_not_allowed_is_named(browser, ask, query, words):
    with pytest.raises(ConfigError) as caught:
        getattr(browser, ask)(query)
    assert words in str(caught.value)


def test_a_row_that_is_not_there_is_named(browser):
    with pytest.raises(ConfigError, match=r"row: 3000 is not allowed; this dataset has rows 0 to 2999"):
        browser.get_row_id([("row", str(N_ROWS))])
    with pytest.raises(DatasetError, match=r"no 'dog-9' in this dataset"):
        browser.run("dog-9")


def test_a_cell_of_a_thumbnail_keeps_the_strongest_sample_that_it_touches():
    rng = np.random.default_rng(3)
    values, samples, edges = rng.random((37, 4)), np.linspace(-2.0, 5.2, 37), np.linspace(-4.0, 6.0, 24)
    half = (samples[1] - samples[0]) / 2
    found = find_strongest(values, samples, edges)
    for cell in range(23):
        touches = (samples + half > edges[cell]) & (samples - half < edges[cell + 1])
        wanted = values[touches].max(axis=0) if touches.any() else np.full(4, np.nan)
        np.testing.assert_array_equal(found[cell], wanted)
    assert np.isnan(found[0]).all()
    assert np.nanmax(found) == values.max()


def test_the_sheet_shows_the_stored_signatures_on_one_scale(dataset):
    facts, arrays = unpack(Browser(dataset).make_sheet([("label", "dog"), ("limit", "4"), ("offset", "1")]))
    chosen = dataset.index[dataset.index.label == "dog"].iloc[1:5]
    assert facts["ids"] == chosen.id.tolist()
    assert facts["reasons"] == [None] * 4
    low, high = facts["image"]["db"]
    for number, codes in zip(chosen.index, arrays["thumbnails"], strict=True):
        strongest_db = 10 * np.log10(dataset.array("signature", number).max())
        assert low + codes.max() * (high - low) / 255 == pytest.approx(strongest_db, abs=(high - low) / 255)
        assert len(np.unique(codes)) > 20
    assert f"{chosen.truth_ground_speed_mps.iloc[0]:.3g} m/s" in facts["captions"][0]


def test_an_opened_example_shows_what_is_stored_and_its_recording(dataset):
    browser = Browser(dataset)
    for name in ("human-000001", "dog-000002"):
        run, example = browser.run(name), dataset[name]
        (view,) = run.targets(None)
        np.testing.assert_array_equal(view.result.signature, example.signature)
        np.testing.assert_array_equal(view.result.cadence_map, example.cadence_map)
        np.testing.assert_array_equal(run.recording.baseband, example.baseband)  # the very recording, simulated again
        assert view.result.features.torso_velocity_mps == example.row["feature_torso_velocity_mps"]
        assert view.truth["gait_frequency_hz"] == example.row["truth_gait_frequency_hz"]
        (analysed,) = analyze(
            run.recording, gate="truth", analysis=run.settings.analysis, gate_error_m=example.row["gate_error_m"]
        )
        largest = float(analysed.cadence_spectrum.max())  # stored in single precision
        np.testing.assert_allclose(
            view.result.cadence_spectrum, analysed.cadence_spectrum, rtol=1e-3, atol=1e-6 * largest
        )
        np.testing.assert_array_equal(view.result.gate_limits.low_m, analysed.gate.low_m)
        assert run.recording.truth[0].body is not None


def test_a_step_doppler_map_that_is_not_stored_is_that_of_the_stored_signature(dataset):
    fields = {name: facts for name, facts in dataset.description["fields"].items() if name == "signature"}
    slim = replace(dataset, description={**dataset.description, "fields": fields})
    (view,) = Browser(slim).run("human-000004").targets(None)
    np.testing.assert_allclose(view.result.cadence_map, dataset["human-000004"].cadence_map, rtol=1e-4, atol=1e-6)
    (bare,) = changed(dataset, fields={}).run("human-000004").targets(None)
    assert not bare.result.arrays
    assert bare.result.features.step_length_m == view.result.features.step_length_m


def test_all_targets_of_a_scene_are_one_run(mixed):
    run = Browser(mixed).run("human-000002-c1")
    human, dog = (view.result for view in run.targets(None))
    assert (human.label, dog.label) == ("human", "dog")
    np.testing.assert_array_equal(dog.signature, mixed["human-000002-c1"].signature)
    middle_m = (dog.gate_limits.low_m + dog.gate_limits.high_m) / 2
    error_m = mixed["human-000002-c1"].row["gate_error_m"]
    np.testing.assert_allclose(middle_m - error_m, run.recording.truth[1].centre_range_m, atol=1e-9)
    assert read_axis(dog.cadence_spectrum, "cadence")[-1] <= 20.0
    facts, _ = unpack(Browser(mixed).make_sheet([]))  # two pulse rates on common axes
    assert facts["reasons"] == [None] * len(mixed)


def changed(dataset, **facts):
    return Browser(replace(dataset, description={**dataset.description, **facts}))


def test_why_there_is_no_recording_is_told_and_the_arrays_are_shown(dataset):
    other_row = dataset.index.assign(truth_range_m=dataset.index.truth_range_m * 1.1)
    for browser, words in (
        (changed(dataset, data_version=5), "has data version 5"),
        (changed(dataset, origin="imported"), "arrays of measured recordings"),
        (Browser(replace(dataset, index=other_row)), "motion file is not that of the dataset"),
    ):
        run = browser.run("dog-000000")
        assert run.recording is None
        assert words in run.reason
        (view,) = run.targets(None)
        np.testing.assert_array_equal(view.result.signature, dataset["dog-000000"].signature)
        assert view.result.gate_limits is None


@pytest.mark.parametrize("sections", [
    {"scene": {"duration_s": 3600.0}},
    {"scene": {"duration_s": 400.0}, "radar": {"prf_hz": 1.0}},
    {"radar": {"range_stop_m": 5000.0, "fold_echoes": False}},
    {"radar": {"prf_hz": 100_000.0, "pulse_rate_hz": 1e9, "fold_echoes": False}, "scene": {"duration_s": 10.0}},
])  # fmt: skip
def test_what_is_too_large_is_not_simulated(dataset, monkeypatch, sections):
    def never(*arguments, **options):
        raise AssertionError("was simulated")

    monkeypatch.setattr("doppelgait.viewer.examples.run_simulation", never)
    config = dataset.description["config"]
    tampered = {**config, **{name: {**config[name], **facts} for name, facts in sections.items()}}
    run = changed(dataset, config=tampered).run("human-000002")
    assert run.recording is None
    assert "too large to simulate here" in run.reason
    assert run.targets(None)[0].result.signature is not None
    with pytest.raises(AssertionError, match="was simulated"):
        _ = Browser(dataset).run("human-000002").recording


def test_nothing_of_a_dataset_is_simulated_before_it_is_asked_for(dataset, monkeypatch):
    pytest.importorskip("starlette")
    from doppelgait.viewer.app import _prepare
    from doppelgait.viewer.source import RunCache

    asked = []
    monkeypatch.setattr(ExampleRuns, "run", lambda self, example_id: asked.append(example_id))
    opened = OpenedSource("dataset", "tiny", "tiny", browser=Browser(dataset))
    _prepare(RunCache(opened), opened, Settings())
    assert asked == []


def moved_by(dataset, motion, **facts):
    """Browser of a dataset in which a motion file moves the people."""
    config = dataset.description["config"]
    classes = [{**config["classes"][0], "motion": motion}, *config["classes"][1:]]
    description = {**dataset.description, "config": {**config, "classes": classes, **facts}}
    return lambda folder: Browser(replace(dataset, description=description), folder).run("human-000002")


@pytest.fixture
def motion_folder(tmp_path):
    (tmp_path / "motions").mkdir()
    for name in ("motions/in.bvh", "out.bvh"):
        (tmp_path / name).write_text("secret")
    (tmp_path / "motions" / "linked.bvh").symlink_to(tmp_path / "out.bvh")
    return tmp_path / "motions"


@pytest.mark.parametrize("path", [
    "{outside}", "../out.bvh", "a/../../out.bvh", "linked.bvh", "//host/share/a.bvh", "\\\\host\\a.bvh", "C:\\a.bvh",
    "C:a.bvh", "..\\out.bvh",
])  # fmt: skip
@pytest.mark.parametrize("form", ["path", "choice", "skeleton", "companion", "preset"])
def test_files_outside_the_motion_folder_are_not_opened(dataset, motion_folder, monkeypatch, path, form):
    opened = []
    monkeypatch.setattr("doppelgait.viewer.examples.resolve_example", lambda *arguments: opened.append(arguments))
    name = path.format(outside=motion_folder.parent / "out.bvh")
    file, walk = {"kind": "file", "path": name}, dataset.description["config"]["classes"][0]["motion"]
    opener = {
        "path": lambda: moved_by(dataset, file),
        "choice": lambda: moved_by(dataset, {"kind": "file", "path": {"choice": [name]}}),
        "skeleton": lambda: moved_by(dataset, {"kind": "file", "path": "in.bvh", "skeleton": name}),
        "companion": lambda: moved_by(dataset, walk, companions=[{"label": "dog", "motion": {"choice": [file]}}]),
        "preset": lambda: moved_by(dataset, walk, radar={"preset": {"choice": [f"{name}.toml"]}}),
    }[form]()
    if (path, form) == ("linked.bvh", "preset"):
        return  # links to nothing
    run = opener(motion_folder)
    assert (run.load, opened) == (None, [])
    assert "lies outside of --motion-folder" in run.reason
    assert str(motion_folder.parent) not in run.reason
    run = opener(None)
    assert (run.load, opened) == (None, [])
    assert "start the viewer with --motion-folder FOLDER" in run.reason


def test_files_in_the_motion_folder_are_opened(dataset, motion_folder):
    run = moved_by(dataset, {"kind": "file", "path": "in.bvh"})(motion_folder)
    assert run.recording is None
    assert "in.bvh" in run.reason
    assert "motion-folder" not in run.reason  # it was read, and is no motion
    assert str(motion_folder) not in run.reason
    assert moved_by(dataset, {"kind": "boulic", "speed_mps": 1.2})(None).load is not None


def test_the_page_does_not_learn_where_folders_are(dataset, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    browser = Browser(dataset, tmp_path / "motions")
    text = f"{dataset.directory}/shards/a.h5: no {tmp_path}/motions/x in {tmp_path}, ./y, or /"
    wanted = f"{dataset.directory.name}/shards/a.h5: no motions/x in {tmp_path.name}, ./y, or /"
    assert remove_folders(text, *browser.folders) == wanted
    assert remove_folders(f"in {tmp_path}") == f"in {tmp_path.name}"
    monkeypatch.chdir(dataset.directory.parent)
    assert (
        remove_folders(f"{dataset.directory.name}: is", Path(dataset.directory.name)) == f"{dataset.directory.name}: is"
    )


def odd_index():
    """Columns of kinds that no index of ours has, and of names that are parameters."""
    index = made_up_index(60)
    return index.assign(**{
        "parts": [[n, n] for n in range(60)], "raw": b"x", "day": pd.Timestamp("2026-01-01"),
        "exact": [Decimal(n) for n in range(60)], "subject": "model/one", "many": [f"v{n % 41}" for n in range(60)],
        "few": [f"v{n % 40}" for n in range(60)], "limit": np.arange(60), "sort": "a", "snr_frame_db.min": 1.0,
        "feature_step_length_m": "long", "quality_flags": [["a"]] * 60, "warnings": [np.array(["a", "b"])] * 60,
    })  # fmt: skip


def test_columns_of_other_kinds_and_names_do_no_harm(tmp_path):
    browser = browser_of(odd_index(), tmp_path)
    columns = {column["name"]: column for column in browser.summary()["columns"]}
    assert not {"limit", "sort", "snr_frame_db.min"} & set(columns)
    kinds = {name: columns[name]["kind"] for name in ("id", "subject", "many", "few", "parts", "label", "raw")}
    assert kinds == {
        "id": "text", "subject": "text", "many": "text", "few": "category", "parts": "text", "label": "category",
        "raw": "category",
    }  # fmt: skip
    assert columns["day"]["values"] == ["2026-01-01 00:00:00"]
    for name in ("parts", "raw", "day", "exact", "quality_flags"):
        answer = json.loads(as_json(browser.rows([("sort", name), ("limit", "3")])))
        assert len(answer["rows"]) == 3
    assert answer["rows"][0]["quality_flags"] == ["a"]
    row = odd_index().iloc[0].to_dict()
    view = build_stored_view(Example({**row, "feature_step_length_m": "long", "sd_x": "y"}, {}), Analysis())
    assert (view.result.features.step_length_m, view.result.flags) == (None, ())
    assert view.result.standard_deviation == {"x": None}
    assert json.loads(as_json([b"x", Decimal("1.5"), pd.Timestamp("2026-01-01"), pd.NaT])) == [
        "b'x'", "1.5", "2026-01-01 00:00:00", "NaT",
    ]  # fmt: skip


def test_damaged_and_missing_shards_are_told_in_a_sentence(dataset, tmp_path):
    folder = tmp_path / "copy"
    shutil.copytree(dataset.directory, folder)
    shards = sorted(set(dataset.index.shard))
    (folder / "shards" / f"{shards[0]}.h5").write_bytes(b"no HDF5")
    (folder / "shards" / f"{shards[1]}.h5").unlink()
    browser = Browser(open_dataset(folder))
    facts, arrays = unpack(browser.make_sheet([]))
    for name, reason, codes in zip(dataset.index.shard, facts["reasons"], arrays["thumbnails"], strict=True):
        assert (reason is None) == (name not in shards[:2])
        assert codes.any() == (reason is None)
        assert reason is None or ("cannot be read" in reason and str(tmp_path) not in reason)
    for shard in shards[:2]:
        name = dataset.index.id[dataset.index.shard == shard].iloc[0]
        with pytest.raises(DatasetError, match=f"{shard}.h5.*cannot be read.*build it again"):
            browser.run(name).targets(None)
        assert browser.run(name).recording is not None


def test_a_target_that_was_not_tracked_has_its_row_and_no_arrays(tmp_path):
    plan = PlanConfig.model_validate({
        "dataset": {"name": "unseen", "examples_per_class": 2, "gate": "track", "fractions": {"train": 1.0}},
        "scene": {"duration_s": 0.8},
        "target": {"range_m": 3.0},
        "noise": {"kind": "snr", "snr_db": -40.0},
        "classes": [{"label": "human", "motion": WALK}],
    })  # fmt: skip
    build_dataset(plan, tmp_path / "unseen", executor="serial")
    browser = Browser(open_dataset(tmp_path / "unseen"))
    facts, arrays = unpack(browser.make_sheet([]))
    assert facts["image"] is None
    assert not arrays
    assert facts["reasons"] == ["no signature: the target was not tracked"] * 2
    (view,) = browser.run("human-000001").targets(None)
    assert (dict(view.result.arrays), view.result.flags) == ({}, ("not_tracked",))
    assert view.result.features.step_length_m is None
    assert browser.run("human-000001").recording is not None
