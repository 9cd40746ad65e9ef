"""Tables in memory, column by column: pandas, polars, pyarrow, xarray, and those of this package.

No library is imported that the caller's table has not imported already.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from . import _core
from ._numbers import Array, as_floats, is_empty, is_words, of_array
from ._warnings import warn
from .exceptions import ModelError

#: Names of what is a clock in a table where nobody says which column is: the first that there is.
CLOCKS = ("stamp", "t", "time", "timestamp")


@dataclass(frozen=True)
class Frame:
    """A table in memory: its columns by name, and constructors of tables of the same kind and rows.

    Attributes
    ----------
    names : list of str
        The columns, in their order.
    rows : int
        Rows.
    column : callable
        The values of a column by name, without a copy if the library allows it.
    made : callable
        A table of this kind from names and values (rows, names).
    joined : callable
        This table with one more column: of a name and values.
    clock : (str, array), optional
        Name and stamps of its index, if that is time.
    numbers : list of str
        The columns that hold numbers.
    source : object
        The table as the engine reads it.
    aside : set of str
        Columns that identify rows and are never states.
    """

    names: list[str]
    rows: int
    column: Callable[[str], Array]
    made: Callable[[Sequence[str], Array], Any]
    joined: Callable[[str, Array], Any]
    clock: tuple[str, Array] | None = None
    numbers: list[str] = field(default_factory=list)
    source: Any = None
    aside: frozenset[str] = frozenset()

    def free(self, wanted: str) -> str:
        """A name that no column has."""
        while wanted in self.names:
            wanted += "_"
        return wanted

    def signals(self, left: Collection[str] = ()) -> list[str]:
        """All numeric columns except those in ``left``.

        Columns of text (possible labels), dates, nested values or no values are left out with a warning.

        Raises
        ------
        DataError
            A column that mixes numbers and text, or another column that is not a signal but may be meant as one.
        """
        kept: list[str] = []
        aside: dict[str, list[str]] = {}
        for name in self.names:
            if name in left or name in self.aside:
                continue
            why = self._no_signal(name)
            (kept if why is None else aside.setdefault(why, [])).append(name)
        if aside:
            whose = ", ".join(
                f"column{'' if len(names) == 1 else 's'} {', '.join(f'`{name}`' for name in names)} ({why})"
                for why, names in aside.items()
            )
            warn(
                f"no signal, and left out: {whose}; "
                "name the states (states=[...]) where labels or conditions need it"
            )
        return kept

    def _no_signal(self, name: str) -> str | None:
        """Content of a column that is not a signal."""
        column = self.column(name)
        if is_empty(column) and len(column):
            return "no value"
        if name in self.numbers:
            return None
        if column.ndim != 1 or column.dtype.kind == "V":
            return "nested values"
        if is_words(column):
            return "words or dates"
        try:
            kind = of_array(column, f"column `{name}`").dtype.kind
        except TypeError:
            # Lists, dicts, or objects of another kind.
            return "nested values"
        return "words or dates" if kind in "mM" else None

    def matrix(self, names: Sequence[str]) -> Array:
        """Columns side by side (rows, names), durations in seconds."""
        columns = [as_floats(of_array(self.column(name), f"column `{name}`")) for name in names]
        return np.column_stack(columns) if columns else np.empty((self.rows, 0))


def frame(thing: Any) -> Frame | None:
    """A table of one of these libraries; None for other objects."""
    for base in type(thing).__mro__:
        read = _KINDS.get((base.__module__.partition(".")[0], base.__name__))
        if read is not None:
            return read(thing)
    return None


def is_lazy(thing: Any) -> bool:
    """True for a lazy table."""
    return type(thing).__name__ == "LazyFrame" and hasattr(thing, "collect")


def frames(thing: Any) -> list[Frame] | None:
    """A table, or a list of tables, one for each run."""
    if isinstance(thing, (list, tuple)) and thing:
        tables = [frame(one) for one in thing]
        return None if any(one is None for one in tables) else [one for one in tables if one is not None]
    one = frame(thing)
    return None if one is None else [one]


def in_order(values: Any, names: Sequence[str], what: str) -> Any:
    """The columns of a table, or the entries of a pandas row, by name; other objects unchanged.

    Raises
    ------
    ModelError
        The table lacks one of the names.
    """
    table = None if isinstance(values, np.ndarray) else frame(values)
    if table is None:
        return values
    if type(values).__name__ == "Series":
        return _entries_in_order(values, names, what)
    if all(name.isdecimal() for name in table.names):
        return table.matrix(table.names)
    missing = [name for name in names if name not in table.names]
    if missing:
        raise ModelError(f"{what}: the table has no column `{missing[0]}`; it has {', '.join(table.names)}")
    return table.matrix(names)


def _entries_in_order(series: Any, names: Sequence[str], what: str) -> Any:
    """The entries of a pandas row by label; a series without names as labels is a column."""
    labels = list(getattr(series, "index", ()))
    texts = [str(label) for label in labels]
    if set(names) <= set(texts):
        return series.iloc[[texts.index(name) for name in names]]
    is_column = len(names) == 1 and (len(series) != 1 or str(series.name) in names)
    if is_column or not all(isinstance(label, str) for label in labels) or all(text.isdecimal() for text in texts):
        return series
    missing = next(name for name in names if name not in texts)
    raise ModelError(f"{what}: the series has no entry `{missing}`; it has {', '.join(texts)}")


def runs_in_order(values: Any, names: Sequence[str], what: str) -> Any:
    """The same of every run of a list."""
    if isinstance(values, (list, tuple)) and any(frame(one) is not None for one in values):
        return [in_order(one, names, what) for one in values]
    return in_order(values, names, what)


def slopes_in_order(values: Any, states: Sequence[str]) -> Any:
    """Derivatives of a table by the names of the states, or by ``x_dot`` for ``x``; without these names by their places.

    Raises
    ------
    ModelError
        The table has some of the names, but not all.
    """
    tables = frames(values)
    if tables is None:
        return values
    wanted = [list(states), [f"{state}_dot" for state in states]]
    for every in (all, any):
        for names in wanted:
            if names and every(name in table.names for name in names for table in tables):
                return runs_in_order(values, names, "x_dot")
    return values


# -- pandas


def _of_pandas(table: Any) -> Frame:
    import pandas

    labels = list(table.columns)
    names = [str(label) for label in labels]

    def column(name: str) -> Array:
        values = table.iloc[:, names.index(name)]
        if getattr(values.dtype, "tz", None) is not None:
            values = values.dt.tz_convert("UTC").dt.tz_localize(None)
        array = values.to_numpy()
        if array.dtype.kind == "O" and values.dtype.kind in "iufb":
            # Types of pandas that know missing values.
            array = values.to_numpy(dtype=np.float64, na_value=np.nan)
        return np.asarray(array)

    return Frame(
        names=names,
        rows=len(table),
        column=column,
        made=lambda new, values: pandas.DataFrame(values, columns=list(new), index=table.index),
        joined=lambda name, values: table.assign(**{name: values}),
        clock=_index_clock(table.index),
        numbers=[name for name, kind in zip(names, table.dtypes) if kind.kind in "iufb"],
        source=table,
    )


def _of_pandas_series(series: Any) -> Frame:
    import pandas

    one = _of_pandas(series.to_frame("x0" if series.name is None else str(series.name)))

    def made(new: Sequence[str], values: Array) -> Any:
        if len(new) == 1:
            return pandas.Series(values[:, 0], index=series.index, name=new[0])
        return one.made(new, values)

    return replace(one, made=made)


def _index_clock(index: Any) -> tuple[str, Array] | None:
    """Name and stamps of an index of times, or of a numeric index with a clock's name."""
    name = None if index.name is None else str(index.name)
    if type(index).__name__ == "PeriodIndex":
        index = index.to_timestamp()
    if type(index).__name__ == "DatetimeIndex":
        stamps = index if index.tz is None else index.tz_convert("UTC").tz_localize(None)
        return name or "t", stamps.to_numpy()
    if type(index).__name__ == "TimedeltaIndex" or (name in CLOCKS and index.dtype.kind in "iuf"):
        return name or "t", index.to_numpy()
    return None


