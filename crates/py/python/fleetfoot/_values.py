"""Checks of a caller's numbers and names, with a uniform message."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from ._words import shown
from .exceptions import RequestError

#: The largest whole number that the engine takes.
_MOST = 2**63 - 1


def count(name: str, value: Any, least: int) -> int:
    """A whole number of at least a given value."""
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, np.integer)) or value < least:
        raise RequestError(f"{name}={shown(repr(value))}: give a whole number of {least} or more")
    if value > _MOST:
        raise RequestError(f"{name}={shown(repr(value))}: give a whole number of {_MOST} at most")
    return int(value)


def number(name: str, value: Any) -> float:
    """A finite number."""
    is_number = isinstance(value, (int, float, np.number)) and not isinstance(value, (bool, np.bool_))
    try:
        value_read = float(value) if is_number else np.nan
    except OverflowError:
        value_read = np.inf
    if not np.isfinite(value_read):
        raise RequestError(f"{name}={shown(repr(value))}: give a number")
    return value_read


def names_of(given: str | Iterable[str]) -> list[str]:
    """A list of names; a single text is one name."""
    return [given] if isinstance(given, str) else list(given)
