"""Measure this package's simulator: ``python -m doppelgait_conformance [--json]``."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from doppelgait import ConfigError
from doppelgait_conformance import Check, format_report, run_conformance


def _convert(check: Check) -> dict[str, Any]:
    """Convert a check for JSON: numbers that are not finite are null."""
    values = asdict(check).items()
    return {name: None if isinstance(value, float) and not math.isfinite(value) else value for name, value in values}


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table of figures and return the exit code: 1 if one failed, 2 for wrong usage."""
    parser = argparse.ArgumentParser(prog="python -m doppelgait_conformance", description=main.__doc__)
    parser.add_argument("--json", action="store_true", help="a list of checks in JSON instead of a table")
    parser.add_argument("--only", action="append", metavar="CHECK", help="this check alone (may be repeated)")
    options = parser.parse_args(arguments)
    try:
        checks = run_conformance(only=options.only)
    except ConfigError as error:
        print(f"error: {error}", file=sys.stderr)
        return error.exit_code
    print(json.dumps([_convert(check) for check in checks], indent=1) if options.json else format_report(checks))
    return int(any(check.passed is False for check in checks))


if __name__ == "__main__":
    sys.exit(main())
