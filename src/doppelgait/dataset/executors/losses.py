"""Go on with what is missing where workers were lost, but not for ever."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from typing import TYPE_CHECKING

from doppelgait.core.errors import DatasetError

if TYPE_CHECKING:
    from doppelgait.dataset.executors import Results
    from doppelgait.dataset.plan import Shard

MAX_LOSSES = 5
"""Losses one after the other with no shard finished between."""


class WorkersLostError(Exception):
    """The workers are gone; what they were at is not finished."""


def with_new_workers(run: Callable[[Sequence[Shard]], Results], shards: Sequence[Shard]) -> Results:
    """Results of ``run``, which is called again for the shards that are missing when it loses its workers.

    Raises
    ------
    DatasetError
        After :data:`MAX_LOSSES` losses with no shard finished between.
    """
    left = {shard.name: shard for shard in shards}
    losses = 0
    while left:
        try:
            with closing(run(list(left.values()))) as results:
                for shard, record in results:
                    del left[shard.name]
                    losses = 0
                    yield shard, record
        except WorkersLostError:
            losses += 1
            if losses >= MAX_LOSSES:
                raise DatasetError(
                    f"workers died {losses} times with no shard finished between, {len(left)} are left; is the memory "
                    "full? Use fewer workers or smaller shards; what was built so far is kept"
                ) from None
