"""The engine: what the package is built on. Not for direct use."""

from collections.abc import Callable, Sequence
from os import PathLike
from typing import Any, TypeAlias, final

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

# -- statistics

# -- tables

def recipe(
    text: str,
    origin: str = "the recipe",
    is_json: bool = False,
    clock: str | None = None,
    unit: str | None = None,
    dt: float | None = None,
) -> str: ...
