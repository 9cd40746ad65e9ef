"""One page about models and their errors."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from typing import Any

from . import _core
from ._compare import _unwrapped
from ._controller import Controller, what
from ._model import Model
from ._progress import Progress, reporting
from ._values import count, names_of
from ._warnings import tell_all

_Path = str | os.PathLike[str]


def report(
    models: Any,
    data: Any = None,
    path: _Path = "report.html",
    *,
    recipe: Any = None,
    title: str | None = None,
    horizon: int | None = None,
    starts: int = 500,
    controller: Controller | _Path | None = None,
    settings: Mapping[str, Any] | None = None,
    plane: Sequence[str] | None = None,
    position: Sequence[str] = (),
    reference: Mapping[str, str] | None = None,
    interval: int = 1,
    band: int | None = None,
    svg: _Path | None = None,
    csv: _Path | None = None,
    cache: _Path | None = None,
    progress: Progress = None,
) -> dict[str, Any]:
    """Writes one page about models: verdict, equations, regions, errors, simulations.

    The page is one HTML file that needs no network and no script.

    Parameters
    ----------
    models : Model, fitted estimator, or dict of these by name
        Models of the page, side by side. For a fitted SINDy or BlockSparse the page also shows the choice: held-out
        errors and selection frequencies.
    data : path, table, array, Dataset, ..., optional
        Recordings to compare the models with, as in :func:`fleetfoot.open`. Use held-out recordings; the page marks
        training episodes. Without data the page shows the models alone.
    path : path
        The page to write.
    recipe : path, str or mapping, optional
        Changes of clock, topics or labels for these data.
    title : str, optional
        Title of the page; default: names the models.
    horizon : int, optional
        Steps of every simulation; default: 200, at most a quarter of the longest episode.
    starts : int
        Number of simulations of every model.
    controller : Controller, str or path, optional
        Controller of the simulations, as in :meth:`fleetfoot.Model.rollout`.
    settings : dict, optional
        Settings of the controller.
    plane : two str, optional
        Two columns or expressions: the page maps the best model's errors and region changes over their plane.
        Default: the angles of a model with two of them.
    position, reference, interval, band : optional
        Scores of simulated paths, as in :meth:`fleetfoot.Model.rollout`.
    svg : path, optional
        Folder for every figure as SVG; ``rsvg-convert``, Inkscape or a browser convert them to PNG and PDF.
    csv : path, optional
        Folder for the numbers of every figure as CSV.
    cache : path, optional
        Folder that keeps decoded columns of large logs.
    progress : bool or callable, optional
        ``True`` for a bar of tqdm, or a function of (stage, done, total).

    Returns
    -------
    dict
        Verdicts of the page: ``findings``, each with ``light`` (good, doubtful, bad, fact), ``head`` and ``text``;
        ``title``, ``episodes``, ``in_sample_episodes``, ``notes``.

    Raises
    ------
    DataError, RequestError, ModelError
    TypeError
        An object is not a model.

    Examples
    --------
    >>> import os, tempfile, numpy as np, fleetfoot as ff
    >>> t = np.arange(0, 5, 0.01)
    >>> runs = [np.column_stack([a * np.cos(2 * t), -2 * a * np.sin(2 * t)]) for a in (1.0, 0.7, 0.4)]
    >>> model = ff.PWA().fit(runs[:2], dt=0.01, feature_names=["q", "v"]).model_
    >>> held_out = ff.open({"q": runs[2][:, 0], "v": runs[2][:, 1]}, dt=0.01)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     told = ff.report(model, held_out, os.path.join(folder, "report.html"))
    >>> told["findings"][0]["head"]
    'What was fitted.'
    """
    named = models if isinstance(models, Mapping) else {None: models}
    listed: list[tuple[str, _core.Model]] = []
    fits: list[str] = []
    inner: Model | None = None
    for name, given in named.items():
        model = _unwrapped(given)
        if not isinstance(model, Model):
            raise TypeError(f"{type(given).__name__} is no model; give a fleetfoot.Model or a fitted estimator")
        inner = model if inner is None else inner
        fit_report = getattr(given, "report_", None)
        if isinstance(fit_report, dict) and ("latents" in fit_report or "candidates" in fit_report):
            fits.append(json.dumps({**fit_report, "hash": model._core.hash()}))
        listed.append((model.method if name is None else str(name), model._core))
    if inner is None:
        raise ValueError("models is empty; give at least one model")
    axes = None if plane is None else [str(axis) for axis in names_of(plane)]
    if axes is not None and len(axes) != 2:
        raise ValueError(f"plane={plane!r}: a plane has two columns")
    opened, changes = (None, "{}") if data is None else inner._opened(data, recipe)
    request = {
        "path": os.fspath(path),
        "svg": None if svg is None else os.fspath(svg),
        "csv": None if csv is None else os.fspath(csv),
        "plane": axes,
        "position": names_of(position),
        "reference": [f"{state}={of}" for state, of in (reference or {}).items()],
        "interval": count("interval", interval, 1),
        "band": None if band is None else count("band", band, 0),
        "fits": fits,
        "title": title,
        "horizon": None if horizon is None else count("horizon", horizon, 1),
        "starts": count("starts", starts, 1),
        "controller": what(controller),
        "settings": [f"{name}={value}" for name, value in (settings or {}).items()],
    }
    with reporting(progress) as callback:
        report_dict: dict[str, Any] = _core.report(listed, opened, changes, request, cache, callback)
    tell_all(report_dict["notes"])
    return report_dict
