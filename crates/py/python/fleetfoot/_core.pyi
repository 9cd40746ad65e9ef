"""The engine: what the package is built on. Not for direct use."""

from collections.abc import Callable, Sequence
from os import PathLike
from typing import Any, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from ._bolasso import BolassoRequest
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

@final
class Problems:
    @staticmethod
    def of(design: Design, groups: Sequence[int] | None, intercept: bool) -> Problems: ...
    @staticmethod
    def products(
        gram: NDArray[np.float64], xy: NDArray[np.float64], yy: NDArray[np.float64], rows: float
    ) -> Problems: ...
    def __len__(self) -> int: ...
    def deviation(self, target: int) -> float: ...
    def largest_alpha(self, target: int, positive: bool) -> float: ...
    def descend(
        self,
        target: int,
        alphas: NDArray[np.float64],
        l1_ratio: float,
        positive: bool,
        start: NDArray[np.float64] | None,
        max_epochs: int,
    ) -> tuple[
        NDArray[np.float64],
        NDArray[np.float64],
        NDArray[np.float64],
        NDArray[np.float64],
        list[int],
        NDArray[np.bool_],
    ]: ...
    def criterion_alpha(self, target: int, positive: bool, criterion: str) -> float: ...
    def refit(self, target: int, support: Sequence[int], positive: bool) -> tuple[NDArray[np.float64], float]: ...

def bolasso(
    x: Any, y: Any, weights: NDArray[np.float64] | None, request: BolassoRequest, progress: Progress = None
) -> tuple[
    NDArray[np.float64],
    NDArray[np.float64],
    NDArray[np.float64],
    NDArray[np.float64],
    float,
    int,
    int,
]: ...
def row_counts(seed: int, lengths: Sequence[int], replicates: int) -> NDArray[np.float64]: ...
def unit_counts(seed: int, units: int, replicates: int) -> NDArray[np.float64]: ...
def fold_errors(
    folds: Sequence[tuple[Design, list[int], list[int]]],
    alphas: NDArray[np.float64],
    intercept: bool,
    l1_ratio: float,
    positive: bool,
    max_epochs: int,
    progress: Progress = None,
) -> tuple[NDArray[np.float64], list[int]]: ...

# -- clusters and thresholds

# -- identification

# -- statistics

# -- tables
