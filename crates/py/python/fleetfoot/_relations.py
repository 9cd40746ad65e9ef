"""Correlations of columns, and the lag of a response: ``info --correlation`` and ``info --lag`` in Python."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from . import _core, _recipe
from ._data import open as open_data
from ._progress import Progress, reporting
from ._values import count, names_of
from ._warnings import tell_all


def correlations(
    data: Any, columns: Sequence[str] | None = None, *, recipe: Any = None, progress: Progress = None
) -> dict[str, Any]:
    """Pearson correlation of every pair of columns.

    Parameters
    ----------
    data : anything that :func:`fleetfoot.open` takes
        Recordings.
    columns : list of str, optional
        The columns; default: all that are numbers.
    recipe : path, str or mapping, optional
        Recipe of the columns.
    progress : bool or callable, optional
        ``True`` for a bar of tqdm, or a function of (stage, done, total).

    Returns
    -------
    dict
        ``columns``, ``matrix`` (``None`` for a column that does not move), ``rows``, ``notes``.

    Raises
    ------
    DataError, RequestError

    Examples
    --------
    >>> import fleetfoot as ff
    >>> found = ff.correlations(ff.open({"a": [1.0, 2.0, 4.0], "b": [-1.0, -2.0, -4.0]}, dt=0.1))
    >>> found["matrix"][0][1]
    -1.0
    """
    dataset = open_data(data, recipe=recipe)
    text = _recipe.to_json(_recipe.of_toml(dataset.recipe))
    with reporting(progress) as callback:
        named = None if columns is None else names_of(columns)
        report: dict[str, Any] = _core.correlations(dataset._core, text, named, callback)
    tell_all(report["notes"])
    return report


def lag_curve(
    data: Any, reference: str, response: str, *, reach: int = 100, recipe: Any = None, progress: Progress = None
) -> dict[str, Any]:
    """Difference of a response from its reference, by the rows by which it is shifted.

    Parameters
    ----------
    data : anything that :func:`fleetfoot.open` takes
        Recordings.
    reference, response : str
        Columns.
    reach : int
        Largest shift, in rows, either way.
    recipe : path, str or mapping, optional
        Recipe of the columns.
    progress : bool or callable, optional
        ``True`` for a bar of tqdm, or a function of (stage, done, total).

    Returns
    -------
    dict
        ``shifts``, each with ``rows``, ``seconds``, ``pairs``, ``difference`` (mean absolute), ``deviation`` and
        ``correlation``; ``nearest`` and ``alike``: the shift of the least difference, and of the largest correlation.

    Raises
    ------
    DataError, RequestError

    Examples
    --------
    >>> import numpy as np, fleetfoot as ff
    >>> r = np.random.default_rng(1).normal(size=500)
    >>> found = ff.lag_curve(ff.open({"r": r, "v": np.roll(r, 7)}, dt=0.01), "r", "v", reach=20)
    >>> found["nearest"], found["alike"]
    (7, 7)
    """
    dataset = open_data(data, recipe=recipe)
    text = _recipe.to_json(_recipe.of_toml(dataset.recipe))
    with reporting(progress) as callback:
        curve: dict[str, Any] = _core.lag_curve(
            dataset._core, text, reference, response, count("reach", reach, 1), callback
        )
    tell_all(curve["notes"])
    return curve


__all__ = ["correlations", "lag_curve"]
