"""The page of one recording in a real browser: what it shows, and that it moves, reads and keeps what it should."""

import json
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import viewer_page as view
from doppelgait.pipeline import analyze
from doppelgait.processing import Analysis, remove_clutter, signature
from doppelgait.radar import read_recording
from doppelgait.viewer.payload import ALIGNMENT, MAGIC, as_json
from doppelgait.viewer.server import open_in_browser


def test_the_page_is_opened_by_a_file(browser: Any, url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    page = browser.new_page()  # the console of a page tells every refusal
    monkeypatch.setattr("webbrowser.open", page.goto)
    with open_in_browser(url):
        page.wait_for_url(f"{url}**")
        page.wait_for_selector(view.READY)
        page.reload()
        page.wait_for_selector(view.READY)
    assert page.url.startswith("http://127.0.0.1:")
    page.close()


def is_under(read: float, share: float, axis: Any) -> bool:
    """Whether a cell of an axis that fills a picture is the one at a share of it, to a pixel of 100 or more."""
    values = np.asarray(axis, dtype=float)
    step = values[1] - values[0]
    expected = values[0] - step / 2 + share * step * values.size
    return bool(abs(read - expected) <= 0.51 * step + 0.01 * step * values.size)


def test_shows_every_panel_and_the_features_of_the_analysis(page: Any, url: str, walk: Path) -> None:
    view.opened(page, url)
    for name in ("range-time", "signature", "range-doppler", "cadence", "spectrum", "scene"):
        assert view.look(page, name)[1] > 20, name
    (result,) = analyze(read_recording(walk), gate="track")
    shown = {row.split("\t")[0]: row.split("\t")[1] for row in page.inner_text("#features tbody").split("\n")}
    assert float(shown["torso velocity"]) == pytest.approx(result.features.torso_velocity_mps, rel=5e-3)
    assert float(shown["torso Doppler"]) == pytest.approx(result.torso_doppler_hz, rel=5e-3)
    assert float(shown["gait frequency"]) == pytest.approx(result.gait_frequency_hz, rel=5e-3)
    assert "800 Hz" in view.text(page, "#facts")
    upper, lower = (page.locator(f"#canvas-{name}").bounding_box() for name in ("range-time", "signature"))
    assert (upper["x"], upper["width"]) == (lower["x"], lower["width"]), "one time axis for both"
    (truth,) = read_recording(walk).truth
    cell = page.inner_text("#features tbody tr >> nth=0").split("\t")[4]
    (true_mps, off) = re.findall(r"^([\d.]+) \((.*) %\)$", cell)[0]
    assert float(true_mps) == pytest.approx(float(np.mean(truth.centre_velocity_mps)), rel=0.02)  # of one segment
    assert abs(float(off.replace("\N{MINUS SIGN}", "-"))) < 5


def test_play_moves_the_cursor_and_what_follows_it(page: Any, url: str) -> None:
    view.opened(page, url)
    moving = ("scene", "range-doppler", "range-time-overlay", "signature-overlay")
    still = ("range-time", "signature", "cadence")
    before = {name: view.look(page, name) for name in (*moving, *still)}
    page.click("#play")
    assert page.get_attribute("#play", "aria-pressed") == "true"
    view.until(lambda: view.seconds(page) > 0.7, "the clock does not run")
    page.click("#play")
    after = {name: view.look(page, name) for name in (*moving, *still)}
    assert [name for name in moving if after[name] == before[name]] == []
    assert [name for name in still if after[name] != before[name]] == []
    stopped = view.seconds(page)
    time.sleep(0.1)
    assert view.seconds(page) == stopped


def test_scrub_and_click_seek(page: Any, url: str) -> None:
    view.opened(page, url)
    page.fill("#scrub", "1.5")
    assert view.seconds(page) == pytest.approx(1.5, abs=0.002)
    view.until(lambda: "t=1.5" in view.address(page), "the time is not in the address")
    for name in ("signature", "range-time"):
        box = page.locator(f"#canvas-{name}").bounding_box()
        x = 400.0 if name == "signature" else 200.0
        page.mouse.click(box["x"] + x, box["y"] + 40)
        expected = view.DURATION_S * (x - view.LEFT) / (box["width"] - view.LEFT - view.RIGHT)
        assert view.seconds(page) == pytest.approx(expected, abs=0.01), name


def test_hover_values_equal_the_file(page: Any, url: str, walk: Path) -> None:
    view.opened(page, url, "?t=1.2&band=all")
    recording = read_recording(walk)
    (result,) = analyze(recording, gate="track")
    baseband, gate = remove_clutter(recording.baseband, Analysis().resolved("track")), result.gate
    pieces = baseband.sel(slow_time=slice(gate.start_s, gate.stop_s))
    whole = signature(pieces, gate, result.analysis, wavelength_m=recording.radar.wavelength_m)
    for x, y in ((0.3, 0.4), (0.62, 0.55), (0.45, 0.25)):
        read, (across, up) = view.read_at(page, "range-time", x, y)
        assert read["s"] == pytest.approx(view.DURATION_S * across, abs=0.002)
        assert is_under(read["m"], up, baseband.range)
        cell = baseband.sel(slow_time=read["s"], range=read["m"], method="nearest")
        assert read["dB"] == pytest.approx(20 * np.log10(abs(complex(cell))), abs=0.05)

        read, (across, up) = view.read_at(page, "signature", x, y)
        assert read["s"] == pytest.approx(view.DURATION_S * across, abs=0.02)
        assert is_under(read["Hz"], up, whole.doppler)
        column = whole.sel(time=read["s"], doppler=read["Hz"], method="nearest")
        assert read["dB"] == pytest.approx(10 * np.log10(float(column)), abs=0.05)
        assert read["m/s"] == pytest.approx(float(column.velocity), abs=2e-3)

        read, _ = view.read_at(page, "cadence", x, y)
        cadence_hz = float(re.search(r"cadence ([\d.]+)", view.text(page, "#hover-cadence")).group(1))
        doppler_hz = float(re.search(r"· (-?[\d.]+) Hz", view.text(page, "#hover-cadence")).group(1))
        cell = result.cadence_map.sel(cadence=cadence_hz, doppler=doppler_hz, method="nearest")
        assert read["dB"] == pytest.approx(20 * np.log10(float(cell)), abs=0.05)


def test_lines_colours_and_levels_change_the_pictures(page: Any, url: str) -> None:
    view.opened(page, url)
    pictures = ("range-time", "signature", "range-doppler", "cadence")

    def changed(act: Callable[[], Any]) -> set[str]:
        before = {name: view.look(page, name) for name in pictures}
        act()
        time.sleep(0.15)
        return {name for name in pictures if view.look(page, name) != before[name]}

    assert changed(lambda: page.check("#parts input[value=torso]")) == {"signature"}
    assert changed(lambda: page.uncheck("#parts input[value=main-line]")) == {"signature"}
    assert changed(lambda: page.select_option("#map", "gray")) == set(pictures)
    assert changed(lambda: page.locator("#db-low").fill("-25") or page.press("#db-low", "Enter")) == set(pictures)
    assert changed(lambda: page.select_option("#band", "all")) == {"signature", "range-doppler", "cadence"}
    light = view.look(page, "spectrum")
    page.select_option("#theme", "dark")
    view.until(lambda: view.look(page, "spectrum") != light, "the theme changes nothing")
    chosen = view.wait_until_idle(page, "spectrum")
    page.select_option("#theme", "")
    view.until(lambda: view.wait_until_idle(page, "spectrum") == light, "the system's theme does not come back")
    page.emulate_media(color_scheme="dark")
    view.until(lambda: view.wait_until_idle(page, "spectrum") == chosen, "the system's dark theme is not followed")


def test_keys(page: Any, url: str) -> None:
    view.opened(page, url)
    page.keyboard.press("ArrowRight")
    step = view.seconds(page)
    assert 0 < step < 0.1
    page.keyboard.press("Shift+ArrowRight")
    assert view.seconds(page) == pytest.approx(11 * step, abs=0.002)
    page.keyboard.press("End")
    assert view.seconds(page) == pytest.approx(view.DURATION_S, abs=0.002)
    page.keyboard.press("Home")
    assert view.seconds(page) == 0
    page.keyboard.press("+")
    assert page.input_value("#speed") == "2"
    page.keyboard.press("l")
    assert not page.is_checked("#loop")
    page.keyboard.press("Space")
    assert page.get_attribute("#play", "aria-pressed") == "true"
    view.until(lambda: page.get_attribute("#play", "aria-pressed") == "false", "without a loop it ends at the end")
    assert view.seconds(page) == pytest.approx(view.DURATION_S, abs=0.002)
    page.keyboard.press("?")
    assert page.is_visible("#help-dialog")
    page.keyboard.press("Escape")
    assert not page.is_visible("#help-dialog")
    page.focus("#db-low")
    page.keyboard.press("l")
    assert not page.is_checked("#loop"), "a key typed into a number is no command"


def test_the_address_restores_what_was_chosen(page: Any, url: str) -> None:
    view.opened(page, url)
    page.select_option("#map", "viridis")
    page.check("#parts input[value=left-leg]")
    page.select_option("#speed", "0.5")
    page.fill("#scrub", "2")
    page.select_option("#gate", "truth")
    page.wait_for_selector(view.READY)
    view.until(
        lambda: all(key in view.address(page) for key in ("map=", "lines=", "t=2", "speed=", "gate=truth")),
        "the choices are not in the address",
    )
    wanted = view.wait_until_idle(page, "signature"), view.wait_until_idle(page, "scene")
    view.opened(page, view.address(page))
    assert page.input_value("#map") == "viridis"
    assert page.input_value("#speed") == "0.5"
    assert page.input_value("#gate") == "truth"
    assert page.is_checked("#parts input[value=left-leg]")
    assert view.seconds(page) == 2
    assert (view.wait_until_idle(page, "signature"), view.wait_until_idle(page, "scene")) == wanted


def test_the_scene_turns_zooms_and_names_what_is_under_the_mouse(page: Any, url: str) -> None:
    view.opened(page, url)
    first = view.wait_until_idle(page, "scene")
    box = page.locator("#canvas-scene").bounding_box()
    page.mouse.move(box["x"] + 100, box["y"] + 100)
    page.mouse.down()
    page.mouse.move(box["x"] + 180, box["y"] + 120, steps=3)
    page.mouse.up()
    view.until(lambda: view.look(page, "scene") != first, "dragging does not turn")
    turned = view.look(page, "scene")
    page.mouse.wheel(0, 300)
    view.until(lambda: view.look(page, "scene") != turned, "the wheel does not zoom")
    page.click("button[data-view=all]")
    view.until(lambda: view.look(page, "scene") == first, "everything in view is not where it began")
    page.click("button[data-view=body]")
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    for dy in range(0, 120, 6):  # up along the middle of the body, to its head at last
        page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2 - dy)
        if "range" in view.text(page, "#hover-scene"):
            break
    found = re.search(r"human: .* at \((.*)\) m · range ([\d.]+) m", view.text(page, "#hover-scene"))
    assert found, view.text(page, "#hover-scene")
    place = np.array([float(part) for part in found.group(1).split(",")])
    assert float(found.group(2)) == pytest.approx(np.linalg.norm(place - [0, 0, 1]), abs=0.02)


