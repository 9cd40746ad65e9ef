"""Arguments of `fit` and `score`: arrays and tables, clocks and targets."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar, cast

import numpy as np

from ._arrays import numbers, period_seconds
from ._base import DataConversionWarning
from ._data import in_unit
from ._frames import CLOCKS, Frame, frame, frames, is_lazy, slopes_in_order
from ._numbers import seconds, unmasked
from ._runs import Columns, array_runs, is_arrays
from .exceptions import DataError, RequestError

Array = np.ndarray[Any, np.dtype[Any]]
Method = TypeVar("Method", bound=Callable[..., Any])

#: Words for predicted quantities of states; any other word is a column.
OF_STATES = ("derivative", "next", "delta")
#: Slips of these words, in small letters and without blanks.
_SLIPS = {
    **{word: word for word in OF_STATES},
    **{f"{word}s": word for word in OF_STATES},
    "nxt": "next",
    "derivate": "derivative",
}
#: Equations that name their own targets.
TASKS = "tasks"


@dataclass(frozen=True)
class Second:
    """A second positional argument: stamps, as in pysindy, or targets, as in scikit-learn."""

    value: Any


def second_by_position(method: Method) -> Method:
    """Marks the second argument of a method if it is positional."""

    @functools.wraps(method)
    def call(self: Any, x: Any, *rest: Any, **named: Any) -> Any:
        if rest and "t" in named:
            # The clock has its name: this is what scikit-learn's tools hand over, y, or nothing.
            if rest[0] is not None and "y" in named:
                raise TypeError("y is given twice, by its place and by its name; give it once")
            named, rest = {"y": rest[0], **named}, (None, *rest[1:]) if len(rest) > 1 else ()
        elif rest:
            rest = (Second(rest[0]), *rest[1:])
        return method(self, x, *rest, **named)

    return cast(Method, call)


@dataclass(frozen=True)
class Call:
    """The arguments of `fit` and `score`."""

    x: Any
    t: Any = None
    x_dot: Any = None
    u: Any = None
    feature_names: Sequence[str] | None = None
    input_names: Sequence[str] | None = None
    y: Any = None
    dt: float | None = None
    columns: Mapping[str, Any] | None = None
    #: Names of the features, where a table has them.
    table_names: tuple[str, ...] | None = None
    #: True if the given targets are a vector.
    is_flat: bool = False

    def understood(
        self, predicts: str, period: float | None, columns_are_named: bool, time: Mapping[str, Any] | None = None
    ) -> Call:
        """The call with a resolved second argument, columns in place of tables, and targets as derivatives, columns,
        or next rows.

        Parameters
        ----------
        predicts : str
            One of :data:`OF_STATES`, or a column.
        period : float, optional
            Seconds from row to row, if the estimator knows them.
        columns_are_named : bool
            Names give the columns of tables their roles.
        time : mapping, optional
            Clock entries of a recipe.
        """
        call = self
        if hasattr(call.x, "toarray") and hasattr(call.x, "nnz"):
            raise TypeError("x is a sparse matrix, and sparse data are not supported here: give x.toarray()")
        call = replace(call, x=_collected(_plain_array(call.x)))
        tables = frames(call.x)
        call._refuse_near_words(predicts, tables)
        call = call._with_second(predicts, period, tables)
        call = replace(call, is_flat=_is_vector(call.y))
        if period is not None and call.t is None and call.dt is None:
            call = replace(call, dt=period)
        if tables is not None and columns_are_named:
            return call._joined(tables, predicts)
        if tables is not None:
            call = call._of_tables(tables, predicts, time or {})
        x_dot, y = call._by_states(call.x_dot), call.y
        y = call._by_states(y) if predicts in OF_STATES else y
        call = replace(call, t=_clock(call.t), x_dot=_values(x_dot), y=_values(y))
        inputs = frames(call.u)
        if inputs is not None:
            call = replace(call, **_inputs(inputs, call))
        return call if call.y is None else call._with_targets(predicts)

    def _with_second(self, predicts: str, period: float | None, tables: list[Frame] | None) -> Call:
        """The second positional argument as clock, unless the estimator has a clock or needs none."""
        if not isinstance(self.t, Second):
            return self
        there = {*(self.columns or ()), *(self.feature_names or ())}
        there |= set(tables[0].names) if tables is not None else set()
        is_column = predicts not in (*OF_STATES, TASKS) and predicts not in there
        is_plain = is_column and (tables is not None or is_arrays(self.x))
        value = _plain_array(self.t.value)
        # A number is a period, whatever else is known.
        if _is_one(value) or not (is_plain or period is not None or self.dt is not None):
            return replace(self, t=value)
        if self.y is not None:
            raise RequestError("y is given twice, by its place and by its name; give it once")
        if _are_stamps(value) and not _rises(self.x):
            raise RequestError(
                "the second argument is the target here, as scikit-learn has it, "
                f"{'because dt is given' if not is_plain else f'because target={predicts!r} is a column'}; "
                "but it rises row by row as stamps do: write t= in front of stamps, or y= in front of a target"
            )
        return replace(self, t=None, y=value)

    def _refuse_near_words(self, predicts: str, tables: list[Frame] | None) -> None:
        """Refuses a misspelt word as target if it is not a known column."""
        if predicts in (*OF_STATES, TASKS) or predicts in {*(self.columns or ()), *(self.feature_names or ())}:
            return
        if tables is None and not is_arrays(self.x) or tables is not None and predicts in tables[0].names:
            return
        meant = _SLIPS.get("".join(predicts.split()).lower())
        if meant is not None:
            raise RequestError(
                f"target={predicts!r}: did you mean {meant!r}? If it is a column, give it in columns={{{predicts!r}: ...}}"
            )

    def _by_states(self, values: Any) -> Any:
        """Derivatives or next values of a table by the names of the states."""
        for names in (self.table_names, self.feature_names):
            if names:
                values = slopes_in_order(values, list(names))
        return values

    def _joined(self, tables: list[Frame], predicts: str) -> Call:
        """Tables with named columns, joined with a column of targets."""
        if self.y is None:
            return self
        if predicts in (*OF_STATES, TASKS):
            raise RequestError(
                "y: the columns of the table have names, so name that of the targets: "
                "derivative={'x': 'x_dot'}, or target='y'"
            )
        targets = array_runs(_values(self.y), "y")
        if len(targets) != len(tables):
            raise ValueError(f"y has {len(targets)} runs and x has {len(tables)}; give as many")
        for at, (table, target) in enumerate(zip(tables, targets)):
            if len(target) != table.rows:
                raise ValueError(f"y of run {at} has {len(target)} rows and x has {table.rows}; give as many")
        new = [table.joined(predicts, vector(target)) for table, target in zip(tables, targets)]
        return replace(self, x=new if isinstance(self.x, (list, tuple)) else new[0], y=None)

    def _of_tables(self, tables: list[Frame], predicts: str, time: Mapping[str, Any]) -> Call:
        """All numeric columns of tables as states, except clock and target."""
        call = self
        if call.t is None and call.dt is None and time.get("column") in tables[0].names:
            call = replace(call, t=time["column"])
        stamps = _clock_column(tables[0], call)
        if stamps is not None:
            call = replace(call, t=in_unit(stamps, [_stamps_of(table, stamps) for table in tables], time.get("unit")))
        columns = dict(self.columns or {})
        if predicts in tables[0].names:
            columns[predicts] = [table.column(predicts) for table in tables]
        if self.feature_names and set(self.feature_names) <= set(tables[0].names):
            names = list(self.feature_names)
        else:
            names = tables[0].signals({*([] if stamps is None else [stamps]), *columns})
        if not names:
            raise DataError(f"the table has no column of numbers beside its clock; it has {', '.join(tables[0].names)}")
        for at, table in enumerate(tables):
            missing = [name for name in names if name not in table.names]
            if missing:
                raise DataError(f"the table of run {at} has no column `{missing[0]}`, and that of run 0 has")
        return replace(
            call,
            x=[Columns([table.column(name) for name in names]) for table in tables],
            feature_names=self.feature_names or names,
            columns=columns or None,
            table_names=tuple(names),
        )

    def _with_targets(self, predicts: str) -> Call:
        """Given targets as derivatives, a column, or the next rows."""
        if predicts == TASKS:
            raise RequestError("y: the tasks name their targets; give these columns by their names, columns={...}")
        if predicts not in OF_STATES:
            targets = [vector(one) for one in array_runs(self.y, "y")]
            return replace(self, y=None, columns={**(self.columns or {}), predicts: targets})
        if predicts == "derivative":
            if self.x_dot is not None:
                raise ValueError("y and x_dot are both given, and both are derivatives; give one of them")
            return replace(self, y=None, x_dot=self.y)
        if self.columns:
            raise ValueError("columns: with next values in y the rows are rearranged; give the columns as inputs, u=")
        return self._by_next_values(predicts)

    def _by_next_values(self, predicts: str) -> Call:
        """Runs cut where the next value is not that of the next row; that value becomes one more row."""
        xs = [_matrix(one) for one in array_runs(self.x, "x")]
        ys = [_matrix(one) for one in array_runs(self.y, "y")]
        us = [_matrix(one) for one in array_runs(self.u, "u")] if self.u is not None else [x[:, :0] for x in xs]
        if [one.shape for one in xs] != [one.shape for one in ys]:
            raise ValueError(
                f"y has the shapes {[one.shape for one in ys]} and x has {[one.shape for one in xs]}: "
                "the next values are those of all states; give as many"
            )
        if [len(one) for one in us] != [len(one) for one in xs]:
            raise ValueError("u has other rows than x; give as many")
        if self.t is not None and not _is_one(self.t):
            raise ValueError("t: next values that are given need no stamps; give dt=, the seconds from row to row")
        pieces = [
            piece
            for x, y, u in zip(xs, ys, us)
            for piece in _pieces(x, y if predicts == "next" else x + y, u)
        ]
        period = self.dt if self.t is None else self.t
        # Times of their own: pairs that are alike are different rows.
        first = np.cumsum([0, *(len(x) for x, _ in pieces)])
        step = 1.0 if period is None else period_seconds(period, "dt")
        stamps = [step * (at + np.arange(len(x))) for at, (x, _) in zip(first, pieces)]
        u = None if self.u is None else [u for _, u in pieces]
        return replace(self, y=None, x=[x for x, _ in pieces], u=u, t=stamps, dt=None)


def _are_stamps(value: Any) -> bool:
    """True for values that rise by similar steps, as stamps do."""
    each = value if isinstance(value, (list, tuple)) and any(np.ndim(one) for one in value) else [value]
    for one in each:
        array = numbers(_values(one), "the second argument")
        if array.dtype.kind in "mM":
            return True
        array = array[:, 0] if array.ndim == 2 and array.shape[1] == 1 else array
        if array.ndim != 1 or len(array) < 3 or array.dtype.kind not in "iuf":
            return False
        steps = np.diff(array.astype(np.float64))
        # Lost samples leave a few long steps.
        if not (np.isfinite(steps).all() and (steps > 0.0).all() and np.quantile(steps, 0.9) < 1.5 * np.median(steps)):
            return False
    return True


def _rises(x: Any) -> bool:
    """True if a column of x other than the clock is monotonic, so that a target may be monotonic too."""
    tables = frames(x)
    if tables is not None:
        each = [table.matrix([name for name in table.numbers if name not in CLOCKS]) for table in tables]
    else:
        each = array_runs(x, "x")
    steps = [np.diff(_matrix(one).astype(np.float64), axis=0) for one in each]
    return all((step > 0.0).all(axis=0).any() or (step < 0.0).all(axis=0).any() for step in steps)


def _pieces(x: Array, after: Array, u: Array) -> list[tuple[Array, Array]]:
    """Rows with their successors, cut where the successor is not the next row. Each piece ends with a successor
    without inputs."""
    # Sums are the next rows to rounding.
    near = 1e-12 * np.max(np.abs(x), axis=0, initial=0.0)
    ends = np.flatnonzero((np.abs(after[:-1] - x[1:]) > near).any(axis=1)) + 1
    unknown = np.full((1, u.shape[1]), np.nan)
    pieces = np.split(np.arange(len(x)), ends)
    return [(np.vstack([x[rows], after[rows[-1:]]]), np.vstack([u[rows], unknown])) for rows in pieces]


def _inputs(tables: list[Frame], call: Call) -> dict[str, Any]:
    """Inputs of tables as arrays: the named columns, else all numeric ones."""
    given = list(call.input_names or ())
    names = given if given and set(given) <= set(tables[0].names) else tables[0].signals()
    u = [table.matrix(names) for table in tables]
    return {"u": u if isinstance(call.u, (list, tuple)) else u[0], "input_names": given or names}


def _clock_column(table: Frame, call: Call) -> str | None:
    """The clock column of a table, or the name of its index: the given one, else one with a clock's name."""
    if isinstance(call.t, str):
        if call.t not in table.names and (table.clock is None or table.clock[0] != call.t):
            raise DataError(f"t={call.t!r}: the table has no such column; it has {', '.join(table.names)}")
        return call.t
    if call.t is not None or call.dt is not None:
        return None
    if table.clock is not None:
        return table.clock[0]
    return next((name for name in CLOCKS if name in table.names), None)


