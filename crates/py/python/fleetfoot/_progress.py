"""Progress of long calls: a bar of ``tqdm``, or a function of the caller."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeAlias

Callback: TypeAlias = Callable[[str, int, int], object]
#: Values of ``progress=``: nothing, ``True`` for a bar, or a function of the stage's name, the pieces done and the
#: pieces in all (0: unknown).
Progress: TypeAlias = "bool | Callback | None"


class _Bar:
    """One bar of tqdm for each stage."""

    def __init__(self, bar: Any) -> None:
        self._new = bar
        self._bar: Any = None
        self._stage = ""

    def __call__(self, stage: str, done: int, total: int) -> None:
        if stage != self._stage:
            self.close()
            self._stage = stage
        if self._bar is None:
            self._bar = self._new(desc=stage or None, total=total or None, leave=False)
        if total and self._bar.total != total:
            self._bar.total = total
        self._bar.update(max(0, done - self._bar.n))

    def close(self) -> None:
        if self._bar is not None:
            self._bar.close()
            self._bar = None


@contextmanager
def reporting(progress: Progress) -> Iterator[Callback | None]:
    """The callback for the engine of ``progress=``.

    Parameters
    ----------
    progress : bool, callable or None
        ``None`` and ``False``: no progress. ``True``: a bar of ``tqdm``. A callable is called a few times a second
        from the waiting thread, with the stage's name, the pieces done and the number of pieces (0: unknown). An
        exception in it stops the work.

    Yields
    ------
    callable or None

    Raises
    ------
    ImportError
        ``progress=True`` and tqdm is not installed.
    TypeError
        ``progress`` is of another kind.

    Examples
    --------
    >>> with reporting(lambda stage, done, total: print(stage, done, total)) as callback:
    ...     callback("scan", 3, 4)
    scan 3 4
    """
    if progress is None or progress is False:
        yield None
    elif progress is True:
        try:
            from tqdm.auto import tqdm  # type: ignore[import-untyped, unused-ignore]
        except ImportError as error:
            raise ImportError(
                "progress=True needs tqdm: pip install tqdm, or give a function (stage, done, total)"
            ) from error
        bar = _Bar(tqdm)
        try:
            yield bar
        finally:
            bar.close()
    elif callable(progress):
        yield progress
    else:
        raise TypeError(f"progress={progress!r}: give True, or a function (stage, done, total), or None")
