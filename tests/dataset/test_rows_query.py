"""Queries of the index against Python, row by row, and everything that is no query."""

import numpy as np
import pandas as pd
import pytest

from doppelgait.core.errors import DatasetError
from doppelgait.dataset.rows import select_rows

INDEX = pd.DataFrame({
    "label": ["human", "dog", "cat", "dog"],
    "range_m": [1.0, 2.5, np.nan, 4.0],
    "row": [0, 1, 2, 3],
    "note": ["a", None, "b", "c"],
})  # fmt: skip


@pytest.mark.parametrize(
    "query",
    [
        "label == 'dog'", "range_m < 3", "1 < range_m <= 4", "label in ['dog', 'cat'] and range_m > 2",
        "label not in ('dog', 'cat')", "not (label == 'dog')", "~(row == 1) | (range_m > 3)", "-range_m < -2",
        "range_m * 2 + row / 2 - 1 > 5", "(label == 'dog') & (row > 1)", "range_m == range_m", "note != 'a'",
        "row in [1, 3] or label == 'human'", "2 >= row", "not ((row < 2) & (range_m > 2))", "-row in [-1, 2]",
    ],
)  # fmt: skip
def test_a_query_marks_what_python_marks(query):
    rows = [{name: np.asarray(value)[()] for name, value in row.items()} for row in INDEX.to_dict("records")]
    assert select_rows(INDEX, query).tolist() == [bool(eval(query, {}, row)) for row in rows]


@pytest.mark.parametrize(
    "query",
    [
        "@pd.io.common.os.system('touch {path}') == 0",
        "__import__('os').system('touch {path}') == 0",
        "label.map(print) == 1",
        "label.str.startswith('d')",
        "[open('{path}', 'w') for x in [1]] == 1",
        "(lambda: 1)() == 1",
        "row[0] == 1",
        "f'{{label}}' == 'dog'",
        "(x := row) == 1",
        "row ** 9 ** 9 > 1",
        "'a' * 999999999 == label",
        "row == 1 if 1 else row == 2",
        "import os",
        "row == " + "(" * 5000 + "1" + ")" * 5000,
        "row == " + "-" * 9000 + "1",
        "row == 1" + " and row == 1" * 2000,
        "row == " + "9" * 5000,
        "row < 1e999 - 1e999 * row and label < 3",
        "row is 1",
        "label in 'dog'",
        "row in [row]",
        "row and label",
        "1 < 2",
        "row == b'1'",
        "row == ...",
        "label == 'dog' \x00",
        "",
    ],
)
def test_what_is_no_query_runs_nothing_and_is_one_line(tmp_path, query):
    path = tmp_path / "written"
    with pytest.raises(DatasetError, match=r"^select ") as refused:
        select_rows(INDEX, query.replace("{path}", str(path)))
    assert not path.exists()
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) < 11_000
