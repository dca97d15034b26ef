"""The page of one's own recording: analysis, zoom, measuring, saving, and how the page uses its space."""

import csv
import io
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import viewer_page as view
from doppelgait.pipeline import analyze, parse_run, run_simulation
from doppelgait.processing import Analysis
from doppelgait.radar import read_recording, write_recording

SEGMENTS = [[0.2, 1.0], [1.2, 2.3]]


def features(page: Any) -> dict[str, list[str]]:
    """Cells of the feature table by the words of the first."""
    rows = [row.split("\t") for row in page.inner_text("#features tbody").replace("\N{MINUS SIGN}", "-").split("\n")]
    return {row[0].strip(): [cell.strip() for cell in row[1:]] for row in rows}


def change(page: Any, control: str, value: str) -> None:
    page.fill(f"#{control}", value)
    page.press(f"#{control}", "Enter")
    page.wait_for_selector(view.READY)


def mark(page: Any, selector: str) -> str:
    """Text that the style sheet adds after an element; "none" without."""
    return str(page.evaluate(f"getComputedStyle(document.querySelector('{selector}'), '::after').content"))


def test_the_analysis_is_changed_by_controls(page: Any, url: str, walk: Path) -> None:
    view.opened(page, url)
    assert "(earlier settings)" not in mark(page, ".panel-signature h2")
    numbers = {name: page.input_value(f"#{name}") for name in ("cpi_s", "window_steepness", "hop")}
    assert numbers == {"cpi_s": "0.1", "window_steepness": "0.4", "hop": "6"}
    before = {name: view.look(page, name) for name in ("signature", "range-doppler", "range-time")}
    page.requested.clear()
    change(page, "cpi_s", "0.2")
    view.until(
        lambda: view.look(page, "range-doppler") != before["range-doppler"], "the interval does not change the maps"
    )
    assert view.look(page, "signature") != before["signature"]
    assert view.look(page, "range-time") == before["range-time"]
    assert not [one for one in page.requested if "api/recording" in one], "range against time needs no interval"
    (expected,) = analyze(read_recording(walk), gate="track", analysis=Analysis(cpi_s=0.2))
    assert float(features(page)["torso velocity"][0]) == pytest.approx(expected.features.torso_velocity_mps, rel=5e-3)
    for name, value in (("hop", "20"), ("window_steepness", "0.2")):
        shown = view.look(page, "signature")
        change(page, name, value)
        view.until(lambda: view.look(page, "signature") != shown, f"{name} changes nothing")  # noqa: B023
    wanted = ("cpi_s=0.2", "hop=20", "window_steepness=0.2")
    view.until(lambda: all(part in view.address(page) for part in wanted), "the address does not state the analysis")
    page.click("#standard")
    page.wait_for_selector(view.READY)
    view.until(lambda: page.input_value("#cpi_s") == "0.1", "the analysis is not as it was at first")
    view.until(lambda: view.look(page, "signature") == before["signature"], "the signature is not as it was at first")


def test_an_error_stands_in_one_line_next_to_its_control(page: Any, url: str) -> None:
    view.opened(page, url)
    before, height = view.look(page, "signature"), page.locator(".controls").bounding_box()["height"]
    page.select_option("#gate", "own")
    page.fill("#gate-from", "3")
    page.fill("#gate-to", "2")
    page.press("#gate-to", "Enter")
    assert "ends before it begins" in view.text(page, "#fault-gate")
    view.altered(
        page, "targets", lambda facts, query: facts.update(targets=[], failed=True, reason="too short for 9 s")
    )
    change(page, "cpi_s", "9")
    assert view.text(page, "#fault-cpi_s") == "too short for 9 s"
    assert view.text(page, "#fault-gate") == ""
    line = page.locator("#fault-cpi_s").bounding_box()
    control = page.locator("#cpi_s").bounding_box()
    assert abs(line["y"] + line["height"] / 2 - control["y"] - control["height"] / 2) < 6, "not next to its control"
    assert view.look(page, "signature") == before, "the pictures stay"
    assert "(earlier settings)" in mark(page, ".panel-signature h2"), "and are not marked"
    assert height < 100


