"""Data sets for fits, scans and scores: files, Arrow tables and numpy arrays."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from . import _core, _outside
from ._arrays import numbers
from ._axes import channels_of
from ._frames import Frame, frame
from ._html import of_dataset
from ._lazy import has_lazy, spooled
from ._numbers import is_words
from ._recipe import as_toml
from ._warnings import warn


class Dataset:
    """Recordings with a recipe, made by :func:`fleetfoot.open`.

    Rows are read on demand by a fit, a scan or a score. Files stream; arrays and Arrow tables are not copied.

    Parameters
    ----------
    core : _core.Data
        What is read.
    recipe : str
        The recipe as TOML, or an empty text.

    Attributes
    ----------
    recipe : str
        The recipe as TOML, or an empty text.
    """

    def __init__(self, core: _core.Data, recipe: str = "", opened: tuple[Any, dict[str, Any]] | None = None) -> None:
        self._core = core
        self.recipe = recipe
        self._opened = opened

    def __copy__(self) -> Dataset:
        return self

    def __deepcopy__(self, memo: object) -> Dataset:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        """The opened sources: files by path, tables and arrays by value."""
        if self._opened is None:
            raise TypeError("this Dataset was not opened by fleetfoot.open, and cannot be pickled")
        return _reopened, self._opened

    @property
    def names(self) -> list[str]:
        """Paths of the files, and names of the tables."""
        return self._core.names()

    def __len__(self) -> int:
        return len(self._core)

    def __repr__(self) -> str:
        names = self.names
        shown = ", ".join(names[:3]) + (", ..." if len(names) > 3 else "")
        return f"Dataset({len(names)} {'log' if len(names) == 1 else 'logs'}: {shown})"

    def _repr_html_(self) -> str:
        return of_dataset(self.names)

    def plot(self, columns: Sequence[str] | None = None, **options: Any) -> Any:
        """Channels over time with their gaps, by matplotlib: :func:`fleetfoot.plot.channels`.

        Returns
        -------
        array of matplotlib.axes.Axes
            One per channel.
        """
        recipe = options.pop("recipe", None)
        data = self if recipe is None else open(self, recipe=recipe)
        return channels_of(data._core, data.recipe, columns, **options)

    def __add__(self, other: Dataset) -> Dataset:
        """Both data sets as one, with one recipe."""
        if not isinstance(other, Dataset):
            return NotImplemented
        if self.recipe and other.recipe and self.recipe != other.recipe:
            raise ValueError("the two datasets have different recipes; open one of them without")
        parts = ("+", {"parts": [self, other]})
        return Dataset(self._core.joined([other._core]), self.recipe or other.recipe, parts)


def _reopened(source: Any, given: dict[str, Any]) -> Dataset:
    """A pickled data set."""
    if "parts" in given:
        first, second = given["parts"]
        both: Dataset = first + second
        return both
    return open(source, **given)


def open(  # noqa: A001
    source: Any,
    *,
    recipe: str | os.PathLike[str] | Mapping[str, Any] | None = None,
    name: str | Sequence[str] | None = None,
    t: Any = None,
    dt: float | None = None,
    where: str | None = None,
) -> Dataset:
    """Opens files, tables or arrays for reading.

    Parameters
    ----------
    source : path, table, array, mapping, list or iterator
        - A path, a glob pattern or a folder, or a list of them: MCAP, rosbag2, ROS 1 bags, ULog, ArduPilot, WPILOG,
          Parquet, CSV, NumPy and MATLAB files, or a statistic (``.stats``). They stream. HDF5, MATLAB 7.3 and Arrow files
          (Feather) are read whole, by h5py and pyarrow.
        - An Arrow table: anything with ``__arrow_c_stream__`` or ``__arrow_c_array__`` (polars, pyarrow, pandas 2.2
          and later, duckdb). Columns of ``float64`` without nulls in one chunk are not copied.
        - A mapping from names to arrays of shape (rows,), or of shape (rows, k), whose columns are called ``name0``,
          ``name1``, ... (a tuple of k names as the key names them). numpy arrays of any numeric type, order and
          strides are not copied.
        - An array of shape (rows, k): its columns are called ``x0``, ``x1``, ...
        - A lazy table of polars, of any number of rows: it is computed block by block into a temporary file and read
          from there.
        - A list of tables, mappings or arrays: one run each.
        - An iterator of record batches or tables of one schema: one run. The batches are kept, as fits read rows more
          than once.
    recipe : path, str or mapping, optional
        The recipe: a TOML file, TOML text, or a mapping.
    name : str or list of str, optional
        Names of the runs in memory; ``"run"``, or ``"run 0"``, ``"run 1"``, ... by default.
    t : str, array or list of arrays, optional
        The clock: the name of its column; or stamps of each run in memory, shape (rows,), in seconds (or
        ``datetime64``).
    dt : float, optional
        Seconds from row to row, for recordings without a clock.
    where : str, optional
        Condition on rows: comparisons between expressions over columns and fields, joined by ``and``, as in
        ``"armed > 0 and 2 < time() < 60"``. Default: all rows. Models carry it; ``"all"`` removes it.

    Returns
    -------
    Dataset

    Raises
    ------
    RequestError
        The recipe cannot be understood.
    DataError
        No file is found; an array or a table cannot be read.
    TypeError
        ``source`` is of another kind.

    Examples
    --------
    >>> import numpy as np, fleetfoot as ff
    >>> time = np.arange(100) * 0.01
    >>> data = ff.open({"t": time, "x": np.cos(time)}, name="swing")
    >>> data
    Dataset(1 log: swing)
    """
    if t is not None and dt is not None:
        raise ValueError("t and dt are both given; the stamps come from one of them")
    given = {"recipe": recipe, "name": name, "t": t, "dt": dt, "where": where}
    added: tuple[str, str | None] | None = None
    if isinstance(source, Dataset):
        core = source._core
        if t is not None and not isinstance(t, str):
            raise ValueError("t: the dataset is open already; give the name of its clock's column")
        recipe = source.recipe if recipe is None else recipe
    elif _is_path(source) or _is_paths(source):
        core = _files(source, name, t)
    elif has_lazy(source):
        if t is not None and not isinstance(t, str):
            raise ValueError("t: lazy tables have their own stamps; give the name of the clock's column")
        tables = list(source) if isinstance(source, (list, tuple)) else [source]
        core = spooled(tables, _names(name, len(tables), not isinstance(source, (list, tuple))))
    else:
        core, added = _memory(source, name, t, has_clock=dt is not None or _says_clock(recipe))
    clock, unit = (t, None) if isinstance(t, str) else added or (None, None)
    return Dataset(core, as_toml(recipe, clock, unit, dt, where), (source, given))


def _says_clock(recipe: Any) -> bool:
    """True if a recipe defines the clock, or its absence."""
    text = as_toml(recipe)
    time = json.loads(_core.recipe_json(text, "the recipe")).get("time", {}) if text.strip() else {}
    return "column" in time or "dt" in time


def _is_path(source: Any) -> bool:
    return isinstance(source, (str, os.PathLike))


def _is_paths(source: Any) -> bool:
    return isinstance(source, (list, tuple)) and bool(source) and all(_is_path(one) for one in source)


def _is_table(source: Any) -> bool:
    return hasattr(source, "__arrow_c_stream__") or hasattr(source, "__arrow_c_array__")


def _files(source: Any, name: Any, t: Any) -> _core.Data:
    if name is not None:
        raise ValueError("name: files have their own names")
    if t is not None and not isinstance(t, str):
        raise ValueError("t: files have their own stamps; give the name of the clock's column")
    paths = [source] if _is_path(source) else list(source)
    outside = [path for path in paths if _outside.is_outside(path)]
    inside = [path for path in paths if not any(path is one for one in outside)]
    parts = [_core.Data.files(inside)] if inside else []
    parts += [_run(os.fspath(path), _outside.read(path)) for path in outside]
    return parts[0].joined(parts[1:]) if len(parts) > 1 else parts[0]


def _memory(source: Any, name: Any, t: Any, *, has_clock: bool) -> tuple[_core.Data, tuple[str, str | None] | None]:
    """Tables in memory, with column and unit of an added clock."""
    if isinstance(source, (np.ndarray, Mapping)) or _is_table(source) or frame(source) is not None:
        runs, single = [source], True
    elif isinstance(source, (list, tuple)):
        runs, single = list(source), False
        if runs and all(np.isscalar(one) for one in runs):
            runs, single = [numbers(source, "source")], True
    elif isinstance(source, Iterator) or isinstance(source, Iterable):
        runs, single = [_Batches(source)], True
    else:
        raise TypeError(
            f"source is a {type(source).__name__}; give paths, Arrow tables, mappings of arrays, arrays, or an "
            "iterator of batches"
        )
    if not runs:
        raise ValueError("source is empty; give at least one run")
    names = _names(name, len(runs), single)
    stamps: list[Any] = [None] * len(runs)
    if t is not None and not isinstance(t, str):
        stamps = _stamps(t, len(runs), single)
    clocks: list[tuple[str, str | None] | None] = []
    for at, (run, stamp) in enumerate(zip(runs, stamps)):
        runs[at], clock = _clocked(run, stamp, has_clock)
        clocks.append(clock)
    if len(set(clocks)) > 1:
        raise ValueError("some of the runs have an index of times and some have none, or they are called differently")
    parts = [_run(name, run) for name, run in zip(names, runs)]
    core = parts[0].joined(parts[1:]) if len(parts) > 1 else parts[0]
    return core, clocks[0]


def in_unit(name: str, stamps: list[Any], unit: str | None = None) -> list[Any]:
    """Integer stamps of each run in the given unit, or in the unit inferred from name, sizes and steps, as for files;
    other stamps unchanged.

    Raises
    ------
    DataError
        The unit of the numbers is ambiguous.
    """
    if not all(getattr(one, "dtype", None) is not None and one.dtype.kind in "iu" and one.ndim == 1 for one in stamps):
        return stamps
    if not sum(map(len, stamps)):
        return stamps
    time = {"column": name} if unit is None else {"column": name, "unit": unit}
    opened = open([{name: one} for one in stamps], recipe={"time": time})
    whole = _core.read_table(opened._core, opened.recipe, [name], None, None, None, None)["stamp"]
    if len(whole) != sum(map(len, stamps)):
        return stamps
    return np.split(whole, np.cumsum([len(one) for one in stamps])[:-1])


def _clocked(run: Any, stamps: Any, has_clock: bool) -> tuple[Any, tuple[str, str | None] | None]:
    """A run with its given stamps or its index as a column, and that column's name and unit."""
    table = frame(run)
    index = None if table is None or stamps is not None else table.clock
    name, values = ("t", stamps) if index is None else index
    if table is not None:
        run = table.source
        if values is not None:
            name = table.free(name)
            run = table.joined(name, values)
    elif values is not None and isinstance(run, _Batches):
        raise ValueError("t: batches have their own stamps; give the name of the clock's column")
    elif values is not None and _is_table(run) and not isinstance(run, np.ndarray):
        raise ValueError("t: give the name of the clock's column, or a table of pandas, polars or pyarrow")
    elif values is not None:
        columns: dict[Any, Any] = {tuple(names): array for array, names in _parts("source", run)}
        if any("t" in names for names in columns):
            raise ValueError("t: there is a column `t` already; give its name, t='t', or leave the array out")
        run = {**columns, ("t",): values}
    if values is None or (index is not None and has_clock):
        return run, None
    # Stamps that are given are seconds; whole numbers of an index are in a unit that is to be found.
    of_unit = numbers(values, "t").dtype.kind in ("mM" if index is None else "mMiu")
    return run, (name, None if of_unit else "s")


