"""What all identification has in common: data in, a recipe, a model and its report out."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from . import _core, _recipe
from ._model import Model
from ._progress import Progress, reporting
from ._runs import differentiated, is_arrays, runs
from ._warnings import warn_all
from .exceptions import RequestError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    Array = np.ndarray[Any, np.dtype[np.float64]]

Own = TypeVar("Own", bound="Identifier")
States = Sequence[str] | Mapping[str, Mapping[str, Any]] | None
AnyRecipe = str | os.PathLike[str] | Mapping[str, Any] | None
Derivative = str | Mapping[str, str] | Callable[..., Any] | None

#: Documentation of the arguments that all have, in the words of numpydoc.
COMMON = """states : list of str, or dict, optional
        Names of the states in files and tables; a dict gives for each what the recipe's ``[states]`` may say. Arrays
        have ``feature_names``.
    inputs : list of str, or dict, optional
        Names of the inputs, likewise.
    angles : list of str
        States and inputs that are angles (radians): their differences wrap, libraries and partitions see their cosine
        and sine.
    derivative : str, dict or callable, optional
        How derivatives are measured: ``"auto"`` (as when not given: central differences, their order chosen by data in
        `SINDy`), ``"central"``, ``"central4"``, ``"central6"``, ``"forward"``, ``"backward"``, or a column; a
        dict says it state by state. A function
        ``(x, t) -> x_dot``, such as pysindy's differentiation objects, is called for every run of arrays.
    known : dict of str to str, optional
        Derivatives that are given, as expressions over columns: integrated, never fitted.
    weight : str, optional
        Non-negative weights of the rows: a column or an expression.
    recipe : path, TOML text or dict, optional
        Anything else that a recipe may say. What the arguments say stands above it; it stands above the recipe of the
        data.
    cache : path, optional
        A folder for the decoded columns of robots' logs.
    progress : bool or callable, optional
        ``True`` for a bar; or a function of the stage's name, the pieces done and the pieces in all."""


def documented(cls: type[Own]) -> type[Own]:
    """Writes the common arguments into a class's documentation."""
    cls.__doc__ = (cls.__doc__ or "").replace("COMMON", COMMON)
    return cls


