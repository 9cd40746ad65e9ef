"""Piecewise-affine models."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any, Literal

from . import _core, _recipe
from ._identify import AnyRecipe, Derivative, Identifier, States, documented, partition
from ._model import Model
from ._progress import Progress


@documented
class PWA(Identifier):
    """A piecewise-affine model: regions of the state space by k-means, labels or a ball, and least squares in each.

    From several partitions the smallest whose cross-validated error is within one standard error of the best is
    chosen (or the one with the lowest BIC).

    Parameters
    ----------
    partition : int, str or list, optional
        ``"average"`` (one region), ``"null"``, ``"zscore:1.5"``, ``"zbox:1.5"``, ``"kmeans:10"`` (or ``10``),
        ``"refined:5"`` (regions that fit the dynamics), ``"lattice:5"`` (small cells, joined where one map fits both),
        ``"tree:3"`` (cuts of single columns, three at most one after another), ``"labels:COLUMN"``,
        ``"labels:COLUMN+kmeans:5"``, ``"labels:COLUMN+refined:5"``, ``"labels:COLUMN+tree:3"``; from a list, or a range
        ``"refined:2..20"``, ``"lattice:2..50"``, ``"tree:1..6"``, one is chosen. Default: those of the recipe or the
        statistic, else ``["average", 2, 5, 10]``, for a statistic without regions ``"average"``.
    target : str, optional
        ``"derivative"``, ``"next"``, ``"delta"``, or a column (plain regression). Default: that of the recipe, else
        ``"derivative"``.
    degree : int, optional
        Total degree of the polynomials. Default: that of the recipe, else 1, affine.
    radial : int, optional
        Number of radial functions of states and inputs beside the polynomials: Gaussians around k-means centroids, as
        wide as the distance between centres. Default: that of the recipe, else none.
    lags : int, str or mapping, optional
        Past rows of every state and input beside the present one: the last 3, ``3``, or every 5th of the last 50,
        ``"50:5"`` or ``{"last": 50, "every": 5}``. Default: that of the recipe, else 0.
    partition_on : list of str, optional
        Columns that define the regions; default: the states.
    select : {"cv", "bic", "rollout"}, default="cv"
        Rule that chooses one of several partitions; ``"rollout"`` by simulations of held-out spans.
    objective : str, default="one-step"
        Objective of the coefficients: ``"one-step"``, ``"steps:20"`` (simulations of 20 steps), or ``"free-run"`` (as
        long as held-out rows allow). A model fitted to simulations is kept only if it simulates held-out rows better;
        see ``report_["objective"]``.
    horizon : int, default=50
        Steps of the rollouts of ``select``, and of those for a span ``{"over": "auto"}``.
    folds : int, default=10
        Folds of the cross-validation: whole episodes if there are enough, else spans; 0 for none.
    purge : float, optional
        Seconds between held-out and training rows of one episode; default: a tenth of the held-out span.
    shrinkage : float, "auto" or "none", default="auto"
        Pull of each region's map towards the map of all rows, in rows; ``"auto"`` by cross-validation.
    continuous : bool, default=False
        Maps of neighbouring regions meet at their border, for kmeans, refined and tree on columns that are
        regressors. ``report_["candidates"]`` also has the loss of independent maps.
    stable : float, optional
        Contraction bound of each region's map over one sampling period (spectral norm in the shared metric): 1 for a
        stable model. ``report_["candidates"]`` has radii, norms, the metric and the loss of the free model.
    passive : str or dict of str to str, optional
        Ports, inputs with the states whose product is a power, ``"force:speed"`` or ``{"force": "speed"}``: maps give
        out no more energy than they took in. A number after a second colon is the allowed energy gain per sample
        (default: twice the discretisation error). See ``stability`` in ``report_["candidates"]``, whose ``metric`` is
        then twice the energy.
    phase : str, optional
        Phase for the counts of regions, along it and from stride to stride: ``"alpha_l:24"``, a periodic column or
        expression with its bins (12), or ``"labels:stance"``. ``model_.export("npz", ...)`` has the counts, and
        ``fleetfoot show --transitions`` prints them.
    unseen_labels : {"refuse", "pool"}, default="refuse"
        Rule for labels that training did not see: an error, or the model fitted on all rows.
    outside : {"average", "hold", "extrapolate"}, default="average"
        Continuation of a model of several regions where a regressor leaves the range that its region saw in training:
        the slopes of the one-region model from the border of the range on, or the map of the region. Maps that are
        bounded, or meet at borders, always extrapolate.
    seed, restarts, iterations : int, default=0, 1, 100
        Settings of k-means.
    tsqr : bool, default=False
        Fit by TSQR in one more pass.
    keep_all : bool
        Keep the models of all partitions, ``models_``.
    memory : int, default=2**29
        Bytes for the rows of k-means; beyond them a sample is clustered.
    COMMON

    Attributes
    ----------
    model_ : Model
    models_ : list of Model
        With ``keep_all`` the models of all partitions, in their order.
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
        radial: int | None = None,
        lags: int | str | Mapping[str, int] | None = None,
        partition_on: Sequence[str] | None = None,
        select: Literal["cv", "bic", "rollout"] = "cv",
        objective: str = "one-step",
        horizon: int = 50,
        folds: int = 10,
        purge: float | None = None,
        shrinkage: float | Literal["auto", "none"] = "auto",
        continuous: bool = False,
        stable: float | None = None,
        passive: str | Mapping[str, str] | None = None,
        phase: str | None = None,
        unseen_labels: Literal["refuse", "pool"] = "refuse",
        outside: Literal["average", "hold", "extrapolate"] = "average",
        seed: int = 0,
        restarts: int = 1,
        iterations: int = 100,
        tsqr: bool = False,
        keep_all: bool = False,
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
        self.partition = partition
        self.target = target
        self.degree = degree
        self.radial = radial
        self.lags = lags
        self.partition_on = partition_on
        self.select = select
        self.objective = objective
        self.horizon = horizon
        self.folds = folds
        self.purge = purge
        self.shrinkage = shrinkage
        self.continuous = continuous
        self.stable = stable
        self.passive = passive
        self.phase = phase
        self.unseen_labels = unseen_labels
        self.outside = outside
        self.seed = seed
        self.restarts = restarts
        self.iterations = iterations
        self.tsqr = tsqr
        self.keep_all = keep_all
        self.memory = memory
        super().__init__(states, inputs, angles, derivative, known, weight, dt, recipe, cache, progress)

    def _ports(self) -> str | None:
        ports = self._argument("passive")
        return ",".join(f"{force}:{speed}" for force, speed in ports.items()) if isinstance(ports, Mapping) else ports

    def _method_recipe(self) -> dict[str, Any]:
        model = _recipe.without_none(
            predict=self._argument("target"),
            degree=self._whole("degree", 1),
            lags=self._past(),
            partition=partition(self._argument("partition")),
            partition_on=self._list("partition_on"),
        )
        least = {"horizon": 1, "folds": 0, "seed": 0, "restarts": 1, "iterations": 1}
        memory = self._whole("memory", 1)
        pwa = _recipe.without_none(
            **{name: self._whole(name, low) for name, low in least.items()},
            select=self._argument("select"),
            objective=self._argument("objective"),
            purge=self._real("purge"),
            shrinkage=self._real("shrinkage", "auto", "none"),
            continuous=self._argument("continuous"),
            stable=self._real("stable"),
            passive=self._ports(),
            phase=self._argument("phase"),
            unseen_labels=self._argument("unseen_labels"),
            outside=self._argument("outside"),
            # The recipe has MiB.
            memory=None if memory is None else memory / 2**20,
            tsqr=self._argument("tsqr"),
        )
        library = _recipe.without_none(radial=self._whole("radial", 1))
        sections = (("model", model), ("library", library), ("pwa", pwa))
        return {name: section for name, section in sections if section}

    def _fit(self, data: _core.Data, recipe: str, progress: Any) -> tuple[Model, dict[str, Any]]:
        rivals = bool(self.keep_all)
        [(_, chosen, report, models)] = _core.fit(
            "pwa", data, recipe, rivals=rivals, cache=self.cache, progress=progress
        )
        self.models_ = [Model(one) for _, one in models]
        return Model(chosen), report
