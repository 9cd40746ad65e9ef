"""fleetfoot: robot logs to equations."""

from . import exceptions
from ._core import VERSION as __version__
from ._core import set_threads, thread_count

# -- lars

# -- lasso
from ._bolasso import Bolasso
from ._coordinate_cv import ElasticNetCV, LassoCV
from ._coordinate_descent import ElasticNet, Lasso, enet_path, lasso_path

# -- clusters and thresholds

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
    "Bolasso",
    "ElasticNet",
    "ElasticNetCV",
    "Lasso",
    "LassoCV",
    "enet_path",
    "lasso_path",
    # -- clusters and thresholds
    # -- identification
    # -- statistics
    # -- tables
]
