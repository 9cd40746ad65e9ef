"""One exception class for each kind of error. All are :class:`FleetfootError`."""

__all__ = [
    "DataError",
    "FitError",
    "FleetfootError",
    "InternalError",
    "ModelError",
    "RequestError",
    "StatisticError",
    "WriteError",
]


class FleetfootError(Exception):
    """Anything that fleetfoot raises on its own account."""


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


class InternalError(FleetfootError, RuntimeError):
    """A mistake in fleetfoot itself: please report it."""
