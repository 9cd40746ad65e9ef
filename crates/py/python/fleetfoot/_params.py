"""Rules of parameters, checked at the start of every `fit`, with a uniform message."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Any

import numpy as np

from .exceptions import ParameterError

__all__ = [
    "ARRAY",
    "BOOLEAN",
    "CV",
    "NONE",
    "RANDOM_STATE",
    "VERBOSE",
    "Rule",
    "check_params",
    "integer",
    "one_of",
    "real",
]


@dataclass(frozen=True)
class Rule:
    """A kind of values, and its name."""

    text: str
    holds: Callable[[Any], bool]


def _interval(low: float, high: float, closed: str) -> tuple[str, Callable[[Any], bool]]:
    left, right = closed in ("left", "both"), closed in ("right", "both")
    text = f"{'[' if left else '('}{low}, {high}{']' if right else ')'}"

    def holds(value: Any) -> bool:
        above = value >= low if left else value > low
        below = value <= high if right else value < high
        return bool(above and below)

    return text, holds


def real(low: float = -np.inf, high: float = np.inf, closed: str = "left") -> Rule:
    """A number between `low` and `high`; `closed` is "left", "right", "both" or "neither"."""
    text, inside = _interval(low, high, closed)
    return Rule(f"a float in the range {text}", lambda v: isinstance(v, Real) and not _is_bool(v) and inside(v))


def integer(low: float = -np.inf, high: float = np.inf, closed: str = "left") -> Rule:
    """A whole number between `low` and `high`."""
    text, inside = _interval(low, high, closed)
    return Rule(f"an int in the range {text}", lambda v: isinstance(v, Integral) and not _is_bool(v) and inside(v))


def one_of(*names: str) -> Rule:
    """One of some words."""
    return Rule(f"a str among {{{', '.join(map(repr, names))}}}", lambda v: isinstance(v, str) and v in names)


def _is_bool(value: Any) -> bool:
    return isinstance(value, (bool, np.bool_))


def _is_seed(value: Any) -> bool:
    if value is None or value is np.random:
        return True
    if isinstance(value, Integral) and not _is_bool(value):
        return 0 <= int(value) <= 2**32 - 1
    return isinstance(value, (np.random.RandomState, np.random.Generator))


def _is_cv(value: Any) -> bool:
    if value is None or (isinstance(value, Integral) and not _is_bool(value)):
        return value is None or int(value) >= 2
    return not isinstance(value, str) and (hasattr(value, "split") or hasattr(value, "__iter__"))


BOOLEAN = Rule("a bool", _is_bool)
NONE = Rule("None", lambda value: value is None)
ARRAY = Rule("an array-like", lambda v: hasattr(v, "__array__") or isinstance(v, (list, tuple)))
RANDOM_STATE = Rule("a seed (an int in [0, 2**32), a numpy RandomState or Generator, or None)", _is_seed)
CV = Rule("a number of folds (at least 2), a splitter, an iterable of (train, test), or None", _is_cv)
VERBOSE = Rule("a bool or an int >= 0", lambda v: _is_bool(v) or (isinstance(v, Integral) and int(v) >= 0))


def check_params(owner: Any, rules: dict[str, tuple[Rule, ...]], **values: Any) -> None:
    """Checks parameters by their rules: those of an estimator, or the `values` given to a function that `owner` names.

    Raises :class:`ParameterError`, which names the parameter, its rule and its value.
    """
    name = owner if isinstance(owner, str) else type(owner).__name__
    for parameter, allowed in rules.items():
        value = values[parameter] if parameter in values else getattr(owner, parameter)
        if any(rule.holds(value) for rule in allowed):
            continue
        *most, last = [rule.text for rule in allowed]
        text = f"{', '.join(most)} or {last}" if most else last
        raise ParameterError(f"The {parameter!r} parameter of {name} must be {text}. Got {value!r} instead.")
