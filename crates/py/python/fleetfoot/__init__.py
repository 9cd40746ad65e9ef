"""fleetfoot: robot logs to equations."""

from . import exceptions
from ._core import VERSION as __version__
from ._core import set_threads, thread_count

# -- lars

# -- lasso

# -- clusters and thresholds

# -- identification

# -- statistics

# -- tables
from ._data import Dataset, open  # noqa: A004

__all__ = [
    "__version__",
    "exceptions",
    "set_threads",
    "thread_count",
    # -- lars
    # -- lasso
    # -- clusters and thresholds
    # -- identification
    # -- statistics
    # -- tables
    "Dataset",
    "open",
]
