"""Run the commands as ``python -m doppelgait``."""

from doppelgait.cli import main

main()
