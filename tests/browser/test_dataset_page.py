"""The dataset browser in a real browser: filters, table, scatter, contact sheet, and an example opened from them."""

import re
import time

import pandas as pd
import pytest

from dataset_plans import put_index
from doppelgait.dataset import PlanConfig, build_dataset
from tiny_dataset import TROT, WALK

N_EACH = 30
TRACKED = 50
"""Row whose gate followed a track."""
COLOURED = """
() => { // middle of the point of the scatter that is nearest to the middle: where a pixel has the colour of a class
  const canvas = document.getElementById("canvas-scatter");
  const { width, height } = canvas;
  const pixels = canvas.getContext("2d").getImageData(0, 0, width, height).data;
  let best = null;
  for (let y = 0; y < height; y += 1) {
    for (let x = 0; x < width; x += 1) {
      const [r, g, b, a] = pixels.subarray(4 * (y * width + x), 4 * (y * width + x) + 4);
      if (a < 150 || Math.max(r, g, b) - Math.min(r, g, b) < 100) continue;
      const distance = Math.hypot(x - width / 2, y - height / 2);
      if (!best || distance < best.distance) best = { x, y, distance };
    }
  }
  const box = canvas.getBoundingClientRect();
  return [box.left + best.x * box.width / width, box.top + best.y * box.height / height];
}
"""
KINDS_OF_PIXELS = """
(canvas) => new Set(new Uint32Array(
  canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data.buffer)).size
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    plan = PlanConfig.model_validate({
        "dataset": {"name": "browsed", "examples_per_class": N_EACH, "fractions": {"train": 0.7, "test": 0.3}},
        "scene": {"duration_s": 0.8},
        "target": {"range_m": {"uniform": [3.0, 4.0]}, "rcs": {"total_m2": {"log_uniform": [0.1, 1.6]}}},
        "noise": {"kind": "snr", "snr_db": {"uniform": [5.0, 20.0]}},
        "classes": [{"label": "human", "motion": WALK}, {"label": "dog", "motion": TROT}],
    })  # fmt: skip
    path = tmp_path_factory.mktemp("browsed") / "dataset"
    build_dataset(plan, path, executor="serial")
    index = pd.read_parquet(path / "index.parquet")
    index.loc[TRACKED, "gate"] = "track"  # as in a plan with such gates, whose limits are not stored
    put_index(path, index)
    return path


@pytest.fixture(scope="module")
def index(folder):
    return pd.read_parquet(folder / "index.parquet")


@pytest.fixture
def opened(page, serve, folder):
    """Page with the first rows of the dataset."""
    page.goto(serve(folder))
    page.wait_for_selector("#rows tr")
    return page


def ids(page):
    return page.eval_on_selector_all("#rows tr", "rows => rows.map((row) => row.dataset.id)")


def until(page, script, wanted):
    """Wait until a function of the page gives a value; the page's own rules allow no script of a test to wait there."""
    deadline = time.monotonic() + 60.0
    while (found := page.evaluate(script)) != wanted:
        assert time.monotonic() < deadline, f"{script} gives {found!r}, not {wanted!r}"
        page.wait_for_timeout(30)


def point_with_a_name(page, pattern):
    """Place of a point under the mouse that is named; the points may move until all has been drawn."""
    deadline = time.monotonic() + 60.0
    while not re.search(pattern, page.text_content("#hover-scatter")):
        assert time.monotonic() < deadline, page.text_content("#hover-scatter")
        x, y = page.evaluate(COLOURED)
        page.mouse.move(x - 30, y)
        page.mouse.move(x, y)
        page.wait_for_timeout(300)
    return x, y


def wait_for_count(page, count):
    until(page, "document.getElementById('n-matching')?.textContent", f"{count} of {2 * N_EACH} rows")
    until(page, "document.querySelectorAll('#rows tr:not(.none)').length", min(count, 50))  # the first page


def wait_for_rows(page, wanted):
    until(page, "[...document.querySelectorAll('#rows tr')].map((row) => row.dataset.id)", wanted)