SEGMENTS = [[0.0, 1.0], [1.2, 2.4]]
FLAGS = {
    "harmonic_ratio_2:no_peak_6_db_above_its_surroundings": "second harmonic ratio: "
    "no peak 6 dB above its surroundings",
    "torso_velocity_mps:uncertain_by_more_than_25_per_cent": "torso velocity: uncertain by more than 25 per cent",
    "gait_frequency_hz:uncertain_by_more_than_25_per_cent": "gait frequency: uncertain by more than 25 per cent",
    "step_length_m,limb_torso_ratio:need_a_gait_frequency": "step length, limb torso ratio: need a gait frequency",
}


def test_says_which_segment_and_which_doppler_axis_it_shows(page: Any, url: str) -> None:
    def with_segments(facts: dict[str, Any], query: dict[str, list[str]]) -> None:
        (target,) = facts["targets"]
        chosen = int(query.get("segment", ["0:1"])[0].split(":")[1])
        target.update(segments=SEGMENTS, segment=chosen, aligned=True, flags=list(FLAGS))
        target["cadence_map"]["band_hz"] = [-40.0, 60.0]
        higher = json.loads(json.dumps({**target, "number": 1}))
        higher["signature"]["band_hz"] = [end + 300 for end in higher["signature"]["band_hz"]]  # another band
        facts["targets"].append(higher)

    view.altered(page, "targets", with_segments)
    view.opened(page, url)
    assert view.text(page, ".panel-signature h2") == "Micro-Doppler signature, segment 2 of 2, 1.2–2.4 s"
    assert view.text(page, ".panel-features h2").endswith("target, 1.2–2.4 s")
    assert page.input_value("#segment") == "0:1"
    assert page.locator(".flags li").all_text_contents() == list(FLAGS.values())
    body = page.locator(".feature-body")
    assert body.evaluate("node => node.scrollHeight - node.clientHeight") <= 1, "flags are cut off"
    for share in (0.02, 0.5, 0.98):
        view.read_at(page, "cadence", 0.5, share)
        shown = re.search(r"· (-?[\d.]+) Hz .* from main line", view.text(page, "#hover-cadence"))
        assert shown
        assert float(shown.group(1)) == pytest.approx(-40 + 100 * share, abs=4)
    tops = [view.read_at(page, name, 0.5, 0.99)[0]["Hz"] for name in ("range-doppler", "signature")]
    assert tops[0] > tops[1] + 100, "not every target's Doppler is in the range-Doppler picture"
    page.select_option("#segment", "0:0")
    view.until(
        lambda: "segment 1 of 2, 0.0–1.0 s" in view.text(page, ".panel-signature h2"), "the segment is not shown"
    )
    assert "segment=0%3A0" in view.address(page)
    page.select_option("#gate", "truth")
    view.until(lambda: page.evaluate("location.search") == "?gate=truth", "another gate has other segments")
    page.wait_for_selector(view.READY)


