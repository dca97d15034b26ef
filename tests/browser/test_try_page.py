"""The page "Try it" in Chromium: a slider redraws, mistakes stand beside the form, the sound follows the cursor."""

import re
import tomllib
from urllib.parse import parse_qs, urlsplit

import pytest
from playwright.sync_api import expect

from doppelgait.pipeline import parse_run
from viewer_page import look

SLOW = 60_000
START = "?duration_s=2&radar=x4-255fps&range_m=3"
DRAG = """([id, value]) => {
  const slider = document.getElementById(id);
  slider.value = value;
  slider.dispatchEvent(new Event("input", { bubbles: true }));
}"""


@pytest.fixture
def try_page(page, serve):
    page.goto(serve() + START)
    expect(page.locator("#features")).to_contain_text("torso", timeout=SLOW)
    expect(page.locator(".run.loading")).to_have_count(0, timeout=SLOW)
    return page


def wait_until_idle(page):
    """Wait until a change has been drawn."""
    expect(page.locator("#try-status")).to_contain_text("redrawn", timeout=SLOW)
    expect(page.locator(".busy")).to_have_count(0, timeout=SLOW)


def test_a_slider_redraws_and_the_last_position_wins(try_page):
    page = try_page
    before = [look(page, name) for name in ("signature", "range-time", "cadence")]
    page.evaluate(
        f"(values) => values.forEach((value) => ({DRAG})(['try-speed_mps', value]))", ["0.8", "1.0", "1.3", "1.6"]
    )
    assert page.input_value("#try-speed_mps-number") == "1.6"
    wait_until_idle(page)
    after = [look(page, name) for name in ("signature", "range-time", "cadence")]
    assert all(new != old for new, old in zip(after, before, strict=True))
    asked = [url.partition("speed_mps=")[2].partition("&")[0] for url in page.requested if "/api/scene" in url]
    assert asked[-1] == "1.6"
    assert len(asked) <= 3, "while one simulation ran, the positions between were not to be asked for"
    expect(page).to_have_url(re.compile("speed_mps=1.6"), timeout=SLOW)
    expect(page.locator("#features")).to_contain_text("torso")


def test_another_target_has_its_own_controls_and_an_example_fills_them(try_page):
    page = try_page
    page.select_option("#try-who", "dog")
    wait_until_idle(page)
    expect(page.locator("#try-height_m")).to_be_hidden()
    expect(page.locator("#try-withers_m")).to_be_visible()
    assert page.input_value("#try-speed_mps") == "2"
    page.get_by_role("button", name="person and dog side by side").click()
    expect(page.locator("#target option")).to_have_count(2, timeout=SLOW)
    assert page.input_value("#try-who") == "person"
    expect(page).to_have_url(re.compile("company=dog"), timeout=SLOW)


def test_the_scene_file_is_what_is_shown(try_page):
    page = try_page
    page.evaluate("() => { navigator.clipboard.writeText = () => Promise.reject(new Error('closed')); }")
    page.click("#try-copy")
    spec = parse_run(tomllib.loads(page.input_value("#try-toml")))
    assert spec.scene.duration_s == 2.0
    assert spec.scene.targets[0].range_m == 3.0
    assert spec.radar.prf_hz == 255.0


def test_a_mistake_stands_beside_the_form_and_goes(browser, serve):
    page = browser.new_page()  # the console of a page tells every answer 400
    page.goto(serve() + START + "&who=dog")
    expect(page.locator("#features")).to_contain_text("torso", timeout=SLOW)
    assert page.get_attribute("#try-range_m", "max") == "5"  # what this radar sees
    page.select_option("#try-gait", "gallop")
    assert page.input_value("#try-speed_mps-number") == "2.2"  # 2 m/s is no gallop
    assert page.get_attribute("#try-speed_mps", "min") == "2.2"
    page.fill("#try-speed_mps-number", "0.5")
    expect(page.locator("#try-status")).to_contain_text("2.17 to 6.26 m/s in a gallop", timeout=SLOW)
    expect(page.locator("#try-copy")).to_be_disabled()
    page.fill("#try-speed_mps-number", "3")
    expect(page.locator("#try-status")).to_contain_text("redrawn", timeout=SLOW)
    expect(page.locator("#try-copy")).to_be_enabled()
    page.fill("#try-speed_mps-number", "12")  # the slider goes to its end
    expect(page.locator("#try-status")).to_contain_text("'12' is not allowed", timeout=SLOW)
    page.fill("#try-speed_mps-number", "")  # empty is no number: not that end either
    page.wait_for_timeout(400)  # the address follows within 300 ms
    expect(page).to_have_url(re.compile("speed_mps=12"), timeout=SLOW)
    page.locator("#try-speed_mps-number").blur()
    assert page.input_value("#try-speed_mps-number") == "12"
    page.close()


def test_gate_and_target_of_a_recording_stay_with_it(browser, serve):
    page = browser.new_page()
    asked = []
    page.on("request", lambda request: asked.append(request.url))
    page.route("**/api/session", lambda route: route.fulfill(json={**route.fetch().json(), "kind": "recording"}))
    page.goto(serve() + START + "&gate=4:6&target=1&t=0.5&clutter=none&segment=0")
    expect(page.locator("#tab-recording")).to_have_attribute("aria-selected", "true")
    page.click("#tab-try")
    expect(page.locator("#features")).to_contain_text("torso", timeout=SLOW)
    names = {"gate", "target", "t", "clutter", "segment"}
    assert not names & set(parse_qs(urlsplit(page.url).query))
    runs = [parse_qs(urlsplit(url).query) for url in asked if "try=1" in url and "/api/targets" in url]
    assert runs
    assert not any("gate" in run or "target" in run for run in runs)
    page.close()


def test_a_tab_that_comes_late_leaves_the_next_one_alone(browser, serve):
    page = browser.new_page()
    page.route("**/api/session", lambda route: route.fulfill(json={**route.fetch().json(), "kind": "dataset"}))
    held = []
    page.route("**/dataset_page.js", lambda route: held.append(route))
    page.goto(serve() + START)
    page.click("#tab-try")
    expect(page.locator("#features")).to_contain_text("torso", timeout=SLOW)
    held[0].continue_()
    page.wait_for_timeout(500)
    expect(page.locator("#features")).to_contain_text("torso")
    page.close()


def test_the_sound_follows_the_cursor(try_page):
    page = try_page
    times = """() => new Promise((done) => requestAnimationFrame(() => setTimeout(() => {
      const audio = document.getElementById("sound-audio");
      done([audio.currentTime, Number(document.getElementById("time").textContent), audio.paused]);
    })))"""
    page.select_option("#speed", "0.5")
    page.click("#sound")
    page.wait_for_timeout(100)
    expect(page.locator("#sound")).not_to_have_attribute("aria-busy", "true", timeout=SLOW)
    page.click("#play")
    page.wait_for_timeout(1200)
    drifts = []
    for _ in range(5):
        page.wait_for_timeout(100)
        heard_s, cursor_s, paused = page.evaluate(times)
        assert not paused
        drifts.append(abs(heard_s - cursor_s))
    assert sorted(drifts)[2] < 0.05, drifts
    page.click("#play")
    page.evaluate(DRAG, ["scrub", "0.7"])
    heard_s, _, paused = page.evaluate(times)
    assert paused
    assert heard_s == pytest.approx(0.7, abs=0.05)
    assert any("/api/sound" in url for url in page.requested)
    page.select_option("#sound-pitch", "2")
    page.wait_for_timeout(100)
    assert "pitch=2" in [url for url in page.requested if "/api/sound" in url][-1]
