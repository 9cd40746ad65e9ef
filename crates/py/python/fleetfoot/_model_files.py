"""Models of files: those of fleetfoot, and networks of other programs."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from . import _core, _recipe
from ._arrays import period_seconds
from ._model import Model

if TYPE_CHECKING:
    from ._data import Dataset


def load(path: str | os.PathLike[str]) -> Model:
    """Reads a model's file.

    Parameters
    ----------
    path : path
        File from :meth:`Model.save` or the command line.

    Returns
    -------
    Model

    Raises
    ------
    ModelError
        The file cannot be read, is damaged, or is of another version.

    Examples
    --------
    >>> import os, tempfile, numpy as np, fleetfoot as ff
    >>> t = np.arange(0, 5, 0.01)
    >>> fitted = ff.PWA().fit(np.exp(-t), t)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     fitted.save(os.path.join(folder, "model.json"))
    ...     model = ff.load(os.path.join(folder, "model.json"))
    >>> model == fitted.model_
    True
    """
    return Model(_core.Model.read(path))


def import_model(
    path: str | os.PathLike[str],
    recipe: str | os.PathLike[str] | Mapping[str, Any],
    data: Dataset | None = None,
    *,
    dt: float | None = None,
) -> Model:
    """Makes a model of a network that another program trained.

    Parameters
    ----------
    path : path
        ONNX file of one input (rows x columns) and one output.
    recipe : path, str or mapping
        The recipe: a TOML file, TOML text, or a mapping. Its states and inputs, with their lags, are the columns that
        the network reads, in its order; its targets are those that the network predicts.
    data : Dataset, optional
        Recordings that trained the network, for training ranges and residuals; without them both are unknown.
    dt : float, optional
        Time between rows in seconds, without ``data``; default: that of the recipe's ``time``.

    Returns
    -------
    Model

    Raises
    ------
    ModelError
        The file cannot be read, or is not such a network.
    RequestError
        The recipe cannot be understood, or no time between rows is given.

    Notes
    -----
    Without ``data`` no row counts as outside of the training range, and :meth:`Model.filter` has no process noise.

    Examples
    --------
    >>> import os, tempfile, numpy as np, fleetfoot as ff
    >>> t = np.arange(0, 5, 0.01)
    >>> model = ff.PWA(target="next").fit(np.exp(-t), t).model_
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = model.export("onnx", folder)
    ...     recipe = {"states": {"x0": {}}, "model": {"predict": "next"}}
    ...     again = ff.import_model(os.path.join(folder, "model.onnx"), recipe, dt=0.01)
    >>> bool(np.allclose(model.step([0.5]), again.step([0.5])))
    True
    """
    period = None if dt is None else period_seconds(dt, "dt")
    logs = None if data is None else data._core
    return Model(_core.Model.of_network(path, _recipe.as_toml(recipe), logs, period))
