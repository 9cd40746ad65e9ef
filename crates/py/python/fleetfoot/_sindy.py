"""Sparse equations from libraries of candidate functions."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from . import _core, _peers, _recipe
from ._call import Call
from ._identify import (
    AnyRecipe,
    Derivative,
    Identifier,
    States,
    documented,
    groups_of,
    partition,
)
from ._model import Model
from ._progress import Progress
from ._runs import array_runs, differentiated, runs
from ._symbols import quoted
from ._values import names_of, number
from .exceptions import RequestError

if TYPE_CHECKING:
    Array = np.ndarray[Any, np.dtype[np.float64]]


@documented
class SINDy(Identifier):
    """Equations as sparse sums of candidate functions, beside a known part of the dynamics (sparse identification of
    nonlinear dynamics).

    One pass over the rows. Held-out errors choose the number of terms (fewest within one standard error of the least)
    unless a threshold or the number is given. With a number for ``threshold`` it is pysindy's STLSQ, including the
    ridge weight 0.05.

    Parameters
    ----------
    optimizer : str or object, default="auto"
        ``"auto"`` (thresholds of STLSQ and backward elimination together), ``"stlsq"``, ``"sr3"``, ``"ssr"``,
        ``"frols"``, ``"lasso"``, ``"group-lasso"``, ``"ols"``; or an ``STLSQ``, ``SR3`` or ``FROLS`` object of
        pysindy or of this package, whose terms are refitted by least squares; or an ``SSR`` or ``EnsembleOptimizer``
        of pysindy, among whose models ``select`` and ``inclusion`` choose. Unsupported settings of an object are
        refused.
    library : str, list of str or object, optional
        Candidate functions: ``"poly(3)"``, ``["poly(2)", "fourier(1)", "x*abs(y)"]``; Python functions,
        ``["poly(1)", lambda x, y: x * abs(y)]``, which are read as expressions of every choice of variables; or a
        polynomial, Fourier, identity, custom, concatenated or tensored library of pysindy. Default: that of the
        recipe, else ``"poly(2)"``, or ``"poly(1)"`` if ``"poly(2)"`` has more than 500 functions.
    radial : int, optional
        Number of radial functions of states and inputs beside the candidates, which are then ``"poly(1)"`` by
        default: Gaussians around k-means centroids, as wide as the distance between centres. Default: that of the
        recipe, else none.
    feature_library : object, optional
        pysindy's name for ``library``.
    differentiation_method : callable, optional
        pysindy's name for ``derivative``.
    threshold : float or "auto", default="auto"
        Smallest coefficient that STLSQ and SR3 keep.
    terms : int, optional
        Number of terms of every equation.
    ridge : float, optional
        Weight of the squared coefficients in STLSQ.
    normalize : bool or "length", optional
        Thresholds and ridge in shares of the target instead of physical coefficients; ``"length"``: coefficients of
        columns of length 1, as pysindy's ``normalize_columns``.
    max_iterations : int, default=20
        Largest number of regressions of STLSQ.
    kappa : float, optional
        Weight of a term in the stopping rule of forward regression (``"frols"``) by error reduction ratios, relative
        to the condition number of the columns.
    select : {"one-se", "cv", "aic", "bic", "ebic"}, default="one-se"
        Rule of the choice.
    objective : str, default="one-step"
        Objective of the coefficients: ``"one-step"``, ``"steps:20"`` (simulations of 20 steps), or ``"free-run"`` (as
        long as held-out rows allow). A model fitted to simulations is kept only if it simulates held-out rows better;
        see ``report_["objective"]``.
    weak : int or {"auto", "off"}, optional
        Weak form: fit on windows of so many rows, without differences of noisy rows; ``"auto"`` takes the length from
        the signals. Default: windows if more than a fifth of the variance of some state's differences is noise; see
        ``report_["weak"]``.
    smooth_states : {"auto", "on", "off"}, default="auto"
        Smooth the states under the equations, in turn with the fit; ``"auto"`` if there are windows because of noise.
        See ``report_["smooth_states"]``.
    folds : int or str, default="auto"
        ``"auto"``, a number, ``"episodes"``, or ``"splits:N"``.
    ensemble : str, optional
        ``"chunks:100"``, ``"episodes:100"``, ``"library:100"``.
    inclusion : float, default=0.6
        Share of an ensemble's fits that must have a term.
    groups : str or dict of str to list of str, optional
        Groups of functions that enter together, for the group lasso: ``"signal"`` (a signal with its powers and lags,
        the default), or lists of signals by the names of the groups.
    l1_ratio : float, default=0
        Share of the absolute values in the penalty of the group lasso.
    seed : int, default=0
        Seed of all random numbers.
    nominal : dict of str to str, optional
        Known part of a state's right side; the rest is learnt.
    fixed : dict of str to list of str, optional
        Terms that a state's equation always has.
    constraints : dict, optional
        Limits on coefficients, as in ``[constraints]`` of a recipe:
        ``{"damping": {"coefficients": {"v": ["v"]}, "at_most": 0.0}}``. Every regression respects them;
        ``report_["limits"]`` has the distances, ``free_rms`` and ``free_held_out_rms`` of each equation the errors
        without limits.
    parameters : dict, optional
        Unknown numbers inside expressions: ``{"tau": 0.05}``, ``{"tau": {"initial": 0.05, "bounds": [0.01, 0.3]}}``.
    discrete_time : bool, default=False
        Predict next values instead of derivatives.
    target : str, optional
        ``"derivative"``, ``"next"``, ``"delta"``, or a column. Default: that of the recipe, else ``"derivative"``.
    partition : int, str or list, optional
        Regions, as for :class:`fleetfoot.PWA`, with separate equations.
    partition_on : list of str, optional
        Columns that define the regions.
    front : bool, default=False
        Keep the models with other numbers of terms in ``front_``.
    COMMON

    Attributes
    ----------
    model_ : Model
    report_ : dict
        ``regions``: for each its ``equations`` with ``terms`` (coefficient, standard error, inclusion), errors on the
        rows of the fit and held out; ``notes``.
    front_ : dict of int to Model
        With ``front``: models by the largest number of terms of an equation.

    Examples
    --------
    >>> import numpy as np, fleetfoot as ff
    >>> t = np.arange(0, 10, 0.01)
    >>> x = np.column_stack([np.cos(2 * t), -2 * np.sin(2 * t)])
    >>> sindy = ff.SINDy(threshold=0.1, library="poly(2)").fit(x, t, feature_names=["q", "v"])
    >>> sindy.equations(3)
    ['d(q)/dt = 1*v', 'd(v)/dt = -4*q']
    """

    front_: dict[int, Model]

    def __init__(
        self,
        optimizer: Any = "auto",
        library: Any = None,
        differentiation_method: Any = None,
        *,
        feature_library: Any = None,
        radial: int | None = None,
        threshold: float | Literal["auto"] = "auto",
        terms: int | None = None,
        ridge: float | None = None,
        normalize: bool | Literal["length"] | None = None,
        max_iterations: int = 20,
        kappa: float | None = None,
        select: Literal["one-se", "cv", "aic", "bic", "ebic"] = "one-se",
        objective: str = "one-step",
        weak: int | Literal["auto", "off"] | None = None,
        smooth_states: Literal["auto", "on", "off"] = "auto",
        folds: int | str = "auto",
        ensemble: str | None = None,
        inclusion: float = 0.6,
        groups: str | Mapping[str, Sequence[str]] | None = None,
        l1_ratio: float = 0.0,
        seed: int = 0,
        nominal: Mapping[str, str] | None = None,
        fixed: Mapping[str, Sequence[str]] | None = None,
        constraints: Mapping[str, Mapping[str, Any]] | None = None,
        parameters: Mapping[str, Any] | None = None,
        discrete_time: bool = False,
        target: str | None = None,
        partition: int | str | Sequence[int | str] | None = None,
        partition_on: Sequence[str] | None = None,
        front: bool = False,
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
        self.optimizer = optimizer
        self.library = library
        self.differentiation_method = differentiation_method
        self.feature_library = feature_library
        self.radial = radial
        self.threshold = threshold
        self.terms = terms
        self.ridge = ridge
        self.normalize = normalize
        self.max_iterations = max_iterations
        self.kappa = kappa
        self.select = select
        self.objective = objective
        self.weak = weak
        self.smooth_states = smooth_states
        self.folds = folds
        self.ensemble = ensemble
        self.inclusion = inclusion
        self.groups = groups
        self.l1_ratio = l1_ratio
        self.seed = seed
        self.nominal = nominal
        self.fixed = fixed
        self.constraints = constraints
        self.parameters = parameters
        self.discrete_time = discrete_time
        self.target = target
        self.partition = partition
        self.partition_on = partition_on
        self.front = front
        super().__init__(states, inputs, angles, derivative, known, weight, dt, recipe, cache, progress)

    def _derivative(self) -> Derivative:
        given = self._argument("derivative")
        method: Derivative = _one("derivative", given, "differentiation_method", self.differentiation_method)
        return method

    def _method_recipe(self) -> dict[str, Any]:
        if self.discrete_time and self.target not in (None, "next"):
            raise RequestError(f"discrete_time=True predicts next values, and target={self.target!r} does not; leave one of them out")
        model = _recipe.without_none(
            predict="next" if self.discrete_time else self._argument("target"),
            partition=partition(self._argument("partition")),
            partition_on=self._list("partition_on"),
        )
        items = _peers.library(_one("library", self._argument("library"), "feature_library", self.feature_library))
        recipe: dict[str, Any] = {"model": model, "sindy": self._section()}
        recipe["library"] = _recipe.without_none(functions=items, radial=self._whole("radial", 1))
        if self.constraints:
            recipe["constraints"] = {name: dict(section) for name, section in self.constraints.items()}
        if self.parameters:
            given = self.parameters.items()
            recipe["parameters"] = {
                name: one if isinstance(one, Mapping) else {"initial": number(name, one)} for name, one in given
            }
        return {name: section for name, section in recipe.items() if section}

    def _data(self, call: Call, base: dict[str, Any]) -> tuple[_core.Data, dict[str, Any]]:
        data, recipe = super()._data(call, base)
        items = recipe.get("library", {}).get("functions", [])
        if any(isinstance(item, _peers.Functions) for item in items):
            kinds = ("quaternion", "rotation-vector", "axis-angle")
            states = [
                name
                for name, state in recipe.get("states", {}).items()
                if state.get("regressor", True) and state.get("kind") not in kinds
            ]
            names = [*states, *recipe.get("inputs", {})]
            texts = [item.expressions(names) if isinstance(item, _peers.Functions) else [item] for item in items]
            recipe = _recipe.over({"library": {"functions": [text for one in texts for text in one]}}, recipe)
        return data, recipe

    def _section(self) -> dict[str, Any]:
        """The entries of ``[sindy]``."""
        entries = _recipe.without_none(
            threshold=self._real("threshold", "auto"),
            terms=self._whole("terms", 1),
            ridge=self._real("ridge"),
            normalize=self._argument("normalize"),
            max_iterations=self._whole("max_iterations", 1),
            kappa=self._real("kappa"),
            select=self._argument("select"),
            objective=self._argument("objective"),
            weak=self._real("weak", "auto", "off"),
            smooth_states=self._argument("smooth_states"),
            folds=self._text("folds"),
            ensemble=self._argument("ensemble"),
            inclusion=self._real("inclusion"),
            groups=groups_of(self.groups),
            l1_ratio=self._real("l1_ratio"),
            seed=self._whole("seed", 0),
        )
        given = _peers.optimizer(self._argument("optimizer"))
        twice = [name for name in entries if name in given and entries[name] != given[name]]
        if twice:
            raise RequestError(
                f"{twice[0]}={entries[twice[0]]!r}: the {type(self.optimizer).__name__} object says {given[twice[0]]!r} "
                f"({_peers.SAYS[twice[0]]}); say it once"
            )
        return _recipe.over(entries, given)

    def _roles(self, recipe: dict[str, Any], arrays: bool) -> dict[str, Any]:
        recipe = super()._roles(recipe, arrays)
        states = recipe.get("states", {})
        for what, given in (("nominal", self.nominal), ("fixed", self.fixed)):
            for name, value in (given or {}).items():
                if not states:
                    raise RequestError(
                        f"{what}: no states are named; give states=... or a recipe with [states] (those of a statistic "
                        "are settled: other targets need the rows)"
                    )
                if name not in states:
                    raise RequestError(f"{what}: {name!r} is not a state; there are {', '.join(states)}")
                states[name] = {**states[name], what: value if what == "nominal" else names_of(value)}
        return recipe

    def _fit(self, data: _core.Data, recipe: str, progress: Any) -> tuple[Model, dict[str, Any]]:
        rivals = bool(self.front)
        [(_, chosen, report, front)] = _core.fit(
            "sindy", data, recipe, rivals=rivals, cache=self.cache, progress=progress
        )
        self.front_ = {int(name.removeprefix("terms")): Model(one) for name, one in front}
        return Model(chosen), report

    def differentiate(self, x: Any, t: Any = None, *, dt: float | None = None) -> Any:
        """Derivatives of runs, measured as in the fit; NaN without the neighbours of a difference.

        Parameters
        ----------
        x : array or list of arrays
            States, (rows, states).
        t : array, list of arrays or float, optional
            Stamps, or the period; default: ``dt``, else the period of the fit.
        dt : float, optional
            The period, seconds.

        Returns
        -------
        array or list of arrays
            In the shape of ``x``.
        """
        model, derivative = self._fitted_model(), self._derivative()
        default = self.dt or model.dt
        if callable(derivative):
            slopes = differentiated(x, t, dt, default, derivative)
        else:
            # Derivatives that were given to the fit are no differences.
            targets = {one["subject"]: one["target"] for one in model.content.fitted() if "(" in one["target"]}
            names = list((self._fitted_names or (model.states, ()))[0])
            data = runs(x, t, None, None, names, dt=dt, default_dt=default)
            text = _core.recipe(_recipe.to_json({"time": data.time}), "the recipe", True, None, None, None)
            wanted = [targets.get(name) or f"central({quoted(name)})" for name in names]
            table = _core.read_table(data.core, text, list(dict.fromkeys(wanted)), None, None, None, None)
            every = np.column_stack([table[name] for name in wanted])
            lengths = [len(one) for one in array_runs(x, "x")]
            slopes = np.split(every, np.cumsum(lengths)[:-1])
        many = isinstance(x, (list, tuple)) and any(isinstance(one, np.ndarray) for one in x)
        shaped = [one.reshape(np.shape(run)) for one, run in zip(slopes, array_runs(x, "x"))]
        return shaped if many else shaped[0]

    def get_feature_names(self, latent: str | None = None) -> list[str]:
        """Names of all candidate functions, including the constant ``"1"``; the model keeps only the used ones."""
        if latent is not None:
            return super().get_feature_names(latent)
        self._fitted_model()
        return list(self.report_["candidates"])

    def coefficients(self, *, latent: str | None = None, region: int | None = None) -> Array:
        """Coefficients of all candidates in the order of :meth:`get_feature_names`, zeros included.

        Parameters
        ----------
        latent : str, optional
            One latent function, over the functions that the model keeps.
        region : int, optional
            One region.

        Returns
        -------
        array
            (equations, candidates) for a single or selected region, else (regions, equations, candidates).
        """
        table = super().coefficients(latent=latent, region=region)
        if latent is not None:
            return table
        place = {name: at for at, name in enumerate(self.report_["candidates"])}
        names = self._fitted_model().get_feature_names()
        all_ = np.zeros((*table.shape[:-1], len(place)))
        for at, name in enumerate(names):
            if name in place:
                all_[..., place[name]] = table[..., at]
        return all_


def _one(name: str, value: Any, other: str, alias: Any) -> Any:
    """The value of an argument with two names."""
    if value is not None and alias is not None:
        raise RequestError(f"{name} and {other} are one argument; give one of them")
    return alias if value is None else value