def test_a_gate_beyond_the_frame_is_refused_or_shortened_with_words(page: Any, url: str) -> None:
    view.opened(page, url)
    page.select_option("#gate", "own")
    page.fill("#gate-from", "2")
    change(page, "gate-to", "90")
    view.until(
        lambda: "gate 2 to 90 m extends beyond the recorded frame: 2.00 to" in view.text(page, "#notes"), "no note"
    )
    assert mark(page, ".panel-signature h2") == "none"
    change(page, "gate-from", "50")
    view.until(lambda: view.text(page, "#fault-gate") != "", "not refused")
    assert view.text(page, "#fault-gate").endswith("use ranges inside")
    size = page.evaluate("(n => [n.scrollWidth, n.clientWidth])(document.getElementById('fault-gate'))")
    assert size[0] <= size[1], "the message is not shown as a whole"
    for panel in ("signature", "cadence", "features"):
        assert "(earlier settings)" in mark(page, f".panel-{panel} h2"), panel
    assert "gate of the earlier settings" in mark(page, ".panel-range-time h2")
    page.click("#standard")
    view.until(lambda: mark(page, ".panel-signature h2") == "none", "still marked")


def test_the_signature_is_that_of_the_whole_track_with_its_segments(page: Any, url: str) -> None:
    def with_segments(facts: dict[str, Any], query: dict[str, list[str]]) -> None:
        facts["targets"][0].update(segments=SEGMENTS, segment=int(query.get("segment", ["0:1"])[0].split(":")[1]))

    view.altered(page, "targets", with_segments)
    view.opened(page, url)
    assert view.read_at(page, "signature", 0.1, 0.5)[0]["dB"] < 0, "there is no signature before the segment"
    colours = """([x, y]) => {
      const canvas = document.getElementById("canvas-signature");
      const ratio = canvas.width / canvas.clientWidth;
      return [...canvas.getContext("2d").getImageData(x * ratio, y * ratio, 1, 1).data];
    }"""
    box = page.locator("#canvas-signature").bounding_box()

    def bar(time_s: float) -> list[int]:
        x = view.LEFT + time_s / view.DURATION_S * (box["width"] - view.LEFT - view.RIGHT)
        return page.evaluate(colours, [x, 7])

    own, other, none = bar(1.5), bar(0.5), bar(1.1)
    assert own[0] > 240 > 200 < own[1]
    assert own[0] > other[0] > none[0] + 40, "the segments are not marked"
    page.select_option("#segment", "0:0")
    view.until(lambda: bar(0.5)[0] > 240, "the other segment is not marked as the one shown")
    page.uncheck("#parts input[value=segments]")
    view.until(lambda: bar(0.5)[0] < 200, "the marks cannot be switched off")


