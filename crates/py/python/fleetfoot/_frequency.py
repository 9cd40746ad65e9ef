"""Frequency responses: the command ``frequency`` in Python."""

from __future__ import annotations

import os
from typing import Any

from . import _core, _recipe
from ._compare import _unwrapped
from ._data import open as open_data
from ._model import Model
from ._progress import Progress, reporting
from ._values import count, number
from ._warnings import tell_all


def frequency(
    data: Any,
    input: str,  # noqa: A002
    output: str,
    *,
    model: Any = None,
    segment: float | None = None,
    period: float | None = None,
    skip: int = 1,
    page: str | os.PathLike[str] | None = None,
    svg: str | os.PathLike[str] | None = None,
    recipe: Any = None,
    progress: Progress = None,
) -> dict[str, Any]:
    """Frequency response of an output to an input, with coherence and 95 % intervals.

    Parameters
    ----------
    data : anything that :func:`fleetfoot.open` takes
        Recordings with even rows.
    input, output : str
        Columns, or expressions over columns; with a model the output is one of its states.
    model : Model or fitted estimator, optional
        Also the response of its simulations with the recorded input.
    segment : float, optional
        Length of the segments of averaged spectra, seconds, rounded to a power of two of samples. Default: the longest
        that gives sixteen segments.
    period : float, optional
        Period of a periodic excitation, seconds: whole periods, and the distortion at frequencies that it leaves out.
    skip : int
        Periods at the beginning of each episode that are left out.
    page : path, optional
        HTML page with the Bode figure.
    svg : path, optional
        Folder for its figures as SVG.
    recipe : path, str or mapping, optional
        Recipe of the columns, or with a model changes of clock, topics or labels.
    progress : bool or callable, optional
        ``True`` for a bar of tqdm, or a function of (stage, done, total).

    Returns
    -------
    dict
        ``measured`` and, with a model, ``model``, each with ``frequency`` [Hz], ``gain``, ``phase`` [rad], ``real``,
        ``imaginary``, ``radius`` of the 95 % circle, ``coherence``, ``input_power``, ``output_power``, ``excited`` and
        ``distortion`` (amplitudes of the output: ``excited``, ``odd``, ``even``, ``noise``); ``inside``: share of the
        excited frequencies at which the model lies in the circle.

    Raises
    ------
    DataError, RequestError, ModelError

    Examples
    --------
    >>> import numpy as np, fleetfoot as ff
    >>> u = np.random.default_rng(1).normal(size=4096)
    >>> y = np.zeros(4096)
    >>> for k in range(1, 4096):
    ...     y[k] = 0.9 * y[k - 1] + 0.1 * u[k - 1]
    >>> told = ff.frequency(ff.open({"u": u, "y": y}, dt=0.01), "u", "y")
    >>> bool(abs(told["measured"]["gain"][0] - 1) < 0.1)
    True
    """
    inner = None if model is None else _unwrapped(model)
    if inner is not None and not isinstance(inner, Model):
        raise TypeError(f"{type(model).__name__} is no model; give a fleetfoot.Model or a fitted estimator")
    if inner is None:
        dataset = open_data(data, recipe=recipe)
        core, text = dataset._core, _recipe.to_json(_recipe.of_toml(dataset.recipe))
    else:
        core, text = inner._opened(data, recipe)
    request = {
        "input": input,
        "output": output,
        "segment": None if segment is None else number("segment", segment),
        "period": None if period is None else number("period", period),
        "skip": count("skip", skip, 0),
        "page": None if page is None else os.fspath(page),
        "svg": None if svg is None else os.fspath(svg),
    }
    with reporting(progress) as callback:
        spectra: dict[str, Any] = _core.frequency(None if inner is None else inner._core, core, text, request, callback)
    tell_all(spectra["notes"])
    return spectra


__all__ = ["frequency"]
