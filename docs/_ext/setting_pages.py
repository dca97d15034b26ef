"""Every key of every configuration file as tables, from the models that check these files."""

from __future__ import annotations

import re

from pydantic import BaseModel

from doppelgait.cli.topics import TOPICS, models_of
from doppelgait.core.keys import Key, list_keys

Group = tuple[str, str, list[tuple[str, type[BaseModel]]]]
"""Title, words, and the tables of a page: heading and model."""


def groups() -> dict[str, Group]:
    """List the pages: keys that a user may write, by file."""
    words = {
        "scene": SCENE_WORDS, "motion": MOTION_WORDS, "radar": RADAR_WORDS, "surroundings": LIST_WORDS,
        "analysis": ANALYSIS_WORDS, "plan": PLAN_WORDS, "files": FILE_WORDS,
    }  # fmt: skip
    return {name: (title, words[name], models_of(name)) for name, title in TOPICS.items()}


SCENE_WORDS = (
    "A scene file is TOML: the keys of `Scene` and `seed` at its top, the tables `[radar]`, `[noise]` and "
    "`[analysis]`, and the lists `[[targets]]`, `[[environment]]` and `[[impairments]]`. `prf_hz = 'auto'` and "
    "`preset` may stand in `[radar]`."
)
MOTION_WORDS = (
    "`motion = { kind = 'NAME', ... }` of a target takes the keys of that model; `kind = 'file'` takes `path` and the "
    "arguments of {py:func}`doppelgait.motion.read`. `path = { kind = 'NAME', ... }` takes those of a path."
)
RADAR_WORDS = "`[radar]`: all of these, or `preset = 'NAME'` and what differs from it."
LIST_WORDS = (
    "Entries of `[[environment]]` and `[[impairments]]`; each names its `kind` and acts in the order of the list."
)
ANALYSIS_WORDS = (
    "`[analysis]` of a scene file or plan, `--set KEY=VALUE` of `doppelgait analyze`; what belongs to `--gate track` "
    "has the prefix `tracking.`, for example `--set tracking.detector.pfa=1e-4`."
)
PLAN_WORDS = (
    "A plan is TOML. Every value of its tables `scene`, `target`, `radar`, `noise`, `analysis` and of its lists may be "
    "a distribution ([datasets](../../datasets.md)); keys there are those of a scene file. The arguments of `dataset "
    "import` are last."
)
FILE_WORDS = (
    "The TOML file next to an `.npz` or `.npy` recording (each key is also an `--option`) or to the `.bin` of a "
    "DCA1000, and `picture.toml` of pictures of spectrograms."
)


def settings_page(title: str, words: str, models: list[tuple[str, type[BaseModel]]]) -> str:
    """Markdown of one page."""
    lines = [f"# {title}", "", words, ""]
    for heading, model in models:
        lines += [f"## {heading}", "", _summary(model), "", "| key | type | unit | default | limits | |",
                  "| --- | --- | --- | --- | --- | --- |"]  # fmt: skip
        lines += [_row(key) for key in list_keys(model)]
        lines.append("")
    return "\n".join(lines) + "\n"


def _summary(model: type[BaseModel]) -> str:
    return _markdown(" ".join((model.__doc__ or "").split("\n\n")[0].split()))


def _row(key: Key) -> str:
    cells = [f"`{key.key}`", *key[1:5], _markdown(key.description)]
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _markdown(text: str) -> str:
    """Turn reStructuredText of docstrings into Markdown."""
    text = re.sub(r":(\w+):`~?([^`]*)`", r"{py:\1}`\2`", " ".join(text.split()))
    text = re.sub(r"\{py:math\}`([^`]*)`", r"$\1$", text)
    return text.replace("``", "`")
