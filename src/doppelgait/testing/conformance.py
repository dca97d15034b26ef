"""Pointer to the conformance suite, which is a package of its own: ``doppelgait_conformance``."""

import runpy
import sys
from importlib.util import find_spec

if __name__ == "__main__":
    if find_spec("doppelgait_conformance") is None:
        sys.exit(
            "error: the conformance suite is the package doppelgait-conformance, which is not installed; install it "
            "from the sources of doppelgait with pip install packages/conformance"
        )
    runpy.run_module("doppelgait_conformance", run_name="__main__", alter_sys=True)
