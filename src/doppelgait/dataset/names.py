"""Labels and subjects from the names of files and folders."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from doppelgait.core.errors import ConfigError, warn_caller
from doppelgait.dataset.config import list_some
from doppelgait.dataset.labels import LABEL, LabelEntry, read_labels
from doppelgait.processing.gate import GateChoice

PARTS = ("label", "subject", "session")
TOKEN = re.compile(r"\{(\w+)\}|(\*\*/)|(\*)")
SHOWN = 8


@dataclass(frozen=True)
class NameForm:
    """File name template of a published set."""

    template: str
    labels: Mapping[str, str] = field(default_factory=dict)
    citation: str = ""
    licence: str = ""


NAME_FORMS = {
    "glasgow": NameForm(
        "**/{label}P{subject}A*R*.dat",
        {"1": "walking", "2": "sitting down", "3": "standing up", "4": "picking up", "5": "drinking", "6": "falling"},
        "Fioranelli, F., Shah, S. A., Li, H., Shrestha, A., Yang, S., Le Kernec, J. (2019) Radar signatures of human "
        "activities. University of Glasgow. DOI 10.5525/gla.researchdata.848",
    )
}
"""Templates of published sets by name; the six activities are from the description of the set."""


def read_names(folder: str | Path, names: str, *, gate: GateChoice = "track") -> list[LabelEntry]:
    """Read labels and subjects from file names."""
    source = Path(folder)
    if not source.is_dir():
        raise ConfigError(f"{source}: no such folder of recordings")
    form = NAME_FORMS.get(names) or NameForm(names)
    pattern, suffix = _compile(names, form.template), Path(form.template).suffix
    files = (path for path in source.rglob("*") if path.is_file() and path.name.endswith(suffix))
    paths = sorted(path.relative_to(source).as_posix() for path in files)
    entries: list[LabelEntry] = []
    unfit, unknown = [], []
    for path in paths:
        found = pattern.fullmatch(path)
        if found is None:
            unfit.append(path)
            continue
        parts = found.groupdict()
        label = form.labels.get(parts["label"], "" if form.labels else parts["label"])
        if not LABEL.fullmatch(label):
            unknown.append(f"{path} ({parts['label']!r})")
            continue
        entries.append(
            LabelEntry(
                len(entries) + 1,
                path,
                label,
                gate,
                subject=parts.get("subject") or "",
                session=parts.get("session") or "",
                citation=form.citation,
                licence=form.licence,
            )
        )
    if unknown:
        allowed = (
            ", ".join(f"{code} ({label})" for code, label in form.labels.items())
            or "letters, digits, spaces, _ . and -; rename it, or write a file of labels"
        )
        raise ConfigError(f"{source}: {list_some(unknown, SHOWN)}: is no label; allowed are {allowed}")
    if not entries:
        seen = f"{len(unfit)} files end in {suffix!r}, the first is {unfit[0]}" if unfit else f"none ends in {suffix!r}"
        raise ConfigError(f"{source}: no file fits {form.template}: {seen}")
    if unfit:
        warn_caller(
            f"{source}: {len(unfit)} files do not fit {form.template} and are left out: {list_some(unfit, SHOWN)}"
        )
    return entries


def label_entries(
    folder: Path,
    labels: Path | None,
    names: str | None,
    classes: Sequence[str],
    *,
    gate: GateChoice,
    options: Mapping[str, Any] | None = None,
) -> Path | list[LabelEntry]:
    """Choose labels of files or names, with classes."""
    if labels is not None and names is None and not (classes or options):
        return labels
    if (labels is None) == (names is None):
        raise ConfigError("set --labels, or set --names if the file names contain the labels")
    entries = (
        read_labels(labels, folder, gate=gate) if labels is not None else read_names(folder, names or "", gate=gate)
    )
    return [replace(one, options={**(options or {}), **one.options}) for one in relabel(entries, classes)]


def relabel(entries: Sequence[LabelEntry], classes: Sequence[str]) -> list[LabelEntry]:
    """Rename labels, or leave their recordings out."""
    labels = list(dict.fromkeys(entry.label for entry in entries))
    there = f"the labels are {', '.join(labels)}"
    renamed: dict[str, str] = {}
    for text in classes:
        old, sign, new = (part.strip() for part in text.partition("="))
        if not sign or not old or (new and not LABEL.fullmatch(new)):
            raise ConfigError(
                f"--label {text!r} is not allowed; it must be LABEL=CLASS, with nothing after = to leave out"
            )
        fitting = [label for label in labels if fnmatchcase(label, old)]
        if not fitting:
            raise ConfigError(f"--label {text!r}: fits no label; {there}")
        renamed = {**dict.fromkeys(fitting, new), **renamed}
    left = [replace(entry, label=renamed.get(entry.label, entry.label)) for entry in entries]
    if not any(entry.label for entry in left):
        raise ConfigError(f"--label {', '.join(classes)}: leaves out every recording; {there}")
    return [entry for entry in left if entry.label]


def _compile(names: str, template: str) -> re.Pattern[str]:
    known = f"known are {', '.join(NAME_FORMS)}, or a template such as {{label}}/{{subject}}_*.png"
    parts = [match[1] for match in TOKEN.finditer(template) if match[1]]
    if "label" not in parts:
        raise ConfigError(f"--names {names!r} is not allowed: it has no {{label}}; {known}")
    if wrong := [part for part in parts if part not in PARTS or parts.count(part) > 1]:
        raise ConfigError(
            f"--names {names!r} is not allowed: {{{wrong[0]}}} must be one of {', '.join(PARTS)}, each once; {known}"
        )
    text, end = "", 0
    for match in TOKEN.finditer(template):
        text += re.escape(template[end : match.start()])
        text += f"(?P<{match[1]}>[^/]+?)" if match[1] else "(?:.*/)?" if match[2] else "[^/]*"
        end = match.end()
    return re.compile(text + re.escape(template[end:]))
