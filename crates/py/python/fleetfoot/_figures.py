"""What ``model.plot()``, ``comparison.plot()`` and ``data.plot()`` draw, with matplotlib."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from . import _core
from ._data import Dataset
from ._data import open as open_data
from ._progress import Progress, reporting

#: Half the width of a 95 % interval, in standard errors.
_TWO_SIDED = 1.96
#: Names longer than this are cut.
_LONG = 40


def axes_of(ax: Any) -> Any:
    """The axes that are given, else new ones."""
    return pyplot().subplots(layout="constrained")[1] if ax is None else ax


def pyplot() -> Any:
    """matplotlib, imported when the first picture is drawn."""
    try:
        import matplotlib.pyplot as plt
    except ImportError as error:
        raise ImportError("fleetfoot.plot needs matplotlib: pip install matplotlib") from error
    return plt


def short(name: str) -> str:
    """A name that has room beside an axis."""
    return name if len(name) <= _LONG else name[: _LONG - 1] + "…"


def coefficients(
    model: Any,
    *,
    target: int | str = 0,
    region: int = 0,
    most: int = 30,
    ax: Any = None,
) -> Any:
    """The coefficients of one equation, with 95 % intervals where the fit knows them.

    Parameters
    ----------
    model : Model or estimator
        A model, or a fitted estimator with ``model_``. A model's file has no standard errors; those of ``SINDy``,
        ``NARX`` and ``BlockSparse`` are in their ``report_``.
    target : int or str
        Which output, or latent function.
    region : int
        Which region.
    most : int
        Functions shown, in the order of the library; of more those with the largest coefficients.
    ax : matplotlib.axes.Axes, optional
        Where to draw.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    ValueError
        No such target or region.
    ImportError
        matplotlib is not installed.

    Examples
    --------
    >>> import numpy as np, fleetfoot as ff
    >>> x = np.cumsum(np.random.default_rng(0).normal(size=(500, 2)), axis=0)
    >>> ax = ff.plot.coefficients(ff.PWA(1).fit(x, dt=0.1, feature_names=["a", "b"]), target="d(b)/dt")
    >>> ax.get_title()
    'd(b)/dt'
    """
    inner = getattr(model, "model_", model)
    content = inner.content
    names = [*inner.outputs, *(latent["name"] for latent in content.latents)]
    place = names.index(target) if isinstance(target, str) and target in names else target
    if not isinstance(place, (int, np.integer)) or not 0 <= place < len(names):
        raise ValueError(f"target={target!r} is none of {', '.join(names)}")
    latent = _latent(inner, int(place), names)
    if not 0 <= region < len(latent["constants"]):
        raise ValueError(f"region={region}: the model has the regions 0 to {len(latent['constants']) - 1}")
    errors = _standard_errors(getattr(model, "report_", None), names[place], latent["name"], region)
    values = [("1", float(latent["constants"][region]))]
    values += zip(content.libraries[latent["library"]], map(float, latent["coefficients"][region]))
    shown = [(name, value) for name, value in values if value != 0.0]
    least = sorted((abs(value) for _, value in shown), reverse=True)[: max(1, most)]
    shown = [(name, value) for name, value in shown if abs(value) >= least[-1]]
    ax = axes_of(ax)
    half = [_TWO_SIDED * errors.get(name, math.nan) for name, _ in shown]
    ax.axvline(0.0, color="0.6", lw=0.8)
    ax.errorbar([value for _, value in shown], range(len(shown)), xerr=half, fmt="o", ms=4, capsize=3)
    ax.set_yticks(range(len(shown)), [short(name) for name, _ in shown])
    ax.set_ylim(len(shown) - 0.5, -0.5)
    known = any(math.isfinite(width) for width in half)
    ax.set_xlabel("coefficient, 95 % interval" if known else "coefficient")
    several = len(latent["constants"]) > 1
    ax.set_title(f"{names[place]}, region {inner.regions[region]}" if several else names[place])
    return ax


def _latent(model: Any, place: int, names: list[str]) -> dict[str, Any]:
    """The function that a target is, or a latent by its name."""
    content = model.content
    if place >= len(model.outputs):
        found: dict[str, Any] = content.latent(names[place])
        return found
    latent = content.own_latent(content.fitted()[place])
    if latent is None:
        listed = ", ".join(names[len(model.outputs) :])
        raise ValueError(f"{names[place]} is a formula of {listed}; name one of these")
    own: dict[str, Any] = latent
    return own


def _standard_errors(report: Any, target: str, latent: str, region: int) -> dict[str, float]:
    """Standard errors by function, as the report of a fit tells them."""
    if not isinstance(report, dict):
        return {}
    terms: list[dict[str, Any]] = []
    regions = report.get("regions")
    if isinstance(regions, list) and region < len(regions) and isinstance(regions[region], dict):
        equations = regions[region].get("equations", [])
        terms = [term for one in equations if one.get("label") == target for term in one["terms"]]
    if isinstance(report.get("latents"), list) and not terms:
        terms = [term for one in report["latents"] if one.get("name") == latent for term in one.get("functions", [])]
    found = {str(term["function"]): term.get("standard_error") for term in terms}
    return {name: float(error) for name, error in found.items() if error is not None}


def prediction(
    model: Any,
    data: Any,
    *,
    target: int | str = 0,
    episode: int | str = 0,
    recipe: Any = None,
    ax: Any = None,
    progress: Progress = None,
) -> Any:
    """Measured values over time, and what the model predicts one step ahead.

    Parameters
    ----------
    model : Model or estimator
        A model, or a fitted estimator with ``model_``.
    data : path, table, array, Dataset, ...
        Rows to show, as in :func:`fleetfoot.open`.
    target : int or str
        Which output.
    episode : int or str
        Which episode.
    recipe : path, str or mapping, optional
        Changes of clock, topics or labels for these data.
    ax : matplotlib.axes.Axes, optional
        Where to draw.
    progress : bool or callable, optional
        ``True`` for a bar of tqdm, or a function of (stage, done, total).

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    ValueError
        No such target or episode.
    ImportError
        matplotlib is not installed.
    """
    inner = getattr(model, "model_", model)
    dataset = data if isinstance(data, Dataset) else open_data(data, recipe=recipe)
    found = inner.predict(dataset, recipe=recipe, progress=progress)
    column = _place("target", target, found["targets"])
    shown = found["episode"] == _place("episode", episode, found["episodes"])
    stamp = found["stamp"][shown]
    time = (stamp - stamp[:1]) * 1e-9
    ax = axes_of(ax)
    ax.plot(time, found["measured"][shown, column], color="0.25", lw=1.2, label="measured")
    ax.plot(time, found["predicted"][shown, column], color="tab:blue", lw=1.2, label="predicted")
    unit = next((one["unit"] for one in inner.content.fitted() if one["unit"]), None)
    unit = inner.content.fitted()[column]["unit"] if column < len(inner.content.fitted()) else unit
    ax.set_xlabel("time since the start of the episode [s]")
    ax.set_ylabel(f"{found['targets'][column]} [{unit}]" if unit else found["targets"][column])
    ax.legend(fontsize="small", frameon=False)
    return ax


def _place(what: str, wanted: int | str, names: Sequence[str]) -> int:
    if isinstance(wanted, str) and wanted in names:
        return list(names).index(wanted)
    if isinstance(wanted, (int, np.integer)) and 0 <= wanted < len(names):
        return int(wanted)
    raise ValueError(f"{what}={wanted!r} is none of {', '.join(names)}")


def channels(
    data: Any,
    *,
    columns: Sequence[str] | None = None,
    recipe: Any = None,
    most: int = 12,
    ax: Any = None,
    progress: Progress = None,
) -> Any:
    """Channels over time, one below the other; gaps between the episodes of a log are shaded.

    Parameters
    ----------
    data : path, table, array, Dataset, ...
        As in :func:`fleetfoot.open`.
    columns : list of str, optional
        Columns, or expressions over them; the recipe's states and inputs, else all, when not given.
    recipe : path, str or mapping, optional
        Which fields are what.
    most : int
        Channels shown, where no columns are named.
    ax : sequence of matplotlib.axes.Axes, optional
        Where to draw: as many as there are channels.
    progress : bool or callable, optional
        ``True`` for a bar of tqdm, or a function of (stage, done, total).

    Returns
    -------
    array of matplotlib.axes.Axes
        One a channel.

    Raises
    ------
    ValueError
        Not as many axes as channels, or no channel.
    ImportError
        matplotlib is not installed.

    Examples
    --------
    >>> import numpy as np, fleetfoot as ff
    >>> t = np.concatenate([np.arange(100), np.arange(300, 400)]) * 0.01
    >>> data = ff.open({"t": t, "q": np.sin(t)}, t="t")
    >>> [axes.get_ylabel() for axes in ff.plot.channels(data)]
    ['q']
    """
    plt = pyplot()
    dataset = data if isinstance(data, Dataset) and recipe is None else open_data(data, recipe=recipe)
    wanted = None if columns is None else [str(column) for column in columns]
    with reporting(progress) as callback:
        table = _core.read_table(dataset._core, dataset.recipe, wanted, None, None, None, callback)
    # Before the channels there are the episode, the stamp, and the seconds where no channel is called so.
    names = [name for name in table.columns if name not in ("episode", "stamp")]
    names = wanted if wanted is not None else [name for name in names if name not in ("t", "seconds")][: max(1, most)]
    if not names:
        raise ValueError("there is no channel to draw: name columns")
    if ax is None:
        size = (7.0, 1.2 + 1.3 * len(names))
        ax = plt.subplots(len(names), sharex=True, squeeze=False, layout="constrained", figsize=size)[1][:, 0]
    drawn = np.atleast_1d(np.asarray(ax, dtype=object)).ravel()
    if len(drawn) != len(names):
        raise ValueError(f"ax has {len(drawn)} axes for {len(names)} channels ({', '.join(names)})")
    logs = list(_logs(table))
    for one, name in zip(drawn, names):
        values = np.asarray(table[name], dtype=float)
        for at, (_, episodes) in enumerate(logs):
            for time, rows in episodes:
                one.plot(time, values[rows], color=f"C{at % 10}", lw=1.0)
            for (before, _), (after, _) in zip(episodes, episodes[1:]):
                one.axvspan(before[-1], after[0], color="0.9", lw=0, zorder=0)
        unit = table.units.get(name)
        one.set_ylabel(f"{short(name)} [{unit}]" if unit else short(name))
    drawn[-1].set_xlabel("time since the start of the log [s]")
    if 1 < len(logs) <= 10:
        for at, (name, _) in enumerate(logs):
            drawn[0].plot([], [], color=f"C{at}", label=short(name))
        drawn[0].legend(fontsize="small", frameon=False)
    return drawn


def _logs(table: Any) -> Iterator[tuple[str, list[tuple[Any, slice]]]]:
    """Logs with their episodes: seconds since the log's start, and the rows."""
    episode = np.asarray(table["episode"], dtype=object)
    stamp = np.asarray(table["stamp"]).astype("datetime64[ns]").astype(np.int64)
    starts = [0, *(np.flatnonzero(episode[1:] != episode[:-1]) + 1), len(episode)] if len(episode) else [0]
    logs: dict[str, list[slice]] = {}
    for first, last in zip(starts, starts[1:]):
        # The episodes of a log are called log#1, log#2, ...
        logs.setdefault(str(episode[first]).rpartition("#")[0] or str(episode[first]), []).append(slice(first, last))
    for name, parts in logs.items():
        begin = stamp[parts[0].start]
        yield name, [((stamp[rows] - begin) * 1e-9, rows) for rows in parts]