# -- polars


def _of_polars(table: Any, made: Callable[[Any], Any] = lambda table: table) -> Frame:
    import polars

    def column(name: str) -> Array:
        series = table[name]
        return np.asarray((series.cast(polars.Float64) if series.dtype == polars.Boolean else series).to_numpy())

    def new_table(new: Sequence[str], values: Array) -> Any:
        return made(polars.DataFrame({name: values[:, at] for at, name in enumerate(new)}))

    return Frame(
        names=list(table.columns),
        rows=len(table),
        column=column,
        made=new_table,
        joined=lambda name, values: table.with_columns(polars.Series(name, values)),
        numbers=[name for name, kind in table.schema.items() if kind.is_numeric() or kind == polars.Boolean],
        source=table,
    )


def _of_lazy(table: Any) -> Frame:
    return _of_polars(table.collect(), lambda made: made.lazy())


def _of_polars_series(series: Any) -> Frame:
    table = series.to_frame(series.name or "x0")
    return _of_polars(table, lambda made: made.to_series() if made.width == 1 else made)


# -- Arrow


def _of_arrow(table: Any) -> Frame:
    import pyarrow  # type: ignore[import-untyped, unused-ignore]

    def column(name: str) -> Array:
        values = table.column(name)
        if pyarrow.types.is_boolean(values.type) or pyarrow.types.is_decimal(values.type):
            values = values.cast(pyarrow.float64())
        return np.asarray(values.to_numpy(zero_copy_only=False) if is_batch else values.to_numpy())

    is_batch = type(table).__name__ == "RecordBatch"
    kinds = (
        pyarrow.types.is_integer,
        pyarrow.types.is_floating,
        pyarrow.types.is_boolean,
        pyarrow.types.is_decimal,
    )
    build = pyarrow.record_batch if is_batch else pyarrow.table
    return Frame(
        names=list(table.schema.names),
        rows=table.num_rows,
        column=column,
        made=lambda new, values: build({name: pyarrow.array(values[:, at]) for at, name in enumerate(new)}),
        joined=lambda name, values: (pyarrow.table(table) if not is_batch else pyarrow.Table.from_batches([table]))
        .append_column(name, pyarrow.array(values)),
        numbers=[one.name for one in table.schema if any(is_kind(one.type) for is_kind in kinds)],
        source=table,
    )


