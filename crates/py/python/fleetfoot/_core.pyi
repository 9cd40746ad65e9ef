"""The engine: what the package is built on. Not for direct use."""

from collections.abc import Callable, Sequence
from os import PathLike
from typing import Any, TypeAlias, TypedDict, final, overload

import numpy as np
from numpy.typing import NDArray
from pathlib import Path

import numpy as np

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
    @staticmethod
    def arrow(tables: Sequence[tuple[str, Sequence[Any]]]) -> Data: ...
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

class BolassoRequest(TypedDict):
    alphas: Sequence[float]
    scales: Sequence[float]
    intercept: bool
    positive: bool
    replicates: int
    seed: int
    unit: str
    block_length: int
    lengths: Sequence[int]

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

# -- identification

_History: TypeAlias = tuple[Any, Any] | None

@final
class Model:
    @staticmethod
    def read(path: str | PathLike[str]) -> Model: ...
    @staticmethod
    def from_json(text: str, name: str) -> Model: ...
    def to_json(self) -> str: ...
    def write(self, path: str | PathLike[str]) -> None: ...
    def hash(self) -> str: ...
    def describe(self, regions: int) -> str: ...
    def names(self) -> tuple[list[str], list[str], list[str]]: ...
    def facts(self) -> tuple[int, bool, bool, float]: ...
    def over_own_columns(self) -> Model: ...
    def step(
        self,
        x: Any,
        u: Any = None,
        dt: float | None = None,
        method_name: str = "rk4",
        history: _History = None,
        t: Any = None,
    ) -> np.ndarray[Any, np.dtype[np.float64]]: ...
    def right_sides(self, x: Any, u: Any = None, history: _History = None, t: Any = None) -> np.ndarray[Any, np.dtype[np.float64]]: ...
    def fitted(self, x: Any = None, u: Any = None, t: Any = None) -> tuple[np.ndarray[Any, np.dtype[np.float64]], np.ndarray[Any, np.dtype[np.int64]]]: ...
    def regions(self, x: Any, u: Any = None, history: _History = None, t: Any = None) -> tuple[np.ndarray[Any, np.dtype[np.int64]], bool]: ...
    def linearize(
        self,
        x: Any,
        u: Any = None,
        dt: float | None = None,
        method_name: str = "rk4",
        history: _History = None,
        t: Any = None,
    ) -> tuple[np.ndarray[Any, np.dtype[np.float64]], np.ndarray[Any, np.dtype[np.float64]], np.ndarray[Any, np.dtype[np.float64]]]: ...
    def simulate(
        self,
        x0: Any,
        t: Any,
        u: Any = None,
        method_name: str = "rk4",
        substeps: int = 1,
        history: _History = None,
        t0: float | None = None,
    ) -> np.ndarray[Any, np.dtype[np.float64]]: ...
    def export(
        self,
        target: str,
        folder: str | PathLike[str],
        prefix: str = "model",
        precision: str = "double",
        method_name: str = "rk4",
        dt: float | None = None,
        domain: bool = True,
    ) -> tuple[list[Path], int, list[str]]: ...
    @staticmethod
    def _of_bytes(bytes: bytes) -> Model: ...
    def __reduce__(self) -> tuple[Any, tuple[bytes]]: ...

def recipe_json(text: str, name: str) -> str: ...
def fit_pwa(
    data: Data,
    recipe_text: str,
    options: dict[str, Any],
    cache: str | PathLike[str] | None = None,
    progress: Progress = None,
) -> tuple[Model, str, list[Model]]: ...
def fit_sindy(
    data: Data,
    recipe_text: str,
    front: bool = False,
    cache: str | PathLike[str] | None = None,
    progress: Progress = None,
) -> tuple[Model, str, list[tuple[int, Model]]]: ...
def fit_narx(
    data: Data,
    recipe_text: str,
    other: Data | None = None,
    cache: str | PathLike[str] | None = None,
    progress: Progress = None,
) -> tuple[Model, str]: ...
def fit_sparse(
    data: Data,
    recipe_text: str,
    by: str | None = None,
    influence: bool = False,
    cache: str | PathLike[str] | None = None,
    progress: Progress = None,
) -> list[tuple[str | None, Model, str]]: ...
def score(
    model: Model,
    data: Data,
    recipe_text: str,
    cache: str | PathLike[str] | None = None,
    progress: Progress = None,
) -> str: ...
def predict_rows(
    model: Model,
    data: Data,
    recipe_text: str,
    cache: str | PathLike[str] | None = None,
    progress: Progress = None,
) -> dict[str, Any]: ...
def rollout(
    model: Model,
    data: Data,
    recipe_text: str,
    request: dict[str, Any],
    cache: str | PathLike[str] | None = None,
    progress: Progress = None,
) -> tuple[str, list[dict[str, Any]]]: ...