def test_zoom_and_scroll_are_linked_and_kept(page: Any, url: str) -> None:
    view.opened(page, url)
    box = page.locator("#canvas-signature").bounding_box()
    middle = (box["x"] + view.LEFT + 0.5 * (box["width"] - view.LEFT - view.RIGHT), box["y"] + 60)

    def ends(name: str) -> list[float]:
        """Times at the ends of a panel."""
        found = []
        for share in (0.002, 0.998):
            view.read_at(page, name, share, 0.5)
            found.append(float(re.search(r"([\d.]+) s", view.text(page, f"#hover-{name}")).group(1)))
        return found

    page.mouse.move(*middle)
    page.mouse.wheel(0, -300)
    view.until(lambda: "time=" in view.address(page), "the wheel does not zoom")
    page.wait_for_timeout(50)
    for name in ("signature", "range-time"):
        low, high = ends(name)
        assert high - low == pytest.approx(view.DURATION_S * 2.718**-0.45, rel=0.05), name
        assert (low + high) / 2 == pytest.approx(view.DURATION_S / 2, abs=0.1), name
    page.keyboard.press("d")
    page.wait_for_timeout(50)
    assert ends("range-time")[1] > high + 0.2, "the key does not scroll"
    page.mouse.move(*middle)
    page.keyboard.down("Shift")
    page.mouse.down()
    page.mouse.move(middle[0] + 2000, middle[1], steps=2)
    page.mouse.up()
    page.keyboard.up("Shift")
    page.wait_for_timeout(50)
    assert ends("signature")[0] < 0.05, "dragging does not scroll"
    assert view.seconds(page) == 0, "scrolling moves the cursor"
    whole = [view.read_at(page, name, 0.5, 0.98)[0]["Hz"] for name in ("signature", "range-doppler")]
    page.mouse.move(box["x"] + 20, middle[1])  # over the numbers of the Doppler axis
    page.mouse.wheel(0, -300)
    view.until(lambda: "doppler=" in view.address(page), "the wheel does not zoom in Doppler")
    page.wait_for_timeout(50)
    zoomed = [view.read_at(page, name, 0.5, 0.98)[0]["Hz"] for name in ("signature", "range-doppler")]
    assert all(new < old - 20 for new, old in zip(zoomed, whole, strict=True)), "Doppler is not linked"
    kept = view.address(page)
    page.mouse.dblclick(*middle)
    view.until(
        lambda: "time=" not in view.address(page) and "doppler=" not in view.address(page),
        "a double click does not reset",
    )
    view.opened(page, kept)
    assert ends("range-time")[1] < view.DURATION_S - 0.3, "the address does not keep the zoom"


def test_measuring_gives_differences_between_two_points(page: Any, url: str) -> None:
    view.opened(page, url)
    page.keyboard.press("m")
    assert page.get_attribute("#measure", "aria-pressed") == "true"
    before = view.look(page, "range-time-overlay")
    box = page.locator("#canvas-range-time").bounding_box()
    page.mouse.click(box["x"] + 100, box["y"] + 30)
    page.mouse.move(box["x"] + 300, box["y"] + 60)
    view.until(lambda: view.look(page, "range-time-overlay") != before, "the measurement is not drawn")
    page.mouse.click(box["x"] + 300, box["y"] + 60)
    assert view.seconds(page) == 0, "measuring moves the cursor"
    script = """async ([axes, from, to]) => {
      const { difference } = await import(new URL("static/measure.js", location.href));
      return difference(axes, from, to);
    }"""
    axes = {"x": {"unit": "s"}, "y": {"unit": "m"}}
    doppler = {"x": {"unit": "s"}, "y": {"unit": "Hz"}, "second": {"unit": "m/s", "scale": 0.02}}
    found = [page.evaluate(script, [axes, [1, 4], [1.5, 3]]), page.evaluate(script, [doppler, [1, -10], [3, 40]])]
    assert [one.replace("\N{MINUS SIGN}", "-") for one in found] == [
        "Δ 0.500 s · -1.000 m · 2.000 m/s", "Δ 2.000 s · 50.00 Hz · 1.000 m/s",
    ]  # fmt: skip
    page.keyboard.press("Escape")
    assert page.get_attribute("#measure", "aria-pressed") == "false"


def test_the_picture_and_the_table_are_saved(page: Any, url: str, walk: Path) -> None:
    view.opened(page, url)
    with page.expect_download() as saved:
        page.click("#save-picture")
    assert saved.value.suggested_filename == "walk.h5.png"
    picture = Path(saved.value.path()).read_bytes()
    assert picture[:8] == b"\x89PNG\r\n\x1a\n"
    width = int.from_bytes(picture[16:20], "big")
    assert width >= 2 * page.locator(".panels").bounding_box()["width"] - 2
    assert len(picture) > 100_000
    height = int.from_bytes(picture[20:24], "big")
    assert height >= 2 * (page.locator(".panels").bounding_box()["height"] + 20), "no line with the recording's name"
    page.focus("#save-picture")
    view.read_at(page, "range-time", 0.5, 0.5)
    with page.expect_download() as saved:
        page.keyboard.press("Enter")
    with_mouse = Path(saved.value.path()).read_bytes()
    assert with_mouse == picture, "the cross at the mouse is in the picture"
    with page.expect_download() as saved:
        page.click("#save-table")
    rows = list(csv.DictReader(io.StringIO(Path(saved.value.path()).read_text("utf-8"))))
    (result,) = analyze(read_recording(walk), gate="track")
    found = {row["feature"]: row for row in rows}
    assert float(found["gait_frequency_hz"]["value"]) == result.gait_frequency_hz
    assert found["gait_frequency_hz"]["unit"] == "Hz"
    assert float(found["torso_velocity_mps"]["start_s"]) == result.quality["start_s"]


