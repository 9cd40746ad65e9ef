"""Search for a model of a log: the command ``auto`` in Python."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from . import _core, _recipe
from ._data import open as open_data
from ._model import Model
from ._progress import Progress, reporting
from ._warnings import warn


@dataclass(frozen=True)
class Auto:
    """Result of :func:`auto`.

    Attributes
    ----------
    model : Model
        The chosen model.
    linear : Model or None
        The linear model, unless it is the chosen one.
    sentences : list of str
        The fit, its error, its useful horizon, weak points, and recordings to make next.
    warning : str or None
        Set if the model is no better than persistence, the mean or the linear model.
    recipe : str
        The recipe (TOML) that gives the same result again.
    chosen : str
        The name of the chosen candidate.
    candidates : list of dict
        All candidates: ``name``, ``method``, ``coefficients``, ``error`` (held out, relative to persistence),
        ``standard_error``, ``folds``, ``reason``.
    tested : list of dict
        For each state the errors on the test rows: ``rmse`` (value, low, high), ``linear``, ``persistence``, ``mean``.
    horizon : dict
        ``steps`` and ``seconds`` of the simulations.
    split : dict
        ``training`` and ``test``: ``rows``, ``episodes``, ``seconds``.
    findings : list of dict
        Faults that :func:`check` found.
    outside, diverged : float
        Shares of the test simulations that leave the training range, and that diverge.
    notes : list of str
        Assumptions: columns that became states and inputs, and columns that were left out.
    """

    model: Model
    linear: Model | None
    sentences: list[str]
    warning: str | None
    recipe: str = field(repr=False)
    chosen: str
    candidates: list[dict[str, Any]] = field(repr=False)
    tested: list[dict[str, Any]]
    horizon: dict[str, Any]
    split: dict[str, Any]
    findings: list[dict[str, Any]]
    outside: float
    diverged: float
    notes: list[str]

    def __str__(self) -> str:
        first = [f"WARNING: {self.warning}"] if self.warning else []
        return "\n".join([*first, *self.sentences, *(f"note: {note}" for note in self.notes)])

    __repr__ = __str__


def auto(
    data: Any,
    *,
    recipe: Any = None,
    states: Sequence[str] | None = None,
    inputs: Sequence[str] | None = None,
    effort: str | None = None,
    horizon: int | None = None,
    output: str | os.PathLike[str] | None = None,
    force: bool = False,
    export_c: bool = False,
    progress: Progress = None,
) -> Auto:
    """Find a model of logs: draft the recipe, fit models by all methods, compare their simulations of held-out rows.

    The last fifth of every episode (of five episodes and more every fifth one) is held out for the test, whose errors
    are in ``tested``.

    Parameters
    ----------
    data : path, list of paths, DataFrame or Dataset
        The logs.
    recipe : path, str or dict, optional
        Known entries of the recipe; the rest is drafted from names and motion of the columns.
    states, inputs : list of str, optional
        Columns that the model advances, and columns that drive it.
    effort : {"low", "normal", "high"}, optional
        Search effort, by the number of kinds of models; ``"normal"`` by default.
    horizon : int, optional
        Steps of the simulations; by default the correlation time of the states.
    output : path, optional
        New folder for model, recipe and page; with ``force`` it may exist.
    force : bool, optional
        Replace the folder of an earlier result.
    export_c : bool, optional
        Also write the model as C into ``output``.
    progress : bool or callable, optional
        ``True`` for a bar of tqdm, or a function of (stage, done, total).

    Returns
    -------
    Auto

    Raises
    ------
    DataError
        Logs that cannot be read, or are too short.

    Examples
    --------
    >>> import numpy as np, fleetfoot as ff
    >>> t = np.arange(900) * 0.05
    >>> u = np.sign(np.sin(0.9 * t) + np.sin(2.3 * t))
    >>> v = np.zeros(900)
    >>> for k in range(899):
    ...     v[k + 1] = 0.9 * v[k] + 0.2 * u[k]
    >>> found = ff.auto(ff.open({"t": t, "v": v, "u": u}, t="t"), effort="low")
    >>> state = found.tested[0]
    >>> bool(state["rmse"][0] < 0.01 * state["persistence"])
    True
    """
    dataset = open_data(data, recipe=recipe)
    file_recipe = _recipe.of_toml(dataset.recipe)
    for name in states or ():
        file_recipe.setdefault("states", {}).setdefault(name, {})
    for name in inputs or ():
        file_recipe.setdefault("inputs", {}).setdefault(name, {})
    settings = _recipe.without_none(effort=effort, horizon=horizon)
    file_recipe = _recipe.override({"auto": settings} if settings else {}, file_recipe)
    with reporting(progress) as callback:
        model, linear, report, text = _core.auto(
            dataset._core,
            _recipe.to_json(file_recipe),
            None if output is None else os.fspath(output),
            force,
            export_c,
            callback,
        )
    if report["warning"]:
        warn(report["warning"])
    names = ("sentences", "warning", "chosen", "candidates", "tested", "horizon", "split", "findings", "outside", "diverged")
    return Auto(
        notes=report["notes"],
        model=Model(model),
        linear=None if linear is None else Model(linear),
        recipe=text,
        **{name: report[name] for name in names},
    )


__all__ = ["Auto", "auto"]
