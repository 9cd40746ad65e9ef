"""One exception class for each kind of error. All are :class:`FleetfootError`; a request that cannot be met has a class a cause."""

from __future__ import annotations

from collections.abc import Sequence

from ._words import of_python

__all__ = [
    "DataError",
    "FitError",
    "FleetfootError",
    "InternalError",
    "ModelError",
    "NeedsLogsError",
    "OptionError",
    "OutOfMemoryError",
    "ParameterError",
    "RequestError",
    "StatisticError",
    "TooFewRowsError",
    "UndeterminedError",
    "UnknownNameError",
    "WriteError",
]


class FleetfootError(Exception):
    """Anything that fleetfoot raises on its own account."""

    def __init__(self, *given: object) -> None:
        message, *rest = given or ("",)
        super().__init__(of_python(message) if isinstance(message, str) else message, *rest)


class RequestError(FleetfootError, ValueError):
    """What was asked for cannot be understood or does not exist: recipes, expressions, columns, options."""


class DataError(FleetfootError, ValueError):
    """Recordings that cannot be read, or do not hold what is needed."""


class FitError(FleetfootError, ValueError):
    """The data do not determine what was to be fitted, or an option of a fit is out of its range."""


class ModelError(FleetfootError, ValueError):
    """A model that cannot be read, run or exported."""


class StatisticError(FleetfootError, ValueError):
    """Statistics that cannot be read or do not go together."""


class WriteError(FleetfootError, OSError):
    """A file that cannot be written."""


class OutOfMemoryError(FleetfootError, MemoryError):
    """The answer needs more memory than the system gives this process; this is found before the work begins."""


class InternalError(FleetfootError, RuntimeError):
    """A mistake in fleetfoot itself: please report it."""


class OptionError(RequestError):
    """An option or a key of the recipe has a value that it does not take, is missing, or excludes another."""


class ParameterError(RequestError, TypeError):
    """A parameter that is not what it may be: a `ValueError` and a `TypeError`, as in scikit-learn."""


class UnknownNameError(RequestError):
    """Nothing has the name: a column, a state, a label, a robot."""

    #: The name, where one was asked for.
    name: str | None = None
    #: Names that may have been meant.
    candidates: Sequence[str] = ()


class TooFewRowsError(RequestError, DataError):
    """There are too few rows for what is to be learnt from them."""

    #: Rows that can be used.
    rows: int = 0
    #: How many it takes at least.
    needed: int = 1


class NeedsLogsError(RequestError):
    """The statistic cannot answer it: it has no rows, or was scanned for something else. The logs could."""


class UndeterminedError(RequestError, FitError):
    """The data do not determine what was asked for."""