def test_features_stand_out_where_they_are_far_from_the_truth(page: Any, url: str) -> None:
    def far(facts: dict[str, Any], query: dict[str, list[str]]) -> None:
        target = facts["targets"][0]
        target["features"]["gait_frequency_hz"] = 2 * target["truth"]["gait_frequency_hz"]
        target["quality"].update(breathing_rate_hz=0.25, ground_step_length_m=0.7)
        target["truth"]["breathing_rate_hz"] = 0.26

    view.altered(page, "targets", far)
    view.opened(page, url)
    names = list(features(page))
    at = names.index("ground step length")
    assert names[at + 1] == "radial step length", names
    assert features(page)["breathing rate"][0] == "0.250"
    assert page.locator("#features tr:has-text('breathing rate')").get_attribute("title") == "15.0 breaths a minute"
    assert page.locator("#features tr.far th").all_text_contents() == ["gait frequency"]


def test_a_panel_without_content_gives_its_space_away(page: Any, url: str) -> None:
    def bare(facts: dict[str, Any], query: dict[str, list[str]]) -> None:
        facts.update(scene=None, bodies=[])

    view.altered(page, "recording", bare)
    view.altered(page, "targets", lambda facts, query: facts["targets"][0].update(cadence_map=None))
    view.opened(page, url)
    width = page.locator(".panels").bounding_box()["width"]
    assert page.locator("#canvas-signature").bounding_box()["width"] > 0.95 * width
    assert page.locator(".panel-scene").bounding_box()["height"] < 40
    assert page.locator(".panel-cadence").bounding_box()["height"] < 40
    assert page.locator("#canvas-range-doppler").bounding_box()["width"] > 0.45 * width


def test_space_plays_unless_a_control_that_uses_it_has_the_focus(page: Any, url: str) -> None:
    def plays() -> bool:
        return bool(page.get_attribute("#play", "aria-pressed") == "true")

    view.opened(page, url)
    for focused, expected in (("#scrub", True), ("#scrub", False), ("#canvas-scene-overlay", True)):
        page.focus(focused)
        page.keyboard.press("Space")
        assert plays() == expected, focused
    page.keyboard.press("Space")
    for box in ("#loop", "#parts input[value=main-line]"):
        ticked = page.is_checked(box)
        page.focus(box)
        page.keyboard.press("Space")
        assert page.is_checked(box) != ticked, box
        assert not plays(), box
    page.focus("#loop")
    page.keyboard.press("Enter")
    assert page.is_checked("#loop"), "Enter switches a box, too"
    for field in ("#cpi_s", "#map"):
        page.focus(field)
        page.keyboard.press("Space")
        page.keyboard.press("Escape")
        assert not plays(), field
    page.focus("#help")
    page.keyboard.press("Space")
    assert page.is_visible("#help-dialog")
    assert not plays()


