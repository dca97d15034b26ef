"""Queries of the index that run no code."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable
from functools import reduce
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from doppelgait.core.errors import DatasetError
from doppelgait.dataset.example import suggest_names

MAX_LENGTH = 10_000
COMPARISONS: dict[type[ast.cmpop], Callable[[Any, Any], Any]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}
ARITHMETIC: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}
ALLOWED = (
    "allowed are columns, numbers, texts, lists, comparisons (== != < <= > >= in, not in), + - * /, and, or, not, "
    "& | ~ and brackets"
)


def select_rows(index: pd.DataFrame, query: str) -> npt.NDArray[np.bool_]:
    """Mark the rows that fulfil a query."""
    try:
        if len(query) > MAX_LENGTH:
            raise ValueError(f"has {len(query)} characters, allowed are {MAX_LENGTH}")
        found = _evaluate_value(ast.parse(query.strip(), mode="eval").body, index)
    except DatasetError as error:
        raise DatasetError(f"select {query!r}: {error}") from None
    except SyntaxError as error:
        raise DatasetError(f"select {query[:200]!r}: is no query: {error.msg}; {ALLOWED}") from None
    except (ValueError, TypeError, ArithmeticError, RecursionError, MemoryError) as error:
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise DatasetError(f"select {query[:200]!r}: is no query: {reason}") from None
    if not _is_condition(found):
        raise DatasetError(f'select {query!r}: is no condition; compare columns, as in "snr_frame_db > 10"')
    return np.asarray(found.fillna(False).to_numpy(dtype=bool))


def _is_condition(value: Any) -> bool:
    return isinstance(value, pd.Series) and pd.api.types.is_bool_dtype(value)


def _evaluate_value(node: ast.expr, index: pd.DataFrame) -> Any:
    match node:
        case ast.Name(id=name):
            if name not in index.columns:
                raise DatasetError(f"no column {name!r}{suggest_names(name, map(str, index.columns))}")
            return index[name]
        case ast.Constant(value=bool() | int() | float() | str() as value):
            return value
        case ast.List(elts=parts) | ast.Tuple(elts=parts):
            return [_evaluate_value(part, index) for part in parts]
        case ast.BoolOp(op=joint, values=parts):
            join = operator.and_ if isinstance(joint, ast.And) else operator.or_
            return reduce(join, [_evaluate_condition(part, index) for part in parts])
        case ast.BinOp(op=ast.BitAnd() | ast.BitOr() as joint, left=left, right=right):
            join = operator.and_ if isinstance(joint, ast.BitAnd) else operator.or_
            return join(_evaluate_condition(left, index), _evaluate_condition(right, index))
        case ast.UnaryOp(op=ast.Not() | ast.Invert(), operand=part):
            return ~_evaluate_condition(part, index)
        case ast.UnaryOp(op=ast.USub(), operand=part):
            return -_number(part, index)
        case ast.BinOp(op=sign, left=left, right=right) if type(sign) in ARITHMETIC:
            return ARITHMETIC[type(sign)](_number(left, index), _number(right, index))
        case ast.Compare(left=left, ops=signs, comparators=parts):
            values = [_evaluate_value(part, index) for part in (left, *parts)]
            pairs = zip(values, signs, values[1:], strict=False)
            return reduce(operator.and_, [_compare(one, sign, two) for one, sign, two in pairs])
    raise DatasetError(f"{ast.unparse(node)[:60]!r} is not allowed; {ALLOWED}")


def _compare(one: Any, sign: ast.cmpop, two: Any) -> Any:
    if isinstance(sign, ast.In | ast.NotIn):
        if not isinstance(one, pd.Series) or not isinstance(two, list) or any(isinstance(v, pd.Series) for v in two):
            raise DatasetError("in needs a column before it and a list of values behind it")
        return one.isin(two) ^ isinstance(sign, ast.NotIn)
    if type(sign) not in COMPARISONS or isinstance(one, list) or isinstance(two, list):
        raise DatasetError(f"a comparison is not allowed; {ALLOWED}")
    return COMPARISONS[type(sign)](one, two)


def _evaluate_condition(node: ast.expr, index: pd.DataFrame) -> Any:
    value = _evaluate_value(node, index)
    if not _is_condition(value):
        raise DatasetError(f"{ast.unparse(node)[:60]!r} is no condition; compare it with something")
    return value


def _number(node: ast.expr, index: pd.DataFrame) -> Any:
    value = _evaluate_value(node, index)
    if isinstance(value, pd.Series) and pd.api.types.is_numeric_dtype(value):
        return value.astype(np.float64)
    if isinstance(value, int | float):
        return float(value)
    raise DatasetError(f"{ast.unparse(node)[:60]!r} is no number")
