"""Clean states and derivatives from raw channels: the command ``prepare`` in Python."""

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
    """Result of :func:`prepare`.

    Attributes
    ----------
    files : list of Path
        One Parquet file per piece of an episode, with states, derivatives and their standard deviations.
    recipe : Path
        The recipe of the files, ready for fits.
    rows, written : int
        Read and written rows.
    smoothed : float
        Seconds over which neighbouring rows share smoothed values; fits keep this distance between held-out and
        training rows.
    episodes : list of dict
        For each episode its pieces and channels: method, penalty and noise, and counts and places of left-out values.
    clocks : list of dict
        Clock offset and skew of other computers, log by log, with intervals and evidence.
    body : dict or None
        For a recipe with ``[body]``: lever, mounting, delay and gravity with their deviations, the noise of each
        sensor, and left-out poses.
    joints : list of dict
        For a recipe with ``[joint.NAME]``: noise, delay and bias of each sensor, left-out readings, density of the
        jerk, and correlation of the sensors' errors.
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

    Every state becomes a smoothing spline, a Gaussian process whose derivative is a random walk, with the penalty of
    greatest likelihood. Outliers are left out, counted and located. One episode is in memory at a time. An argument
    of ``None`` leaves the recipe's entry, else the default.

    Parameters
    ----------
    data : Dataset, path, table, array or list
        Recordings, as in :func:`fleetfoot.open`.
    folder : path
        Folder for the clean episodes, created if necessary.
    recipe : path, str or mapping, optional
        The recipe with states and inputs; default: that of the data set.
    channels : mapping, optional
        Exceptions for one state or input: its name and the arguments below, as ``{"q": {"range": (-1.5, 1.5)}}``.
    clocks : mapping, optional
        Topics that another computer stamps, and the channels that compare its clock:
        ``{"mocap": {"topics": ["/mocap/*"], "motion": ["speed", "turning"]}}``, two channels of one motion, by the
        reference clock and by this one. ``wave`` instead of ``motion`` for a square wave; ``offset`` in seconds,
        ``reach`` of the search around it.
    method : str, optional
        Smoothing method of the states: the smoothing splines ``"cubic"`` and ``"quintic"`` (default with
        ``second_order``), ``"auto"`` for one of the two by the data (the default; cubic if ``lam`` is a number),
        ``"trend-filter"``, the curves through every measurement ``"not-a-knot"`` and ``"pchip"``,
        ``"savitzky-golay"``, ``"butterworth"``, ``"none"``. Inputs are not smoothed unless ``channels`` sets a
        method.
    second_order : bool, optional
        The rate of a state is a state too, and its acceleration the target (``False``).
    lam : float or {"likelihood", "gcv"}, optional
        The penalty of a spline, in s^3 (cubic) or s^5 (quintic), or of the trend filter, in units of the state times
        s^degree; or the rule that chooses it (``"likelihood"``).
    reject : float, optional
        Standard deviations from the curve beyond which a value is an outlier, repeated until no outlier is left; 0
        for none (4 for smoothing splines, 0 for the others).
    hampel : int, optional
        Rows on either side for the median; values beyond six robust standard deviations from it are removed first; 0
        for none (0).
    stuck : int, optional
        Longest run of equal values in rows; a longer one is a stuck sensor and is left out; 0 for never (0).
    range : (float, float), optional
        Measuring range of a sensor: values at or beyond these ends are left out.
    bounds : (float, float), optional
        Bounds of a channel: a row beyond them ends an episode.
    window, degree : int, optional
        Rows of a window and degree of the polynomials of Savitzky and Golay (11 and 3); degree of the trend filter's
        pieces, 1 to 3 (2).
    cutoff : float, optional
        Frequency in Hz at which the Butterworth filter halves the power, run one way.
    order : int, optional
        Order of the Butterworth filter, run one way (4).
    delay : float, optional
        Delay of a sensor's stamps in seconds (0).
    average : float, optional
        Averaging time of a sensor before its stamp, in seconds; the mean is late by half of it (0).
    clip : float, optional
        Seconds cut off at both ends of every episode, before any other step (0).
    dejitter : bool, optional
        Replace stamps by their regression on the sample count (``False``).
    decimate : int, optional
        Write every n-th row (1).
    min_rows : int, optional
        Pieces of fewer rows are not written (50).
    force : bool
        Replace the files of an earlier preparation.
    progress : bool or callable, optional
        ``True`` for a bar of tqdm, or a function of the stage's name, the pieces done and the pieces in all.

    Returns
    -------
    Prepared

    Raises
    ------
    RequestError
        The recipe cannot be understood or names an unknown column; no piece is long enough.
    DataError
        The recordings cannot be read.
    WriteError
        The folder cannot be written, or holds other files.

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
    prepared_recipe = _recipe.without_none(
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
    above: dict[str, Any] = {"prepare": prepared_recipe} if prepared_recipe else {}
    if channels:
        above["channels"] = {
            name: {"lambda" if key == "lam" else key: value for key, value in settings.items()}
            for name, settings in channels.items()
        }
    if clocks:
        above["clocks"] = {name: dict(settings) for name, settings in clocks.items()}
    dataset = open_data(data, recipe=recipe)
    text = _recipe.to_json(_recipe.override(above, _recipe.of_toml(dataset.recipe)))
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
