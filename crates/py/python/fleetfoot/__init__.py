"""fleetfoot: robot logs to equations."""

from . import exceptions
from ._core import VERSION as __version__
from ._core import set_threads, thread_count

# -- lars

# -- lasso

# -- clusters and thresholds
from ._kmeans import KMeans

# -- identification

# -- statistics

# -- tables

__all__ = [
    "__version__",
    "exceptions",
    "set_threads",
    "thread_count",
    # -- lars
    # -- lasso
    # -- clusters and thresholds
    "KMeans",
    # -- identification
    # -- statistics
    # -- tables
]