def test_warnings_are_shown_once_and_move_nothing(page: Any, url: str) -> None:
    held: list[Any] = []
    page.route("**/api/targets*", lambda route: held.append(route))
    view.altered(page, "recording", lambda facts, query: facts.update(notes=["the radar is guessed"]))
    page.goto(url)
    view.until(
        lambda: page.wait_for_timeout(20) or "guessed" in view.text(page, "#notes"),
        "the note of the recording is missing",
    )
    place = page.locator(".panels").bounding_box()["y"]
    page.unroute("**/api/targets*")
    said = ["the radar is guessed", "the gate leaves the frame"]
    view.altered(page, "targets", lambda facts, query: facts.update(notes=said))
    page.select_option("#gate", "truth")  # asks for both again
    page.wait_for_selector(view.READY)
    view.until(lambda: "2 notes" in view.text(page, "#notes summary"), "the warning of the analysis is missing")
    assert page.locator("#notes li").all_text_contents() == said
    page.click("#notes summary")
    assert page.is_visible("#notes li >> nth=1")
    assert page.locator(".panels").bounding_box()["y"] == place, "a warning moves the panels"


def test_the_picture_comes_first_in_a_narrow_window(page: Any, url: str) -> None:
    page.set_viewport_size({"width": 400, "height": 800})
    view.opened(page, url)
    places = {name: page.locator(name).bounding_box() for name in (".time-panels", ".panel-features", ".controls")}
    assert places[".time-panels"]["y"] < 110
    assert places[".controls"]["y"] > places[".panel-features"]["y"]
    play = page.locator("#play").bounding_box()
    assert play["y"] + play["height"] <= 800, "the time is out of sight"
    assert page.evaluate("document.documentElement.scrollWidth") <= 400
    assert page.locator("#canvas-signature").bounding_box()["width"] > 350


def test_range_doppler_has_the_levels_of_its_frame(page: Any, url: str) -> None:
    view.opened(page, url)
    bar = ".panel-range-doppler .colour-bar span >> nth=1"
    far = view.text(page, bar)
    page.fill("#scrub", "2.4")
    view.until(lambda: view.text(page, bar) != far, "a frame near the radar and one far off have the same levels")


LABELS = """async (body) => {
  const { drawLabels } = await import(new URL("static/scene_floor.js", location.href));
  const texts = [];
  const [measureText, fillText] = [(words) => ({ width: 6 * words.length }), (...text) => texts.push(text)];
  const context = { canvas: { clientWidth: 800 }, measureText, fillText };
  const camera = { project: ([x, y, z]) => ({ x: 150 + 80 * x, y: 300 - 60 * y - 70 * z, depth: 9 - x, scale: 80 }) };
  const corners = [[0, 0, 0], [6, 3, 2], [0, -3, 0]];
  const scene = { radar: [0, 0, 1], azimuth: 0, tilt: 0, corners, floor: { x: [-1, 7], y: [-3, 3] } };
  drawLabels(context, camera, scene, { places: body.map(([x, y]) => ({ x, y, body: 0 })), colours: {} });
  return texts;
}"""


def test_no_label_of_the_scene_crosses_a_body(page: Any, url: str) -> None:
    page.goto(url)
    labels = page.evaluate(LABELS, [[700, 50]])
    assert {"4 m", "radar, 1.00 m high", "x = 7 m"} <= {words for words, *_ in labels}
    for words, x, y in labels:  # a body where this text would be
        others = page.evaluate(LABELS, [[x - 9, y - 20], [x + 6 * len(words), y + 20]])
        assert [x, y] not in [place for word, *place in others if word == words], words


