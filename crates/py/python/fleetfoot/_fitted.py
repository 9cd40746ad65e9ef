"""Results of a fit: predictions, scores, simulations, coefficients."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _recipe
from ._arrays import numbers
from ._base import check_is_fitted
from ._call import OF_STATES, TASKS, Call, Second, second_by_position
from ._data import open as open_data
from ._frames import frame, in_order, runs_in_order, slopes_in_order
from ._lazy import has_lazy, signals
from ._model import Model
from ._runs import array_runs, by_name, differentiated, is_arrays
from ._tables import Filtered, Rollouts, Scores
from .exceptions import ModelError, RequestError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    Array = np.ndarray[Any, np.dtype[np.float64]]


class Fitted:
    """Results of a fitted estimator of recordings."""

    model_: Model
    n_features_in_: int
    recipe: Any
    dt: float | None

    #: Names of the states and inputs of the arrays that were fitted; nothing after files and data sets.
    _fitted_names: tuple[tuple[str, ...], tuple[str, ...]] | None = None
    #: True if the target was a vector.
    _is_flat: bool = False

    if TYPE_CHECKING:
        # Methods of the estimators that this class is a base of.
        def _predicts(self, base: Mapping[str, Any] | None = None) -> str: ...

        def _names_columns(self, base: Mapping[str, Any]) -> bool: ...

        def _derivative(self) -> Any: ...

        def _method_recipe(self) -> dict[str, Any]: ...

        def _period(self, recipe: Mapping[str, Any]) -> float | None: ...

    def _fitted_model(self) -> Model:
        # Tags are not asked for with every call.
        if not hasattr(self, "model_"):
            check_is_fitted(self)
        return self.model_

    @property
    def model(self) -> Model:
        """The fitted model."""
        return self._fitted_model()

    @property
    def complexity(self) -> int:
        """Number of terms: :attr:`fleetfoot.Model.complexity`."""
        return self._fitted_model().complexity

    def print(self, regions: int = 10) -> None:
        """Prints the model: columns, equations, regions."""
        self._fitted_model().print(regions)

    def equations(self, precision: int = 5, *, region: int | None = None) -> list[str]:
        """The equations with numbers: :meth:`fleetfoot.Model.equations`."""
        return self._fitted_model().equations(precision, region=region)

    def coefficients(self, *, latent: str | None = None, region: int | None = None) -> Array:
        """The coefficients: :meth:`fleetfoot.Model.coefficients`."""
        return self._fitted_model().coefficients(latent=latent, region=region)

    def get_feature_names(self, latent: str | None = None) -> list[str]:
        """Names of the candidate functions: :meth:`fleetfoot.Model.get_feature_names`."""
        return self._fitted_model().get_feature_names(latent)

    def predict(self, x: Any, u: Any = None, t: ArrayLike | None = None, **options: Any) -> Any:
        """Predictions of the fitted equations for every row: :meth:`fleetfoot.Model.predict`.

        Arrays have the columns of the fit (states, or regressors of a column); tables have them by name.
        """
        model = self._fitted_model()
        if isinstance(x, (list, tuple)) and any(isinstance(run, np.ndarray) for run in x):
            us = u if u is not None else [None] * len(x)
            ts = t if isinstance(t, (list, tuple)) else [t] * len(x)
            if not len(us) == len(ts) == len(x):
                raise ModelError(f"x is a list of {len(x)} runs; give lists of as many for u and t")
            return [self.predict(*run, **options) for run in zip(x, us, ts)]
        if hasattr(x, "__array__") and not isinstance(x, np.ndarray) and frame(x) is None:
            x = numbers(x, "x")
        if not is_arrays(x) or self._fitted_names is None:
            predicted = model.predict(x, u, t, **options)
            # Of one target that was a vector, a table's column.
            is_column = self._is_flat and len(model.outputs) == 1 and not hasattr(predicted, "collect")
            return predicted[model.outputs[0]] if is_column and frame(x) is not None else predicted
        self._check_width(x)
        predicted = model.predict(*self._placed(model, x, u), t, **options)
        return predicted[:, 0] if self._is_flat and predicted.ndim == 2 and predicted.shape[1] == 1 else predicted

    def _check_width(self, x: Any) -> None:
        """Arrays have the columns of the fit."""
        width = self.n_features_in_
        for one in array_runs(x, "x"):
            if one.ndim == 1 and width > 1:
                raise ValueError(
                    f"x is a vector of the shape {one.shape}, and the fit had {width} columns. Reshape your data: "
                    "x.reshape(1, -1) is one row"
                )
            if one.ndim == 2 and one.shape[1] != width:
                raise ValueError(
                    f"X has {one.shape[1]} features, but {type(self).__name__} is expecting {width} features as input"
                )

    def _placed(self, model: Model, x: Any, u: Any) -> tuple[Any, Any]:
        """Arrays with the columns of the fit as the model's states and inputs."""
        features, inputs = self._fitted_names or ((), ())
        rows = numbers(x, "x")
        rows = rows[:, None] if rows.ndim == 1 and len(features) == 1 else rows
        beside = None if u is None else numbers(in_order(u, inputs, "u"), "u")
        beside = beside[:, None] if beside is not None and beside.ndim == 1 and len(inputs) == 1 else beside
        if features == model.states or rows.ndim != 2:
            return rows, beside
        columns = dict(zip(features, rows.T))
        columns.update(zip(inputs, () if beside is None else beside.T))
        wanted = (*model.states, *model.inputs)
        if any(name not in columns for name in wanted):
            return rows, beside
        states, given = (
            np.column_stack([columns[name] for name in names]) if names else None for names in (model.states, model.inputs)
        )
        # A model of constants still has rows.
        return states, given if wanted else np.empty((len(rows), 0))

    def simulate(self, x0: ArrayLike, t: ArrayLike | int, u: Any = None, **options: Any) -> Array:
        """The states over time: :meth:`fleetfoot.Model.simulate`."""
        return self._fitted_model().simulate(x0, t, u, **options)

    def rollout(self, data: Any, horizon: int, **options: Any) -> Rollouts:
        """Simulations from measured states, scored by horizon: :meth:`fleetfoot.Model.rollout`."""
        return self._fitted_model().rollout(data, horizon, **options)

    def filter(self, data: Any, **options: Any) -> Filtered:
        """States from noisy measurements: :meth:`fleetfoot.Model.filter`."""
        return self._fitted_model().filter(data, **options)

    def resimulate(self, data: Any, **options: Any) -> dict[str, Any]:
        """States and inputs that obey the model and follow recordings: :meth:`fleetfoot.Model.resimulate`."""
        return self._fitted_model().resimulate(data, **options)

    @second_by_position
    def score(
        self,
        x: Any,
        t: Any = None,
        x_dot: Any = None,
        u: Any = None,
        *,
        y: Any = None,
        dt: float | None = None,
        columns: Mapping[str, Any] | None = None,
        **options: Any,
    ) -> float:
        """R2 of the one-step predictions, the mean over the fitted equations.

        Parameters
        ----------
        x, t, x_dot, u, y, dt, columns
            As for :meth:`fit`; arrays without ``t`` and ``dt`` have the period of the fit.
        **options
            As for :meth:`fleetfoot.Model.score`, which also returns errors of baselines, by episode, with intervals.
        """
        model, base = self._fitted_model(), _recipe.of_anything(self.recipe)
        features, inputs = self._fitted_names or (None, None)
        if inputs:
            u = runs_in_order(u, inputs, "u")
        if features:
            x_dot = slopes_in_order(x_dot, features)
        names = None if has_lazy(x) else features
        given = Call(x, t, x_dot, u, names, inputs if u is not None else None, y, dt, columns)
        predicts = self._predicts(base)
        given, base, _ = self._streamed(given, base)
        call = given.understood(predicts, self.dt, self._names_columns(base), base.get("time"))
        if is_arrays(call.x) and self._fitted_names is not None:
            self._check_width(call.x)
        if not is_arrays(call.x):
            report = model.score(call.x, call.t, dt=call.dt, **options)
        elif predicts in (*OF_STATES, TASKS):
            report = self._score_of_states(model, call, options)
        else:
            report = self._score_of_column(model, call, predicts, options)
        shares = [target["r2"] for target in report["targets"]]
        return float(np.mean([np.nan if share is None else share for share in shares]))

    def _streamed(self, given: Call, base: dict[str, Any]) -> tuple[Call, dict[str, Any], list[str] | None]:
        """A lazy table as a streaming data set, with its signals as states if no argument names the columns.

        Further arrays, and a function for derivatives, need the rows in memory.
        """
        if not has_lazy(given.x):
            return given, base, None
        t = given.t.value if isinstance(given.t, Second) else given.t
        besides = (given.x_dot, given.u, given.y, given.feature_names, given.input_names, given.columns)
        is_whole = any(one is not None for one in besides) or callable(self._derivative()) or np.ndim(t) > 0
        if is_whole:
            return given, base, None
        dataset = open_data(given.x)
        if t is not None and not isinstance(t, str):
            given, t = replace(given, dt=t), None
        given = replace(given, x=dataset, t=t)
        if self._names_columns(base):
            return given, base, None
        time = base.get("time", {})
        has_period = given.dt is not None or self.dt is not None or "dt" in time
        names, clock = signals(dataset._core, t or time.get("column"), [self._predicts(base)], find_clock=not has_period)
        if clock is None and not has_period:
            given = replace(given, dt=self._period(_recipe.over(self._method_recipe(), base)))
        return replace(given, t=clock), _recipe.over({"states": {name: {} for name in names}}, base), names

    def _score_of_states(self, model: Model, call: Call, options: Mapping[str, Any]) -> Scores:
        derivative, x_dot = self._derivative(), call.x_dot
        if callable(derivative) and x_dot is None:
            x_dot = differentiated(call.x, call.t, call.dt, model.dt, derivative)
        return model.score(call.x, call.t, x_dot, call.u, dt=call.dt, columns=call.columns, **options)

    def _score_of_column(
        self, model: Model, call: Call, target: str, options: Mapping[str, Any]
    ) -> Scores:
        """Score of a model of a column, by the names of the fit."""
        if target not in (call.columns or ()):
            raise RequestError(f"y is missing: the model predicts `{target}`; give y=, or columns={{{target!r}: ...}}")
        features, inputs = self._fitted_names or ((), ())
        xs = array_runs(call.x, "x")
        tables = [by_name(one, features) for one in xs]
        beside = [(call.u, inputs), *((values, (name,)) for name, values in (call.columns or {}).items())]
        for values, names in beside:
            for table, one in zip(tables, [] if values is None else array_runs(values, "columns")):
                table.update(by_name(one, names))
        if call.t is None or np.ndim(call.t) == 0:
            period = call.dt if call.t is None else call.t
            dataset = open_data(tables, dt=model.dt or 1.0 if period is None else period)
        else:
            dataset = open_data(tables, t=call.t if isinstance(call.t, list) else [call.t] * len(tables))
        return model.score(dataset, **options)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the model's file: :meth:`fleetfoot.Model.save`."""
        self._fitted_model().save(path)
