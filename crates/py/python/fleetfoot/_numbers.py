"""Arrays and sequences as plain numeric arrays. Tables go through :mod:`fleetfoot._arrays`."""

from __future__ import annotations

import contextlib
import datetime
import re
from typing import Any

import numpy as np

from .exceptions import DataError

Array = np.ndarray[Any, np.dtype[Any]]

#: Types of numbers that the engine reads where they lie.
_READ = {np.dtype(kind).str for kind in ("bool", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "f4", "f8")}
#: First characters of a number.
_NUMBER = re.compile(r"\s*[-+]?[.,]?\d")
#: Conversion of text to numbers.
_MEND = (
    "text stands for labels and conditions alone; read it as numbers (pandas.read_csv(..., decimal=',', na_values=['-']), "
    "pandas.to_numeric(column, errors='coerce')), or leave the column out"
)


def of_array(values: Any, what: str) -> Array:
    """A plain array of numbers, dates or durations.

    Parameters
    ----------
    values : array, masked array or sequence
        Values of the caller.
    what : str
        Its name, for messages.

    Raises
    ------
    DataError
        Text, complex numbers, or an array of another kind.
    TypeError
        Objects that are not numbers.
    """
    array = _array(values, what)
    kind = array.dtype
    if kind.kind in "mM":
        return _in_seconds_or_finer(array, what)
    if kind.str in _READ:
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
    if kind.kind in "UST":
        return _of_objects(array.astype(object), what)
    raise DataError(f"{what} has the type {kind}, which cannot be read as numbers: give its columns side by side")


def as_floats(array: Array) -> Array:
    """``float64`` in the order of its indices; durations and dates in seconds."""
    return np.require(seconds(array), np.float64, ["C", "A"])


def seconds(array: Array) -> Array:
    """Durations in seconds, dates in seconds since 1970, in ``float64``; other numbers unchanged."""
    if array.dtype.kind not in "mM":
        return array
    missing = np.isnat(array)
    since = np.where(missing, np.zeros((), dtype=array.dtype), array) - np.zeros((), dtype=array.dtype)
    whole = since // np.timedelta64(1, "s")
    rest = (since - whole * np.timedelta64(1, "s")) / np.timedelta64(1, "s")
    return np.where(missing, np.nan, whole + rest)


def unmasked(values: Any) -> Any:
    """A masked array with masked values as missing; other arrays unchanged."""
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
    """True if all values are text or missing and none begins like a number: labels, not a damaged signal."""
    if array.dtype.kind not in "OUT":
        return False
    flat = array.ravel().tolist()
    there = {kind for kind in set(map(type, flat)) if not _is_missing_type(kind)}
    if not there <= {str, np.str_, float}:
        return False
    words = {one for one in set(flat) if isinstance(one, str) or not (_is_missing(one) or one != one)}
    return bool(words) and all(isinstance(one, str) and not _NUMBER.match(one) for one in words)


def is_empty(array: Array) -> bool:
    """True if all values are missing."""
    if array.dtype.kind == "f":
        return bool(np.isnan(array).all())
    if array.dtype.kind != "O":
        return False
    flat = array.ravel().tolist()
    kinds = set(map(type, flat))
    return all(_is_missing_type(kind) or kind is float for kind in kinds) and all(
        _is_missing(one) or one != one for one in flat
    )


def _in_seconds_or_finer(array: Array, what: str) -> Array:
    """Dates and durations in a unit of the engine: s, ms, us or ns."""
    unit, count = np.datetime_data(array.dtype)
    kind = array.dtype.newbyteorder("=")
    if unit not in ("s", "ms", "us", "ns") or count != 1:
        # Longer units are so many seconds, shorter ones lose what is below a nanosecond.
        wanted = unit if unit in ("ms", "us", "ns") else "ns" if unit in ("ps", "fs", "as") else "s"
        kind = np.dtype(f"{kind.kind}8[{wanted}]")
    if unit == "generic" or (kind.kind == "m" and unit in ("Y", "M")):
        raise DataError(f"{what} has durations of no fixed length ({array.dtype}); give seconds, or timedelta64[ns]")
    return array.astype(kind, copy=False)