def _of_table(table: Any) -> Frame:
    def made(new: Sequence[str], values: Array) -> Any:
        columns = {name: values[:, at] for at, name in enumerate(new)}
        data = _core.Data.arrays([("run", [(array, [name]) for name, array in columns.items()])])
        recipe = _core.recipe("", "the recipe", False, None, None, 1.0, None)
        return _core.read_table(data, recipe, list(new), None, None, None, None)[list(new)]

    def joined(name: str, values: Array) -> Any:
        return {**{one: table[one] for one in table.columns}, name: values}

    kinds = {name: table[name].dtype.kind for name in table.columns}
    # Of a table that was read: seconds since an episode's begin, beside the stamps.
    besides = {"t", "seconds", "stamp", "episode"} if kinds.get("stamp") == "M" else set()
    return Frame(
        names=list(table.columns),
        rows=len(table),
        column=lambda name: np.asarray(table[name]),
        made=made,
        joined=joined,
        numbers=[name for name, kind in kinds.items() if kind in "iufb" and name not in besides],
        source=table,
        aside=frozenset(besides),
    )


# -- xarray


def _of_xarray(data: Any) -> Frame:
    """A data set: variables over the rows' dimension are columns, further dimensions become several."""
    rows = _row_dimension(data)
    columns: dict[str, Array] = {}
    for name, variable in data.data_vars.items():
        columns.update(_variable_columns(str(name), variable, rows, str(name)))
    return _of_columns(data, rows, columns, lambda names, values, over: _new_dataset(data, rows, names, values, over))


