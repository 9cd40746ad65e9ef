"""Axes and the channels of recordings, for :mod:`fleetfoot.plot` and ``Dataset.plot``."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from . import _core
from ._progress import Progress, reporting

#: Names longer than this are cut.
_LONG = 40


def axes_of(ax: Any) -> Any:
    """The given axes, else new ones."""
    return pyplot().subplots(layout="constrained")[1] if ax is None else ax


def pyplot() -> Any:
    """matplotlib, imported when the first picture is drawn."""
    try:
        import matplotlib.pyplot as plt
    except ImportError as error:
        raise ImportError("fleetfoot.plot needs matplotlib: pip install matplotlib") from error
    return plt


def short(name: str) -> str:
    """A name shortened to fit beside an axis."""
    return name if len(name) <= _LONG else name[: _LONG - 1] + "…"


def channels_of(
    data: _core.Data,
    recipe: str,
    columns: Sequence[str] | None = None,
    *,
    most: int = 12,
    ax: Any = None,
    progress: Progress = None,
) -> Any:
    """Channels of opened data over time, one below the other; see :func:`fleetfoot.plot.channels`."""
    plt = pyplot()
    wanted = None if columns is None else [str(column) for column in columns]
    with reporting(progress) as callback:
        table = _core.read_table(data, recipe, wanted, None, None, None, callback)
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
