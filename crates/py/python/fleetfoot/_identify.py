"""What all identification has in common: data in, a recipe, a model and its report out."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from . import _core, _recipe
from ._base import BaseEstimator, check_is_fitted
from ._call import OF_STATES, TASKS, Call, second_by_position
from ._frames import frame
from ._model import Model
from ._progress import Progress, reporting
from ._runs import array_runs, by_name, differentiated, is_arrays, runs
from ._warnings import tell_all
from .exceptions import ModelError, RequestError

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
    derivative : str, dict or callable, default="auto"
        How derivatives are measured: ``"auto"`` (central differences, their order chosen by data in
        `SINDy`), ``"central"``, ``"central4"``, ``"central6"``, ``"forward"``, ``"backward"``, or a column; a
        dict says it state by state. A function
        ``(x, t) -> x_dot``, such as pysindy's differentiation objects, is called for every run of arrays.
    known : dict of str to str, optional
        Derivatives that are given, as expressions over columns: integrated, never fitted.
    weight : str, optional
        Non-negative weights of the rows: a column or an expression.
    dt : float, optional
        Seconds from row to row of arrays and tables without a clock, so that ``fit(X, y)`` needs none.
    recipe : path, TOML text or dict, optional
        Anything else that a recipe may say. An argument that differs from its default stands above it; it stands
        above the recipe of the data.
    cache : path, optional
        A folder for the decoded columns of robots' logs.
    progress : bool or callable, optional
        ``True`` for a bar; or a function of the stage's name, the pieces done and the pieces in all."""


def documented(cls: type[Own]) -> type[Own]:
    """Writes the common arguments into a class's documentation."""
    cls.__doc__ = (cls.__doc__ or "").replace("COMMON", COMMON)
    return cls


