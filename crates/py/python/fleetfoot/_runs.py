"""Runs as numpy arrays, for fits and scores."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from . import _core
from ._arrays import numbers, period_seconds
from ._numbers import seconds
from ._values import names_of

Differentiate = Callable[[np.ndarray[Any, Any], Any], Any]


@dataclass
class Runs:
    """Arrays for the engine, with their entries of a recipe."""

    core: _core.Data
    states: list[str]
    inputs: list[str]
    #: The column that holds the derivative of each state, where it was given.
    derivatives: dict[str, str] = field(default_factory=dict)
    #: The section ``[time]``.
    time: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Columns:
    """The columns of a run, as arrays without a copy."""

    arrays: list[np.ndarray[Any, Any]]
    ndim: ClassVar[int] = 2

    def __len__(self) -> int:
        return len(self.arrays[0])

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return len(self), len(self.arrays)

    def parts(self, names: Sequence[str]) -> list[tuple[Any, list[str]]]:
        """The arrays with their names."""
        return [(array, [name]) for array, name in zip(self.arrays, names)]


def is_arrays(x: Any) -> bool:
    """True for an array or a list of arrays, false for a path, a table or a mapping."""
    if isinstance(x, (np.ndarray, Columns)):
        return True
    if not isinstance(x, (list, tuple)) or not x:
        return False
    return all(isinstance(one, (np.ndarray, Columns, list, tuple, int, float, np.generic)) for one in x)


def array_runs(values: Any, what: str) -> list[Any]:
    """One array for each run."""
    if isinstance(values, Columns):
        return [values]
    many = isinstance(values, (list, tuple)) and any(isinstance(one, (np.ndarray, Columns)) for one in values)
    each = values if many else [values]
    arrays = [one if isinstance(one, Columns) else numbers(one, what) for one in each]
    for run, array in enumerate(arrays):
        if array.ndim not in (1, 2):
            where = f"{what}[{run}]" if many else what
            raise ValueError(f"{where} has {array.ndim} dimensions; give rows, or rows and columns")
    return arrays


def _width(arrays: list[Any], what: str) -> int:
    widths = {1 if array.ndim == 1 else array.shape[1] for array in arrays}
    if len(widths) > 1:
        raise ValueError(f"{what}: the runs have {', '.join(map(str, sorted(widths)))} columns; give as many in each")
    return widths.pop()


def _names(given: Sequence[str] | None, what: str, letter: str, width: int) -> list[str]:
    if given is None:
        return [f"{letter}{i}" for i in range(width)]
    names = [str(name) for name in names_of(given)]
    if len(names) != width:
        raise ValueError(f"{what} has {len(names)} names ({', '.join(names)}) for {width} columns")
    return names


def _stamps(t: Any, count: int, rows: list[int]) -> tuple[list[np.ndarray[Any, Any]] | None, float | None]:
    """Stamps of each run, or the period of all."""
    if t is None:
        return None, None
    if not isinstance(t, (list, tuple)) and np.ndim(t) == 0:
        return None, period_seconds(t, "t")
    if isinstance(t, (list, tuple)) and any(isinstance(one, np.ndarray) and one.ndim == 1 for one in t):
        stamps = [numbers(one, "t") for one in t]
    elif isinstance(t, (list, tuple)) and len(t) == count and count > 1:
        periods = {period_seconds(one, "t") for one in t}
        if len(periods) > 1:
            raise ValueError(f"t: the runs have the periods {sorted(periods)}; give stamps, or fit runs of one rate")
        return None, periods.pop()
    else:
        stamps = [numbers(t, "t")] * count
    if len(stamps) != count:
        raise ValueError(f"t has {len(stamps)} arrays for {count} runs")
    for run, (stamp, length) in enumerate(zip(stamps, rows)):
        if stamp.shape != (length,):
            raise ValueError(f"t of run {run} has the shape {stamp.shape}; x has {length} rows. {_MEANT}")
        _check_rise(stamp, run)
    return stamps, None


#: Hints for arrays that are no stamps.
_MEANT = (
    "t are the times of the rows. Derivatives are x_dot=...; another target is a column, "
    "columns={'y': y} with target='y' (or take PWARegressor); several runs are a list of arrays"
)


def _check_rise(stamp: np.ndarray[Any, Any], run: int) -> None:
    """Refuses invalid stamps: a clock does not go back, and rarely stands still."""
    if stamp.dtype.kind not in "iufmM" or len(stamp) < 2:
        return
    back = np.flatnonzero(stamp[1:] < stamp[:-1])
    if len(back):
        row = int(back[0]) + 1
        more = f", as {len(back) - 1} more do" if len(back) > 1 else ""
        place = f"in row {row + 1} (counted from 1), from {stamp[row - 1]} to {stamp[row]}{more}"
        raise ValueError(f"t of run {run} goes back {place}. {_MEANT}")
    still = int(np.count_nonzero(stamp[1:] == stamp[:-1]))
    if 2 * still >= len(stamp):
        raise ValueError(f"t of run {run} stands still at {still} of {len(stamp)} rows. {_MEANT}")


#: Share of a step that it may differ from the median, and share of the steps that may differ by more.
_UNEVEN, _MANY = 0.1, 0.05


def uneven(clocks: Sequence[Any]) -> list[str]:
    """Notes for row-by-row models on stamps that are not one period apart, apart from gaps."""
    notes = []
    for run, clock in enumerate(clocks):
        stamps = numbers(clock, "t")
        if stamps.ndim != 1 or len(stamps) < 3 or stamps.dtype.kind not in "iufmM":
            continue
        steps = seconds(np.diff(stamps)).astype(float)
        steps = steps[np.isfinite(steps)]
        period = float(np.median(steps)) if len(steps) else 0.0
        share = float(np.mean(np.abs(steps - period) > _UNEVEN * period)) if period > 0.0 else 0.0
        if share > _MANY:
            notes.append(
                f"t of run {run} is uneven: {share:.0%} of its steps differ from their median, {period:.3g} s, by more than "
                f"{_UNEVEN:.0%}, and the model goes from row to row as if all were alike; fit derivatives "
                "(target='derivative'), or bring the rows to one rate first"
            )
    return notes


def _beside(values: Any, what: str, x: list[Any]) -> list[Any]:
    """Further arrays beside x."""
    arrays = array_runs(values, what)
    if len(arrays) != len(x):
        raise ValueError(f"{what} has {len(arrays)} runs and x has {len(x)}; give as many")
    for run, (array, states_of_run) in enumerate(zip(arrays, x)):
        if len(array) != len(states_of_run):
            raise ValueError(f"{what} of run {run} has {len(array)} rows and x has {len(states_of_run)}; give as many")
    return arrays


def _free(wanted: str, taken: set[str]) -> str:
    while wanted in taken:
        wanted += "_"
    taken.add(wanted)
    return wanted


def runs(
    x: Any,
    t: Any = None,
    x_dot: Any = None,
    u: Any = None,
    feature_names: Sequence[str] | None = None,
    input_names: Sequence[str] | None = None,
    *,
    dt: float | None = None,
    default_dt: float | None = None,
    differentiate: Differentiate | None = None,
    derivative_names: dict[str, str] | None = None,
    columns: Mapping[str, Any] | None = None,
) -> Runs:
    """Arrays as one data set; a list is a list of runs."""
    if t is not None and dt is not None:
        raise ValueError("t and dt are both given; the stamps come from one of them")
    xs = array_runs(x, "x")
    if any(one.ndim == 2 and one.shape[1] == 0 for one in xs):
        raise ValueError(f"x has 0 feature(s) (shape={xs[0].shape}) while a minimum of 1 is required.")
    if any(len(one) == 0 for one in xs):
        raise ValueError("x has a run without rows")
    states = _names(feature_names, "feature_names", "x", _width(xs, "x"))
    parts: list[list[tuple[Any, list[str]]]] = [
        one.parts(states) if isinstance(one, Columns) else [(one, states)] for one in xs
    ]
    taken = set(states)
    inputs: list[str] = []
    if u is not None:
        us = _beside(u, "u", xs)
        inputs = _names(input_names, "input_names", "u", _width(us, "u"))
        for part, one in zip(parts, us):
            part.append((one, inputs))
        taken.update(inputs)
    elif input_names is not None:
        raise ValueError("input_names is given and u is not")
    others = [str(name) for name in columns or ()]
    for name in others:
        for part, one in zip(parts, _beside((columns or {})[name], f"columns[{name!r}]", xs)):
            part.append((one, [name]))
    every = states + inputs + others
    taken.update(others)
    if len(taken) < len(every):
        twice = sorted({name for name in every if every.count(name) > 1})
        raise ValueError(f"feature_names, input_names and columns: {', '.join(twice)} stands for two columns")
    stamps, period = _stamps(t if dt is None else period_seconds(dt, "dt"), len(xs), [len(one) for one in xs])
    period = default_dt if stamps is None and period is None else period
    if stamps is None and period is None:
        raise ValueError("t is missing: give the stamps of every run in seconds, or dt=, the seconds from row to row")
    if differentiate is not None and x_dot is None:
        clocks: Sequence[Any] = stamps if stamps is not None else [period] * len(xs)
        x_dot = [_derivative(differentiate, one, clock, run) for run, (one, clock) in enumerate(zip(xs, clocks))]
    made = Runs(_core.Data.arrays([]), states, inputs)
    if x_dot is not None:
        dots = _beside(x_dot, "x_dot", xs)
        if _width(dots, "x_dot") != len(states):
            raise ValueError(f"x_dot has {_width(dots, 'x_dot')} columns and x has {len(states)}; give as many")
        known = derivative_names or {}
        made.derivatives = {name: known.get(name) or _free(f"{name}_dot", taken) for name in states}
        for part, one in zip(parts, dots):
            part.append((one, list(made.derivatives.values())))
    if stamps is not None:
        clock = _free("t", taken)
        for part, one in zip(parts, stamps):
            part.append((one, [clock]))
        made.time = {"column": clock} if stamps[0].dtype.kind in "mM" else {"column": clock, "unit": "s"}
    else:
        made.time = {"dt": period}
    made.core = _core.Data.arrays([(f"run {run}", part) for run, part in enumerate(parts)])
    return made


def differentiated(x: Any, t: Any, dt: float | None, default_dt: float | None, differentiate: Differentiate) -> Any:
    """Derivatives of every run by a function of the caller."""
    xs = array_runs(x, "x")
    stamps, period = _stamps(t if dt is None else period_seconds(dt, "dt"), len(xs), [len(one) for one in xs])
    clocks: Sequence[Any] = stamps if stamps is not None else [default_dt if period is None else period] * len(xs)
    return [_derivative(differentiate, one, clock, run) for run, (one, clock) in enumerate(zip(xs, clocks))]


def _derivative(differentiate: Differentiate, x: Any, t: Any, run: int) -> np.ndarray[Any, Any]:
    slopes = numbers(differentiate(_columns(x), t), "derivative")
    if slopes.shape != _columns(x).shape:
        shape = _columns(x).shape
        raise ValueError(f"derivative: run {run} of the shape {shape} has derivatives of the shape {slopes.shape}")
    return slopes


def _columns(array: Any) -> np.ndarray[Any, Any]:
    if isinstance(array, Columns):
        return np.column_stack([seconds(numbers(one, "x")) for one in array.arrays])
    return np.asarray(array[:, None] if array.ndim == 1 else array)


def by_name(array: Any, names: Sequence[str]) -> dict[str, np.ndarray[Any, Any]]:
    """The columns of a run by their names."""
    columns = array.arrays if isinstance(array, Columns) else _columns(array).T
    return dict(zip(names, columns))
