"""The page of a recording in a browser: how tests open it, read it, and change what the server answers."""

import json
import re
import time
from collections.abc import Callable
from typing import Any
from urllib.parse import parse_qs, urlsplit

from doppelgait.viewer.payload import ALIGNMENT, MAGIC, as_json

DURATION_S = 2.5
WALK = {
    "seed": 7,
    "duration_s": DURATION_S,
    "radar_position_m": [0.0, 0.0, 1.0],
    "radar": {"preset": "x4", "prf_hz": 800},
    "noise": {"kind": "snr", "snr_db": 25},
    "targets": [{"label": "human", "motion": {"kind": "boulic", "speed_mps": 1.2}, "range_m": 4.0, "aspect_deg": 0}],
}
LEFT, RIGHT, TOP = 58, 58, 4
"""Margins of the charts in pixels; below, 36, or 10 where the numbers of the axis stand under the next picture."""
READY = ".run:not(.loading)"
# colours counted and summed up: two pictures are the same if both numbers are
LOOK = """(id) => {
  const canvas = document.getElementById(id);
  const pixels = new Uint32Array(canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data.buffer);
  let hash = 0;
  for (const pixel of pixels) hash = (Math.imul(hash, 31) + pixel) | 0;
  return [hash, new Set(pixels).size];
}"""


def opened(page: Any, url: str, query: str = "") -> Any:
    page.goto(url + query)
    page.wait_for_selector(READY)
    until(lambda: look(page, "range-doppler")[1] > 20, "no range-Doppler picture")
    return page


def look(page: Any, name: str) -> tuple[int, int]:
    """Fingerprint of a canvas and how many colours are in it."""
    hashed, colours = page.evaluate(LOOK, f"canvas-{name}")
    return hashed, colours


def until(condition: Callable[[], bool], otherwise: str, *, seconds: float = 8.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, otherwise
        time.sleep(0.03)


def address(page: Any) -> str:
    """Address as it is now; the driver's own copy lags behind while a test only waits."""
    return str(page.evaluate("location.href"))


def wait_until_idle(page: Any, name: str) -> tuple[int, int]:
    """Fingerprint of a canvas once it stays the same for a while."""
    seen = [look(page, name)]
    while len(seen) < 4 or len(set(seen[-4:])) > 1:
        time.sleep(0.05)
        seen.append(look(page, name))
        assert len(seen) < 100, f"{name} does not come to rest"
    return seen[-1]


def text(page: Any, selector: str) -> str:
    return str(page.text_content(selector)).replace("\N{MINUS SIGN}", "-")


def seconds(page: Any) -> float:
    return float(text(page, "#time"))


def read_at(page: Any, name: str, x: float, y: float) -> tuple[dict[str, float], tuple[float, float]]:
    """Numbers of a panel's read-out by unit, with the mouse at shares of its axes; and these shares, to the pixel."""
    box = page.locator(f"#canvas-{name}").bounding_box()
    width, height = (
        box["width"] - LEFT - RIGHT,
        box["height"] - TOP - (10 if name in ("range-time", "cadence") else 36),
    )
    at_x, at_y = round(x * width), round(y * height)
    page.mouse.move(box["x"] + LEFT + at_x, box["y"] + TOP + height - at_y)
    found = re.findall(r"(-?[\d.]+) (dB|Hz|m/s|m|s)\b", text(page, f"#hover-{name}"))
    return {unit: float(number) for number, unit in reversed(found)}, (at_x / width, at_y / height)


def altered(page: Any, name: str, change: Callable[[dict[str, Any], dict[str, list[str]]], None]) -> None:
    """Let ``change(facts, query)`` alter the facts of a payload on its way to the page; the server is asked for the
    opened recording as it shows it first."""

    def answer(route: Any) -> None:
        address = route.request.url
        response = route.fetch(url=address.split("?")[0])
        body = response.body()
        end = 8 + int.from_bytes(body[4:8], "little")
        facts = json.loads(body[8:end])
        change(facts, parse_qs(urlsplit(address).query))
        header = as_json(facts)
        header += b" " * (-len(header) % ALIGNMENT)
        route.fulfill(response=response, body=MAGIC + len(header).to_bytes(4, "little") + header + body[end:])

    page.route(f"**/api/{name}*", answer)