class Identifier:
    """Base of what fits models to recordings."""

    model_: Model
    report_: dict[str, Any]

    states: States
    inputs: States
    angles: Sequence[str]
    derivative: Derivative
    known: Mapping[str, str] | None
    weight: str | None
    recipe: AnyRecipe
    cache: str | os.PathLike[str] | None
    progress: Progress

    # -- parameters, as scikit-learn has them

    @classmethod
    def _parameters(cls) -> list[str]:
        return [name for name in inspect.signature(cls.__init__).parameters if name != "self"]

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """The arguments of the constructor by name."""
        return {name: getattr(self, name) for name in self._parameters()}

    def set_params(self: Own, **params: Any) -> Own:
        """Changes arguments of the constructor."""
        known = self._parameters()
        for name, value in params.items():
            if name not in known:
                raise ValueError(f"{type(self).__name__} has no parameter {name!r}; it has {', '.join(known)}")
            setattr(self, name, value)
        return self

    def __repr__(self) -> str:
        defaults = inspect.signature(type(self).__init__).parameters
        params = self.get_params().items()
        given = (f"{name}={value!r}" for name, value in params if _differs(value, defaults[name].default))
        return f"{type(self).__name__}({', '.join(given)})"

    def __sklearn_is_fitted__(self) -> bool:
        return hasattr(self, "model_")

    # -- fitting

    def fit(
        self: Own,
        x: Any,
        t: Any = None,
        x_dot: Any = None,
        u: Any = None,
        feature_names: Sequence[str] | None = None,
        input_names: Sequence[str] | None = None,
        *,
        dt: float | None = None,
        columns: Mapping[str, Any] | None = None,
    ) -> Own:
        """Fits to runs.

        Parameters
        ----------
        x : array, list of arrays, or anything that :func:`fleetfoot.open` takes
            The states of a run, (rows, states), or a list of such, one for each run. Read where they are, whatever
            their type, order and strides.
            Or files, a table, a data set, a statistic.
        t : array, list of arrays, float or str, optional
            Stamps of the rows in seconds, (rows,), for each run or one for all; or the period. For tables and files
            the name of the clock's column.
        x_dot : array or list of arrays, optional
            Measured derivatives, in the shape of ``x``; differences of ``x`` when not given.
        u : array or list of arrays, optional
            Inputs, (rows, inputs).
        feature_names, input_names : list of str, optional
            Names of the columns of ``x`` and ``u``; ``x0``, ``x1``, ... and ``u0``, ``u1``, ... when not given.
        dt : float, optional
            Seconds from row to row, in place of ``t``.
        columns : dict of str to array or list of arrays, optional
            Further columns beside arrays, (rows,): labels of a partition, weights, what expressions speak of.

        Returns
        -------
        self
            With ``model_`` (:class:`fleetfoot.Model`) and ``report_`` (dict: scores, candidates, certificates,
            standard errors, notes).

        Raises
        ------
        ValueError
            Shapes that do not fit each other.
        RequestError
            What is asked for cannot be understood or does not exist.
        DataError
            The data cannot be read, or do not hold what is needed.
        FitError
            The data do not determine what was to be fitted.

        Warns
        -----
        FleetfootWarning
            What was assumed, left out, or cannot be told apart.
        """
        data, recipe = self._data(x, t, x_dot, u, feature_names, input_names, dt, columns)
        with reporting(self.progress) as callback:
            self.model_, self.report_ = self._fit(data, _recipe.to_json(recipe), callback)
        self.report_["recipe"] = self.model_.recipe
        warn_all(self.report_.get("notes", ()))
        return self

    def _fit(self, data: _core.Data, recipe: str, progress: Any) -> tuple[Model, dict[str, Any]]:
        raise NotImplementedError

    def _derivative(self) -> Derivative:
        return self.derivative

    def _own_recipe(self) -> dict[str, Any]:
        """What the arguments of this method say."""
        return {}

    def _period(self, recipe: Mapping[str, Any]) -> float | None:
        """The period of arrays without a clock, where none is needed."""
        return None if recipe.get("model", {}).get("predict", "derivative") == "derivative" else 1.0

    def _data(
        self,
        x: Any,
        t: Any,
        x_dot: Any,
        u: Any,
        feature_names: Sequence[str] | None,
        input_names: Sequence[str] | None,
        dt: float | None,
        columns: Mapping[str, Any] | None,
    ) -> tuple[_core.Data, dict[str, Any]]:
        """What is read, and the whole recipe."""
        own = _recipe.of_anything(self.recipe)
        derivative = self._derivative()
        differentiate = derivative if callable(derivative) else None
        if is_arrays(x):
            named = feature_names if feature_names is not None else _listed(self.states)
            found = runs(
                x,
                t,
                x_dot,
                u,
                named,
                input_names if input_names is not None or u is None else _listed(self.inputs),
                dt=dt,
                default_dt=self._period(_recipe.over(self._own_recipe(), own)),
                differentiate=differentiate,
                columns=columns,
            )
            data = found.core
            states = {name: _recipe.said(derivative=found.derivatives.get(name)) for name in found.states}
            below = {"states": states, "inputs": {name: {} for name in found.inputs}, "time": found.time}
            recipe = _recipe.over(own, below)
        else:
            if any(given is not None for given in (x_dot, u, feature_names, input_names, columns)):
                raise ValueError(
                    "x_dot, u, feature_names, input_names and columns belong to arrays; "
                    "of files and tables name the columns: states=, inputs=, derivative="
                )
            if differentiate is not None:
                raise ValueError("derivative: a function is called for arrays; of files and tables name a column")
            from ._data import open as open_data

            if hasattr(x, "_as_data"):
                data, recipe = x._as_data(), own
            else:
                dataset = open_data(x, t=t, dt=dt)
                data, recipe = dataset._core, _recipe.over(own, _recipe.of_toml(dataset.recipe))
        recipe = _recipe.say(self._own_recipe(), self._roles(recipe, is_arrays(x)))
        if self.weight is not None:
            recipe = _recipe.over({"model": {"weight": self.weight}}, recipe)
        return data, recipe

    def _roles(self, recipe: dict[str, Any], arrays: bool) -> dict[str, Any]:
        """The recipe with what the arguments say of states and inputs."""
        for section, names in (("states", self.states), ("inputs", self.inputs)):
            if names is None or (arrays and not isinstance(names, Mapping)):
                continue
            entries = names if isinstance(names, Mapping) else {name: {} for name in names}
            recipe = _recipe.over({section: dict(entries)}, recipe)
        states, inputs = dict(recipe.get("states", {})), dict(recipe.get("inputs", {}))
        for name in self.angles:
            table = states if name in states else inputs if name in inputs else None
            if table is None:
                known = ", ".join([*states, *inputs])
                raise RequestError(f"angles: {name!r} is neither a state nor an input; there are {known}")
            entry = table[name]
            table[name] = {**({"column": entry} if isinstance(entry, str) else entry), "kind": "angle"}
        pairs: list[tuple[str, Derivative]] = [("derivative", self._derivative()), ("known", self.known)]
        for what, given in pairs:
            texts = dict(given) if isinstance(given, Mapping) else {}
            if isinstance(given, str):
                texts = {name: given for name, state in states.items() if not {"known", "derivative"} & set(state)}
            for name, text in texts.items():
                if name not in states:
                    raise RequestError(f"{what}: {name!r} is not a state; there are {', '.join(states)}")
                states[name] = {**states[name], what: text}
        sections = {"states": states, "inputs": inputs}
        return {**recipe, **{name: section for name, section in sections.items() if section}}

    # -- what was found

    def _found(self) -> Model:
        if not hasattr(self, "model_"):
            raise AttributeError(f"this {type(self).__name__} is not fitted yet; call fit first")
        return self.model_

    @property
    def model(self) -> Model:
        """The fitted model."""
        return self._found()

    def print(self, regions: int = 10) -> None:
        """Prints the model: columns, equations, regions."""
        self._found().print(regions)

    def equations(self, precision: int = 5, *, region: int | None = None) -> list[str]:
        """The equations with numbers: :meth:`fleetfoot.Model.equations`."""
        return self._found().equations(precision, region=region)

    def coefficients(self, *, latent: str | None = None, region: int | None = None) -> Array:
        """The coefficients: :meth:`fleetfoot.Model.coefficients`."""
        return self._found().coefficients(latent=latent, region=region)

    def get_feature_names(self, latent: str | None = None) -> list[str]:
        """Names of the candidate functions: :meth:`fleetfoot.Model.get_feature_names`."""
        return self._found().get_feature_names(latent)

    def predict(self, x: Any, u: ArrayLike | None = None, t: ArrayLike | None = None, **options: Any) -> Any:
        """What the fitted equations say of every row: :meth:`fleetfoot.Model.predict`."""
        return self._found().predict(x, u, t, **options)

    def simulate(self, x0: ArrayLike, t: ArrayLike, u: Any = None, **options: Any) -> Array:
        """The states over time: :meth:`fleetfoot.Model.simulate`."""
        return self._found().simulate(x0, t, u, **options)

    def score(self, x: Any, t: Any = None, x_dot: Any = None, u: Any = None, **options: Any) -> float:
        """Coefficient of determination of the one-step predictions, the mean of the fitted equations.

        :meth:`fleetfoot.Model.score` takes the same and tells more: errors beside baselines, by episode, with
        intervals.
        """
        model, derivative = self._found(), self._derivative()
        if callable(derivative) and x_dot is None and is_arrays(x):
            x_dot = differentiated(x, t, options.get("dt"), model.dt, derivative)
        report = model.score(x, t, x_dot, u, **options)
        shares = [target["r2"] for target in report["targets"]]
        return float(np.mean([np.nan if share is None else share for share in shares]))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the model's file: :meth:`fleetfoot.Model.save`."""
        self._found().save(path)