def test_filters_narrow_table_and_counts_and_stay_in_the_address(opened, index):
    wait_for_count(opened, 60)
    assert ids(opened) == index.id.tolist()[:50]
    opened.click("#page-next")
    wait_for_rows(opened, index.id.tolist()[50:])
    opened.check("input[name=label][value=dog]")
    wait_for_count(opened, N_EACH)
    assert ids(opened) == index.id[index.label == "dog"].tolist()
    limit = float(index.truth_ground_speed_mps[index.label == "dog"].median().round(2))
    opened.fill("input[name='truth_ground_speed_mps.max']", str(limit))
    opened.press("input[name='truth_ground_speed_mps.max']", "Tab")
    wanted = index[(index.label == "dog") & (index.truth_ground_speed_mps <= limit)]
    wait_for_count(opened, len(wanted))
    counts = opened.eval_on_selector_all("#balance tbody td:last-child", "cells => cells.map((c) => c.textContent)")
    assert counts == ["0", str(len(wanted))]
    assert opened.evaluate("document.activeElement.name") == "snr_frame_db.min"  # the form kept its focus
    opened.wait_for_timeout(350)  # the address follows a little later
    opened.reload()
    wait_for_count(opened, len(wanted))
    opened.go_back()
    wait_for_count(opened, N_EACH)
    opened.go_forward()
    wait_for_count(opened, len(wanted))
    assert opened.is_checked("input[name=label][value=dog]")
    opened.click("th[data-column=snr_frame_db] button")
    wait_for_rows(opened, wanted.sort_values("snr_frame_db").id.tolist())
    opened.click("th[data-column=snr_frame_db] button")
    wait_for_rows(opened, wanted.sort_values("snr_frame_db", ascending=False).id.tolist())
    opened.type("#filter-text", "nobody")
    wait_for_count(opened, 0)
    assert opened.evaluate("document.activeElement.id") == "filter-text"
    opened.click("#clear-filters")
    wait_for_count(opened, 60)
    words = opened.eval_on_selector_all("#filter-flag option", "options => options.map((one) => one.textContent)")
    assert any("no peak 6 dB above" in text for text in words)

    opened.fill("input[name='snr_frame_db.min']", "10")
    opened.fill("input[name='snr_frame_db.max']", "5")
    opened.press("input[name='snr_frame_db.max']", "Tab")
    wait_for_count(opened, 60)
    assert opened.is_visible(".fault:has-text('The first limit is above the second: not used.')")
    assert opened.get_attribute("input[name='snr_frame_db.min']", "aria-invalid") == "true"
    assert not [url for url in opened.requested if "snr_frame_db.min=10&snr_frame_db.max=5" in url]
    opened.evaluate(
        "import(document.querySelector('script[type=module]').src.replace('main.js', 'ui.js'))"
        ".then((ui) => ui.showError(new Error('an old mistake')))"
    )
    assert opened.is_visible("#error")
    opened.check("input[name=label][value=dog]")
    wait_for_count(opened, N_EACH)
    assert not opened.is_visible("#error")
    assert opened.is_visible(".fault:has-text('not used')")  # the form keeps what is not used yet


