"""The engine: what the package is built on. Not for direct use."""

from collections.abc import Callable, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, TypeAlias, final

import numpy as np

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

# -- lasso

# -- clusters and thresholds

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

def recipe(
    text: str,
    origin: str = "the recipe",
    is_json: bool = False,
    clock: str | None = None,
    unit: str | None = None,
    dt: float | None = None,
) -> str: ...
