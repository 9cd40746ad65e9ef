"""Conversion of a caller's arrays to plain numeric arrays in native byte order.

Memory order and strides are kept. Masked values become missing (NaN, NaT), foreign byte orders and widths native
ones, numeric objects ``float64``. Text and complex numbers are refused.
"""

from __future__ import annotations

import datetime
from typing import Any

import numpy as np

from ._frames import frame
from ._numbers import Array, as_floats, of_array, seconds
from .exceptions import DataError


def numbers(values: Any, what: str) -> Array:
    """A plain array of numbers, dates or durations.

    Parameters
    ----------
    values : array, masked array, sequence, table or series
        Values of the caller; the columns of a table side by side.
    what : str
        Its name, for messages.

    Raises
    ------
    DataError
        Text, complex numbers, or an array of another kind.
    TypeError
        Objects that are not numbers.
    """
    return of_array(_laid_out(values), what)


def floats(values: Any, what: str) -> Array:
    """The same as ``float64`` in the order of its indices; durations and dates in seconds."""
    return as_floats(numbers(values, what))


def since_first(values: Any, what: str) -> Array:
    """Stamps in seconds; dates count from the first valid one."""
    array = numbers(values, what)
    if array.dtype.kind != "M":
        return seconds(array)
    return seconds(array - array[~np.isnat(array)][:1] if not np.isnat(array).all() else array)


def period_seconds(value: Any, what: str) -> float:
    """A period in seconds: a number, or a duration (``timedelta``, ``numpy.timedelta64``, ``pandas.Timedelta``)."""
    if isinstance(value, (datetime.timedelta, np.timedelta64)) or getattr(value, "dtype", None) is not None:
        value = floats(value, what)
    try:
        return float(value)
    except (TypeError, ValueError) as error:
        raise DataError(f"{what}={value!r}: give a number of seconds, or a duration") from error


def _laid_out(values: Any) -> Any:
    """The columns of a table side by side, the values of a series; anything else as it is."""
    table = None if isinstance(values, np.ndarray) else frame(values)
    if table is None:
        return values
    is_series = type(values).__name__ == "Series"
    return table.column(table.names[0]) if is_series else table.matrix(table.names)