def _stamps_of(table: Frame, name: str) -> np.ndarray[Any, Any]:
    if table.clock is not None and table.clock[0] == name:
        return table.clock[1]
    return table.column(name)


def clocks(call: Call) -> list[Any]:
    """The stamps of runs in memory, if available."""
    if call.t is not None and not isinstance(call.t, str):
        if _is_one(call.t):
            return []
        many = isinstance(call.t, (list, tuple)) and not all(_is_one(one) for one in call.t)
        return list(call.t) if many else [call.t]
    tables = frames(call.x)
    name = None if not tables else _clock_column(tables[0], call)
    return [] if name is None or not tables else [_stamps_of(table, name) for table in tables]


def _clock(t: Any) -> Any:
    """Stamps as arrays."""
    if isinstance(t, (list, tuple)):
        return [_clock(one) for one in t]
    one = frame(t)
    if one is not None:
        return one.column(one.names[0])
    return numbers(t, "t") if hasattr(t, "__array__") and np.ndim(t) else t


def _values(given: Any) -> Any:
    """Arrays in the place of tables and series."""
    tables = frames(given)
    if tables is None:
        return given
    many = isinstance(given, (list, tuple))
    arrays = [
        one.column(one.names[0]) if _is_series(values) else one.matrix(one.signals())
        for one, values in zip(tables, given if many else [given])
    ]
    return arrays if many else arrays[0]


