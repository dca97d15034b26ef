"""The command ``doppelgait`` and its error handling.

Heavy imports happen inside the commands.
"""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from doppelgait import __version__
from doppelgait.cli import (
    analyze,
    classify,
    dataset,
    keys,
    listen,
    live,
    model,
    motion,
    radar,
    simulate,
    view,
)
from doppelgait.cli.output import print_message, show_warnings_plainly
from doppelgait.core.errors import ConfigError, DoppelgaitError, explain_memory
from doppelgait.core.interrupt import Stop


class _Commands(TyperGroup):
    """Commands with errors of options in plain words."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except typer.BadParameter as error:
            from doppelgait.core.config import reword_fault

            error.message = reword_fault(error.message)
            raise

    def list_commands(self, ctx: Any) -> list[str]:
        return list(dict.fromkeys([*super().list_commands(ctx), *sorted(load_commands())]))

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        command = super().get_command(ctx, cmd_name)
        if command is not None:
            return command
        function = load_commands().get(cmd_name)
        if function is None and cmd_name in PACKAGES:
            package, folder = PACKAGES[cmd_name]
            raise ConfigError(
                f"the command {cmd_name!r} is in the package {package}, which is not installed; install it from the "
                f"sources of doppelgait with pip install {folder}"
            )
        if function is None:
            return None
        alone = typer.Typer(add_completion=False, rich_markup_mode=None)
        alone.command(cmd_name)(function)
        return typer.main.get_command(alone)


PACKAGES = {"reproduce": ("doppelgait-liland2018", "packages/liland2018")}
"""Package and folder of the commands that are not part of the wheel."""


def load_commands() -> dict[str, Callable[..., Any]]:
    """Load the commands of other packages, entry points of the group ``doppelgait.commands``."""
    from importlib.metadata import entry_points

    functions = {}
    for entry in entry_points(group="doppelgait.commands"):
        try:
            functions[entry.name] = entry.load()
        except Exception as error:
            print_message(f"warning: the command {entry.name!r} ({entry.value}) cannot be loaded: {error}")
    return functions


app = typer.Typer(
    cls=_Commands,
    name="doppelgait",
    help="Labelled micro-Doppler radar data of people and dogs, from motion capture or gait models.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.add_typer(motion.app, name="motion")
app.add_typer(dataset.app, name="dataset")
app.add_typer(radar.app, name="radar")
app.add_typer(model.app, name="model")
dataset.app.command("import")(dataset.import_recordings)
command: Callable[..., None]
for command in (dataset.status, dataset.verify, dataset.card, dataset.export, dataset.forms):
    dataset.app.command()(command)
app.command("demo")(simulate.run_demo)
for command in (simulate.simulate, analyze.analyze, classify.evaluate, classify.classify, model.benchmark, live.live):
    app.command()(command)
for command in (view.view, listen.listen, keys.keys, keys.plugins, keys.fetch):
    app.command()(command)

_debug = False


def _print_version(wanted: bool) -> None:
    if wanted:
        print(__version__)
        raise typer.Exit


@app.callback()
def options(
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
    version: Annotated[
        bool, typer.Option("--version", help="Print the version.", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    """Set the options that apply to every command."""
    global _debug
    _debug = debug


def main() -> None:
    """Run the command line."""
    try:
        gc.set_threshold(5000)
        show_warnings_plainly()
        explain_memory(app)()
    except KeyboardInterrupt as stop:
        print_message(f"\n{stop}" if str(stop) else "\nstopped")
        sys.exit(130)
    except Exception as error:
        if Stop.came:  # a library reported the interruption as an error
            print_message("\nstopped")
            sys.exit(130)
        if isinstance(error, BrokenPipeError):
            sys.stderr.close()
            sys.exit(1)
        if _debug or not isinstance(error, DoppelgaitError):
            raise
        print_message(f"error: {error}")
        sys.exit(error.exit_code)
