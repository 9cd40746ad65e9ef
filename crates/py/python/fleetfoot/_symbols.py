"""Python functions as expressions: called once with symbols in place of numbers.

They can be exported, differentiated and simulated like all other candidates.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .exceptions import RequestError

#: Functions of numpy by the names that expressions have for them.
_FUNCTIONS = {
    "sin": "sin",
    "cos": "cos",
    "tan": "tan",
    "arcsin": "asin",
    "arccos": "acos",
    "arctan": "atan",
    "sinh": "sinh",
    "cosh": "cosh",
    "tanh": "tanh",
    "exp": "exp",
    "log": "log",
    "sqrt": "sqrt",
    "absolute": "abs",
    "fabs": "abs",
    "sign": "sign",
    "arctan2": "atan2",
    "minimum": "min",
    "fmin": "min",
    "maximum": "max",
    "fmax": "max",
}
_OPERATORS = {
    "add": "+",
    "subtract": "-",
    "multiply": "*",
    "true_divide": "/",
    "divide": "/",
    "power": "^",
    "float_power": "^",
}


class Symbol:
    """An expression in place of a number."""

    def __init__(self, text: str) -> None:
        self.text = text

    def __array_ufunc__(self, ufunc: Any, method: str, *given: Any, **options: Any) -> Any:
        name, arguments = ufunc.__name__, [_text(one) for one in given]
        if method != "__call__" or options:
            return NotImplemented
        if name in _OPERATORS:
            return _joined(given[0], _OPERATORS[name], given[1])
        if name in _FUNCTIONS:
            return Symbol(f"{_FUNCTIONS[name]}({', '.join(arguments)})")
        others = {"negative": f"(-{arguments[0]})", "positive": arguments[0], "square": f"({arguments[0]}^2)"}
        others["reciprocal"] = f"(1/{arguments[0]})"
        return Symbol(others[name]) if name in others else NotImplemented

    def __add__(self, other: Any) -> Symbol:
        return _joined(self, "+", other)

    def __radd__(self, other: Any) -> Symbol:
        return _joined(other, "+", self)

    def __sub__(self, other: Any) -> Symbol:
        return _joined(self, "-", other)

    def __rsub__(self, other: Any) -> Symbol:
        return _joined(other, "-", self)

    def __mul__(self, other: Any) -> Symbol:
        return _joined(self, "*", other)

    def __rmul__(self, other: Any) -> Symbol:
        return _joined(other, "*", self)

    def __truediv__(self, other: Any) -> Symbol:
        return _joined(self, "/", other)

    def __rtruediv__(self, other: Any) -> Symbol:
        return _joined(other, "/", self)

    def __pow__(self, other: Any) -> Symbol:
        return _joined(self, "^", other)

    def __rpow__(self, other: Any) -> Symbol:
        return _joined(other, "^", self)

    def __neg__(self) -> Symbol:
        return Symbol(f"(-{self.text})")

    def __pos__(self) -> Symbol:
        return self

    def __abs__(self) -> Symbol:
        return Symbol(f"abs({self.text})")

    def __bool__(self) -> bool:
        raise TypeError("it decides by the values of its arguments")


def quoted(name: str) -> str:
    """A column's name, quoted for an expression."""
    return name if name.isidentifier() else f"`{name.replace('`', '``')}`"


def _joined(left: Any, operator: str, right: Any) -> Symbol:
    return Symbol(f"({_text(left)} {operator} {_text(right)})")


def _text(value: Any) -> str:
    if isinstance(value, Symbol):
        return value.text
    if np.ndim(value) == 0 and isinstance(value, (int, float, np.number)) and np.isfinite(value):
        text = repr(value.item() if isinstance(value, np.number) else value)
        return f"({text})" if text.startswith("-") else text
    raise TypeError(f"it has {value!r} in it")


def expressions(function: Callable[..., Any], names: Sequence[str], *, repeats: bool = False) -> list[str]:
    """Expressions of a function for every choice of its number of variables.

    Parameters
    ----------
    function : callable
        Function of one or more values, made of operators and numpy functions.
    names : list of str
        The variables.
    repeats : bool
        Allow a variable more than once.

    Raises
    ------
    RequestError
        The function cannot be written as an expression.

    Examples
    --------
    >>> expressions(lambda x: x * abs(x), ["v", "w"])
    ['(v * abs(v))', '(w * abs(w))']
    >>> expressions(lambda x, y: np.sin(x - y) ** 2, ["a", "b", "c"])[0]
    '(sin((a - b)) ^ 2)'
    """
    count = function.__code__.co_argcount if hasattr(function, "__code__") else int(getattr(function, "nin", 1))
    choose = itertools.combinations_with_replacement if repeats else itertools.combinations
    return [_written(function, chosen) for chosen in choose(names, count)]


def _written(function: Callable[..., Any], names: Sequence[str]) -> str:
    symbols = [Symbol(quoted(name)) for name in names]
    try:
        return _text(function(*symbols))
    except Exception as error:
        raise RequestError(
            f"library: the function {getattr(function, '__name__', function)!r} cannot be written as an expression "
            f"({error}); give the expression, library=['{names[0]}*abs({names[0]})'], or its values as a column"
        ) from error