def test_two_recordings_are_compared_on_one_time_line(page: Any, walk: Path, serve: Any, tmp_path: Path) -> None:
    longer = {**view.WALK, "seed": 8, "duration_s": 3.5, "noise": {"kind": "snr", "snr_db": 15}}
    write_recording(run_simulation(parse_run(longer)), tmp_path / "longer.h5")
    view.opened(page, serve(walk, tmp_path / "longer.h5"))
    for name in ("other-range-time", "other-signature"):
        assert view.look(page, name)[1] > 20, name
    for name in ("range-time", "signature"):
        bars = page.locator(f".panel-{name} .colour-bar").all_text_contents()
        assert len(bars) == 2
        assert bars[0] != bars[1], "the levels are those of the other recording"
        own, other = (page.locator(f"#canvas-{one}").bounding_box() for one in (name, f"other-{name}"))
        assert (own["x"], own["width"]) == (other["x"], other["width"])
    assert page.get_attribute("#scrub", "max") == "3.5"
    view.read_at(page, "signature", 0.2, 0.9)
    shown = view.text(page, "#hover-signature")
    box = page.locator("#canvas-other-signature").bounding_box()
    page.mouse.move(box["x"] + view.LEFT + round(0.2 * (box["width"] - view.LEFT - view.RIGHT)), box["y"] + 30)
    view.until(lambda: view.text(page, "#hover-other-signature") != "", "the second picture is not read")
    times = [
        float(re.search(r"([\d.]+) s", one).group(1)) for one in (shown, view.text(page, "#hover-other-signature"))
    ]
    assert times[0] == pytest.approx(times[1], abs=0.02), "the pictures have other times"
    headings = page.locator(".panel h2").all_text_contents()
    assert len(headings) == 9
    assert all(one.startswith(("walk.h5: ", "longer.h5: ")) for one in headings), headings
    with page.expect_download() as saved:
        page.click("#save-table")
    rows = list(csv.DictReader(io.StringIO(Path(saved.value.path()).read_text("utf-8"))))
    assert {row["recording"] for row in rows} == {"walk.h5", "longer.h5"}
    page.keyboard.press("n")
    for x in (100, 200):
        page.mouse.click(box["x"] + x, box["y"] + 30)
    assert page.is_hidden("#annotations"), "a span of the second recording is one of the first"
    page.keyboard.press("Escape")
    before = view.look(page, "other-signature")
    change(page, "cpi_s", "0.2")
    view.until(lambda: view.look(page, "other-signature") != before, "the second recording keeps another interval")


def test_a_zoom_is_computed_again_on_a_finer_grid(page: Any, url: str) -> None:
    def times(name: str) -> list[float]:
        return sorted({view.read_at(page, name, 0.5 + n / 300, 0.5)[0]["s"] for n in range(12)})

    view.opened(page, url)
    levels = view.text(page, ".panel-signature .colour-bar")
    page.goto(url + "?time=1:1.2")
    page.wait_for_selector(view.READY)
    view.until(lambda: min(np.diff(times("signature"))) < 0.002, "the columns are as wide as those of the whole")
    assert min(np.diff(times("range-time"))) < 0.002  # 800 pulses a second; before, one column in 6
    assert view.text(page, ".panel-signature .colour-bar") == levels


def test_decisions_and_alarm_are_below_the_signature(page: Any, url: str) -> None:
    def mark(n: int) -> dict[str, Any]:
        decided = {"label": "human", "reason": ""} if n > 2 else {"label": None, "reason": "too low"}
        where = {"time_s": 0.4 * n, "range_m": 4.0 + 1.2 * (view.DURATION_S / 2 - 0.4 * n)}  # of the walker
        return {"track": 7, "evidence": 0.2 * n, "alarm": n > 3, **where, **decided}

    def answer(route: Any) -> None:
        first = int(re.search(r"from=(\d+)", route.request.url).group(1))
        facts = {"shown_class": "human", "alarm_class": "human", "alarm_threshold": 0.7, "stop_s": 2.4}
        marks = [*map(mark, range(6)), {**mark(2), "track": 8, "range_m": 1.0}]
        route.fulfill(json={**facts, "marks": marks[first:][:4], "complete": bool(changes)})

    changes: list[str] = []
    page.route("**/api/decisions*", answer)
    view.opened(page, url)
    change(page, "cpi_s", "0.2")  # the decisions go on, with the parameters of their model
    view.until(lambda: "cpi_s" in view.address(page), "not changed")
    page.wait_for_selector(view.READY)
    changes.append("cpi_s")
    view.until(lambda: view.text(page, ".panel-evidence h2") == "Decisions: probability of human", "not complete")
    upper, lower = (page.locator(f"#canvas-{name}").bounding_box() for name in ("signature", "evidence"))
    assert (upper["x"], upper["width"]) == (lower["x"], lower["width"]), "not one time axis"
    assert upper["y"] < lower["y"] < lower["y"] + lower["height"] - 150
    keys = ["target 0", "track that is not listed", "○ undecided", "╌ alarm from 0.70", "│ alarm begins"]
    assert page.locator(".keys > span").all_text_contents() == keys
    for n, said in ((2, "undecided: too low · human 0.400"), (5, "human · human 1.000 · alarm")):
        view.read_at(page, "evidence", 0.4 * n / view.DURATION_S, (0.2 * n + 0.08) / 1.16)
        assert view.text(page, "#hover-evidence") == f"{0.4 * n:.2f} s · target 0 · {said}"


