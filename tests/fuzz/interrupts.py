"""Interrupt every long command at random moments and print how they ended.

python tests/fuzz/interrupts.py [CASES OF EACH KIND] [KIND ...]
"""

import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))

from interrupted import KINDS, interrupt_often

if __name__ == "__main__":
    count, kinds = int((sys.argv[1:2] or ["30"])[0]), sys.argv[2:] or KINDS
    wrong = 0
    with tempfile.TemporaryDirectory() as folder:
        for kind in kinds:
            found = interrupt_often(kind, Path(folder), count, seed=24)
            print(
                f"{kind}: {dict(found.statuses)}, longest {found.longest_s:.1f} s, {len(found.tracebacks)} tracebacks, "
                f"{'resumed' if found.resumed else 'NOT RESUMED'}",
                flush=True,
            )
            for text in found.tracebacks[:2]:
                print(text)
            wrong += len(found.tracebacks) + (not found.resumed) + (found.longest_s > 10.0)
            wrong += sum(n for status, n in found.statuses.items() if status not in (0, 130))
    sys.exit(wrong > 0)