def _is_series(table: Any) -> bool:
    return type(table).__name__ == "Series"


def vector(array: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """One target as a vector."""
    if array.ndim == 2 and array.shape[1] == 1:
        what = "A column-vector y was passed when a 1d array was expected: give y.ravel()"
        warnings.warn(what, DataConversionWarning, stacklevel=2)
    elif array.ndim != 1:
        raise ValueError(f"y should be a 1d array, got an array of shape {array.shape} instead: it is one column")
    return array.reshape(len(array))


def _matrix(one: Any) -> np.ndarray[Any, Any]:
    if isinstance(one, Columns):
        return np.column_stack([seconds(numbers(array, "x")) for array in one.arrays])
    array = seconds(numbers(one, "x"))
    return array[:, None] if array.ndim == 1 else array


def _is_vector(y: Any) -> bool:
    if isinstance(y, (list, tuple)) and not all(_is_one(one) for one in y):
        return all(_is_vector(one) for one in y)
    return y is not None and np.ndim(y) == 1


def _is_one(value: Any) -> bool:
    """True for a number, a name or None, false for an array."""
    return not isinstance(value, (list, tuple)) and np.ndim(value) == 0


def _collected(given: Any) -> Any:
    """Lazy tables, read once."""
    if isinstance(given, (list, tuple)):
        return [_collected(one) for one in given] if any(is_lazy(one) for one in given) else given
    return given.collect() if is_lazy(given) else given


def _plain_array(given: Any) -> Any:
    """A numpy array of another library's array."""
    is_other = hasattr(given, "__array__") and not isinstance(given, (np.ndarray, np.generic))
    return np.asarray(given) if is_other and frame(given) is None else unmasked(given)
