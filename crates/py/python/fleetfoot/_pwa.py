"""Piecewise-affine models."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from typing import Any

from . import _core, _recipe
from ._identify import AnyRecipe, Derivative, Identifier, States, count, documented, number, partition
from ._model import Model
from ._progress import Progress


@documented
class PWA(Identifier):
    """A piecewise-affine model: regions of the state space by k-means, labels or a ball, and least squares in each.

    Of several partitions the smallest whose cross-validated error is within one standard error of the best is taken
    (or the one of the lowest BIC).

    Parameters
    ----------
    partition : int, str or list, optional
        ``"average"`` (one region, as when not given), ``"null"``, ``"zscore:1.5"``, ``"kmeans:10"`` (or ``10``),
        ``"labels:COLUMN"``, ``"labels:COLUMN+kmeans:5"``; of a list one is
        chosen.
    target : str, optional
        ``"derivative"`` (as when not given), ``"next"``, ``"delta"``, or a column (plain regression).
    degree : int, optional
        Total degree of the polynomials; 1, affine, when not given.
    lags : int, optional
        Past rows of every state and input that stand beside the present one.
    partition_on : list of str, optional
        What partitions look at; the states when not given.
    select : {"cv", "bic", "rollout"}, optional
        How one of several partitions is chosen: ``"cv"`` when not given; ``"rollout"`` by simulations of spans that did
        not train.
    objective : str, optional
        What coefficients are fitted to: ``"one-step"`` (as when not given) or ``"steps:20"``, simulations of 20 steps,
        written where they simulate rows that did not train better; ``report_["objective"]`` tells.
    horizon : int, optional
        Steps of the rollouts of ``select``, and of those that choose a span ``{"over": "auto"}``; 50 when not given.
    folds : int, optional
        Folds of the cross-validation: whole episodes where there are enough, else spans; 0 for none, 10 when not given.
    purge : float, optional
        Seconds between held-out and training rows of one episode; a tenth of the held-out span when not given.
    shrinkage : float or "auto", optional
        Pull of each region towards the one-region model, in rows; ``"auto"`` by cross-validation; 0 when not given.
    unseen_labels : {"refuse", "pool"}, optional
        What happens to labels that training did not see; an error when not given.
    seed, restarts, iterations : int, optional
        Of k-means; 0, 1 and 100 when not given.
    tsqr : bool, optional
        Fit by TSQR in one more pass.
    keep_all : bool
        Keep the models of all partitions, ``models_``.
    memory : int, optional
        Bytes for the rows that k-means keeps; beyond it a sample is clustered. 512 MiB when not given.
    COMMON

    Attributes
    ----------
    model_ : Model
    models_ : list of Model
        With ``keep_all`` those of all partitions, in their order.
    report_ : dict
        ``candidates``: for each partition ``mae_over_null``, ``r2``, ``loss``, ...; ``chosen``; ``condition``;
        ``notes``.

    Examples
    --------
    >>> import numpy as np, fleetfoot as ff
    >>> t = np.arange(0, 6, 0.01)
    >>> x = np.sin(3 * t)
    >>> force = np.where(x > 0, -2.0 * x, -5.0 * x)
    >>> model = ff.PWA(2, target="next").fit(np.column_stack([x, force]), t, feature_names=["x", "f"])
    >>> model.coefficients().shape
    (2, 2, 3)
    """

    models_: list[Model]

    def __init__(
        self,
        partition: int | str | Sequence[int | str] | None = None,
        *,
        target: str | None = None,
        degree: int | None = None,
        lags: int | None = None,
        partition_on: Sequence[str] | None = None,
        select: str | None = None,
        objective: str | None = None,
        horizon: int | None = None,
        folds: int | None = None,
        purge: float | None = None,
        shrinkage: float | str | None = None,
        unseen_labels: str | None = None,
        seed: int | None = None,
        restarts: int | None = None,
        iterations: int | None = None,
        tsqr: bool | None = None,
        keep_all: bool = False,
        memory: int | None = None,
        states: States = None,
        inputs: States = None,
        angles: Sequence[str] = (),
        derivative: Derivative = None,
        known: Mapping[str, str] | None = None,
        weight: str | None = None,
        recipe: AnyRecipe = None,
        cache: str | os.PathLike[str] | None = None,
        progress: Progress = None,
    ) -> None:
        self.partition = partition
        self.target = target
        self.degree = degree
        self.lags = lags
        self.partition_on = partition_on
        self.select = select
        self.objective = objective
        self.horizon = horizon
        self.folds = folds
        self.purge = purge
        self.shrinkage = shrinkage
        self.unseen_labels = unseen_labels
        self.seed = seed
        self.restarts = restarts
        self.iterations = iterations
        self.tsqr = tsqr
        self.keep_all = keep_all
        self.memory = memory
        self.states = states
        self.inputs = inputs
        self.angles = angles
        self.derivative = derivative
        self.known = known
        self.weight = weight
        self.recipe = recipe
        self.cache = cache
        self.progress = progress

    def _own_recipe(self) -> dict[str, Any]:
        model = _recipe.said(
            predict=self.target,
            degree=None if self.degree is None else count("degree", self.degree, 1),
            lags=None if self.lags is None else count("lags", self.lags, 0),
            partition=partition(self.partition),
            partition_on=None if self.partition_on is None else list(self.partition_on),
        )
        least = {"horizon": 1, "folds": 0, "seed": 0, "restarts": 1, "iterations": 1}
        whole = {name: getattr(self, name) for name in least}
        pwa = _recipe.said(
            **{name: None if value is None else count(name, value, least[name]) for name, value in whole.items()},
            select=self.select,
            objective=self.objective,
            purge=None if self.purge is None else number("purge", self.purge),
            shrinkage=self.shrinkage if self.shrinkage in (None, "auto") else number("shrinkage", self.shrinkage),
            unseen_labels=self.unseen_labels,
            # The recipe has MiB.
            memory=None if self.memory is None else count("memory", self.memory, 1) / 2**20,
            tsqr=self.tsqr,
        )
        return {name: section for name, section in (("model", model), ("pwa", pwa)) if section}

    def _fit(self, data: _core.Data, recipe: str, progress: Any) -> tuple[Model, dict[str, Any]]:
        chosen, report, models = _core.fit_pwa(data, recipe, bool(self.keep_all), self.cache, progress)
        self.models_ = [Model(one) for one in models]
        return Model(chosen), json.loads(report)
