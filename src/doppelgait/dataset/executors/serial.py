"""Shards one after the other in this process."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from doppelgait.dataset.executors import Results, Work
    from doppelgait.dataset.plan import Shard


def run_serial(work: Work, shards: Sequence[Shard]) -> Results:
    """Results in the order of the shards."""
    for shard in shards:
        yield shard, work(shard)
