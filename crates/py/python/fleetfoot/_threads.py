"""Number of threads."""

from __future__ import annotations

from . import _core
from ._values import count as whole


def set_threads(count: int) -> None:
    """Sets the number of threads of all following calls; results do not depend on it.

    Parameters
    ----------
    count : int
        Number of threads; 0, the initial value, for one per core.

    Raises
    ------
    RequestError
        The count is not a whole number, or too large.

    Examples
    --------
    >>> import fleetfoot as ff
    >>> ff.set_threads(2)
    >>> ff.thread_count()
    2
    >>> ff.set_threads(0)
    """
    _core.set_threads(whole("count", count, 0))