class Identifier(BaseEstimator):
    """Base of what fits models to recordings: an estimator, as scikit-learn has them."""

    model_: Model
    report_: dict[str, Any]
    n_features_in_: int

    states: States
    inputs: States
    angles: Sequence[str]
    derivative: Derivative
    known: Mapping[str, str] | None
    weight: str | None
    dt: float | None
    recipe: AnyRecipe
    cache: str | os.PathLike[str] | None
    progress: Progress

    #: The columns of the arrays that were fitted, and whether the target was a vector.
    _fitted_names: tuple[tuple[str, ...], tuple[str, ...]] | None = None
    _is_flat: bool = False
    #: The arrays that scikit-learn's routing of metadata need not know.
    __metadata_request__fit = {"x": "$UNUSED$"}
    __metadata_request__score = {"x": "$UNUSED$"}
    __metadata_request__predict = {"x": "$UNUSED$"}

    # -- what it is to scikit-learn

    def __sklearn_is_fitted__(self) -> bool:
        return hasattr(self, "model_")

    def __sklearn_tags__(self) -> Any:
        from sklearn.utils import RegressorTags  # type: ignore[import-untyped, unused-ignore]

        tags = super().__sklearn_tags__()  # type: ignore[misc, unused-ignore]
        tags.estimator_type = "regressor"
        tags.regressor_tags = RegressorTags()
        tags.target_tags.multi_output = self._predicts() in OF_STATES
        # Rows that lack a value are left out, and counted.
        tags.input_tags.allow_nan = True
        return tags

    def _said(self, name: str) -> Any:
        """An argument of the constructor, where it is not the default: that leaves the recipe its word."""
        value, default = getattr(self, name), inspect.signature(type(self).__init__).parameters[name].default
        return None if value is None or not _differs(value, default) else value

    def _whole(self, name: str, least: int) -> int | None:
        """A whole number that an argument says."""
        value = self._said(name)
        return None if value is None else count(name, value, least)

    def _real(self, name: str) -> float | str | None:
        """A number, or "auto", that an argument says."""
        value = self._said(name)
        return value if value is None or _is_auto(value) else number(name, value)

    def _text(self, name: str) -> str | None:
        """What an argument says, as a text."""
        value = self._said(name)
        return None if value is None else str(value)

    def _list(self, name: str) -> list[str] | None:
        value = self._said(name)
        return None if value is None else list(value)

    # -- fitting

    @second_by_position
    def fit(
        self: Own,
        x: Any,
        t: Any = None,
        x_dot: Any = None,
        u: Any = None,
        feature_names: Sequence[str] | None = None,
        input_names: Sequence[str] | None = None,
        *,
        y: Any = None,
        dt: float | None = None,
        columns: Mapping[str, Any] | None = None,
    ) -> Own:
        """Fits to runs.

        Parameters
        ----------
        x : array, table, list of them, or anything that :func:`fleetfoot.open` takes
            The states of a run, (rows, states), or a list of such, one for each run. Read where they are, whatever
            their type, order and strides. A table (pandas, polars, pyarrow, xarray) whose columns no ``states`` and
            ``inputs`` name has all its numbers as states, but the clock and the target.
            Or files, a data set, a statistic.
        t : array, list of arrays, float or str, optional
            Stamps of the rows in seconds, (rows,), for each run or one for all; or the period. For tables and files
            the name of the clock's column. A table's index of times is its clock; so is a column ``stamp``, ``t``,
            ``time`` or ``timestamp``.
        x_dot : array or list of arrays, optional
            Measured derivatives, in the shape of ``x``; differences of ``x`` when not given.
        u : array, table or list of them, optional
            Inputs, (rows, inputs).
        feature_names, input_names : list of str, optional
            Names of the columns of ``x`` and ``u``; ``x0``, ``x1``, ... and ``u0``, ``u1``, ... when not given.
        y : array or list of arrays, optional
            Targets, as scikit-learn calls them: derivatives, or with ``target`` (``discrete_time``) next values or
            differences, in the shape of ``x``; or the column that ``target`` names, (rows,). Never stamps. The second
            argument by position is ``t``, as pysindy has it; and ``y``, as scikit-learn's tools hand it over, where
            the clock is told by its name (``t=``, ``dt=``, or ``dt`` of the constructor), or ``target`` names a column
            that is nowhere else, which needs none.
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
            What was left out, or cannot be told apart, or may be wrong. What was assumed as usual is logged
            (``logging``, ``fleetfoot``), and stands in ``report_["notes"]`` too.
        """
        given = Call(x, t, x_dot, u, feature_names, input_names, y, dt, columns)
        own = _recipe.of_anything(self.recipe)
        call = given.understood(self._predicts(own), self.dt, self._names_columns(own))
        data, recipe = self._data(call, own)
        with reporting(self.progress) as callback:
            self.model_, self.report_ = self._fit(data, _recipe.to_json(recipe), callback)
        self.report_["recipe"] = self.model_.recipe
        self._is_flat = call.is_flat
        self.report_["notes"] = tell_all(self.report_.get("notes", ()))
        return self

    def _fit(self, data: _core.Data, recipe: str, progress: Any) -> tuple[Model, dict[str, Any]]:
        raise NotImplementedError

    def _derivative(self) -> Derivative:
        said: Derivative = self._said("derivative")
        return said

    def _own_recipe(self) -> dict[str, Any]:
        """What the arguments of this method say."""
        return {}

    def _predicts(self, own: Mapping[str, Any] | None = None) -> str:
        """What is predicted: of states, or a column."""
        recipe = _recipe.over(self._own_recipe(), _recipe.of_anything(self.recipe) if own is None else own)
        return str(recipe.get("model", {}).get("predict", "derivative"))

    def _names_columns(self, own: Mapping[str, Any]) -> bool:
        """Whether arguments or recipe give columns of tables their roles."""
        named = (self.states, self.inputs, self.known, *(own.get(name) for name in ("states", "inputs", "tasks")))
        return any(named) or bool(self._own_recipe().get("tasks"))

    def _period(self, recipe: Mapping[str, Any]) -> float | None:
        """The period of arrays without a clock, where none is needed."""
        return None if recipe.get("model", {}).get("predict", "derivative") == "derivative" else 1.0

    def _data(self, call: Call, own: dict[str, Any]) -> tuple[_core.Data, dict[str, Any]]:
        """What is read, and the whole recipe."""
        arrays = is_arrays(call.x)
        data, recipe = self._of_arrays(call, own) if arrays else self._of_recordings(call, own)
        recipe = _recipe.say(self._own_recipe(), self._roles(recipe, arrays))
        if self.weight is not None:
            recipe = _recipe.over({"model": {"weight": self.weight}}, recipe)
        return data, recipe

    def _of_arrays(self, call: Call, own: dict[str, Any]) -> tuple[_core.Data, dict[str, Any]]:
        derivative = self._derivative()
        found = runs(
            call.x,
            call.t,
            call.x_dot,
            call.u,
            call.feature_names if call.feature_names is not None else _listed(self.states),
            call.input_names if call.input_names is not None or call.u is None else _listed(self.inputs),
            dt=call.dt,
            default_dt=self._period(_recipe.over(self._own_recipe(), own)),
            differentiate=derivative if callable(derivative) else None,
            columns=call.columns,
        )
        self._remember(found.states, found.inputs, call.table_names)
        states = {name: _recipe.said(derivative=found.derivatives.get(name)) for name in found.states}
        below = {"states": states, "inputs": {name: {} for name in found.inputs}, "time": found.time}
        return found.core, _recipe.over(own, below)

    def _of_recordings(self, call: Call, own: dict[str, Any]) -> tuple[_core.Data, dict[str, Any]]:
        besides = (call.x_dot, call.u, call.feature_names, call.input_names, call.columns, call.y)
        if any(given is not None for given in besides):
            raise ValueError(
                "x_dot, y, u, feature_names, input_names and columns belong to arrays; "
                "of files and tables name the columns: states=, inputs=, derivative=, target="
            )
        if callable(self._derivative()):
            raise ValueError("derivative: a function is called for arrays; of files and tables name a column")
        self._remember(None, None, None)
        if hasattr(call.x, "_as_data"):
            return call.x._as_data(), own
        from ._data import open as open_data

        dataset = open_data(call.x, t=call.t, dt=call.dt)
        return dataset._core, _recipe.over(own, _recipe.of_toml(dataset.recipe))

    def _remember(self, states: list[str] | None, inputs: list[str] | None, table: Sequence[str] | None) -> None:
        """The columns of arrays, as scikit-learn's estimators keep them."""
        for name in ("n_features_in_", "feature_names_in_"):
            vars(self).pop(name, None)
        self._fitted_names = None if states is None else (tuple(states), tuple(inputs or ()))
        if states is not None:
            self.n_features_in_ = len(states)
        if table is not None:
            self.feature_names_in_ = np.array(table, dtype=object)

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
        check_is_fitted(self)
        return self.model_

    @property
    def model(self) -> Model:
        """The fitted model."""
        return self._found()

    @property
    def complexity(self) -> int:
        """Number of terms: :attr:`fleetfoot.Model.complexity`."""
        return self._found().complexity

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

    def predict(self, x: Any, u: Any = None, t: ArrayLike | None = None, **options: Any) -> Any:
        """What the fitted equations say of every row: :meth:`fleetfoot.Model.predict`.

        Arrays have the columns of the fit, whether they are states, or what a column is predicted from; tables have
        theirs by name.
        """
        model = self._found()
        if isinstance(x, (list, tuple)) and any(isinstance(run, np.ndarray) for run in x):
            us = u if u is not None else [None] * len(x)
            ts = t if isinstance(t, (list, tuple)) else [t] * len(x)
            if not len(us) == len(ts) == len(x):
                raise ModelError(f"x is a list of {len(x)} runs; give lists of as many for u and t")
            return [self.predict(*run, **options) for run in zip(x, us, ts)]
        if hasattr(x, "__array__") and not isinstance(x, np.ndarray) and frame(x) is None:
            x = np.asarray(x)
        if not is_arrays(x) or self._fitted_names is None:
            found = model.predict(x, u, t, **options)
            # Of one target that was a vector, a table's column.
            is_column = self._is_flat and frame(x) is not None and hasattr(found, "__getitem__") and len(model.outputs) == 1
            return found[model.outputs[0]] if is_column and not hasattr(found, "collect") else found
        self._check_width(x)
        found = model.predict(*self._placed(model, x, u), t, **options)
        return found[:, 0] if self._is_flat and found.ndim == 2 and found.shape[1] == 1 else found

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
        rows = np.asarray(x)
        rows = rows[:, None] if rows.ndim == 1 and len(features) == 1 else rows
        beside = None if u is None else np.asarray(u)
        beside = beside[:, None] if beside is not None and beside.ndim == 1 and len(inputs) == 1 else beside
        if features == model.states or rows.ndim != 2:
            return rows, beside
        columns = dict(zip(features, rows.T))
        columns.update(zip(inputs, () if beside is None else beside.T))
        wanted = (*model.states, *model.inputs)
        if any(name not in columns for name in wanted):
            return rows, beside
        own = [np.column_stack([columns[name] for name in names]) if names else None for names in (model.states, model.inputs)]
        # A model of constants still has rows.
        return own[0], own[1] if wanted else np.empty((len(rows), 0))

    def simulate(self, x0: ArrayLike, t: ArrayLike | int, u: Any = None, **options: Any) -> Array:
        """The states over time: :meth:`fleetfoot.Model.simulate`."""
        return self._found().simulate(x0, t, u, **options)

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
        """Coefficient of determination of the one-step predictions, the mean of the fitted equations.

        Parameters
        ----------
        x, t, x_dot, u, y, dt, columns
            As for :meth:`fit`; arrays without ``t`` and ``dt`` have the period of the fit.
        **options
            As for :meth:`fleetfoot.Model.score`, which tells more: errors beside baselines, by episode, with
            intervals.
        """
        model, own = self._found(), _recipe.of_anything(self.recipe)
        features, inputs = self._fitted_names or (None, None)
        given = Call(x, t, x_dot, u, features, inputs if u is not None else None, y, dt, columns)
        predicts = self._predicts(own)
        call = given.understood(predicts, self.dt, self._names_columns(own))
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

    def _score_of_states(self, model: Model, call: Call, options: Mapping[str, Any]) -> dict[str, Any]:
        derivative, x_dot = self._derivative(), call.x_dot
        if callable(derivative) and x_dot is None:
            x_dot = differentiated(call.x, call.t, call.dt, model.dt, derivative)
        return model.score(call.x, call.t, x_dot, call.u, dt=call.dt, columns=call.columns, **options)

    def _score_of_column(
        self, model: Model, call: Call, target: str, options: Mapping[str, Any]
    ) -> dict[str, Any]:
        """The score of a model of a column, whose rows are told by the names of the fit."""
        if target not in (call.columns or ()):
            raise RequestError(f"y is missing: the model predicts `{target}`; give y=, or columns={{{target!r}: ...}}")
        features, inputs = self._fitted_names or ((), ())
        xs = array_runs(call.x, "x")
        tables = [by_name(one, features) for one in xs]
        beside = [(call.u, inputs), *((values, (name,)) for name, values in (call.columns or {}).items())]
        for values, names in beside:
            for table, one in zip(tables, [] if values is None else array_runs(values, "columns")):
                table.update(by_name(one, names))
        from ._data import open as open_data

        if call.t is None or isinstance(call.t, (int, float, np.number)):
            dataset = open_data(tables, dt=float(call.dt or call.t or model.dt or 1.0))
        else:
            dataset = open_data(tables, t=call.t if isinstance(call.t, list) else [call.t] * len(tables))
        return model.score(dataset, **options)

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


def _is_auto(value: Any) -> bool:
    return isinstance(value, str) and value == "auto"
