"""Run the commands as ``python -m doppelgait``."""

from doppelgait.cli.app import main

main()
