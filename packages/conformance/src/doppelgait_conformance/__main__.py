"""Measure this package's simulator: ``python -m doppelgait_conformance [--json]``."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict

from doppelgait.core.config import convert_to_json
from doppelgait.core.errors import ConfigError
from doppelgait_conformance import format_report, run_conformance


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table of figures and return the exit code.
    0 if all passed, 1 if one failed, 2 for wrong usage.
    """
    parser = argparse.ArgumentParser(prog="python -m doppelgait_conformance", description=main.__doc__)
    parser.add_argument("--json", action="store_true", help="a list of checks in JSON instead of a table")
    parser.add_argument("--only", action="append", metavar="CHECK", help="this check alone (may be repeated)")
    options = parser.parse_args(arguments)
    try:
        checks = run_conformance(only=options.only)
    except ConfigError as error:
        print(f"error: {error}", file=sys.stderr)
        return error.exit_code
    print(
        json.dumps([convert_to_json(asdict(check)) for check in checks], indent=1)
        if options.json
        else format_report(checks)
    )
    return int(any(check.passed is False for check in checks))


if __name__ == "__main__":
    sys.exit(main())
