"""From raw channels to clean states and derivatives: what the command ``prepare`` does, from Python."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from . import _core, _recipe
from ._data import Dataset
from ._data import open as open_data
from ._keywords import hinting
from ._progress import Progress, reporting
from ._warnings import tell_all


@dataclass(frozen=True)
class Prepared:
    """What :func:`prepare` wrote.

    Attributes
    ----------
    files : list of Path
        A Parquet file a piece of an episode, with states, derivatives and their standard deviations.
    recipe : Path
        The recipe for them, which fits take as it is.
    rows, written : int
        Rows that were read, and rows that were written.
    smoothed : float
        Seconds over which neighbouring rows share smoothed values; fits hold out rows that far from those that train.
    episodes : list of dict
        For each episode its pieces and their channels: how each was smoothed, its penalty and noise, and counts and
        places of everything that was left out.
    clocks : list of dict
        What the clock of another computer shows more, log by log: offset and skew with their intervals, and why.
    body : dict or None
        Of a recipe with ``[body]``: lever, mounting, delay and gravity with their deviations, the noise of each sensor,
        and the poses that were left out.
    joints : list of dict
        Of a recipe with ``[joint.NAME]``: the noise, delay and bias of each sensor, the readings that were left out, the
        density of the jerk, and how errors of sensors go together.
    """

    files: list[Path]
    recipe: Path
    rows: int
    written: int
    smoothed: float
    episodes: list[dict[str, Any]]
    clocks: list[dict[str, Any]]
    body: dict[str, Any] | None
    joints: list[dict[str, Any]]

    def open(self) -> Dataset:
        """The clean episodes with their recipe, for a fit."""
        return open_data(list(self.files), recipe=self.recipe)


@hinting
def prepare(
    data: Any,
    folder: str | os.PathLike[str],
    *,
    recipe: str | os.PathLike[str] | Mapping[str, Any] | None = None,
    channels: Mapping[str, Mapping[str, Any]] | None = None,
    clocks: Mapping[str, Mapping[str, Any]] | None = None,
    method: str | None = None,
    second_order: bool | None = None,
    lam: float | str | None = None,
    reject: float | None = None,
    hampel: int | None = None,
    stuck: int | None = None,
    range: tuple[float, float] | None = None,  # noqa: A002
    bounds: tuple[float, float] | None = None,
    window: int | None = None,
    degree: int | None = None,
    cutoff: float | None = None,
    order: int | None = None,
    delay: float | None = None,
    average: float | None = None,
    clip: float | None = None,
    dejitter: bool | None = None,
    decimate: int | None = None,
    min_rows: int | None = None,
    force: bool = False,
    progress: Progress = None,
) -> Prepared:
    """Smooths the states of recordings, and writes clean episodes with derivatives, standard deviations and a recipe.

    Every state becomes a smoothing spline, which is a Gaussian process whose derivative is a random walk; its penalty
    is the likeliest. Values that no curve explains are left out, counted and placed. One episode is in memory at a
    time. What is ``None`` is said by the recipe, else by the default.

    Parameters
    ----------
    data : Dataset, path, table, array or list
        Recordings, as :func:`fleetfoot.open` takes them.
    folder : path
        Where the clean episodes go; made if it is not there.
    recipe : path, str or mapping, optional
        Which fields are states and inputs; that of the dataset when not given.
    channels : mapping, optional
        What is otherwise for one state or input: its name and the arguments below, as
        ``{"q": {"range": (-1.5, 1.5)}}``.
    clocks : mapping, optional
        Topics that another computer stamps, and what tells how its clock goes: ``{"mocap": {"topics": ["/mocap/*"],
        "motion": ["speed", "turning"]}}``, two channels that saw one motion, by the reference clock and by this one.
        ``wave`` in place of ``motion`` for a square wave; ``offset`` in seconds, ``reach`` about it.
    method : str, optional
        How states become smooth: the smoothing splines ``"cubic"`` and ``"quintic"`` (that with ``second_order``),
        ``"auto"`` for whichever of the two the state is more like (the default; the cubic one where ``lam`` is a
        number), ``"trend-filter"``, the curves through every measurement ``"not-a-knot"`` and ``"pchip"``,
        ``"savitzky-golay"``, ``"butterworth"``, ``"none"``. Inputs stay as they are unless ``channels`` says how.
    second_order : bool, optional
        A state's rate is a state too, and its acceleration is what is fitted (``False``).
    lam : float or {"likelihood", "gcv"}, optional
        The penalty of a spline, in s^3 (cubic) or s^5 (quintic), or of the trend filter, in units of the state times
        s^degree, or what it is chosen by (``"likelihood"``).
    reject : float, optional
        Values further off the curve than so many standard deviations are left out, again and again until there are
        none; 0 for none (4 for smoothing splines, 0 for the others).
    hampel : int, optional
        Values off the median of so many rows on either side by more than six robust standard deviations are left out
        first; 0 for none (0).
    stuck : int, optional
        A value that is repeated over more rows than this is a sensor that hangs, and left out; 0 for never (0).
    range : (float, float), optional
        What a sensor can measure: values at or beyond these ends are left out.
    bounds : (float, float), optional
        Where a channel may be: a row beyond these ends an episode.
    window, degree : int, optional
        Rows of a window and degree of the polynomials of Savitzky and Golay (11 and 3); degree of the trend filter's
        pieces, 1 to 3 (2).
    cutoff : float, optional
        Frequency in Hz at which the Butterworth filter has halved the power, run one way.
    order : int, optional
        Order of the Butterworth filter, run one way (4).
    delay : float, optional
        Seconds by which a sensor's stamps are late (0).
    average : float, optional
        Seconds before its stamp of which a sensor reports the mean, which is late by half of them (0).
    clip : float, optional
        Seconds that are cut off at both ends of every episode, before anything else (0).
    dejitter : bool, optional
        Replace stamps by their regression on the sample count (``False``).
    decimate : int, optional
        Write every n-th row (1).
    min_rows : int, optional
        Pieces of fewer rows are not written (50).
    force : bool
        Replace what an earlier preparation wrote there.
    progress : bool or callable, optional
        ``True`` for a bar of tqdm, or a function of the stage's name, the pieces done and the pieces in all.

    Returns
    -------
    Prepared

    Raises
    ------
    RequestError
        The recipe cannot be understood or asks for what is not there; no piece is long enough.
    DataError
        The recordings cannot be read.
    WriteError
        A folder that cannot be written, or that holds other files.

    Examples
    --------
    >>> import tempfile, numpy as np, fleetfoot as ff
    >>> t = np.arange(400) * 0.01
    >>> noise = np.random.default_rng(0).normal(0.0, 0.01, 400)
    >>> log = ff.open({"t": t, "x": np.sin(3 * t) + noise}, t="t", recipe={"states": {"x": {}}})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     clean = ff.prepare(log, folder)
    ...     table = ff.read(clean.files[0])
    >>> bool(np.std(table["x_dot"] - 3 * np.cos(3 * t)) < 0.15)  # 0.7 by central differences
    True
    """
    own = _recipe.said(
        method=method,
        second_order=second_order,
        reject=reject,
        hampel=hampel,
        stuck=stuck,
        range=range,
        bounds=bounds,
        window=window,
        degree=degree,
        cutoff=cutoff,
        order=order,
        delay=delay,
        average=average,
        clip=clip,
        dejitter=dejitter,
        decimate=decimate,
        min_rows=min_rows,
        **{"lambda": lam},
    )
    above: dict[str, Any] = {"prepare": own} if own else {}
    if channels:
        above["channels"] = {
            name: {"lambda" if key == "lam" else key: value for key, value in said.items()}
            for name, said in channels.items()
        }
    if clocks:
        above["clocks"] = {name: dict(said) for name, said in clocks.items()}
    dataset = open_data(data, recipe=recipe)
    text = _recipe.to_json(_recipe.say(above, _recipe.of_toml(dataset.recipe)))
    with reporting(progress) as callback:
        made = _core.prepare(dataset._core, text, Path(folder), force, callback)
    tell_all(made["notes"])
    files = [Path(file) for file in made["files"]]
    return Prepared(
        files,
        Path(made["recipe"]),
        made["rows"],
        made["written"],
        made["smoothed"],
        made["episodes"],
        made.get("clocks", []),
        made.get("body"),
        made.get("joints", []),
    )


__all__ = ["Prepared", "prepare"]
