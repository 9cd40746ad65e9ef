"""The engine: what the package is built on. Not for direct use."""

from collections.abc import Callable, Sequence
from os import PathLike
from typing import Any, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from ._lars import LarsRequest

Progress: TypeAlias = Callable[[str, int, int], object] | None

VERSION: str

def set_threads(count: int) -> None: ...
def thread_count() -> int: ...
@final
class Data:
    @staticmethod
    def files(patterns: Sequence[str | PathLike[str]]) -> Data: ...
    @staticmethod
    def arrays(runs: Sequence[tuple[str, Sequence[tuple[Any, Sequence[str]]]]]) -> Data: ...
    def joined(self, others: Sequence[Data]) -> Data: ...
    def names(self) -> list[str]: ...
    def __len__(self) -> int: ...

# -- lars

@final
class Design:
    def __new__(
        cls,
        x: Any,
        y: Any,
        weights: NDArray[np.float64] | None = None,
        labels: NDArray[np.uint32] | None = None,
        groups: int = 1,
        progress: Progress = None,
    ) -> Design: ...
    @property
    def shape(self) -> tuple[int, int, int, int]: ...
    def mean_squares(
        self,
        groups: Sequence[int] | None,
        target: int,
        coefficients: NDArray[np.float64],
        intercepts: NDArray[np.float64],
        progress: Progress = None,
    ) -> NDArray[np.float64]: ...

@final
class LarsPath:
    @property
    def alphas(self) -> NDArray[np.float64]: ...
    @property
    def coefficients(self) -> NDArray[np.float64]: ...
    @property
    def intercepts(self) -> NDArray[np.float64]: ...
    @property
    def mse(self) -> NDArray[np.float64]: ...
    @property
    def violations(self) -> NDArray[np.float64]: ...
    @property
    def active(self) -> list[int]: ...
    @property
    def collinear(self) -> list[int]: ...
    @property
    def stalled(self) -> bool: ...
    @property
    def interpolating(self) -> bool: ...

def lars_paths(
    design: Design, groups: Sequence[int] | None, intercept: bool, request: LarsRequest, progress: Progress = None
) -> list[LarsPath]: ...
def lars_path_of_products(gram: Any, xy: Any, yy: float | None, rows: float, request: LarsRequest) -> LarsPath: ...

# -- lasso

# -- clusters and thresholds

@final
class KMeansPoints:
    def __new__(cls, x: Any, weights: NDArray[np.float64] | None = None, progress: Progress = None) -> KMeansPoints: ...
    def plus_plus(
        self, clusters: int, draws: NDArray[np.float64], progress: Progress = None
    ) -> NDArray[np.float64]: ...
    def run(
        self, start: NDArray[np.float64], max_iter: int, tol: float, history: bool = False, progress: Progress = None
    ) -> tuple[NDArray[np.float64], float, int, bool, float, list[tuple[float, int, float]]]: ...

def kmeans_draws(clusters: int) -> int: ...
def kmeans_assign(
    x: Any, centroids: NDArray[np.float64], weights: NDArray[np.float64] | None = None, progress: Progress = None
) -> tuple[NDArray[np.int32], list[int], float]: ...
def kmeans_distances(x: Any, centroids: NDArray[np.float64], progress: Progress = None) -> NDArray[np.float64]: ...

class StlsqRequest(TypedDict):
    threshold: float
    alpha: float
    max_iter: int
    normalize: bool
    unbias: bool
    fixed: list[int]

class Sr3Request(TypedDict):
    regularizer: str
    nu: float
    tol: float
    max_iter: int
    normalize: bool
    unbias: bool

class FrolsRequest(TypedDict):
    max_terms: int
    alpha: float
    kappa: float
    normalize: bool
    unbias: bool

@final
class SparseModels:
    @property
    def coefficients(self) -> NDArray[np.float64]: ...
    @property
    def decided(self) -> NDArray[np.float64]: ...
    @property
    def history(self) -> NDArray[np.float64]: ...
    @property
    def relaxed(self) -> NDArray[np.float64]: ...
    @property
    def ratios(self) -> list[list[float]]: ...
    @property
    def iterations(self) -> int: ...
    @property
    def converged(self) -> bool: ...
    @property
    def empty(self) -> list[int]: ...

def stlsq(
    design: Design, request: StlsqRequest, initial: NDArray[np.float64] | None = None, progress: Progress = None
) -> SparseModels: ...
def sr3(
    design: Design,
    request: Sr3Request,
    weights: NDArray[np.float64],
    initial: NDArray[np.float64] | None = None,
    progress: Progress = None,
) -> SparseModels: ...
def frols(design: Design, request: FrolsRequest, progress: Progress = None) -> SparseModels: ...

class PwaRequest(TypedDict):
    partitions: str
    features: list[int]
    groups: list[int]
    folds: int
    shrinkage: float | None
    bic: bool
    seed: int
    restarts: int
    max_iter: int

class PwaRule(TypedDict):
    features: list[int]
    centre: list[float]
    scale: list[float]
    centroids: list[list[float]]
    radius: float | None

@final
class PwaFit:
    def __new__(cls, x: Any, y: Any, weights: Any | None, request: PwaRequest, progress: Progress = None) -> PwaFit: ...
    @property
    def coefficients(self) -> list[list[list[float]]]: ...
    @property
    def constants(self) -> list[list[float]]: ...
    @property
    def partition(self) -> str: ...
    @property
    def units(self) -> tuple[list[float], list[float]]: ...
    @property
    def centroids(self) -> list[list[float]]: ...
    @property
    def radius(self) -> float | None: ...
    @property
    def rows(self) -> list[int]: ...
    @property
    def candidates(self) -> list[tuple[str, int, float, float, list[float], list[float], float]]: ...
    @property
    def chosen(self) -> int: ...
    @property
    def notes(self) -> list[str]: ...

def pwa_regions(x: Any, rule: PwaRule) -> NDArray[np.int32]: ...

# -- identification

# -- statistics

# -- tables