# -- statistics
@final
class Statistic:
    @staticmethod
    def freeze(
        recipe: str, data: Data, keys: Sequence[str], chunk_rows: int | None = None, progress: Progress = None
    ) -> tuple[Statistic, list[str]]: ...
    @staticmethod
    def scan(
        recipe: str, data: Data, keys: Sequence[str], chunk_rows: int | None = None, progress: Progress = None
    ) -> tuple[Statistic, list[str], list[str]]: ...
    def scan_with(
        self, data: Data, keys: Sequence[str], part: bool = False, progress: Progress = None
    ) -> tuple[Statistic, list[str], list[str]]: ...
    def plan(self) -> Statistic: ...
    @staticmethod
    def from_bytes(bytes: bytes) -> Statistic: ...
    def to_bytes(self) -> bytes: ...
    @staticmethod
    def read(path: str | PathLike[str]) -> Statistic: ...
    def write(self, path: str | PathLike[str]) -> None: ...
    def merged(self, others: Sequence[Statistic]) -> Statistic: ...
    def appended(self, others: Sequence[Statistic]) -> tuple[Statistic, list[str]]: ...
    def kept(self, identities: set[str]) -> Statistic: ...
    def compacted(self) -> Statistic: ...
    @property
    def hash(self) -> str: ...
    @property
    def text(self) -> str: ...
    @property
    def recipe(self) -> str: ...
    @property
    def chunk_rows(self) -> int: ...
    @property
    def chunks(self) -> int: ...
    @property
    def rows(self) -> tuple[int, int, int]: ...
    @property
    def tasks(self) -> list[str]: ...
    @property
    def latents(self) -> list[tuple[str, list[str]]]: ...
    @property
    def files(self) -> list[tuple[str, str, int]]: ...
    def episodes(self) -> list[dict[str, Any]]: ...
    def root(self, task: int) -> dict[str, Any]: ...
    def solve(self, recipe: str | None, strength: float | None, l1_ratio: float, progress: Progress = None) -> dict[str, Any]: ...
    def data(self) -> Data: ...
    def by_label(self) -> dict[str, dict[str, tuple[int, int]]]: ...

# -- tables
from typing import overload  # noqa: E402

def recipe(
    text: str,
    origin: str = "the recipe",
    is_json: bool = False,
    clock: str | None = None,
    unit: str | None = None,
    dt: float | None = None,
) -> str: ...
@final
class Table:
    @property
    def columns(self) -> list[str]: ...
    @property
    def units(self) -> dict[str, str | None]: ...
    @property
    def notes(self) -> list[str]: ...
    @property
    def shape(self) -> tuple[int, int]: ...
    def __len__(self) -> int: ...
    def __contains__(self, name: str, /) -> bool: ...
    @overload
    def __getitem__(self, key: str, /) -> Any: ...
    @overload
    def __getitem__(self, key: slice, /) -> Table: ...
    def __arrow_c_schema__(self) -> object: ...
    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object: ...
    def to_pyarrow(self) -> Any: ...
    def to_polars(self) -> Any: ...
    def to_pandas(self) -> Any: ...

def read_messages(
    path: str | PathLike[str], topic: str, fields: Sequence[str] | None = None, progress: Progress = None
) -> Table: ...
def topics(path: str | PathLike[str]) -> list[tuple[str, int | None]]: ...
def read_table(
    data: Data,
    recipe: str,
    columns: Sequence[str] | None = None,
    base: str | None = None,
    rate: float | None = None,
    stamp: str | None = None,
    progress: Progress = None,
) -> Table: ...
def read_model_rows(model: str, data: Data, recipe: str = "", progress: Progress = None) -> dict[str, Any]: ...
def student_t_95(freedom: int) -> float: ...
def info(path: str | PathLike[str], values: bool = False, progress: Progress = None) -> str: ...
def robots() -> list[str]: ...
def world(robot: str, text: str | None = None, settings: Sequence[tuple[str, str]] = ...) -> str: ...
def generate(
    robot: str,
    folder: str | PathLike[str],
    text: str | None,
    settings: Sequence[tuple[str, str]],
    wanted: dict[str, Any],
    progress: Progress = None,
) -> str: ...
def project(
    model: str, data: Data, recipe: str, x: str, y: str, bins: int, progress: Progress = None
) -> dict[str, Any]: ...