def test_annotations_are_listed_saved_kept_and_deleted(page: Any, url: str) -> None:
    view.opened(page, url)
    before = {name: view.wait_until_idle(page, f"{name}-overlay") for name in ("signature", "range-time")}
    box = page.locator("#canvas-signature").bounding_box()
    at = [box["x"] + view.LEFT + share * (box["width"] - view.LEFT - view.RIGHT) for share in (0.6, 0.2)]
    page.keyboard.press("n")
    page.mouse.click(at[0], box["y"] + 50)
    page.mouse.click(at[1], box["y"] + 90)  # the second point may be the earlier
    page.wait_for_selector("#annotations input:focus")
    page.keyboard.type('=comes, "waves"')
    page.keyboard.press("Enter")
    page.click("#annotate")
    page.mouse.move(at[1], box["y"] + 60)
    page.mouse.down()
    page.mouse.move(at[1] - 40, box["y"] + 60, steps=3)
    page.mouse.up()
    assert page.locator("#annotations tbody tr").count() == 2
    assert page.get_attribute("#annotate", "aria-pressed") == "false"
    assert view.seconds(page) == 0, "marking moves the cursor"
    for name, look in before.items():
        assert view.look(page, f"{name}-overlay") != look, name
    page.reload()
    page.wait_for_selector(view.READY)
    view.until(lambda: page.locator("#annotations tbody tr").count() == 2, "a reload forgets the annotations")
    with page.expect_download() as saved:
        page.click("#annotations-json")
    assert saved.value.suggested_filename == "walk.h5.annotations.json"
    found = json.loads(Path(saved.value.path()).read_text("utf-8"))
    assert [one["label"] for one in found] == ["", '=comes, "waves"']
    assert {one["file"] for one in found} == {"walk.h5"}
    assert [found[1]["start_s"], found[1]["stop_s"]] == pytest.approx([0.2 * 2.5, 0.6 * 2.5], abs=0.01)
    with page.expect_download() as saved:
        page.click("#annotations-csv")
    rows = list(csv.DictReader(io.StringIO(Path(saved.value.path()).read_text("utf-8"))))
    assert rows[1].pop("label") == "'" + found[1].pop("label")  # no formula of a spreadsheet
    assert [{**row, "start_s": float(row["start_s"]), "stop_s": float(row["stop_s"])} for row in rows] == found
    page.click("#annotations tbody tr >> nth=0 >> text=delete")
    assert page.input_value("#annotations tbody input") == '=comes, "waves"'
    page.click("#annotations tbody tr >> text=delete")
    key = page.evaluate("Object.keys(localStorage).find((name) => name.includes('annotations'))")
    assert page.evaluate("(key) => localStorage.getItem(key)", key) == "[]"
    for kept, count in (("[1, null, {}]", 0), ('{"a": 1}', 0), ("{", 0), ('[{"start_s": 1, "stop_s": 2}]', 1)):
        page.evaluate("(item) => localStorage.setItem(...item)", [key, kept])
        page.reload()
        page.wait_for_selector(view.READY)
        assert (page.locator("#annotations tbody tr").count(), page.is_hidden("#error")) == (count, True), kept
    view.altered(page, "recording", lambda facts, _: facts.update(content="another file of this name"))
    page.reload()
    page.wait_for_selector(view.READY)
    assert page.is_hidden("#annotations")
