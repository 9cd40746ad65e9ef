"""fleetfoot: robot logs to equations."""

from . import exceptions
from ._core import VERSION as __version__
from ._core import set_threads, thread_count

# -- lars

# -- lasso

# -- clusters and thresholds

# -- identification
from ._block_sparse import BlockSparse
from ._model import Model, load
from ._narx import NARX
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
from ._data import Dataset, open  # noqa: A004
from ._read import Generated, Table, generate, info, read, read_mcap, robots, world

__all__ = [
    "__version__",
    "exceptions",
    "set_threads",
    "thread_count",
    # -- lars
    # -- lasso
    # -- clusters and thresholds
    # -- identification
    "NARX",
    "PWA",
    "BlockSparse",
    "FleetfootWarning",
    "Model",
    "SINDy",
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
    "Comparison",
    "Dataset",
    "Generated",
    "Table",
    "compare",
    "generate",
    "info",
    "open",
    "plot",
    "read",
    "read_mcap",
    "robots",
    "world",
]
