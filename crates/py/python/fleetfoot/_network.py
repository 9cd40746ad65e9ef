"""Feed-forward and recurrent networks beside a linear map."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any, Literal

from . import _core, _recipe
from ._identify import AnyRecipe, Derivative, Identifier, States, documented
from ._model import Model
from ._progress import Progress


@documented
class Network(Identifier):
    """A network beside a linear map, where it predicts held-out rows better; else the linear model.

    Of several sizes, the linear model among them, the smallest is taken whose cross-validated error is above the least
    one by no more than one standard error of their ratio.

    Parameters
    ----------
    hidden : int or list of int, optional
        Units of every hidden layer. When not given sizes are tried from small to large.
    activation : {"tanh", "relu", "softplus"}, default="tanh"
        What units do with their sums.
    cell : {"none", "rnn", "gru", "lstm"}, default="none"
        Recurrent cell that reads the past rows one after another, in place of hidden layers; ``hidden`` is then one
        number of units.
    effort : {"low", "normal", "high"}, default="normal"
        Sizes that are tried, and the passes over rows that training takes.
    target : str, optional
        ``"derivative"``, ``"next"``, ``"delta"``, or a column (plain regression). When not given what the recipe says,
        else ``"delta"``; ``"derivative"`` where a state has a known or a measured derivative.
    degree : int, optional
        Total degree of the polynomials that the linear map and the network read. When not given what the recipe says,
        else 1.
    lags : int, str or mapping, optional
        Past rows of every state and input that stand beside the present one: the last 3, ``3``, or every 5th of the
        last 50, ``"50:5"`` or ``{"last": 50, "every": 5}``. When not given what the recipe says, else those with which
        linear models simulate held-out spans best, if the network simulates them better with past rows than without
        (``target="next"`` and ``"delta"``).
    folds : int, default=5
        Folds of the cross-validation: whole episodes where there are enough, else spans.
    seed : int, default=0
        Of the first weights and of the order of rows.
    memory : int, default=2**29
        Bytes for the rows that train; of more rows an even share is taken.
    COMMON

    Attributes
    ----------
    model_ : Model
    report_ : dict
        ``candidates``: for each size ``loss``, ``standard_error``, ``rmse``, ...; ``chosen``; ``held_out``: errors of
        the model that is written, of the mean and of persistence; ``notes``.

    Examples
    --------
    >>> import numpy as np, fleetfoot as ff
    >>> t = np.arange(0, 20, 0.02)
    >>> x = np.sin(3 * t) * np.cos(0.7 * t)
    >>> fit = ff.Network(target="y", effort="low").fit(np.column_stack([x, np.tanh(3 * x)]), t, feature_names=["x", "y"])
    >>> fit.report_["candidates"][0]["name"]
    'linear'
    """

    def __init__(
        self,
        hidden: int | Sequence[int] | None = None,
        *,
        activation: Literal["tanh", "relu", "softplus"] = "tanh",
        cell: Literal["none", "rnn", "gru", "lstm"] = "none",
        effort: Literal["low", "normal", "high"] = "normal",
        target: str | None = None,
        degree: int | None = None,
        lags: int | str | Mapping[str, int] | None = None,
        folds: int = 5,
        seed: int = 0,
        memory: int = 2**29,
        states: States = None,
        inputs: States = None,
        angles: Sequence[str] = (),
        derivative: Derivative = "auto",
        known: Mapping[str, str] | None = None,
        weight: str | None = None,
        dt: float | None = None,
        recipe: AnyRecipe = None,
        cache: str | os.PathLike[str] | None = None,
        progress: Progress = None,
    ) -> None:
        self.hidden = hidden
        self.activation = activation
        self.cell = cell
        self.effort = effort
        self.target = target
        self.degree = degree
        self.lags = lags
        self.folds = folds
        self.seed = seed
        self.memory = memory
        super().__init__(states, inputs, angles, derivative, known, weight, dt, recipe, cache, progress)

    def _method_recipe(self) -> dict[str, Any]:
        model = _recipe.without_none(predict=self._argument("target"), degree=self._whole("degree", 1), lags=self._past())
        hidden = self._argument("hidden")
        if hidden is not None and not isinstance(hidden, str):
            hidden = ",".join(str(int(units)) for units in (hidden if isinstance(hidden, Sequence) else [hidden]))
        memory = self._whole("memory", 1)
        network = _recipe.without_none(
            hidden=hidden,
            activation=self._argument("activation"),
            cell=self._argument("cell"),
            effort=self._argument("effort"),
            folds=self._whole("folds", 2),
            seed=self._whole("seed", 0),
            # The recipe has MiB.
            memory=None if memory is None else max(1, memory // 2**20),
        )
        return {name: section for name, section in (("model", model), ("network", network)) if section}

    def _fit(self, data: _core.Data, recipe: str, progress: Any) -> tuple[Model, dict[str, Any]]:
        [(_, chosen, report, _)] = _core.fit("network", data, recipe, cache=self.cache, progress=progress)
        return Model(chosen), report
