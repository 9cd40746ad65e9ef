"""Rows and matrices of the package's table, for libraries without Arrow."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from ._core import Table

#: Rows that are objects at a time.
_BLOCK = 1 << 14


def rows(table: Table) -> Iterator[dict[str, Any]]:
    """The rows as dicts by the names of the columns."""
    names = table.columns
    columns = [table[name] for name in names]
    for begin in range(0, len(table), _BLOCK):
        # Stamps stay stamps.
        parts = [column[begin : begin + _BLOCK] for column in columns]
        for row in zip(*(part if part.dtype.kind == "M" else part.tolist() for part in parts)):
            yield dict(zip(names, row))


def matrix(table: Table) -> np.ndarray[Any, np.dtype[np.float64]]:
    """The columns side by side.

    Raises
    ------
    TypeError
        A column is not numeric.
    """
    columns = {name: table[name] for name in table.columns}
    others = [name for name, column in columns.items() if column.dtype.kind != "f"]
    if others or not columns:
        left = [name for name in columns if name not in others]
        raise TypeError(f"{', '.join(f'`{name}`' for name in others) or 'the table'} holds no numbers: take table[{left}]")
    return np.column_stack(list(columns.values()))
