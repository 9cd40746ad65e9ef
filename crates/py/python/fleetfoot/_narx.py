"""Autoregressions with inputs."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any, Literal

from . import _core, _recipe
from ._data import open as open_data
from ._identify import AnyRecipe, Derivative, Identifier, States, documented, partition
from ._model import Model
from ._progress import Progress


@documented
class NARX(Identifier):
    """Autoregression of outputs on past outputs and inputs: polynomial, optionally piecewise.

    Simulations of held-out spans choose order, terms and partition, unless ``select`` names another rule. The outputs
    are ``x`` of :meth:`fit`.

    Parameters
    ----------
    lags_out, lags_in : int, optional
        Past values of every output and input; default: searched.
    lags : int, str or mapping, optional
        Instead of these, past rows of every output and input beside the present one, as regressors of the next row:
        the last 3, ``3``, or every 5th of the last 50, ``"50:5"`` or ``{"last": 50, "every": 5}``.
    degree : int, optional
        Total degree of the polynomials; default: searched up to 3.
    direct : bool, optional
        Direct feedthrough of the inputs; default: searched, unless ``lags_in`` is given.
    order : {"fixed", "auto"}, optional
        Lags and degree as given (2 if one is not given), or the best up to them.
    effort : {"low", "normal", "high"}, default="normal"
        Search effort, a count of work, never of seconds.
    library : list of str, optional
        Functions of outputs and inputs of one row, ``["y", "u", "sqrt(max(y, 0))"]``: their lags are the candidates,
        instead of products of lags.
    terms : int or {"auto", "all"}, default="auto"
        Terms of every equation.
    max_terms : int, default=20
        Largest number of terms that ``"auto"`` tries.
    select : {"free-run", "one-se", "cv", "aic", "bic", "ebic"}, default="free-run"
        Rule of the choice.
    objective : str, default="one-step"
        Objective of the coefficients: ``"one-step"``, ``"steps:20"`` (simulations of 20 steps), or ``"free-run"`` (as
        long as held-out rows allow). A model fitted to simulations is kept only if it simulates held-out rows better;
        see ``report_["objective"]``.
    folds : int, default=5
        Number of spans that are held out in turn.
    decimate : int, default=1
        Every n-th row only.
    test_share : float, default=0
        Share of the rows at the end of every episode that does not train and is simulated.
    seed, starts : int, default=0, 1
        Settings of k-means.
    partition : int, str or list, optional
        Regions, as for :class:`fleetfoot.PWA`.
    partition_on : list of str, optional
        Columns that define the regions.
    free_run : optional
        Held-out recordings to simulate, as in :func:`fleetfoot.open`.
    COMMON

    Attributes
    ----------
    model_ : Model
        A discrete model; it needs ``history`` at points.
    report_ : dict
        ``order``, ``regions`` with the terms and their error reduction ratios, ``held_out`` (the written model,
        refitted on the other spans), ``search`` (tried models, limits of the effort), ``train`` and ``test`` with
        one-step and free-run errors, ``files`` with those ``by_file`` and their ``mean``; ``notes``.

    Examples
    --------
    >>> import numpy as np, fleetfoot as ff
    >>> rng = np.random.default_rng(0)
    >>> u, y = rng.normal(size=400), np.zeros(400)
    >>> for k in range(1, 399):
    ...     y[k + 1] = 0.6 * y[k] - 0.2 * y[k - 1] + 0.5 * u[k]
    >>> narx = ff.NARX(lags_out=2, lags_in=1, degree=1, terms=3).fit(y, u=u, feature_names=["y"], input_names=["u"])
    >>> sorted(term["function"] for term in narx.report_["regions"][0]["equations"][0]["terms"])
    ['lag(y, 1)', 'u', 'y']
    """

    def __init__(
        self,
        lags_out: int | None = None,
        lags_in: int | None = None,
        degree: int | None = None,
        *,
        lags: int | str | Mapping[str, int] | None = None,
        direct: bool | None = None,
        order: str | None = None,
        effort: Literal["low", "normal", "high"] = "normal",
        library: Sequence[str] | None = None,
        terms: int | Literal["auto", "all"] = "auto",
        max_terms: int = 20,
        select: Literal["free-run", "one-se", "cv", "aic", "bic", "ebic"] = "free-run",
        objective: str = "one-step",
        folds: int = 5,
        decimate: int = 1,
        test_share: float = 0.0,
        seed: int = 0,
        starts: int = 1,
        partition: int | str | Sequence[int | str] | None = None,
        partition_on: Sequence[str] | None = None,
        free_run: Any = None,
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
        self.lags_out = lags_out
        self.lags_in = lags_in
        self.degree = degree
        self.lags = lags
        self.direct = direct
        self.order = order
        self.effort = effort
        self.library = library
        self.terms = terms
        self.max_terms = max_terms
        self.select = select
        self.objective = objective
        self.folds = folds
        self.decimate = decimate
        self.test_share = test_share
        self.seed = seed
        self.starts = starts
        self.partition = partition
        self.partition_on = partition_on
        self.free_run = free_run
        super().__init__(states, inputs, angles, derivative, known, weight, dt, recipe, cache, progress)

    def _period(self, recipe: Mapping[str, Any]) -> float | None:
        return 1.0

    def _predicts(self, base: Mapping[str, Any] | None = None) -> str:
        return "next"

    def _method_recipe(self) -> dict[str, Any]:
        whole = ("lags_out", "lags_in", "max_terms", "folds", "decimate", "seed", "starts")
        narx = _recipe.without_none(
            **{name: self._whole(name, 0) for name in whole},
            direct=self._argument("direct"),
            order=self._argument("order"),
            effort=self._argument("effort"),
            terms=self._argument("terms") if isinstance(self.terms, str) else self._whole("terms", 1),
            select=self._argument("select"),
            objective=self._argument("objective"),
            test_share=self._real("test_share"),
        )
        model = _recipe.without_none(
            degree=self._whole("degree", 1),
            lags=self._past(),
            partition=partition(self._argument("partition")),
            partition_on=self._list("partition_on"),
        )
        library = _recipe.without_none(functions=self._list("library"))
        sections = (("narx", narx), ("model", model), ("library", library))
        return {name: section for name, section in sections if section}

    def _fit(self, data: _core.Data, recipe: str, progress: Any) -> tuple[Model, dict[str, Any]]:
        other = None
        if self.free_run is not None:
            other = open_data(self.free_run)._core
        [(_, model, report, _)] = _core.fit("narx", data, recipe, other=other, cache=self.cache, progress=progress)
        return Model(model), report