def _of_data_array(data: Any) -> Frame:
    """An array with labels: those of its second dimension are the columns."""
    rows = _row_dimension(data)
    columns = _variable_columns("x" if data.name is None else str(data.name), data, rows, "")
    return _of_columns(data, rows, columns, lambda names, values, over: _new_array(data, rows, names, values, over))


def _row_dimension(data: Any) -> Any:
    dimensions = list(data.dims)
    if not dimensions:
        raise ValueError("the xarray object has no dimensions; its rows are one")
    times = [one for one in dimensions if one in data.coords and data.coords[one].dtype.kind in "mM"]
    return next(iter([*times, *(one for one in dimensions if one in CLOCKS), *dimensions]))


def _variable_columns(name: str, variable: Any, rows: Any, prefix: str) -> dict[str, Array]:
    """The columns of a variable: one, or one for every label of its other dimension."""
    others = [one for one in variable.dims if one != rows]
    if rows not in variable.dims:
        return {}
    if not others:
        return {name: variable.to_numpy()}
    if len(others) > 1:
        raise ValueError(f"{name} has the dimensions {', '.join(map(str, variable.dims))}; give rows and columns")
    (other,) = others
    values = variable.transpose(rows, other).to_numpy()
    labels = variable.coords[other].to_numpy() if other in variable.coords else range(values.shape[1])
    texts = [str(label) for label in labels]
    # Labels that are words are names; numbers are counted behind the variable's name.
    wordless = not prefix and not all(text.isidentifier() for text in texts)
    return {f"{name if wordless else prefix}{text}": values[:, at] for at, text in enumerate(texts)}


def _of_columns(data: Any, rows: Any, columns: dict[str, Array], made: Callable[[Any, Array, Any], Any]) -> Frame:
    clock = None
    if rows in data.coords and (rows in CLOCKS or data.coords[rows].dtype.kind in "mM"):
        clock = (str(rows), data.coords[rows].to_numpy())
    over = {rows: data.coords[rows]} if rows in data.coords else {}
    return Frame(
        names=list(columns),
        rows=int(data.sizes[rows]),
        column=lambda name: columns[name],
        made=lambda names, values: made(names, values, over),
        joined=lambda name, values: {**columns, name: values},
        clock=clock,
        numbers=[name for name, values in columns.items() if values.dtype.kind in "iufb"],
        source=columns,
    )


def _new_dataset(data: Any, rows: Any, names: Sequence[str], values: Array, over: Any) -> Any:
    return type(data)({name: (rows, values[:, at]) for at, name in enumerate(names)}, coords=over)


def _new_array(data: Any, rows: Any, names: Sequence[str], values: Array, over: Any) -> Any:
    return type(data)(values, dims=(rows, "output"), coords={**over, "output": list(names)})


_KINDS: dict[tuple[str, str], Callable[[Any], Frame]] = {
    ("pandas", "DataFrame"): _of_pandas,
    ("pandas", "Series"): _of_pandas_series,
    ("polars", "DataFrame"): _of_polars,
    ("polars", "LazyFrame"): _of_lazy,
    ("polars", "Series"): _of_polars_series,
    ("pyarrow", "Table"): _of_arrow,
    ("pyarrow", "RecordBatch"): _of_arrow,
    ("fleetfoot", "Table"): _of_table,
    ("xarray", "Dataset"): _of_xarray,
    ("xarray", "DataArray"): _of_data_array,
}
