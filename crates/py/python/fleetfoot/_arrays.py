"""The one door of arrays: what a caller gives becomes a plain array of numbers of this machine.

Order of memory and strides stay as they are. Masked values are missing (NaN, NaT), other byte orders and widths become
those of this machine, objects that are numbers become ``float64``. Text and complex numbers are refused.
"""

from __future__ import annotations

import datetime
import re
from typing import Any

import numpy as np

from .exceptions import DataError

Array = np.ndarray[Any, np.dtype[Any]]

#: Types of numbers that the engine reads where they lie.
_READ = {np.dtype(kind).str for kind in ("bool", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "f4", "f8")}
#: How a number begins.
_NUMBER = re.compile(r"\s*[-+]?[.,]?\d")
#: How text becomes numbers.
_MEND = (
    "text stands for labels and conditions alone; read it as numbers (pandas.read_csv(..., decimal=',', na_values=['-']), "
    "pandas.to_numeric(column, errors='coerce')), or leave the column out"
)


def numbers(values: Any, what: str) -> Array:
    """A plain array of numbers, dates or durations.

    Parameters
    ----------
    values : array, masked array, sequence, table or series
        What the caller gave. The columns of a table lie side by side.
    what : str
        Its name, for messages.

    Raises
    ------
    DataError
        Text, complex numbers, or an array of another kind.
    TypeError
        Objects that are no numbers.
    """
    array = _array(values, what)
    kind = array.dtype
    if kind.str in _READ or kind.kind in "mM":
        return array if kind.isnative else array.astype(kind.newbyteorder("="))
    if kind.kind == "f":
        # Halves are exact as single precision.
        return array.astype(np.float32 if kind.itemsize == 2 else np.float64)
    if kind.kind in "iub":
        return array.astype(kind.newbyteorder("="))
    if kind.kind == "O":
        return _of_objects(array, what)
    if kind.kind == "c":
        raise DataError(f"{what} holds complex numbers. Complex data not supported: give real and imaginary parts")
    if kind.kind in "US":
        raise _text(array.ravel()[0] if array.size else "", 0, what)
    if kind.kind == "T":
        return _of_objects(array.astype(object), what)
    raise DataError(f"{what} has the type {kind}, which cannot be read as numbers: give its columns side by side")


def floats(values: Any, what: str) -> Array:
    """The same as ``float64`` in the order of its indices; durations and dates in seconds."""
    array = numbers(values, what)
    if array.dtype.kind in "mM":
        array = seconds(array)
    return np.require(array, np.float64, ["C", "A"])


def seconds(array: Array) -> Array:
    """Durations in seconds, dates in seconds since 1970, as exact as ``float64`` is; other numbers as they are."""
    if array.dtype.kind not in "mM":
        return array
    since = array - np.zeros((), dtype=array.dtype)
    whole = since // np.timedelta64(1, "s")
    rest = (since - whole * np.timedelta64(1, "s")) / np.timedelta64(1, "s")
    return np.where(np.isnat(since), np.nan, whole + rest)


def since_first(values: Any, what: str) -> Array:
    """Stamps in seconds; dates count from the first."""
    array = numbers(values, what)
    return seconds(array - array.ravel()[:1] if array.dtype.kind == "M" and array.size else array)


def period_seconds(value: Any, what: str) -> float:
    """A period in seconds: a number, or a duration (``timedelta``, ``numpy.timedelta64``, ``pandas.Timedelta``)."""
    if isinstance(value, (datetime.timedelta, np.timedelta64)) or getattr(value, "dtype", None) is not None:
        value = floats(value, what)
    try:
        return float(value)
    except (TypeError, ValueError) as error:
        raise DataError(f"{what}={value!r}: give a number of seconds, or a duration") from error


def unmasked(values: Any) -> Any:
    """A masked array with its masked values missing; anything else as it is."""
    if not isinstance(values, np.ma.MaskedArray):
        return values
    plain: Array = values.data
    hidden: Array = np.broadcast_to(values.mask, plain.shape)
    if not hidden.any():
        return plain
    if plain.dtype.kind in "mM":
        return np.where(hidden, np.array("NaT", dtype=plain.dtype), plain)
    return np.where(hidden, np.nan, plain) if plain.dtype.kind in "iubfcO" else plain


def is_words(array: Array) -> bool:
    """Whether all values are text or missing, and none begins as a number does: labels, and no damaged signal."""
    if array.dtype.kind not in "OUT":
        return False
    there = [one for one in array.ravel().tolist() if not (_is_missing(one) or one != one)]
    return bool(there) and all(isinstance(one, str) and not _NUMBER.match(one) for one in there)


def _array(values: Any, what: str) -> Array:
    from ._frames import frame

    if isinstance(values, np.ndarray):
        return np.asarray(unmasked(values))
    table = frame(values)
    if table is not None:
        is_series = type(values).__name__ == "Series"
        return table.column(table.names[0]) if is_series else table.matrix(table.names)
    if isinstance(values, (list, tuple)):
        values = [unmasked(one) for one in values]
    try:
        return np.asarray(values)
    except (TypeError, ValueError) as error:
        raise DataError(f"{what} cannot be read as numbers: {error}") from error


def _text(value: Any, row: int, what: str) -> DataError:
    return DataError(f"{what} cannot be read as numbers: it holds text ({value!r} at row {row}, counted from 0); {_MEND}")


def _of_objects(array: Array, what: str) -> Array:
    """Objects that are numbers, or missing, as numbers."""
    flat = array.ravel()
    there = [one for one in flat if not _is_missing(one)]
    if there and all(isinstance(one, datetime.datetime) for one in there):
        naive = [np.datetime64("NaT") if _is_missing(one) else np.datetime64(_utc(one), "us") for one in flat]
        return np.array(naive, dtype="datetime64[us]").reshape(array.shape)
    if there and all(isinstance(one, datetime.timedelta) for one in there):
        spans = [np.timedelta64("NaT") if _is_missing(one) else np.timedelta64(one, "us") for one in flat]
        return np.array(spans, dtype="timedelta64[us]").reshape(array.shape)
    found = np.empty(len(flat))
    for at, one in enumerate(flat):
        if isinstance(one, (str, bytes)):
            raise _text(one, int(np.unravel_index(at, array.shape)[0]), what)
        if isinstance(one, (complex, np.complexfloating)):
            raise DataError(f"{what} holds complex numbers. Complex data not supported: give real and imaginary parts")
        try:
            found[at] = np.nan if _is_missing(one) else float(one)
        except TypeError as error:
            raise TypeError(f"{what} cannot be read as numbers: {error}") from error
        except ValueError as error:
            raise DataError(f"{what} cannot be read as numbers: {error}") from error
    return found.reshape(array.shape)


def _is_missing(value: Any) -> bool:
    return value is None or value is np.ma.masked or type(value).__name__ in ("NAType", "NaTType")


def _utc(stamp: datetime.datetime) -> datetime.datetime:
    return stamp if stamp.tzinfo is None else stamp.astimezone(datetime.timezone.utc).replace(tzinfo=None)