def _names(name: Any, count: int, single: bool) -> list[str]:
    if name is None:
        return ["run"] if single else [f"run {i}" for i in range(count)]
    if isinstance(name, str):
        return [name] if count == 1 else [f"{name} {i}" for i in range(count)]
    names = [str(one) for one in name]
    if len(names) != count:
        raise ValueError(f"name has {len(names)} names for {count} runs")
    return names


def _stamps(t: Any, count: int, single: bool) -> list[Any]:
    if single and not (isinstance(t, (list, tuple)) and len(t) == 1 and np.ndim(t[0]) == 1):
        return [numbers(t, "t")]
    if not isinstance(t, (list, tuple)):
        raise ValueError(f"t: give a list of {count} arrays, one for each run")
    if len(t) != count:
        raise ValueError(f"t has {len(t)} arrays for {count} runs")
    return [numbers(one, "t") for one in t]


class _Batches:
    """Record batches of one run."""

    def __init__(self, batches: Iterable[Any]) -> None:
        self.batches = list(batches)


def _run(name: str, run: Any) -> _core.Data:
    if isinstance(run, _Batches):
        for at, batch in enumerate(run.batches):
            if not _is_table(batch):
                raise TypeError(f"source: batch {at} is a {type(batch).__name__}; give record batches or tables")
        return _core.Data.arrow([(name, run.batches)])
    if _is_table(run) and not isinstance(run, np.ndarray):
        try:
            return _core.Data.arrow([(name, [run])])
        except ImportError:
            # pandas hands out Arrow only beside pyarrow; its columns are arrays as well.
            table = frame(run)
            if table is None:
                raise
            read = {column: _read(table, column) for column in table.names}
            run = {column: array for column, array in read.items() if array is not None}
            left = [column for column, array in read.items() if array is None]
            if left:
                warn(f"left out, as only pyarrow hands out text and nested values: columns `{'`, `'.join(left)}`")
    return _core.Data.arrays([(name, _parts(name, run))])


def _read(table: Frame, column: str) -> Any:
    """A column of numbers or stamps; None for text and nested values, which come by Arrow."""
    values = table.column(column)
    if is_words(values):
        return None
    try:
        return numbers(values, f"column `{column}`")
    except TypeError:
        return None


def _parts(name: str, run: Any) -> list[tuple[Any, list[str]]]:
    """Arrays with the names of their columns."""
    if not isinstance(run, Mapping):
        array = numbers(run, name)
        if array.ndim not in (1, 2):
            raise ValueError(f"{name} has {array.ndim} dimensions; give rows and columns")
        return [(array, [f"x{i}" for i in range(1 if array.ndim == 1 else array.shape[1])])]
    if not run:
        raise ValueError(f"{name} has no columns")
    parts = []
    for key, values in run.items():
        array = numbers(values, f"{name}, column {key!r}")
        if isinstance(key, tuple):
            names = [str(one) for one in key]
        elif array.ndim == 2:
            names = [f"{key}{i}" for i in range(array.shape[1])]
        else:
            names = [str(key)]
        parts.append((array, names))
    return parts