def test_deviations_from_the_truth_and_the_body_of_a_target(page: Any, url: str) -> None:
    page.goto(url)
    cases = {
        (1.0, 1.2, 0.1, "m/s"): "1.00 (+20 %)",
        (-1.0, -1.2, None, "m/s"): "-1.00 (-20 %)",
        (0.3, 0.6, 0.4, "m/s"): "0.300",  # less than one deviation from zero
        (-1e-12, 1.24, None, "m/s"): "0",
        (0.01, 1.0, None, "m"): "0.0100",
        (2.0, None, None, "Hz"): "2.00",
        (None, 1.0, None, "Hz"): "–",
    }
    script = """async (cases) => {
      const { compared } = await import(new URL("static/features.js", location.href));
      return cases.map(([truth, value, deviation, unit]) => compared(truth, { value, deviation, unit }));
    }"""
    found = page.evaluate(script, [list(case) for case in cases])
    assert [one.replace("\N{MINUS SIGN}", "-") for one in found] == list(cases.values())
    script = """async (middles) => {
      const { bodyOf } = await import(new URL("static/truth.js", location.href));
      const time = { first: 0, step: 0.5, n: 4 };
      const list = [{ time, range: "far" }, { time, range: "near" }];
      const truth = { list, arrays: { far: [4, 4, 4, 4], near: [2, 2.5, 3, 3.5] } };
      const target = { gate_limits: { time: "t", low: "low", high: "high" } };
      return middles.map((middle) => {
        const [low, high] = [-0.3, 0.3].map((by) => middle.map((value) => value + by));
        return bodyOf(target, { t: [0, 0.5, 1, 1.5], low, high }, truth);
      });
    }"""
    middles = [[2, 2.5, 3, 3.4], [4.5, 4.5, 4.5, 4.5], [7, 7, 7, 7], [2, 2.5, 9, 3.5]]
    assert page.evaluate(script, middles) == [1, 0, None, 1]


