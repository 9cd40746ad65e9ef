"""Files as tables, and logs of simulated robots."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, overload

from . import _core
from ._controller import Controller, what
from ._core import Table
from ._data import Dataset
from ._data import open as open_data
from ._progress import Progress, reporting
from ._values import count, number
from .exceptions import DataError


def _one_path(path: Any) -> Path:
    """The single recording of a path, a glob or a list."""
    names = open_data(path).names
    if len(names) != 1:
        raise DataError(f"{len(names)} recordings are named, but messages are read from one at a time; give one path")
    return Path(names[0])


# A text is a sequence of texts: its overload stands first.
@overload
def read_mcap(
    path: Any,
    topic: str | None = None,
    *,
    fields: Sequence[str] | None = None,
    columns: Sequence[str] | None = None,
    recipe: Any = None,
    base: str | None = None,
    rate: float | None = None,
    stamp: Literal["header", "log", "publish"] | str | None = None,
    progress: Progress = None,
) -> Table: ...
@overload
def read_mcap(
    path: Any,
    topic: Sequence[str],
    *,
    fields: Sequence[str] | None = None,
    progress: Progress = None,
) -> dict[str, Table]: ...
def read_mcap(
    path: Any,
    topic: str | Sequence[str] | None = None,
    *,
    fields: Sequence[str] | None = None,
    columns: Sequence[str] | None = None,
    recipe: Any = None,
    base: str | None = None,
    rate: float | None = None,
    stamp: Literal["header", "log", "publish"] | str | None = None,
    progress: Progress = None,
) -> Table | dict[str, Table]:
    """Reads a robot's log (MCAP, rosbag2, ROS 1 bag, ULog, ArduPilot or WPILOG) into a table.

    The rows are the messages of a topic (``topic``), or joined rows of several topics on one clock (``columns`` or
    ``recipe``). Messages are decoded on all cores, directly into Arrow memory.

    Parameters
    ----------
    path : path or list of paths
        The log. Joined rows may come from several.
    topic : str or list of str, optional
        Read the messages of this topic. A list gives a dict of tables, by topic. Without ``topic``, ``columns`` and
        ``recipe`` the log must have a single topic.
    fields : list of str, optional
        Paths of the fields within a message, such as ``"pose.position.x"``; default: all fields of the messages.
        Elements of arrays with more than 64 numbers are read only by name (``"ranges[0]"``).
    columns : list of str, optional
        Read joined rows of these columns: fields with their topics (``"/odom.twist.twist.linear.x"``), aliases of the
        recipe, or expressions over both.
    recipe : path, str or mapping, optional
        Recipe of the fields and their joins. Without ``columns`` its states and inputs are read, else its aliases.
    base : str, optional
        The topic whose messages make the joined rows; default: that of the first column.
    rate : float, optional
        Joined rows per second, instead of a base.
    stamp : {"header", "log", "publish"}, optional
        Clock of the joined rows; default: headers if every topic has them, else log times.
    progress : bool or callable, optional
        ``True`` for a bar of tqdm, or a function of (stage, done, total).

    Returns
    -------
    Table or dict of Table
        For messages: ``log_time`` and ``publish_time`` (nanoseconds, UTC), ``header_stamp`` if there are headers,
        then the fields: numbers and booleans as ``float64`` (NaN if missing), texts as dictionaries. Integers beyond
        2**53 are rounded. For joined rows: ``episode``, ``stamp`` (nanoseconds), ``t`` (seconds since the episode's
        begin), then the columns. ``table.notes`` lists assumptions and omissions.

    Raises
    ------
    DataError
        The log cannot be read; a topic or field does not exist, or holds neither numbers nor texts.

    Examples
    --------
    >>> import tempfile, fleetfoot as ff
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     made = ff.generate("diffdrive", folder, seconds=2.0)
    ...     odometry = ff.read_mcap(made.files[0], "/odom", fields=["twist.twist.linear.x"])
    >>> odometry.columns
    ['log_time', 'publish_time', 'header_stamp', 'twist.twist.linear.x']
    """
    joined = columns is not None or recipe is not None
    if topic is not None and joined:
        raise ValueError("topic reads messages as they are, columns and recipe join topics: give one of them")
    if joined:
        if fields is not None:
            raise ValueError("fields are those of one topic's messages; name them with their topics in columns")
        data = open_data(path, recipe=recipe)
        return _read_rows(data, columns, base, rate, stamp, progress)
    for name, value in [("base", base), ("rate", rate), ("stamp", stamp)]:
        if value is not None:
            raise ValueError(f"{name} says how topics are joined: give columns or a recipe as well")
    file = _one_path(path)
    if topic is None:
        topic = _only_topic(file)
    wanted = None if fields is None else [str(field) for field in fields]
    with reporting(progress) as callback:
        if isinstance(topic, str):
            return _core.read_messages(file, topic, wanted, callback)
        return {str(name): _core.read_messages(file, str(name), wanted, callback) for name in topic}


def _only_topic(path: Path) -> str:
    topics = [name for name, messages in _core.topics(path) if messages != 0]
    if len(topics) != 1:
        raise DataError(
            f"{path} has {len(topics)} topics with messages ({', '.join(topics[:20])}); name one: topic=..."
        )
    return topics[0]


def _read_rows(
    data: Dataset,
    columns: Sequence[str] | None,
    base: str | None,
    rate: float | None,
    stamp: str | None,
    progress: Progress,
) -> Table:
    if isinstance(columns, str):
        raise TypeError(f"columns={columns!r}: give a list of names")
    if base is not None and rate is not None:
        raise ValueError("base and rate are both given; the rows come from one of them")
    names = None if columns is None else [str(name) for name in columns]
    with reporting(progress) as callback:
        return _core.read_table(data._core, data.recipe, names, base, rate, stamp, callback)


def read(
    source: Any,
    columns: Sequence[str] | None = None,
    *,
    recipe: str | os.PathLike[str] | Mapping[str, Any] | None = None,
    t: Any = None,
    dt: float | None = None,
    progress: Progress = None,
) -> Table:
    """Reads rows of any recordings into a table, as a fit reads them.

    Rows are ordered by episode: each file and each gap in the clock begins one. Rows without a readable stamp are
    left out and counted in ``notes``.

    Parameters
    ----------
    source : path, table, array, Dataset, ...
        As in :func:`fleetfoot.open`.
    columns : list of str, optional
        Columns, aliases of the recipe, or expressions over both. Default: states and inputs of the recipe, else its
        aliases, else all columns.
    recipe, t, dt
        As in :func:`fleetfoot.open`.
    progress : bool or callable, optional
        ``True`` for a bar of tqdm, or a function of (stage, done, total).

    Returns
    -------
    Table
        ``episode``, ``stamp`` (nanoseconds), ``t`` (seconds since the episode's begin; ``seconds`` if a column is
        called ``t``), then the columns.

    Raises
    ------
    RequestError
        A column does not exist.
    DataError
        The recordings cannot be read.

    Examples
    --------
    >>> import numpy as np, fleetfoot as ff
    >>> table = ff.read({"t": np.arange(3) * 0.5, "x": np.array([1.0, 2.0, 4.0])}, ["x", "x * x"])
    >>> table["x * x"]
    array([ 1.,  4., 16.])
    """
    return _read_rows(open_data(source, recipe=recipe, t=t, dt=dt), columns, None, None, None, progress)


def info(path: str | os.PathLike[str], *, values: bool = False, progress: Progress = None) -> dict[str, Any]:
    """Summary of a file: columns, units, clock; for a robot's log topics and fields.

    Parameters
    ----------
    path : path
        A log or a table of any format that :func:`fleetfoot.open` reads.
    values : bool
        Read all rows once: ranges of the values, gaps of the clock, episodes.
    progress : bool or callable, optional
        ``True`` for a bar of tqdm, or a function of (stage, done, total).

    Returns
    -------
    dict
        ``file``, ``format``, ``bytes``, ``rows``, ``columns`` (name, unit, kind, statistics, ...), ``topics`` (name,
        type, messages, rate in Hz, gaps, ...), ``metadata`` of the log, ``time`` (the guessed clock), ``clock``
        (periods and gaps in seconds), ``episodes``, ``notes``. Unknown values are ``None``.

    Raises
    ------
    DataError
        A file that cannot be read.

    Examples
    --------
    >>> import pathlib, tempfile, fleetfoot as ff
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "log.csv")
    ...     _ = path.write_text("t,speed [m/s]\\n0,1\\n0.1,2\\n")
    ...     told = ff.info(path)
    >>> [(column["name"], column["unit"]) for column in told["columns"]]
    [('t', None), ('speed [m/s]', 'm/s')]
    """
    with reporting(progress) as callback:
        info_dict: dict[str, Any] = _core.info(Path(path), values, callback)
    return info_dict


@dataclass(frozen=True)
class Generated:
    """Result of :func:`generate`.

    Attributes
    ----------
    files : list of Path
        The logs, in the order of their runs.
    recipe : Path
        The recipe of the logs.
    runs : list of dict
        For each run its file, length (seconds), rows, messages, size (bytes), end and excitation.
    excitation : dict
        Information for a model in the rows of all runs together.
    """

    files: list[Path]
    recipe: Path
    runs: list[dict[str, Any]]
    excitation: dict[str, Any]

    def open(self) -> Dataset:
        """The logs with their recipe, for a fit."""
        return open_data(list(self.files), recipe=self.recipe)


def robots() -> list[str]:
    """Names of the robots that :func:`generate` can simulate.

    Returns
    -------
    list of str

    Examples
    --------
    >>> import fleetfoot as ff
    >>> "diffdrive" in ff.robots()
    True
    """
    return list(_core.robots())


def world(robot: str, world: str | os.PathLike[str] | Mapping[str, Any] | None = None) -> str:
    """A robot's physical parameters, as TOML with comments.

    Parameters
    ----------
    robot : str
        One of :func:`robots`.
    world : path, str or mapping, optional
        Changed parameters, as in :func:`generate`.

    Returns
    -------
    str

    Raises
    ------
    RequestError
        An unknown robot or parameter, or a value out of range.

    Examples
    --------
    >>> import fleetfoot as ff
    >>> ff.world("diffdrive").startswith("#")
    True
    """
    text, settings = _world(world)
    return _core.world(robot, text, settings)


def _world(world: Any) -> tuple[str | None, list[tuple[str, str]]]:
    """TOML text, and single settings."""
    if world is None:
        return None, []
    if isinstance(world, Mapping):
        return None, list(_flat("", world))
    if isinstance(world, str) and ("\n" in world or "=" in world):
        return world, []
    return Path(world).read_text(encoding="utf-8"), []


def _flat(prefix: str, table: Mapping[str, Any]) -> Any:
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from _flat(f"{prefix}{key}.", value)
        else:
            # Numbers, texts and lists are written alike in JSON and TOML.
            plain = value.tolist() if hasattr(value, "tolist") else value
            yield f"{prefix}{key}", json.dumps(plain)


def generate(
    robot: str,
    folder: str | os.PathLike[str],
    *,
    runs: int = 1,
    minutes: float | None = None,
    seconds: float | None = None,
    seed: int = 1,
    world: str | os.PathLike[str] | Mapping[str, Any] | None = None,
    excitation: str | None = None,
    controller: Controller | str | os.PathLike[str] | None = None,
    speed: tuple[float, float] | None = None,
    format: Literal["mcap", "parquet"] | None = None,  # noqa: A002
    truth: bool = True,
    first_run: int = 0,
    force: bool = False,
    progress: Progress = None,
) -> Generated:
    """Simulates a robot and writes its logs, and a recipe for fits beside them.

    The same arguments give the same bytes on any number of threads.

    Parameters
    ----------
    robot : str
        One of :func:`robots`.
    folder : path
        Folder of the logs, created if necessary.
    runs : int
        Number of runs; each is a file.
    minutes : float, optional
        Simulated time of all runs together, minutes.
    seconds : float, optional
        Simulated time of each run, seconds; the default depends on the robot.
    seed : int
        Seed of all random numbers.
    world : path, str or mapping, optional
        Physical parameters: a TOML file, TOML text, or a mapping such as ``{"belt": {"speed": 0.3}}`` or
        ``{"belt.speed": 0.3}``.
    excitation : str, optional
        Excitation of the robot, if it can be chosen.
    controller : Controller or path, optional
        Result of :meth:`Model.lqr`, or its file, which replaces the robot's controller.
    speed : (float, float), optional
        The first and the last run's speed, spread evenly over the runs, in the unit of the world's parameter.
    format : {"mcap", "parquet"}, optional
        Messages of sensors, or rows of truth; the default depends on the robot.
    truth : bool
        Write the truth too, on separate topics.
    first_run : int
        The number of the first run, which decides its random numbers.
    force : bool
        Replace the runs of an earlier call in the folder.
    progress : bool or callable, optional
        ``True`` for a bar of tqdm, or a function of (stage, done, total).

    Returns
    -------
    Generated

    Raises
    ------
    RequestError
        An unknown robot or parameter, or a value out of range.
    WriteError
        The folder cannot be written, or holds other logs.

    Examples
    --------
    >>> import tempfile, fleetfoot as ff
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     made = ff.generate("diffdrive", folder, runs=2, seconds=1.0)
    >>> len(made.files), made.recipe.name
    (2, 'robot.toml')
    """
    if minutes is not None and seconds is not None:
        raise ValueError(
            "minutes and seconds are both given; minutes are of all runs together, seconds of each: give one"
        )
    runs = count("runs", runs, 1)
    if minutes is not None:
        seconds = number("minutes", minutes) * 60.0 / runs
    text, settings = _world(world)
    wanted = {
        "runs": runs,
        "first_run": count("first_run", first_run, 0),
        "seconds": None if seconds is None else number("seconds", seconds),
        "seed": count("seed", seed, 0),
        "speed": speed,
        "format": format,
        "truth": truth,
        "force": force,
        "excitation": excitation,
        "controller": what(controller),
    }
    with reporting(progress) as callback:
        made = _core.generate(robot, Path(folder), text, settings, wanted, callback)
    files = [Path(run["file"]) for run in made["runs"]]
    return Generated(files, Path(made["recipe"]), made["runs"], made["excitation"])


__all__ = ["Generated", "Table", "generate", "info", "read", "read_mcap", "robots", "world"]
