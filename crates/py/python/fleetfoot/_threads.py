"""How many threads calls use."""

from __future__ import annotations

from . import _core
from ._values import count as whole


def set_threads(count: int) -> None:
    """Sets the number of threads of all following calls; results do not depend on it.

    Parameters
    ----------
    count : int
        Threads; 0 for as many as there are cores, as at first.

    Raises
    ------
    RequestError
        No whole number, or more threads than can be.

    Examples
    --------
    >>> import fleetfoot as ff
    >>> ff.set_threads(2)
    >>> ff.thread_count()
    2
    >>> ff.set_threads(0)
    """
    _core.set_threads(whole("count", count, 0))
