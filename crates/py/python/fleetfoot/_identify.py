"""Shared code of the estimators of recordings: data and recipe in, model and report out."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar, TypeVar

import numpy as np

from . import _core, _recipe, plot
from ._base import BaseEstimator
from ._call import OF_STATES, Call, clocks, second_by_position
from ._data import open as open_data
from ._fitted import Fitted
from ._model import Model
from ._progress import Progress, reporting
from ._runs import is_arrays, runs, uneven
from ._values import count, names_of, number
from ._warnings import tell_all
from .exceptions import RequestError

Own = TypeVar("Own", bound="Identifier")
States = Sequence[str] | Mapping[str, Mapping[str, Any]] | None
AnyRecipe = str | os.PathLike[str] | Mapping[str, Any] | None
Derivative = str | Mapping[str, str] | Callable[..., Any] | None

#: Documentation of the arguments that all have, in the words of numpydoc.
COMMON = """states : list of str, or dict, optional
        Names of the states in files and tables; a dict has for each the entries of ``[states]``. Arrays have
        ``feature_names``.
    inputs : list of str, or dict, optional
        Names of the inputs, likewise.
    angles : list of str
        States and inputs that are angles (radians): their differences wrap, libraries and partitions see their cosine
        and sine.
    derivative : str, dict or callable, default="auto"
        Measured derivatives: ``"auto"`` (central differences; `SINDy` chooses their order by the data),
        ``"central"``, ``"central4"``, ``"central6"``, ``"forward"``, ``"backward"``, or a column; a dict sets it for
        each state. A function ``(x, t) -> x_dot``, such as pysindy's differentiation objects, is called for every run
        of arrays.
    known : dict of str to str, optional
        Known derivatives as expressions over columns: integrated, never fitted.
    weight : str, optional
        Non-negative weights of the rows: a column or an expression.
    dt : float, optional
        Seconds from row to row of arrays and tables without a clock, for ``fit(X, y)``.
    recipe : path, TOML text or dict, optional
        Further entries of a recipe, above those of the data. An argument that differs from its default overrides
        them; ``{"pwa": {"folds": 10}}`` restores a default.
    cache : path, optional
        Folder for the decoded columns of robots' logs.
    progress : bool or callable, optional
        ``True`` for a bar; or a function of the stage's name, the pieces done and the pieces in all."""


def documented(cls: type[Own]) -> type[Own]:
    """Writes the common arguments into a class's documentation."""
    cls.__doc__ = (cls.__doc__ or "").replace("COMMON", COMMON)
    return cls


