"""Parameters of given equations."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

from . import _core, _recipe
from ._identify import AnyRecipe, Derivative, Identifier, States, documented
from ._model import Model
from ._progress import Progress
from ._values import number


@documented
class Parameters(Identifier):
    """Parameters of given equations, by output error, filter error (maximum likelihood) or equation error.

    The equation of every state is given by ``known``, over columns and parameters.

    Parameters
    ----------
    parameters : dict
        For each name the start of the search, or a dict with ``initial`` and optionally ``bounds``, ``fixed`` and
        ``unit``.
    constraints : dict, optional
        Limits on parameters, as in ``[constraints]`` of a recipe:
        ``{"inertia": {"matrix": [["J11", "J12"], ["J12", "J22"]], "at_least": 1e-3}}``, eigenvalues, or
        ``{"of": "J11 - J22", "at_most": 0.0}``, a number. The initial values must be strictly within; see
        ``report_["limits"]``.
    method : {"output-error", "filter-error", "equation-error"}, default="output-error"
        Method: simulations from estimated initial states, the same corrected by measurements with estimated gains, or
        derivatives row by row.
    segment : int, optional
        Largest number of rows of a segment; each has its own initial state. Default: whole episodes.
    compare : list of str, optional
        States that are compared with their measurements; default: all.
    folds : int, default=5
        Number of folds whose rows are held out in turn and simulated; 0 for none.
    search : int, default=0
        Evaluations of a global search for the start, between the bounds of the parameters; each is one simulation of
        the logs.
    COMMON

    Attributes
    ----------
    model_ : Model
        The equations with the values of the parameters.
    report_ : dict
        ``parameters`` with ``value``, ``standard_error`` and ``interval`` (95 %), ``confounded``, ``noise``,
        ``correlated_rows``, ``held_out``, ``warnings``, ``notes``; of filter error ``gains`` and ``innovations``.

    Examples
    --------
    >>> import numpy as np, fleetfoot as ff
    >>> t = np.arange(0.0, 10.0, 0.05)
    >>> x = np.column_stack([np.cos(1.5 * t), -1.5 * np.sin(1.5 * t)])
    >>> x += 0.01 * np.random.default_rng(0).normal(size=x.shape)
    >>> known = {"q": "v", "v": "-k*q"}
    >>> found = ff.Parameters({"k": 1.0}, known=known).fit(x, t, feature_names=["q", "v"])
    >>> low, high = found.report_["parameters"][0]["interval"]
    >>> bool(low < 2.25 < high and high - low < 0.02)
    True
    """

    def __init__(
        self,
        parameters: Mapping[str, Any] | None = None,
        *,
        constraints: Mapping[str, Mapping[str, Any]] | None = None,
        method: str = "output-error",
        segment: int | None = None,
        compare: Sequence[str] | None = None,
        folds: int = 5,
        search: int = 0,
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
        self.parameters = parameters
        self.constraints = constraints
        self.method = method
        self.segment = segment
        self.compare = compare
        self.folds = folds
        self.search = search
        super().__init__(states, inputs, angles, derivative, known, weight, dt, recipe, cache, progress)

    def _method_recipe(self) -> dict[str, Any]:
        compare = self._list("compare")
        estimate = _recipe.without_none(
            method=self._argument("method"),
            segment=self._whole("segment", 2),
            compare=None if compare is None else ",".join(f"`{name}`" for name in compare),
            folds=self._whole("folds", 0),
            search=self._whole("search", 0),
        )
        given = (self.parameters or {}).items()
        parameters = {
            name: dict(one) if isinstance(one, Mapping) else {"initial": number(name, one)} for name, one in given
        }
        constraints = {name: dict(one) for name, one in (self.constraints or {}).items()}
        sections = (("estimate", estimate), ("parameters", parameters), ("constraints", constraints))
        return {name: section for name, section in sections if section}

    def _fit(self, data: _core.Data, recipe: str, progress: Any) -> tuple[Model, dict[str, Any]]:
        [(_, model, report, _)] = _core.fit("parameters", data, recipe, cache=self.cache, progress=progress)
        return Model(model), report