def _array(values: Any, what: str) -> Array:
    if isinstance(values, np.ndarray):
        return np.asarray(unmasked(values))
    if isinstance(values, (list, tuple)):
        values = [unmasked(one) for one in values]
    try:
        array = np.asarray(values)
        # Numbers beside text stay what they are.
        return np.asarray(values, dtype=object) if array.dtype.kind in "US" else array
    except (TypeError, ValueError) as error:
        raise DataError(f"{what} cannot be read as numbers: {error}") from error


def _text(flat: list[Any], shape: tuple[int, ...], what: str) -> DataError:
    """The first text that is not a number, or the first text if all are numbers."""
    texts = [at for at, one in enumerate(flat) if isinstance(one, (str, bytes))]
    at = next((at for at in texts if not _is_number(flat[at])), texts[0])
    row, *columns = np.unravel_index(at, shape) if shape else (0,)
    place = "".join(f", column {int(column) + 1}" for column in columns)
    value = flat[at]
    shown = repr(bytes(value) if isinstance(value, bytes) else str(value))
    return DataError(
        f"{what} cannot be read as numbers: it holds text ({shown} in row {int(row) + 1}{place}, counted from 1); {_MEND}"
    )


def _is_number(text: str | bytes) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _of_objects(array: Array, what: str) -> Array:
    """Objects that are numbers, or missing, as numbers."""
    flat = array.ravel().tolist()
    kinds = set(map(type, flat))
    there = {kind for kind in kinds if not _is_missing_type(kind)}
    if there <= {int, float, bool}:
        known = flat if kinds - there <= {type(None)} else [None if _is_missing(one) else one for one in flat]
        with contextlib.suppress(OverflowError):
            return np.array(known, dtype=np.float64).reshape(array.shape)
    if any(issubclass(kind, (str, bytes)) for kind in there):
        raise _text(flat, array.shape, what)
    for held, numpys in ((datetime.date, "datetime64"), (datetime.timedelta, "timedelta64")):
        if there and all(issubclass(kind, held) for kind in there):
            return _in_seconds_or_finer(_of_times(flat, numpys, what).reshape(array.shape), what)
    if any(issubclass(kind, (complex, np.complexfloating)) for kind in there):
        raise DataError(f"{what} holds complex numbers. Complex data not supported: give real and imaginary parts")
    values = np.empty(len(flat))
    for at, one in enumerate(flat):
        try:
            values[at] = np.nan if _is_missing(one) else float(one)
        except TypeError as error:
            raise TypeError(f"{what} cannot be read as numbers: {error}") from error
        except (ValueError, OverflowError) as error:
            raise DataError(f"{what} cannot be read as numbers: {error}") from error
    return values.reshape(array.shape)


def _of_times(flat: list[Any], kind: str, what: str) -> Array:
    """Dates or durations, in the finest of their units: those of pandas have nanoseconds."""
    missing = np.datetime64("NaT") if kind == "datetime64" else np.timedelta64("NaT")
    try:
        times = [missing if _is_missing(one) else _of_time(one) for one in flat]
        converted: Array = np.array(times)
        coarse = f"{kind}[us]"
        if len({one.dtype for one in times}) > 1 and not np.array_equal(
            converted.astype(coarse), np.array([one.astype(coarse) for one in times]), equal_nan=True
        ):
            # numpy makes another time of one that has no place in the finest unit.
            raise OverflowError("they are too far apart to be counted in nanoseconds")
    except (OverflowError, ValueError) as error:
        raise DataError(f"{what} cannot be read as times: {error}") from error
    return converted


def _of_time(one: Any) -> Any:
    if hasattr(one, "to_timedelta64"):
        return one.to_timedelta64()
    if hasattr(one, "to_datetime64"):
        return one.to_datetime64()
    if isinstance(one, datetime.timedelta):
        return np.timedelta64(one, "us")
    return np.datetime64(_utc(one), "us") if isinstance(one, datetime.datetime) else np.datetime64(one, "D")


def _is_missing(value: Any) -> bool:
    return _is_missing_type(type(value))


def _is_missing_type(kind: type) -> bool:
    return kind in (type(None), np.ma.core.MaskedConstant) or kind.__name__ in ("NAType", "NaTType")


def _utc(stamp: datetime.datetime) -> datetime.datetime:
    return stamp if stamp.tzinfo is None else stamp.astimezone(datetime.timezone.utc).replace(tzinfo=None)
