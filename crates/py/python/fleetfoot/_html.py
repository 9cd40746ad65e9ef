"""Notebook display of tables, models, data sets and comparisons: plain HTML without styles."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

from ._core import Table

#: Rows and columns of a table that are shown.
ROWS, COLUMNS = 10, 12
#: Equations and regions of a model, and names of a data set, that are shown.
MOST = 40


def grid(header: Sequence[str], rows: Iterable[Sequence[str]], below: str = "") -> str:
    """A table of texts; `below` is a line under it."""
    head = "".join(f"<th>{escape(cell)}</th>" for cell in header)
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    line = f"<p>{escape(below)}</p>" if below else ""
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{line}"


def of_table(table: Table) -> str:
    """The first rows of a table, its columns with their units."""
    names, units = table.columns[:COLUMNS], table.units
    header = [f"{name} [{units[name]}]" if units[name] else name for name in names]
    first = table[:ROWS]
    columns = [[_cell(value) for value in first[name]] for name in names]
    rows, width = table.shape
    more = f"; {width - COLUMNS} more columns" if width > COLUMNS else ""
    return grid(header, zip(*columns), f"{rows} rows, {width} columns{more}")


def of_model(
    method: str,
    equations: Sequence[str],
    formulas: Iterable[tuple[str | None, str]],
    regions: int,
    *,
    dt: float | None,
    is_continuous: bool,
) -> str:
    """A model's equations with regions and MathML, and its training data."""
    items = "".join(
        f"<li>{escape(f'region {region}: ') if region else ''}<math alttext=\"{escape(line)}\">{formula}</math></li>"
        for line, (region, formula) in zip(equations[:MOST], formulas)
    )
    more = f"<p>and {len(equations) - MOST} more</p>" if len(equations) > MOST else ""
    step = f"; a step of {dt:.6g} s" if dt else ""
    facts = f"{regions} region{'' if regions == 1 else 's'}, {'continuous' if is_continuous else 'discrete'}{step}"
    return f"<p><b>{escape(method)}</b>: {escape(facts)}</p><ul>{items}</ul>{more}"


def of_dataset(names: Sequence[str]) -> str:
    """The logs of a data set."""
    more = f"and {len(names) - MOST} more" if len(names) > MOST else ""
    return grid([f"{len(names)} log{'' if len(names) == 1 else 's'}"], [[name] for name in names[:MOST]], more)


def of_comparison(header: Sequence[str], rows: Iterable[Sequence[str]], below: str, notes: Iterable[str]) -> str:
    """Errors of models side by side, with a caption and notes."""
    return grid(header, rows, below) + "".join(f"<p>{escape(note)}</p>" for note in notes)


def _cell(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else "" if value is None else str(value)
