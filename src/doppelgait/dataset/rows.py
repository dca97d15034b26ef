"""Rows of an index: queries that run no code, orders, weights and pictures for training."""

from __future__ import annotations

import ast
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr

from doppelgait.core.errors import DatasetError
from doppelgait.core.rng import Streams
from doppelgait.dataset.config import suggest_names
from doppelgait.dataset.shard_files import MAX_OPEN
from doppelgait.processing.patches import Levels, Patch
from doppelgait.processing.patches import patch as draw_patch

Array = npt.NDArray[Any]
As = Literal["array", "picture"] | Patch
"""Form of the arrays: stored arrays, or pictures of the default or of another format."""


@dataclass(frozen=True, eq=False)
class LabelledArrays:
    """Arrays of examples; unpacks as ``values, y, groups``.

    Parameters
    ----------
    values : ndarray, shape (n, ...), or list of ndarray
        Values of the rows; a list if their shapes differ.
    y : ndarray of str, shape (n,)
        Labels.
    groups : ndarray of str, shape (n,)
        Group of each row. Rows of a group share a subject or a scene: keep each group in one fold.
    ids : ndarray of str, shape (n,)
    """

    values: Array | list[Array]
    y: npt.NDArray[np.str_]
    groups: npt.NDArray[np.str_]
    ids: npt.NDArray[np.str_]

    def __iter__(self) -> Iterator[Array | list[Array]]:
        """Iterate over values, y and groups, in this order."""
        return iter((self.values, self.y, self.groups))

    def __len__(self) -> int:
        return len(self.y)


def make_picture(signature: xr.DataArray | None, patch: Patch) -> Levels:
    """Convert the middle of a signature to levels from 0 to 1, (n_velocity, n_time)."""
    if signature is None or signature.sizes["time"] < 2:
        return np.zeros((patch.n_velocity, patch.n_time), dtype=np.float32)
    return draw_patch(signature, patch)


def check_fields(fields: Sequence[str], kept: Collection[str], owner: str) -> None:
    """Raise a :class:`DatasetError` if ``owner`` does not keep a field."""
    for name in fields:
        if name not in kept:
            raise DatasetError(f"{owner} keeps no {name!r}; it keeps {', '.join(kept) or 'no arrays'}")


def picture_format(as_: As, fields: Sequence[str]) -> Patch | None:
    """Return the format of the pictures, None for arrays."""
    if as_ == "array":
        return None
    if not (as_ == "picture" or isinstance(as_, Patch)):
        raise DatasetError(f"as_: {as_!r} is not allowed; it must be 'array', 'picture' or a doppelgait.classify.Patch")
    for name in fields:
        if name != "signature":
            raise DatasetError(f"as_: only the field signature has a picture; read {name} with as_='array'")
    return as_ if isinstance(as_, Patch) else Patch()


POOL_SHARDS = MAX_OPEN // 2  # number of shards that are shuffled together


def shuffled_rows(index: pd.DataFrame, rng: np.random.Generator) -> npt.NDArray[np.int64]:
    """Shuffle rows so that shard files open once."""
    # rows of a few shards at a time are shuffled together, so that files open once
    codes, shards = pd.factorize(index["shard"])
    place_of_shard = rng.permutation(len(shards))
    pool = place_of_shard[codes] // POOL_SHARDS
    order = rng.permutation(len(index))
    return order[np.argsort(pool[order], kind="stable")]


def epoch_rows(index: pd.DataFrame, seed: int | None, epoch: int, worker: int, workers: int) -> npt.NDArray[np.int64]:
    """Return the rows of one worker in one epoch, each once."""
    rows = np.arange(len(index))
    if seed is not None:
        rows = shuffled_rows(index, Streams(seed, epoch).generator("batches"))
    return rows[worker::workers]


MAX_LENGTH = 10_000
LOGIC = (ast.And, ast.Or, ast.BitAnd, ast.BitOr, ast.Not, ast.Invert)
ARITHMETIC = (ast.Add, ast.Sub, ast.Mult, ast.Div, ast.USub)
COMPARISONS = (ast.Eq, ast.NotEq, ast.Lt, ast.LtE, ast.Gt, ast.GtE, ast.In, ast.NotIn)
EXPRESSIONS = (ast.Name, ast.Load, ast.Compare, ast.BoolOp, ast.BinOp, ast.UnaryOp)
ALLOWED = (
    "allowed are columns, numbers, texts, lists, comparisons (== != < <= > >= in, not in), + - * "
    "/, and, or, not, & | ~ and brackets"
)


