"""Streams of examples simulated on use, without disk."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy.typing as npt

from doppelgait.core.errors import ConfigError, DatasetError, DoppelgaitError, warn_caller
from doppelgait.dataset.config import PlanConfig, load_plan
from doppelgait.dataset.example import Example, label_arrays
from doppelgait.dataset.motions import expand_folders, list_labels
from doppelgait.dataset.plan import Plan, PlannedExample
from doppelgait.dataset.resolve import resolve_example
from doppelgait.dataset.rows import As, check_fields, make_picture, picture_format
from doppelgait.dataset.shard import BuildContext, build_planned
from doppelgait.dataset.shard_files import INDEX_NAMES, describe_fields
from doppelgait.processing.patches import Patch

if TYPE_CHECKING:
    from doppelgait.dataset.torch_data import TorchStream

MAX_FAILURES = 10
"""Number of consecutive failures after which a stream ends with an error, because the plan is then at fault."""


@dataclass(frozen=True)
class ExampleStream:
    """Endless examples of a plan, in number order; every iteration starts at the first number.

    Parameters
    ----------
    config : PlanConfig
        With its folders expanded.
    folder : Path
        Folder that relative motion paths start from.
    start, step : int
        First number, and step from one number to the next.
    """

    config: PlanConfig
    folder: Path
    start: int
    step: int = 1

    def __iter__(self) -> Iterator[Example]:
        return (example for _, example in self.iterate_numbered())

    def iterate_numbered(self) -> Iterator[tuple[int, Example]]:
        """Yield examples with their numbers; a scene of several targets gives one example each.

        An example that fails is left out with a :class:`DoppelgaitWarning`.

        Raises
        ------
        ConfigError
            If the plan samples a value that is not allowed.
        DatasetError
            If :data:`MAX_FAILURES` examples in a row fail.
        """
        number, size, failed = self.start, 1, 0
        context, facts = BuildContext(self.config, str(self.folder)), describe_fields(self.config.dataset.fields)
        while True:
            entries = [PlannedExample(number + n * self.step, 0, "", "", "", ()) for n in range(size)]
            for (number, *_), made in zip(entries, build_planned(entries, context), strict=True):
                if isinstance(made, Exception):
                    if isinstance(made, ConfigError) or not isinstance(made, DoppelgaitError):
                        raise made
                    failed += 1
                    if failed == MAX_FAILURES:
                        raise DatasetError(f"{failed} examples in a row failed, the last is number {number}: {made}")
                    warn_caller(f"example number {number} failed: {made}; left out")
                    continue
                failed = 0
                for row, arrays in made:
                    labelled = label_arrays(facts, row, arrays.get, carrier_hz=row["carrier_hz"])
                    row = {INDEX_NAMES.get(name, name): value for name, value in row.items()}
                    yield number, Example(row, labelled, partial(resolve_example, self.config, number, self.folder))
            number += self.step
            size = min(2 * size, context.batch_size)  # the first example is there soon

    def class_number(self, label: str) -> int:
        """Return a class's number in the plan's order."""
        labels = list_labels(self.config)
        if label not in labels:
            raise DatasetError(
                f"{label!r} is the label of a companion and no class of the plan; add a class of this name"
            )
        return labels.index(label)

    def part(self, number: int, count: int) -> ExampleStream:
        """Return the share of one of ``count`` workers; all shares together are this stream, without duplicates."""
        if not 0 <= number < count:
            raise DatasetError(f"worker: ({number}, {count}) is not allowed; it must be (k, n) with k from 0 to n - 1")
        return replace(self, start=self.start + number * self.step, step=self.step * count)

    def torch(
        self,
        fields: Sequence[str] = ("signature",),
        *,
        as_: As = "array",
        transform: Callable[[Any], Any] | None = None,
        target: Literal["label", "index"] = "label",
    ) -> TorchStream:
        """Return the stream as a ``torch.utils.data.IterableDataset``; the workers of a loader share its numbers.

        Items and other parameters are as those of :meth:`doppelgait.dataset.Dataset.torch`.

        Parameters
        ----------
        target : {"label", "index"}
            Number of the class in the order of the plan, or number of the example.

        Raises
        ------
        DatasetError
            If torch is not installed, or the plan does not keep a field, or it has no picture.
        """
        check_fields(fields, [spec.name for spec in self.config.dataset.fields], "fields: the plan")
        from doppelgait.dataset.torch_data import TorchStream, check_request

        check_request(fields, target)
        read = partial(self._read_arrays, tuple(fields), picture_format(as_, fields), target)
        return TorchStream(read, transform)

    def _read_arrays(
        self, fields: Sequence[str], patch: Patch | None, target: str, worker: int, workers: int
    ) -> Iterator[tuple[dict[str, npt.NDArray[Any]], int]]:
        for number, example in self.part(worker, workers).iterate_numbered():
            if patch is None:
                arrays = {name: example.arrays[name].values for name in fields}
            else:
                arrays = {name: make_picture(example.arrays.get(name), patch) for name in fields}
            yield arrays, number if target == "index" else self.class_number(example.label)


def stream_examples(
    plan: PlanConfig | Plan | str | Path,
    *,
    folder: Path | None = None,
    seed: int | None = None,
    worker: tuple[int, int] = (0, 1),
    start: int | None = None,
) -> ExampleStream:
    """Simulate a plan's examples on use, without end.

    The example of a number is the same as in the built dataset. By default the stream starts after
    the examples of the built dataset, so that it never contains the examples of a built test split.
    There the classes alternate. Subjects of motion recordings are repeated, however: use
    ``example.row["subject"]`` to leave out test subjects.

    Parameters
    ----------
    plan : PlanConfig, Plan, path or name
        A path is that of a plan file, a name that of a built-in plan.
    folder : Path, optional
        Folder that relative motion paths start from; that of the plan or the working folder by default.
    seed : int, optional
        Instead of the plan's.
    worker : (int, int)
        (k, n): the k-th of n equal shares.
    start : int, optional
        First number, 0 or larger; the first beyond the plan by default.

    Returns
    -------
    ExampleStream
        Its examples carry no split and no group.

    Raises
    ------
    ConfigError
        If the seed or a folder of the plan is not allowed.
    DatasetError
        If ``worker`` or ``start`` is not allowed, or a folder holds nothing usable.

    See Also
    --------
    build_dataset : build a dataset in a folder.

    Examples
    --------
    >>> import doppelgait as dg
    >>> stream = dg.dataset.stream_examples("home-alarm")
    >>> example = next(iter(stream))
    >>> example.row["label"]
    'human'
    """
    if isinstance(plan, str | Path):
        plan, plan_folder = load_plan(plan)
        folder = folder or plan_folder
    source = folder or (plan.folder if isinstance(plan, Plan) else Path())
    config = plan.config if isinstance(plan, Plan) else expand_folders(plan, source)
    if seed is not None:
        if seed < 0:
            raise ConfigError(f"seed: {seed} is not allowed; it must be 0 or larger")
        config = config.model_copy(update={"dataset": config.dataset.model_copy(update={"seed": seed})})
    first = config.count_examples() if start is None else start
    if first < 0:
        raise DatasetError(f"start: {first} is not allowed; it must be 0 or larger")
    return ExampleStream(config, source, first).part(*worker)