def test_a_link_asks_for_what_the_dataset_knows_and_leads_to_neighbours(page, serve, folder, index):
    asked = ("f.bogus=1", "f.label=cat", "f.label=dog", "f.text=G-0", "f.text=b", "f.snr_frame_db.min=abc",
             "f.truth_ground_speed_mps.min=9", "f.truth_ground_speed_mps.max=1", "f.constructor=1", "f.__proto__=1",
             "sort=nonsense", "offset=1e9")  # fmt: skip
    page.goto(f"{serve(folder)}?{'&'.join(asked)}")
    wait_for_count(page, N_EACH)
    assert ids(page) == index.id[index.label == "dog"].tolist()
    left_out = page.text_content("#left-out").partition(": ")[2].split(", ")
    assert left_out == [
        "bogus=1", "label=cat", "text=b", "snr_frame_db.min=abc", "truth_ground_speed_mps.min=9",
        "truth_ground_speed_mps.max=1", "constructor=1", "__proto__=1", "sort=nonsense",
    ]  # fmt: skip
    page.goto(f"{serve(folder)}?offset=1e9")
    wait_for_rows(page, index.id.tolist()[50:])
    assert not page.is_visible("#left-out")
    chosen = index[index.label == "dog"].sort_values("snr_frame_db").id.tolist()
    page.goto(f"{serve(folder)}?f.label=dog&sort=snr_frame_db&example={chosen[-2]}")
    page.click("#example-next")
    until(page, "document.getElementById('example-id').textContent", chosen[-1])
    until(page, "document.getElementById('example-previous').disabled", False)
    assert page.is_disabled("#example-next")
    page.goto(f"{serve(folder)}?example={index.id[TRACKED - 1]}&at=3")  # the last row of a page, with a wrong place
    page.wait_for_selector("#example-next:enabled")
    assert not page.is_visible("#gate-note")
    page.click("#example-next")
    until(page, "document.getElementById('example-id').textContent", index.id[TRACKED])
    page.wait_for_selector("#gate-note:has-text('followed a track')")
    page.select_option("#gate", "truth")
    assert not page.is_visible("#gate-note")


def test_a_point_of_the_scatter_is_named_and_opens_and_back_returns(opened, index):
    opened.select_option("#scatter-y", "snr_frame_db")
    x, y = point_with_a_name(opened, r"-\d{6}: .* m/s, .* dB")
    name, *values = re.fullmatch(r"(.*): (.*) m/s, (.*) dB", opened.text_content("#hover-scatter")).groups()
    row = index.set_index("id").loc[name]
    expected = (row.feature_torso_velocity_mps, row.snr_frame_db)
    assert [float(value) for value in values] == pytest.approx(expected, rel=6e-3)
    opened.mouse.click(x, y)
    opened.wait_for_selector("#canvas-signature")
    assert opened.text_content("#example-id") == name
    until(opened, f"({KINDS_OF_PIXELS})(document.getElementById('canvas-signature')) > 100", True)
    assert not opened.is_visible("#rows")
    opened.go_back()
    opened.wait_for_selector("#rows tr")
    assert opened.query_selector("#canvas-signature") is None
    assert opened.input_value("#scatter-y") == "snr_frame_db"


def test_the_contact_sheet_shows_signatures_and_leads_from_one_to_the_next(opened, index):
    opened.click("#view-sheet")
    opened.wait_for_selector("#sheet canvas")
    kinds = opened.eval_on_selector_all("#sheet canvas", f"canvases => canvases.map({KINDS_OF_PIXELS})")
    assert len(kinds) == 24
    assert min(kinds) > 20
    opened.click(f"#sheet [data-id={index.id[3]}]")
    opened.wait_for_selector("#canvas-signature")
    assert opened.text_content("#example-id") == index.id[3]
    opened.click("#example-next")
    until(opened, "document.getElementById('example-id').textContent", index.id[4])
    opened.click("#back")
    opened.wait_for_selector("#sheet canvas")
    opened.click("#page-next")
    until(opened, "document.querySelector('#sheet .card').dataset.id", index.id[24])
    opened.go_back()
    until(opened, "document.querySelector('#sheet .card').dataset.id", index.id[0])
    opened.evaluate("history.go(-4)")  # behind the sheet, the two examples and the way back from them
    opened.wait_for_selector("#rows tr")


def test_the_browser_fits_a_narrow_screen(opened):
    opened.eval_on_selector("#balance tbody th", "cell => { cell.textContent = 'dog'.repeat(40); }")
    for width in (1440, 400):
        opened.set_viewport_size({"width": width, "height": 800})
        over = "document.getElementById('balance').getBoundingClientRect().right"
        assert opened.evaluate(f"{over} <= document.querySelector('.panel-balance').getBoundingClientRect().right")
    for view in ("#view-sheet", "#view-table"):
        opened.click(view)
        opened.wait_for_selector({"#view-sheet": "#sheet canvas", "#view-table": "#rows tr"}[view])
        assert opened.evaluate("document.documentElement.scrollWidth") <= 400