def test_tells_what_it_waits_for_and_what_cannot_be_had(page: Any, url: str) -> None:
    held: list[Any] = []
    page.route("**/api/targets*", lambda route: held.append(route))
    page.goto(url)
    view.until(
        lambda: page.wait_for_timeout(20) or "analysing" in view.text(page, "#status"), "no word of what takes so long"
    )
    assert re.match(r"analysing [23] s", view.text(page, "#status"))
    box = page.locator("#canvas-range-time").bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] - 20)
    assert view.text(page, "#hover-range-time"), "the picture ends above the signature's axis"
    assert view.look(page, "signature")[1] > 20, "no signature before the targets are there"
    assert view.text(page, ".panel-signature h2") == "Micro-Doppler signature, all ranges"
    reason = as_json({"targets": [], "reason": "nothing moves", "notes": [], "analysis": {}, "arrays": {}})
    reason += b" " * (-len(reason) % ALIGNMENT)
    held[0].fulfill(body=MAGIC + len(reason).to_bytes(4, "little") + reason)
    page.wait_for_selector(view.READY)
    assert view.text(page, "#status") == ""
    assert view.text(page, ".panel-features .empty") == "nothing moves"
    assert view.wait_until_idle(page, "signature")[1] > 20, "the signature goes where there is no target"
    assert page.is_disabled("#sound")
    assert "no target" in page.get_attribute("#sound", "title")


@pytest.mark.shared
def test_a_real_recording_says_what_it_does_not_have(page: Any, serve: Callable[..., str], shared: Path) -> None:
    folder = shared / "data/radar/x4_baseband_iq_novelda/xethru_recording_20170913_150437_baseband_recording"
    view.opened(page, serve(folder, "--set", "cpi_s=1"))  # 17 frames a second: a longer interval
    assert view.look(page, "range-time")[1] > 20
    assert "only for simulated recordings" in view.text(page, ".panel-scene .empty")
    assert view.text(page, ".panel-signature .empty") == ""  # somebody who breathes for the first 12 s
    assert page.locator("#gate option[value=truth]").count() == 0
    before = view.look(page, "range-time-overlay")
    page.click("#play")
    view.until(lambda: view.seconds(page) > 0.3, "the clock does not run")
    page.click("#play")
    assert view.look(page, "range-time-overlay") != before
    page.select_option("#gate", "own")
    page.fill("#gate-from", "0.5")
    page.fill("#gate-to", "2")
    page.press("#gate-to", "Enter")
    view.until(lambda: view.look(page, "signature")[1] > 20, "no signature for the gate")
