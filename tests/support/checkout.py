"""Where the files of this checkout are, whatever folder a test is in."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SHARED = ROOT.parent / "shared"  # recordings that may not be redistributed
SUPPORT = ROOT / "tests" / "support"  # helper modules, importable by every test
