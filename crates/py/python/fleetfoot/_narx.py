"""Autoregressions with inputs."""

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
class NARX(Identifier):
    """Outputs from their own past and that of the inputs: polynomials, and piecewise where asked for.

    What is chosen (order, terms, partition) is chosen by simulations of spans that did not train, unless another rule
    is named. The outputs are what
    :meth:`fit` calls ``x``.

    Parameters
    ----------
    lags_out, lags_in : int, optional
        Past values of every output and input; looked for when not given.
    degree : int, optional
        Total degree of the polynomials; looked for up to 3 when not given.
    direct : bool, optional
        Whether inputs act at once; looked for when neither it nor ``lags_in`` is given.
    order : {"fixed", "auto"}, optional
        Lags and degree as given (2 where they are not), or the best up to them.
    effort : {"low", "normal", "high"}, optional
        How far what is not given is looked for: a count of work, never of seconds.
    library : list of str, optional
        Functions of outputs and inputs of one row, ``["y", "u", "sqrt(max(y, 0))"]``: the candidates are the lags of
        each, in the place of products of lags.
    terms : int or {"auto", "all"}, optional
        Terms of every equation.
    max_terms : int, optional
        The most terms that ``"auto"`` tries.
    select : {"free-run", "one-se", "cv", "aic", "bic", "ebic"}, optional
        What is chosen by.
    objective : str, optional
        What coefficients are fitted to: ``"one-step"`` (as when not given) or ``"steps:20"``, simulations of 20 steps,
        written where they simulate rows that did not train better; ``report_["objective"]`` tells.
    folds : int, optional
        Spans that are held out in turn.
    decimate : int, optional
        Every n-th row only.
    test_share : float, optional
        Last share of the rows of every episode that does not train and is run freely.
    seed, starts : int, optional
        Of k-means.
    partition : int, str or list, optional
        Regions, as for :class:`fleetfoot.PWA`.
    partition_on : list of str, optional
        What the partition looks at.
    free_run : optional
        Recordings to run the model on that do not train, as :func:`fleetfoot.open` takes them.
    COMMON

    Attributes
    ----------
    model_ : Model
        A discrete model; it needs ``history`` at points.
    report_ : dict
        ``order``, ``regions`` with the terms and their error reduction ratios, ``held_out`` (the model that is written,
        refitted on the other spans), ``search`` (what was looked at, what the effort cut), ``train`` and ``test`` with
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
        direct: bool | None = None,
        order: str | None = None,
        effort: str | None = None,
        library: Sequence[str] | None = None,
        terms: int | str | None = None,
        max_terms: int | None = None,
        select: str | None = None,
        objective: str | None = None,
        folds: int | None = None,
        decimate: int | None = None,
        test_share: float | None = None,
        seed: int | None = None,
        starts: int | None = None,
        partition: int | str | Sequence[int | str] | None = None,
        partition_on: Sequence[str] | None = None,
        free_run: Any = None,
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
        self.lags_out = lags_out
        self.lags_in = lags_in
        self.degree = degree
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
        self.states = states
        self.inputs = inputs
        self.angles = angles
        self.derivative = derivative
        self.known = known
        self.weight = weight
        self.recipe = recipe
        self.cache = cache
        self.progress = progress

    def _period(self, recipe: Mapping[str, Any]) -> float | None:
        return 1.0

    def _own_recipe(self) -> dict[str, Any]:
        whole = ("lags_out", "lags_in", "max_terms", "folds", "decimate", "seed", "starts")
        numbers = {name: getattr(self, name) for name in whole}
        narx = _recipe.said(
            **{name: None if value is None else count(name, value, 0) for name, value in numbers.items()},
            direct=self.direct,
            order=self.order,
            effort=self.effort,
            terms=self.terms if self.terms is None or isinstance(self.terms, str) else count("terms", self.terms, 1),
            select=self.select,
            objective=self.objective,
            test_share=None if self.test_share is None else number("test_share", self.test_share),
        )
        model = _recipe.said(
            degree=None if self.degree is None else count("degree", self.degree, 1),
            partition=partition(self.partition),
            partition_on=None if self.partition_on is None else list(self.partition_on),
        )
        library = _recipe.said(functions=None if self.library is None else list(self.library))
        sections = (("narx", narx), ("model", model), ("library", library))
        return {name: section for name, section in sections if section}

    def _fit(self, data: _core.Data, recipe: str, progress: Any) -> tuple[Model, dict[str, Any]]:
        other = None
        if self.free_run is not None:
            from ._data import open as open_data

            other = open_data(self.free_run)._core
        model, report = _core.fit_narx(data, recipe, other, self.cache, progress)
        return Model(model), json.loads(report)
