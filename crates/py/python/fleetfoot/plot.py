"""Figures with matplotlib, imported at the first figure: ``pip install matplotlib``.

Each function draws on an ``Axes``, a new one when none is given, and returns it.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np

from . import _core
from ._axes import axes_of, short
from ._data import Dataset
from ._data import open as open_data
from ._plot_paths import path, selection_frequency
from ._progress import Progress, reporting

__all__ = [
    "channels",
    "coefficients",
    "comparison",
    "horizon",
    "path",
    "prediction",
    "region_map",
    "selection_frequency",
]

#: Half the width of a 95 % interval, in standard errors.
_TWO_SIDED = 1.96


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
        Columns, or expressions over them; default: states and inputs of the recipe, else all.
    recipe : path, str or mapping, optional
        The recipe of the fields.
    most : int
        Largest number of channels, without ``columns``.
    ax : sequence of matplotlib.axes.Axes, optional
        Axes to draw on, one per channel.
    progress : bool or callable, optional
        ``True`` for a bar of tqdm, or a function of (stage, done, total).

    Returns
    -------
    array of matplotlib.axes.Axes
        One per channel.

    Raises
    ------
    ValueError
        The numbers of axes and channels differ, or there is no channel.
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
    dataset = data if isinstance(data, Dataset) and recipe is None else open_data(data, recipe=recipe)
    return dataset.plot(columns, most=most, ax=ax, progress=progress)


def coefficients(
    model: Any,
    *,
    target: int | str = 0,
    region: int = 0,
    most: int = 30,
    ax: Any = None,
) -> Any:
    """The coefficients of one equation, with 95 % intervals if available.

    Parameters
    ----------
    model : Model or estimator
        A model, or a fitted estimator with ``model_``. A model's file has no standard errors; those of ``SINDy``,
        ``NARX`` and ``BlockSparse`` are in their ``report_``.
    target : int or str
        Output, or latent function.
    region : int
        Region.
    most : int
        Largest number of functions, those with the largest coefficients, in the order of the library.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    ValueError
        An unknown target or region.
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
    values += zip(content.features(latent), content.weights(latent, region))
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
    """The function of a target, or a latent function by name."""
    content = model.content
    if place >= len(model.outputs):
        latent_entry: dict[str, Any] = content.latent(names[place])
        return latent_entry
    latent = content.latent_of(content.fitted()[place])
    if latent is None:
        listed = ", ".join(names[len(model.outputs) :])
        raise ValueError(f"{names[place]} is a formula of {listed}; name one of these")
    entry: dict[str, Any] = latent
    return entry


def _standard_errors(report: Any, target: str, latent: str, region: int) -> dict[str, float]:
    """Standard errors by function, from the report of a fit."""
    if not isinstance(report, dict):
        return {}
    terms: list[dict[str, Any]] = []
    regions = report.get("regions")
    if isinstance(regions, list) and region < len(regions) and isinstance(regions[region], dict):
        equations = regions[region].get("equations", [])
        terms = [term for one in equations if one.get("label") == target for term in one["terms"]]
    if isinstance(report.get("latents"), list) and not terms:
        terms = [term for one in report["latents"] if one.get("name") == latent for term in one.get("functions", [])]
    by_name = {str(term["function"]): term.get("standard_error") for term in terms}
    return {name: float(error) for name, error in by_name.items() if error is not None}


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
    """Measured values over time, and the one-step predictions of the model.

    Parameters
    ----------
    model : Model or estimator
        A model, or a fitted estimator with ``model_``.
    data : path, table, array, Dataset, ...
        Rows to show, as in :func:`fleetfoot.open`.
    target : int or str
        Output.
    episode : int or str
        Episode.
    recipe : path, str or mapping, optional
        Changes of clock, topics or labels for these data.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on.
    progress : bool or callable, optional
        ``True`` for a bar of tqdm, or a function of (stage, done, total).

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    ValueError
        An unknown target or episode.
    ImportError
        matplotlib is not installed.
    """
    inner = getattr(model, "model_", model)
    dataset = data if isinstance(data, Dataset) else open_data(data, recipe=recipe)
    predicted = inner.predict(dataset, recipe=recipe, progress=progress)
    column = _place("target", target, predicted["targets"])
    shown = predicted["episode"] == _place("episode", episode, predicted["episodes"])
    stamp = predicted["stamp"][shown]
    time = (stamp - stamp[:1]) * 1e-9
    ax = axes_of(ax)
    ax.plot(time, predicted["measured"][shown, column], color="0.25", lw=1.2, label="measured")
    ax.plot(time, predicted["predicted"][shown, column], color="tab:blue", lw=1.2, label="predicted")
    unit = next((one["unit"] for one in inner.content.fitted() if one["unit"]), None)
    unit = inner.content.fitted()[column]["unit"] if column < len(inner.content.fitted()) else unit
    ax.set_xlabel("time since the start of the episode [s]")
    ax.set_ylabel(f"{predicted['targets'][column]} [{unit}]" if unit else predicted["targets"][column])
    ax.legend(fontsize="small", frameon=False)
    return ax