class Identifier(Fitted, BaseEstimator):
    """Base of the estimators that fit models to recordings, with scikit-learn's interface."""

    report_: dict[str, Any]

    #: The arrays that scikit-learn's routing of metadata need not know.
    __metadata_request__fit = {"x": "$UNUSED$"}
    __metadata_request__score = {"x": "$UNUSED$"}
    __metadata_request__predict = {"x": "$UNUSED$"}

    #: The defaults of the constructor's arguments.
    _defaults: ClassVar[dict[str, Any]] = {}

    def __init__(
        self,
        states: States,
        inputs: States,
        angles: Sequence[str],
        derivative: Derivative,
        known: Mapping[str, str] | None,
        weight: str | None,
        dt: float | None,
        recipe: AnyRecipe,
        cache: str | os.PathLike[str] | None,
        progress: Progress,
    ) -> None:
        self.states = states
        self.inputs = inputs
        self.angles = angles
        self.derivative = derivative
        self.known = known
        self.weight = weight
        self.dt = dt
        self.recipe = recipe
        self.cache = cache
        self.progress = progress

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        cls._defaults = {one.name: one.default for one in inspect.signature(cls).parameters.values()}

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

    def _argument(self, name: str) -> Any:
        """An argument of the constructor if it differs from the default, which leaves the recipe's entry in force."""
        value = getattr(self, name)
        return None if value is None or not _differs(value, self._defaults[name]) else value

    def _whole(self, name: str, least: int) -> int | None:
        """Whole number of an argument."""
        value = self._argument(name)
        return None if value is None else count(name, value, least)

    def _past(self) -> int | str | Mapping[str, int] | None:
        """The past rows: a number is checked, other forms are kept."""
        lags = self._argument("lags")
        return lags if isinstance(lags, (str, Mapping)) else self._whole("lags", 0)

    def _real(self, name: str, *words: str) -> float | str | None:
        """Number or word of an argument."""
        value = self._argument(name)
        if value is None or (isinstance(value, str) and value in words):
            return value
        if isinstance(value, str) and words:
            raise RequestError(f"{name}={value!r}: give a number, or one of {', '.join(map(repr, words))}")
        return number(name, value)

    def _text(self, name: str) -> str | None:
        """An argument as text."""
        value = self._argument(name)
        return None if value is None else str(value)

    def _list(self, name: str) -> list[str] | None:
        value = self._argument(name)
        return None if value is None else names_of(value)

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
            The states of a run, (rows, states), or a list with one array per run, of any type, order and strides,
            without a copy. A table (pandas, polars, pyarrow, xarray) without ``states`` and ``inputs`` has all
            numeric columns as states, except clock and target. Or files, a data set, a statistic.
        t : array, list of arrays, float or str, optional
            Stamps of the rows in seconds, (rows,), for each run or for all; or the period. For tables and files the
            name of the clock column. Default for tables: an index of times, or a column ``stamp``, ``t``, ``time`` or
            ``timestamp``.
        x_dot : array or list of arrays, optional
            Measured derivatives, in the shape of ``x``; default: differences of ``x``.
        u : array, table or list of them, optional
            Inputs, (rows, inputs).
        feature_names, input_names : list of str, optional
            Names of the columns of ``x`` and ``u``; ``x0``, ``x1``, ... and ``u0``, ``u1``, ... by default.
        y : array or list of arrays, optional
            Targets in the sense of scikit-learn: derivatives, or with ``target`` (``discrete_time``) next values or
            differences, in the shape of ``x``; or the column that ``target`` names, (rows,). The second positional
            argument is ``t``, as in pysindy. It is ``y``, as in scikit-learn, if ``t=``, ``dt=`` or the constructor's
            ``dt`` sets the clock, or if ``target`` names a column that is not in the data.
        dt : float, optional
            Seconds from row to row, in place of ``t``.
        columns : dict of str to array or list of arrays, optional
            Further columns beside arrays, (rows,): labels of a partition, weights, columns of expressions.

        Returns
        -------
        self
            With ``model_`` (:class:`fleetfoot.Model`) and ``report_`` (dict: scores, candidates, certificates,
            standard errors, notes).

        Raises
        ------
        ValueError
            Shapes differ.
        RequestError
            The request cannot be understood or names something unknown.
        DataError
            The data cannot be read, or lack a column.
        FitError
            The data do not determine the fit.

        Warns
        -----
        FleetfootWarning
            Left-out columns, confounded candidates, possible mistakes. Usual assumptions are logged (``logging``,
            ``fleetfoot``) and listed in ``report_["notes"]``.
        """
        given = Call(x, t, x_dot, u, feature_names, input_names, y, dt, columns)
        base = _recipe.of_anything(self.recipe)
        given, base, names = self._streamed(given, base)
        call = given.understood(self._predicts(base), self.dt, self._names_columns(base), base.get("time"))
        data, recipe = self._data(call, base)
        if names is not None:
            self._remember(names, [], names)
        with reporting(self.progress) as callback:
            self.model_, self.report_ = self._fit(data, _recipe.to_json(recipe), callback)
        self.report_["recipe"] = self.model_.recipe
        self._is_flat = call.is_flat
        notes = list(self.report_.get("notes", ()))
        if any(one["prediction"] in ("next", "delta") for one in self.model_.content.fitted()):
            notes += uneven(clocks(call))
        self.report_["notes"] = tell_all(notes)
        return self

    def _fit(self, data: _core.Data, recipe: str, progress: Any) -> tuple[Model, dict[str, Any]]:
        raise NotImplementedError

    def _derivative(self) -> Derivative:
        derivative: Derivative = self._argument("derivative")
        return derivative

    def _method_recipe(self) -> dict[str, Any]:
        """The arguments of this method as a recipe."""
        return {}

    def _predicts(self, base: Mapping[str, Any] | None = None) -> str:
        """The target: of states, or a column."""
        recipe = _recipe.over(self._method_recipe(), _recipe.of_anything(self.recipe) if base is None else base)
        return str(recipe.get("model", {}).get("predict", "derivative"))

    def plot(self, data: Any = None, **options: Any) -> Any:
        """The coefficients with their intervals, or with data the measured values beside the predictions:
        :func:`fleetfoot.plot.coefficients` and :func:`fleetfoot.plot.prediction`.
        """
        return plot.coefficients(self, **options) if data is None else plot.prediction(self, data, **options)

    def _names_columns(self, base: Mapping[str, Any]) -> bool:
        """True if arguments or recipe name the roles of columns."""
        named = (self.states, self.inputs, self.known, *(base.get(name) for name in ("states", "inputs", "tasks")))
        return any(named) or bool(self._method_recipe().get("tasks"))

    def _period(self, recipe: Mapping[str, Any]) -> float | None:
        """The period of arrays that need no clock."""
        return None if recipe.get("model", {}).get("predict", "derivative") == "derivative" else 1.0

    def _data(self, call: Call, base: dict[str, Any]) -> tuple[_core.Data, dict[str, Any]]:
        """The data to read, and the whole recipe."""
        arrays = is_arrays(call.x)
        data, recipe = self._of_arrays(call, base) if arrays else self._of_recordings(call, base)
        recipe = _recipe.override(self._method_recipe(), self._roles(recipe, arrays))
        if self.weight is not None:
            recipe = _recipe.over({"model": {"weight": self.weight}}, recipe)
        return data, recipe

    def _of_arrays(self, call: Call, base: dict[str, Any]) -> tuple[_core.Data, dict[str, Any]]:
        derivative = self._derivative()
        made = runs(
            call.x,
            call.t,
            call.x_dot,
            call.u,
            call.feature_names if call.feature_names is not None else _listed(self.states),
            call.input_names if call.input_names is not None or call.u is None else _listed(self.inputs),
            dt=call.dt,
            default_dt=self._period(_recipe.over(self._method_recipe(), base)),
            differentiate=derivative if callable(derivative) else None,
            columns=call.columns,
        )
        self._remember(made.states, made.inputs, call.table_names)
        states = {name: _recipe.without_none(derivative=made.derivatives.get(name)) for name in made.states}
        below = {"states": states, "inputs": {name: {} for name in made.inputs}, "time": made.time}
        if call.table_names is not None and "column" in made.time:
            # The clock of the table is read already, under another name.
            base = {**base, "time": {name: value for name, value in base.get("time", {}).items() if name not in ("column", "unit")}}
        return made.core, _recipe.over(base, below)

    def _of_recordings(self, call: Call, base: dict[str, Any]) -> tuple[_core.Data, dict[str, Any]]:
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
            return call.x._as_data(), base
        dataset = open_data(call.x, t=call.t, dt=call.dt)
        return dataset._core, _recipe.over(base, _recipe.of_toml(dataset.recipe))

    def _remember(self, states: list[str] | None, inputs: list[str] | None, table: Sequence[str] | None) -> None:
        """The columns of arrays, as attributes of scikit-learn's estimators."""
        for name in ("n_features_in_", "feature_names_in_"):
            vars(self).pop(name, None)
        self._fitted_names = None if states is None else (tuple(states), tuple(inputs or ()))
        if states is not None:
            self.n_features_in_ = len(states)
        if table is not None:
            self.feature_names_in_ = np.array(table, dtype=object)

    def _roles(self, recipe: dict[str, Any], arrays: bool) -> dict[str, Any]:
        """The recipe with the states and inputs of the arguments."""
        for section, names in (("states", self.states), ("inputs", self.inputs)):
            if names is None or (arrays and not isinstance(names, Mapping)):
                continue
            entries = names if isinstance(names, Mapping) else {name: {} for name in names_of(names)}
            recipe = _recipe.over({section: dict(entries)}, recipe)
        states, inputs = dict(recipe.get("states", {})), dict(recipe.get("inputs", {}))
        for name in names_of(self.angles):
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
                texts = {name: given for name, state in states.items() if not {"known", "derivative", "rate"} & set(state)}
            for name, text in texts.items():
                if name not in states:
                    raise RequestError(f"{what}: {name!r} is not a state; there are {', '.join(states)}")
                states[name] = {**states[name], what: text}
        sections = {"states": states, "inputs": inputs}
        return {**recipe, **{name: section for name, section in sections.items() if section}}


def _listed(given: States) -> Sequence[str] | None:
    return None if given is None or isinstance(given, Mapping) else names_of(given)


def _differs(value: Any, default: Any) -> bool:
    try:
        return not bool(np.all(value == default))
    except (TypeError, ValueError):
        return True


def groups_of(given: Any) -> Any:
    """A word, or lists of signals by name."""
    if given is None or isinstance(given, str):
        return given
    if isinstance(given, Mapping):
        return {name: [one] if isinstance(one, str) else list(one) for name, one in given.items()}
    raise RequestError(f"groups={given!r}: give 'signal', 'term', or a dict of lists of signals")


def partition(given: Any) -> str | None:
    """``5`` is ``kmeans:5``; from several one is chosen."""
    if given is None or isinstance(given, str):
        return given
    if isinstance(given, (list, tuple)):
        return ",".join(str(partition(one)) for one in given)
    return f"kmeans:{count('partition', given, 1)}"