def select_rows(index: pd.DataFrame, query: str) -> npt.NDArray[np.bool_]:
    """Mark the rows that fulfil a query."""
    try:
        if len(query) > MAX_LENGTH:
            raise ValueError(f"has {len(query)} characters, allowed are {MAX_LENGTH}")
        tree = ast.parse(query.strip(), mode="eval").body
        _check_query(tree, index)
        found = index.eval(ast.unparse(_Words().visit(tree)), engine="python")
    except DatasetError as error:
        raise DatasetError(f"select {query!r}: {error}") from None
    except SyntaxError as error:
        raise DatasetError(f"select {query[:200]!r}: is no query: {error.msg}; {ALLOWED}") from None
    except (ValueError, TypeError, ArithmeticError, RecursionError, MemoryError, NotImplementedError) as error:
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise DatasetError(f"select {query[:200]!r}: is no query: {reason}") from None
    if not (isinstance(found, pd.Series) and pd.api.types.is_bool_dtype(found)):
        raise DatasetError(f'select {query!r}: is no condition; compare columns, as in "snr_frame_db > 10"')
    return np.asarray(found.fillna(False).to_numpy(dtype=bool))


class _Words(ast.NodeTransformer):
    """``and`` and ``or`` for ``&`` and ``|``, which pandas reads with their precedence."""

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        self.generic_visit(node)
        words = {ast.BitAnd: ast.And, ast.BitOr: ast.Or}.get(type(node.op))
        return node if words is None else ast.BoolOp(words(), [node.left, node.right])


def _is_value(node: ast.expr) -> bool:
    return isinstance(node.operand if isinstance(node, ast.UnaryOp) else node, ast.Constant)


def _is_condition(node: ast.expr, index: pd.DataFrame) -> bool:
    match node:
        case ast.Name(id=name):
            return name not in index.columns or pd.api.types.is_bool_dtype(index[name])
        case ast.UnaryOp(op=sign) | ast.BinOp(op=sign):
            return isinstance(sign, LOGIC)
    return isinstance(node, ast.Compare | ast.BoolOp)


def _check_query(tree: ast.expr, index: pd.DataFrame) -> None:
    """Refuse everything but columns, plain values and their operators, so that pandas runs no code."""
    for node in ast.walk(tree):
        match node:
            case ast.Name(id=name) if name not in index.columns:
                raise DatasetError(f"no column {name!r}{suggest_names(name, map(str, index.columns))}")
            case ast.Compare(left=left, ops=signs, comparators=parts):
                lists = [isinstance(part, ast.List | ast.Tuple) for part in (left, *parts)]
                if lists != [False, *(isinstance(sign, ast.In | ast.NotIn) for sign in signs)]:
                    raise DatasetError("in needs a column before it and a list of values behind it")
            case ast.BinOp(op=sign) | ast.UnaryOp(op=sign) if isinstance(sign, ARITHMETIC):
                for part in ast.iter_child_nodes(node):
                    if isinstance(part, ast.Name) and not pd.api.types.is_numeric_dtype(index.get(part.id, [])):
                        raise DatasetError(f"{part.id!r} is no number")
                    if isinstance(part, ast.List | ast.Tuple) or isinstance(getattr(part, "value", 0), str):
                        raise DatasetError(f"{ast.unparse(part)[:60]!r} is no number")
            case ast.List(elts=parts) | ast.Tuple(elts=parts) if all(map(_is_value, parts)):
                pass
            case ast.BoolOp(values=parts) if not all(_is_condition(part, index) for part in parts):
                raise DatasetError("and, or need a condition on both sides")
            case ast.BinOp(left=left, op=ast.BitAnd() | ast.BitOr(), right=right) if not (
                _is_condition(left, index) and _is_condition(right, index)
            ):
                raise DatasetError("&, | need a condition on both sides, in brackets")
            case ast.UnaryOp(op=ast.Not() | ast.Invert(), operand=part) if not _is_condition(part, index):
                raise DatasetError("not, ~ need a condition")
            case ast.Constant(value=bool() | int() | float() | str()):
                pass
            case _ if not isinstance(node, (*EXPRESSIONS, *COMPARISONS, *ARITHMETIC, *LOGIC)):
                words = ast.unparse(node)[:60] or type(node).__name__
                raise DatasetError(f"{words!r} is not allowed; {ALLOWED}")