def _place(what: str, wanted: int | str, names: Sequence[str]) -> int:
    if isinstance(wanted, str) and wanted in names:
        return list(names).index(wanted)
    if isinstance(wanted, (int, np.integer)) and 0 <= wanted < len(names):
        return int(wanted)
    raise ValueError(f"{what}={wanted!r} is none of {', '.join(names)}")


def comparison(found: Any, *, target: str | None = None, ax: Any = None) -> Any:
    """Errors of the models of a comparison, with 95 % intervals across the groups.

    Parameters
    ----------
    found : Comparison
        Result of :func:`fleetfoot.compare`.
    target : str, optional
        One target, in its unit; default: all targets, relative to the null model.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    ValueError
        An unknown target.
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


def horizon(
    rollout: Any,
    *,
    state: str | None = None,
    unit: str | None = None,
    baselines: bool = True,
    label: str = "model",
    ax: Any = None,
) -> Any:
    """The error of rollouts against the time since their start.

    Parameters
    ----------
    rollout : dict
        Result of ``Model.rollout``.
    state : str, optional
        State whose RMSE is drawn; default: the Mahalanobis score of all states, with its 95 % interval.
    unit : str, optional
        The state's unit.
    baselines : bool
        Draw the baselines too.
    label : str
        Name of the model.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    TypeError
        The argument is not a rollout.
    ValueError
        An unknown state.
    ImportError
        matplotlib is not installed.

    Examples
    --------
    >>> from fleetfoot import plot
    >>> report = {"time": [0.1, 0.2], "states": ["v"], "model": {"rmse": [[0.1], [0.2]]}, "baselines": {}}
    >>> plot.horizon(report, state="v", unit="m/s").get_ylabel()
    'RMSE of v [m/s]'
    """
    if not isinstance(rollout, dict) or not {"time", "states", "model", "baselines"} <= rollout.keys():
        raise TypeError(f"{type(rollout).__name__} is no rollout; give what Model.rollout returns")
    time = np.asarray(rollout["time"], dtype=float)
    curves = [(label, rollout["model"])] + (list(rollout["baselines"].items()) if baselines else [])
    place = None
    if state is not None:
        if state not in rollout["states"]:
            raise ValueError(f"state={state!r} is none of {', '.join(rollout['states'])}")
        place = rollout["states"].index(state)
    ax = axes_of(ax)
    for at, (name, score) in enumerate(curves):
        style: dict[str, Any] = (
            {"lw": 2.0, "color": "tab:blue"} if at == 0 else {"lw": 1.2, "ls": "--", "color": f"C{at}"}
        )
        if place is not None:
            ax.plot(time, np.asarray(score["rmse"], dtype=float)[:, place], label=name, **style)
            continue
        bands = np.asarray(score["mahalanobis"], dtype=float)
        ax.plot(time, bands[:, 0], label=name, **style)
        ax.fill_between(time, bands[:, 1], bands[:, 2], color=style["color"], alpha=0.15, lw=0)
    ax.set_xlabel("time since the start [s]")
    ax.set_ylabel(f"RMSE of {state}" + (f" [{unit}]" if unit else "") if state else "Mahalanobis score [1]")
    ax.set_xlim(left=0.0)
    ax.set_ylim(bottom=0.0)
    ax.legend(fontsize="small", frameon=False)
    return ax


_VALUES = {
    "transitions": "share of passages with a change of region [1]",
    "score": "mean Mahalanobis score of one step [1]",
    "rows": "rows",
}


def region_map(
    model: Any,
    data: Any,
    x: str,
    y: str,
    *,
    value: Literal["region", "transitions", "score", "rows"] = "region",
    bins: int = 60,
    recipe: Any = None,
    ax: Any = None,
    progress: Progress = None,
) -> Any:
    """Regions of a model, or its errors, on the plane of two columns.

    Parameters
    ----------
    model : Model or estimator
        A model, or a fitted estimator with ``model_``.
    data : path, table, array, Dataset, ...
        Rows to show, as in :func:`fleetfoot.open`.
    x, y : str
        Columns of the model, or expressions over them; for ``value="region"`` columns.
    value : {"region", "transitions", "score", "rows"}
        Quantity of the colour: the region of most rows of the cell; the share of passages through the cell in which
        the region changes; the mean Mahalanobis score of the one-step errors; or the number of rows.
    bins : int
        Cells along each axis.
    recipe : path, str or mapping, optional
        Changes of clock, topics or labels for these data.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on.
    progress : bool or callable, optional
        ``True`` for a bar of tqdm, or a function of (stage, done, total).

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    ValueError
        An unknown column, or an unknown ``value``.
    ImportError
        matplotlib is not installed.

    Examples
    --------
    >>> import numpy as np, fleetfoot as ff
    >>> x = np.cumsum(np.random.default_rng(0).normal(size=(500, 2)), axis=0)
    >>> data = ff.open({("a", "b"): x}, dt=0.1, recipe={"states": {"a": {}, "b": {}}})
    >>> ax = ff.plot.region_map(ff.PWA(3).fit(data), data, "a", "b", bins=20)
    >>> ax.get_xlabel(), ax.get_ylabel()
    ('a', 'b')
    """
    if value != "region" and value not in _VALUES:
        raise ValueError(f'value={value!r}: write "region", {", ".join(repr(name) for name in _VALUES)}')
    if not 1 <= bins <= 1000:
        raise ValueError(f"bins={bins}: give 1 to 1000")
    ax = axes_of(ax)
    inner = getattr(model, "model_", model)
    dataset = open_data(data, recipe=recipe)
    text = inner.to_json()
    with reporting(progress) as callback:
        plane = _core.project(text, dataset._core, dataset.recipe, x, y, int(bins), callback)
        rows = _core.read_model_rows(text, dataset._core, dataset.recipe, callback) if value == "region" else None
    extent = (*plane["x"][:2], *plane["y"][:2])
    if rows is None:
        cells = np.asarray(plane[value]).reshape(bins, bins).T
        cells = np.where(np.asarray(plane["rows"]).reshape(bins, bins).T > 0, cells, np.nan)
        image = ax.imshow(cells, origin="lower", extent=extent, aspect="auto", interpolation="nearest", cmap="viridis")
        ax.figure.colorbar(image, ax=ax, label=_VALUES[value])
    else:
        _regions(ax, rows, (x, y), plane, bins, extent)
    units = _units_of(inner)
    ax.set_xlabel(_labelled(x, units))
    ax.set_ylabel(_labelled(y, units))
    return ax


def _regions(
    ax: Any, rows: dict[str, Any], axes: tuple[str, str], plane: dict[str, Any], bins: int, extent: Any
) -> None:
    """Region of most rows in each cell."""
    from matplotlib.colors import BoundaryNorm, ListedColormap
    from matplotlib.pyplot import get_cmap

    cells = []
    for name, key in zip(axes, ("x", "y")):
        if name not in rows["columns"]:
            raise ValueError(
                f"{name!r} is no column of the model ({', '.join(rows['columns'])}); "
                'value="transitions" takes expressions'
            )
        low, high, periodic = plane[key]
        values = rows["columns"][name][1]
        offset = np.mod(values - low, high - low) if periodic else values - low
        with np.errstate(invalid="ignore"):
            cells.append(np.floor(offset / (high - low) * bins))
    region = rows["region"]
    inside = (region >= 0) & np.logical_and.reduce([(cell >= 0) & (cell < bins) for cell in cells])
    if not inside.any():
        raise ValueError("no row of these data is in a region of the model")
    place = (cells[1][inside] * bins + cells[0][inside]).astype(np.int64)
    seen, which = np.unique(region[inside], return_inverse=True)
    counts = np.zeros((bins * bins, len(seen)), dtype=np.int64)
    np.add.at(counts, (place, which), 1)
    shown = np.where(counts.any(axis=1), counts.argmax(axis=1), -1).reshape(bins, bins)
    palette = get_cmap("tab20" if len(seen) > 10 else "tab10")
    colours = ListedColormap([palette(at % palette.N) for at in range(len(seen))])
    norm = BoundaryNorm(np.arange(len(seen) + 1) - 0.5, len(seen))
    masked_less: Any = np.ma.masked_less  # some versions of numpy give it no types
    image = ax.imshow(
        masked_less(shown, 0),
        origin="lower",
        extent=extent,
        aspect="auto",
        interpolation="nearest",
        cmap=colours,
        norm=norm,
    )
    bar = ax.figure.colorbar(image, ax=ax, label="region")
    step = max(1, -(-len(seen) // 20))
    bar.set_ticks(np.arange(0, len(seen), step), labels=[str(region) for region in seen[::step]])


def _units_of(model: Any) -> dict[str, str | None]:
    """Units of a model's columns, from its file."""
    content = json.loads(model.to_json())
    columns = content.get("columns") or content.get("model", {}).get("columns", [])
    return {column["name"]: column.get("unit") for column in columns}


def _labelled(name: str, units: dict[str, str | None]) -> str:
    unit = units.get(name)
    return f"{name} [{unit}]" if unit else name