def _listed(given: States) -> Sequence[str] | None:
    return None if given is None or isinstance(given, Mapping) else given


def _differs(value: Any, default: Any) -> bool:
    try:
        return not bool(np.all(value == default))
    except (TypeError, ValueError):
        return True


def count(name: str, value: Any, least: int) -> int:
    """A whole number of at least so much."""
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, np.integer)) or value < least:
        raise RequestError(f"{name}={value!r}: give a whole number of {least} or more")
    return int(value)


def number(name: str, value: Any) -> float:
    """A finite number."""
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, float, np.number)) or not np.isfinite(value):
        raise RequestError(f"{name}={value!r}: give a number")
    return float(value)


def groups_of(given: Any) -> Any:
    """A word, or lists of signals by name."""
    if given is None or isinstance(given, str):
        return given
    if isinstance(given, Mapping):
        return {name: [one] if isinstance(one, str) else list(one) for name, one in given.items()}
    raise RequestError(f"groups={given!r}: give 'signal', 'term', or a dict of lists of signals")


def partition(given: Any) -> str | None:
    """``5`` is ``kmeans:5``; of several one is chosen."""
    if given is None or isinstance(given, str):
        return given
    if isinstance(given, (list, tuple)):
        return ",".join(str(partition(one)) for one in given)
    return f"kmeans:{count('partition', given, 1)}"
