"""One exception class for each kind of error. All are :class:`FleetfootError`; a refused request has one class per
cause."""

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
    """Base of all errors of fleetfoot."""

    def __init__(self, *given: object) -> None:
        message, *rest = given or ("",)
        super().__init__(of_python(message) if isinstance(message, str) else message, *rest)


class RequestError(FleetfootError, ValueError):
    """The request cannot be understood or names something unknown: recipes, expressions, columns, options."""


class DataError(FleetfootError, ValueError):
    """Recordings cannot be read, or lack a column."""


class FitError(FleetfootError, ValueError):
    """The data do not determine the fit, or an option of a fit is out of range."""


class ModelError(FleetfootError, ValueError):
    """A model cannot be read, run or exported."""


class StatisticError(FleetfootError, ValueError):
    """Statistics cannot be read or merged."""


class WriteError(FleetfootError, OSError):
    """A file cannot be written."""


class OutOfMemoryError(FleetfootError, MemoryError):
    """The work needs more memory than the process may use; raised before it begins."""


class InternalError(FleetfootError, RuntimeError):
    """A bug in fleetfoot: please report it."""


class OptionError(RequestError):
    """An option or a key of the recipe has an invalid value, is missing, or excludes another."""


class ParameterError(RequestError, TypeError):
    """A parameter has an invalid value: a `ValueError` and a `TypeError`, as in scikit-learn."""


class UnknownNameError(RequestError):
    """An unknown name: a column, a state, a label, a robot."""

    #: The name, where one was asked for.
    name: str | None = None
    #: Names that may have been meant.
    candidates: Sequence[str] = ()


class TooFewRowsError(RequestError, DataError):
    """There are too few rows for the fit."""

    #: Rows that can be used.
    rows: int = 0
    #: Least number of rows.
    needed: int = 1


class NeedsLogsError(RequestError):
    """The statistic has no rows, or was scanned for another purpose: the request needs the logs."""


class UndeterminedError(RequestError, FitError):
    """The data do not determine the result."""
