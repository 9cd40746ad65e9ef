"""fleetfoot: robot logs to equations."""

from . import exceptions
from ._core import VERSION as __version__
from ._core import set_threads, thread_count

# -- lars
from ._lars import lars_path, lars_path_gram
from ._lars_models import Lars, LassoLars
from ._lars_select import LassoLarsCV, LassoLarsIC

# -- lasso

# -- clusters and thresholds
from ._kmeans import KMeans
from ._optimizers import FROLS, SR3, STLSQ
from ._pwa import PWARegressor

# -- identification

# -- statistics

# -- tables

__all__ = [
    "__version__",
    "exceptions",
    "set_threads",
    "thread_count",
    # -- lars
    "Lars",
    "LassoLars",
    "LassoLarsCV",
    "LassoLarsIC",
    "lars_path",
    "lars_path_gram",
    # -- lasso
    # -- clusters and thresholds
    "FROLS",
    "KMeans",
    "PWARegressor",
    "SR3",
    "STLSQ",
    # -- identification
    # -- statistics
    # -- tables
]
