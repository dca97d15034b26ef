"""The command line as a page, from the typer application itself."""

from __future__ import annotations

import inspect
import types
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal, Union, get_args, get_origin

import typer
from typer.models import ArgumentInfo, OptionInfo

KINDS = {Path: "path", str: "text", int: "integer", float: "number"}


def commands(app: typer.Typer, prefix: str = "doppelgait") -> Iterator[tuple[str, Callable[..., Any]]]:
    """Full name and function of every command."""
    for command in app.registered_commands:
        function = command.callback
        if function is not None and not command.hidden:
            yield f"{prefix} {command.name or function.__name__.replace('_', '-')}", function
    for group in app.registered_groups:
        if group.typer_instance is not None and not group.hidden:
            yield from commands(group.typer_instance, f"{prefix} {group.name}")


def commands_page(app: typer.Typer, others: dict[str, Callable[..., Any]]) -> str:
    """Markdown of all commands: what each does, its examples, arguments and options."""
    lines = ["# Command line", "", "Made from the program; `doppelgait COMMAND --help` says the same.", ""]
    callback = app.registered_callback
    if callback is not None and callback.callback is not None:
        lines += ["## doppelgait", "", str(app.info.help or ""), "", *_options(callback.callback)]
    for name, function in sorted([*commands(app), *((f"doppelgait {n}", f) for n, f in others.items())]):
        lines += [f"## {name}", "", f"    {_usage(name, function)}", "", *_words(function), *_options(function)]
    return "\n".join(lines) + "\n"


def _words(function: Callable[..., Any]) -> list[str]:
    """Read the docstring, its examples as code."""
    lines: list[str] = []
    for paragraph in inspect.cleandoc(function.__doc__ or "").split("\n\n"):
        text = " ".join(paragraph.split())
        lines += [f"    {text.removeprefix('Example: ')}" if text.startswith("Example: ") else _safe(text), ""]
    return lines


def _parameters(function: Callable[..., Any]) -> Iterator[tuple[str, Any, OptionInfo | ArgumentInfo, Any]]:
    """Name, type, declaration and default of every parameter that the command line has."""
    for name, parameter in inspect.signature(function, eval_str=True).parameters.items():
        kind, *declared = get_args(parameter.annotation)
        if declared and isinstance(declared[0], OptionInfo | ArgumentInfo):
            yield name, kind, declared[0], parameter.default


def _usage(name: str, function: Callable[..., Any]) -> str:
    """Write the command with its arguments and required options."""
    words = [name]
    for key, kind, declared, default in _parameters(function):
        if isinstance(declared, ArgumentInfo):
            word = (declared.metavar or key.strip("_")).upper() + (" ..." if get_origin(kind) is list else "")
            words.append(word if default is inspect.Parameter.empty else f"[{word}]")
        elif default is inspect.Parameter.empty:
            words.append(f"{_flags(key, declared)[-1]} {_kind(kind).upper()}")
    return " ".join([*words, "[OPTIONS]"])


def _options(function: Callable[..., Any]) -> list[str]:
    """Table of arguments and options."""
    rows = []
    for key, kind, declared, default in _parameters(function):
        if isinstance(declared, ArgumentInfo):
            names = f"`{(declared.metavar or key.strip('_')).upper()}`"
        else:
            names = ", ".join(f"`{flag}`" for flag in _flags(key, declared))
        rows.append(f"| {names} | {_kind(kind)} | {_default(default)} | {_safe(declared.help or '')} |")
    if not rows:
        return []
    return ["| argument or option | takes | default | |", "| --- | --- | --- | --- |", *rows, ""]


def _flags(key: str, declared: OptionInfo) -> list[str]:
    """Names of an option; where it is declared inside ``Annotated`` the first of them is kept as a default."""
    named = [name for name in (declared.default, *(declared.param_decls or ())) if isinstance(name, str)]
    return [name for name in named if name.startswith("-")] or [f"--{key.replace('_', '-')}"]


def _kind(kind: Any) -> str:
    """Name the kind of a value; nothing for a switch."""
    members = [member for member in get_args(kind) if member is not type(None)]
    if get_origin(kind) in (Union, types.UnionType):
        return " or ".join(dict.fromkeys(_kind(member) for member in members))
    if get_origin(kind) is Literal:
        return ", ".join(f"`{member}`" for member in members)
    if get_origin(kind) is list:
        return f"{_kind(members[0])}, repeatable"
    if get_origin(kind) is tuple:
        return ", ".join(_kind(member) for member in members)
    return "" if kind is bool else KINDS.get(kind, getattr(kind, "__name__", str(kind)))


def _default(value: Any) -> str:
    if value is inspect.Parameter.empty:
        return "required"
    return "" if value in (None, False) or value == [] else f"`{value}`"


def _safe(text: str) -> str:
    """Text that Markdown leaves as it is."""
    for sign in "\\|<*_{":
        text = text.replace(sign, f"\\{sign}")
    return " ".join(text.split())