def comparison(found: Any, *, target: str | None = None, ax: Any = None) -> Any:
    """Errors of the models of a comparison, with 95 % intervals across the groups.

    Parameters
    ----------
    found : Comparison
        What :func:`fleetfoot.compare` gives.
    target : str, optional
        One target, in its unit; all of them, over the error of the null model, when not given.
    ax : matplotlib.axes.Axes, optional
        Where to draw.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    ValueError
        No such target.
    ImportError
        matplotlib is not installed.
    """
    targets = list(found.targets) if target is None else [target]
    if target is not None and target not in found.targets:
        raise ValueError(f"target={target!r} is none of {', '.join(found.targets)}")
    cells = {(row["model"], row["target"]): row for row in found.table}
    ax = axes_of(ax)
    models = [name for name in found.models if target is not None or name != "null"]
    step = 0.8 / max(1, len(models))
    for at, model in enumerate(models):
        rows = [cells[model, one] for one in targets]
        over = [1.0 if target is not None else cells["null", one]["rmse"] for one in targets]
        values = np.array([row["rmse"] / scale for row, scale in zip(rows, over)])
        ends = np.array([[row["low"] / scale, row["high"] / scale] for row, scale in zip(rows, over)])
        places = np.arange(len(targets)) - 0.4 + (at + 0.5) * step
        # An interval that is not known has no ends.
        reach = np.nan_to_num(np.abs(ends - values[:, None]).T, nan=0.0)
        ax.errorbar(values, places, xerr=reach, fmt="o", ms=4, capsize=3, label=model, color=f"C{at % 10}")
    ax.set_yticks(range(len(targets)), [short(one) for one in targets])
    ax.set_ylim(len(targets) - 0.5, -0.5)
    unit = found.units.get(target) if target is not None else None
    if target is None:
        ax.axvline(1.0, color="black", lw=0.8, ls="--", label="null")
    ax.set_xlim(left=0.0)
    ax.set_xlabel("RMSE over the null model's" if target is None else f"RMSE [{unit}]" if unit else "RMSE")
    ax.legend(fontsize="small", frameon=False)
    return ax
