"""Sparse models of latent functions that equations share."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from . import _core, _recipe
from ._call import TASKS
from ._identify import AnyRecipe, Derivative, Identifier, States, documented, groups_of
from ._model import Model
from ._progress import Progress

if TYPE_CHECKING:
    Array = np.ndarray[Any, np.dtype[np.float64]]


@documented
class BlockSparse(Identifier):
    """Latent functions, each a sparse sum of its candidates, fitted together from all their equations (block-sparse
    regression).

    The lasso path and a choice of lambda, or with ``bolasso`` the columns that most resamples select, give the
    support. Least squares on it gives the coefficients. Without ``latents`` and ``tasks`` every state has a latent
    function over the polynomials.

    Parameters
    ----------
    latents : dict, optional
        Latent functions: ``{"T": {"times": "N1", "of": ["rho", "M"], "degree": 4}, "D": {...}}``, as in ``[latents]``
        of a recipe: ``times``, ``of``, ``degree``, ``functions``, ``constant``, ``penalty``, ``signs``, ``at_least``,
        ``at_most``, ``prior``, ``prior_strength``, ``prior_scale``.
    tasks : dict, optional
        Equations, linear in the latent functions: ``{"along": {"target": "m*V_dot", "right": "T - D"}}``, with
        ``scale``, the error that counts as one. A pair of texts is target and right side.
    constraints : dict, optional
        Limits on the latent functions at every row, as in ``[constraints]`` of a recipe:
        ``{"friction": {"of": "F*v", "at_least": 0.0}}`` takes power and gives none,
        ``{"inertia": {"matrix": [["M11", "M12"], ["M12", "M22"]], "at_least": 1e-3}}`` has no eigenvalue below the
        bound. With ``at_most`` too.
    lam : float or str, default="auto"
        Lambda: ``"auto"``, a number, or ``"L0/sqrt(n)"``.
    select : {"one-se", "cv", "aic", "bic", "ebic"}, default="one-se"
        Rule that chooses lambda.
    folds : int or str, default="auto"
        ``"auto"``, a number, ``"episodes"``, or ``"splits:N"``.
    l1_ratio : float, optional
        Share of the absolute values in the penalty: beside squares (the elastic net), or with `groups` beside the
        groups' norms.
    groups : str or dict of str to list of str, optional
        Groups of functions that enter together (group lasso): ``"signal"`` (a signal with its powers and lags),
        ``"term"`` (a function in all equations), or lists of signals by the names of the groups.
    adaptive : bool, default=False
        Penalty factors from a first fit.
    bolasso : str, optional
        ``"rows:128"``, ``"chunks:128"`` or ``"episodes:128"``.
    threshold : float, optional
        Share of the resamples that must select a column.
    stability : bool, default=False
        Stability selection by half-samples.
    prior_strength : float, default=1
        Strength of all priors without their own.
    unscaled : bool, default=False
        Penalise coefficients in raw units.
    seed : int, default=0
        Seed of all random numbers.
    degree : int, optional
        Degree of the polynomials without ``latents``; 2 if neither it nor a recipe is given.
    target : str, optional
        ``"derivative"``, ``"next"``, ``"delta"``, or a column, without ``tasks``. Default: that of the recipe, else
        ``"derivative"``.
    by : str, optional
        Label of the episodes: one model for every value, in ``models_``.
    influence : bool, default=False
        Influence of every episode on the fit, by leaving it out once.
    COMMON

    Attributes
    ----------
    model_ : Model
        The model; with ``by`` the first one.
    models_ : dict of str to Model
        With ``by`` the models by the label's value.
    report_ : dict
        ``tasks`` (errors, also those without constraints), ``limits`` (constraints and their nearest row),
        ``latents`` with their candidates (coefficient, standard error, frequency, interval), ``lambda``,
        ``certificate`` (KKT residual, duality gap), ``confounded``, ``notes``. With ``by`` that of the first model.
    reports_ : dict of str to dict
        With ``by`` the reports by the label's value.

    Examples
    --------
    >>> import numpy as np, fleetfoot as ff
    >>> rng = np.random.default_rng(1)
    >>> a, b = rng.normal(size=(2, 500))
    >>> data = ff.open({"a": a, "b": b, "force": 2.0 * a - 0.5 * b**2}, dt=0.01)
    >>> fit = ff.BlockSparse(
    ...     latents={"F": {"of": ["a", "b"], "degree": 3}}, tasks={"along": ("force", "F")}, select="bic"
    ... ).fit(data)
    >>> [one["function"] for one in fit.report_["latents"][0]["functions"] if one["selected"]]
    ['1', 'a', 'b^2']
    >>> fit.coefficients(latent="F")[1:4].round(6) + 0.0
    array([2., 0., 0.])
    """

    models_: dict[str, Model]
    reports_: dict[str, dict[str, Any]]

    def __init__(
        self,
        latents: Mapping[str, Mapping[str, Any]] | None = None,
        tasks: Mapping[str, Any] | None = None,
        *,
        constraints: Mapping[str, Mapping[str, Any]] | None = None,
        lam: float | str = "auto",
        select: Literal["one-se", "cv", "aic", "bic", "ebic"] = "one-se",
        folds: int | str = "auto",
        l1_ratio: float | None = None,
        groups: str | Mapping[str, Sequence[str]] | None = None,
        adaptive: bool = False,
        bolasso: str | None = None,
        threshold: float | None = None,
        stability: bool = False,
        prior_strength: float = 1.0,
        unscaled: bool = False,
        seed: int = 0,
        degree: int | None = None,
        target: str | None = None,
        by: str | None = None,
        influence: bool = False,
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
        self.latents = latents
        self.tasks = tasks
        self.constraints = constraints
        self.lam = lam
        self.select = select
        self.folds = folds
        self.l1_ratio = l1_ratio
        self.groups = groups
        self.adaptive = adaptive
        self.bolasso = bolasso
        self.threshold = threshold
        self.stability = stability
        self.prior_strength = prior_strength
        self.unscaled = unscaled
        self.seed = seed
        self.degree = degree
        self.target = target
        self.by = by
        self.influence = influence
        super().__init__(states, inputs, angles, derivative, known, weight, dt, recipe, cache, progress)

    def _predicts(self, base: Mapping[str, Any] | None = None) -> str:
        return TASKS if self.tasks else super()._predicts(base)

    def _method_recipe(self) -> dict[str, Any]:
        lam = self._argument("lam")
        sparse = _recipe.without_none(
            **{name: self._real(name) for name in ("l1_ratio", "threshold", "prior_strength")},
            **{"lambda": None if lam is None else _text(lam)},
            select=self._argument("select"),
            folds=self._text("folds"),
            groups=groups_of(self.groups),
            adaptive=self._argument("adaptive"),
            bolasso=self._argument("bolasso"),
            stability=self._argument("stability"),
            unscaled=self._argument("unscaled"),
            seed=self._whole("seed", 0),
        )
        model = _recipe.without_none(predict=self._argument("target"), degree=self._whole("degree", 1))
        tasks = {name: _task(name, task) for name, task in (self.tasks or {}).items()}
        named = {name: dict(getattr(self, name) or {}) for name in ("latents", "constraints")}
        sections = (("sparse", sparse), ("model", model), *named.items(), ("tasks", tasks))
        return {name: section for name, section in sections if section}

    def _roles(self, recipe: dict[str, Any], arrays: bool) -> dict[str, Any]:
        recipe = super()._roles(recipe, arrays)
        # As SINDy has it: dynamics are seldom linear. A recipe says what it means.
        if self.recipe is None and self.degree is None and not (self.latents or recipe.get("latents")):
            recipe = _recipe.over(recipe, {"model": {"degree": 2}})
        return recipe

    def _fit(self, data: _core.Data, recipe: str, progress: Any) -> tuple[Model, dict[str, Any]]:
        fitted = _core.fit(
            "sparse", data, recipe, by=self.by, influence=bool(self.influence), cache=self.cache, progress=progress
        )
        models = [(value, Model(model), report) for value, model, report, _ in fitted]
        self.models_ = {value: model for value, model, _ in models if value is not None}
        self.reports_ = {value: report for value, _, report in models if value is not None}
        _, model, report = models[0]
        return model, report


    def _candidates(self) -> list[list[str]]:
        """Candidates of every latent function."""
        self._fitted_model()
        return [[one["function"] for one in latent["functions"]] for latent in self.report_["latents"]]

    def get_feature_names(self, latent: str | None = None) -> list[str]:
        """Names of all candidate functions, if the latent functions share them. The model keeps the used ones, which
        ``latent`` selects."""
        candidates = self._candidates()
        if latent is not None or any(one != candidates[0] for one in candidates):
            return super().get_feature_names(latent)
        return candidates[0]

    def coefficients(self, *, latent: str | None = None, region: int | None = None) -> Array:
        """Coefficients (latent functions, candidates) in the order of :meth:`get_feature_names`, zeros included; with
        ``latent`` the non-zero ones of one function."""
        candidates = self._candidates()
        if latent is not None or any(one != candidates[0] for one in candidates):
            return super().coefficients(latent=latent, region=region)
        table = np.zeros((len(candidates), len(candidates[0])))
        for row, one in zip(table, self.report_["latents"]):
            names = super().get_feature_names(one["name"])
            kept = dict(zip(names, super().coefficients(latent=one["name"], region=region)))
            row[:] = [kept.get(name, 0.0) for name in candidates[0]]
        return table


def _text(lam: float | str) -> str:
    return lam if isinstance(lam, str) else repr(float(np.asarray(lam)))


def _task(name: str, task: Any) -> dict[str, Any]:
    if isinstance(task, Mapping):
        return dict(task)
    if isinstance(task, (list, tuple)) and len(task) == 2:
        return {"target": task[0], "right": task[1]}
    raise ValueError(f"tasks: {name!r} is {task!r}; give a dict of target and right, or the two texts")
