"""fleetfoot: robot logs to equations."""

from . import exceptions
from ._core import VERSION as __version__
from ._core import thread_count
from ._threads import set_threads

# -- lars
from ._lars import lars_path, lars_path_gram
from ._lars_models import Lars, LassoLars
from ._lars_select import LassoLarsCV, LassoLarsIC

# -- lasso
from ._bolasso import Bolasso
from ._coordinate_cv import ElasticNetCV, LassoCV
from ._coordinate_descent import ElasticNet, Lasso, enet_path, lasso_path
from ._group_cv import GroupLassoCV, SparseGroupLassoCV
from ._group_lasso import GroupLasso, SparseGroupLasso

# -- clusters and thresholds
from ._frols import FROLS
from ._kmeans import KMeans
from ._pwa_regressor import PWARegressor
from ._sr3 import SR3
from ._stlsq import STLSQ

# -- identification
from ._block_sparse import BlockSparse
from ._controller import Controller
from ._model import Model
from ._model_files import import_model, load
from ._narx import NARX
from ._network import Network
from ._parameters import Parameters
from ._pwa import PWA
from ._sindy import SINDy
from ._warnings import FleetfootWarning

# -- statistics
from . import distributed
from ._episodes import Episode
from ._solution import Certificate, Solution
from ._stats import Plan, Stats, merge, scan

# -- tables
from . import plot
from ._compare import Comparison, compare
from ._data import Dataset
from ._data import open as open  # noqa: A004
from ._auto import Auto, auto
from ._check import Checked, Finding, check
from ._frequency import frequency
from ._relations import correlations, lag_curve
from ._prepare import Prepared, prepare
from ._read import Generated, Table, generate, info, read, read_mcap, robots, world
from ._report import report

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
    "Bolasso",
    "ElasticNet",
    "ElasticNetCV",
    "GroupLasso",
    "GroupLassoCV",
    "Lasso",
    "LassoCV",
    "SparseGroupLasso",
    "SparseGroupLassoCV",
    "enet_path",
    "lasso_path",
    # -- clusters and thresholds
    "FROLS",
    "KMeans",
    "PWARegressor",
    "SR3",
    "STLSQ",
    # -- identification
    "NARX",
    "PWA",
    "BlockSparse",
    "Controller",
    "FleetfootWarning",
    "Model",
    "Network",
    "Parameters",
    "SINDy",
    "import_model",
    "load",
    # -- statistics
    "Certificate",
    "Episode",
    "Plan",
    "Solution",
    "Stats",
    "distributed",
    "merge",
    "scan",
    # -- tables
    "Checked",
    "Comparison",
    "Dataset",
    "Finding",
    "Generated",
    "Prepared",
    "Table",
    "Auto",
    "auto",
    "check",
    "compare",
    "correlations",
    "frequency",
    "generate",
    "info",
    "lag_curve",
    "plot",
    "prepare",
    "read",
    "read_mcap",
    "report",
    "robots",
    "world",
]
