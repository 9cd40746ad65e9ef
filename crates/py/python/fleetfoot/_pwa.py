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
    select : {"cv", "bic"}
        How one of several partitions is chosen.
    folds : int
        Folds of the cross-validation: whole episodes where there are enough, else spans; 0 for none.
    purge : float
        Seconds between held-out and training rows of one episode; 0: a tenth of the held-out span.
    shrinkage : float or "auto"
        Pull of each region towards the one-region model, in rows; ``"auto"`` by cross-validation.
    unseen_labels : {"refuse", "pool"}
        What happens to labels that training did not see.
    seed, restarts, iterations : int
        Of k-means.
    tsqr : bool
        Fit by TSQR in one more pass.
    keep_all : bool
        Keep the models of all partitions, ``models_``.
    memory : int
        Bytes for the rows that k-means keeps; beyond it a sample is clustered.
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
        select: str = "cv",
        folds: int = 10,
        purge: float = 0.0,
        shrinkage: float | str = 0.0,
        unseen_labels: str = "refuse",
        seed: int = 0,
        restarts: int = 1,
        iterations: int = 100,
        tsqr: bool = False,
        keep_all: bool = False,
        memory: int = 512 << 20,
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
        return {"model": model} if model else {}

    def _fit(self, data: _core.Data, recipe: str, progress: Any) -> tuple[Model, dict[str, Any]]:
        options = {
            "folds": count("folds", self.folds, 0),
            "purge": number("purge", self.purge),
            "select": self.select,
            "shrinkage": None if self.shrinkage == "auto" else number("shrinkage", self.shrinkage),
            "unseen_labels": self.unseen_labels,
            "seed": count("seed", self.seed, 0),
            "restarts": count("restarts", self.restarts, 1),
            "iterations": count("iterations", self.iterations, 1),
            "tsqr": bool(self.tsqr),
            "keep_all": bool(self.keep_all),
            "memory": count("memory", self.memory, 1),
        }
        chosen, report, models = _core.fit_pwa(data, recipe, options, self.cache, progress)
        self.models_ = [Model(one) for one in models]
        return Model(chosen), json.loads(report)
