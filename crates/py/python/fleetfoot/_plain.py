"""Substitutes for scikit-learn's base classes and functions if it is not installed.

Names, parameters and behaviour are scikit-learn's, so that code written for one works with the other.
"""

from __future__ import annotations

import inspect
import warnings
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ._numbers import unmasked


if TYPE_CHECKING:
    from typing_extensions import Self


class NotFittedError(ValueError, AttributeError):
    """An estimator is used before it was fitted."""


class ConvergenceWarning(UserWarning):
    """A solver stopped above its tolerance, or the data do not determine the result."""


class DataConversionWarning(UserWarning):
    """Data have another shape than expected."""


class BaseEstimator:
    """Parameters by name: those of ``__init__``."""

    @classmethod
    def _parameter_names(cls) -> list[str]:
        if cls.__init__ is object.__init__:
            return []
        named = inspect.signature(cls.__init__).parameters.values()
        return sorted(p.name for p in named if p.name != "self" and p.kind != p.VAR_KEYWORD)

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Parameters by name, and those of estimators among them as ``name__parameter`` when `deep`."""
        values: dict[str, Any] = {}
        for name in self._parameter_names():
            value = getattr(self, name)
            if deep and hasattr(value, "get_params") and not isinstance(value, type):
                values.update((f"{name}__{inner}", v) for inner, v in value.get_params().items())
            values[name] = value
        return values

    def set_params(self, **params: Any) -> Self:
        """Sets parameters by name, ``name__parameter`` for those of an estimator among them."""
        known = self._parameter_names()
        inner: dict[str, dict[str, Any]] = {}
        for name, value in params.items():
            head, _, rest = name.partition("__")
            if head not in known:
                raise ValueError(f"{type(self).__name__} has no parameter {head!r}; it has {', '.join(known) or 'none'}")
            if rest:
                inner.setdefault(head, {})[rest] = value
            else:
                setattr(self, head, value)
        for head, values in inner.items():
            getattr(self, head).set_params(**values)
        return self

    def __repr__(self) -> str:
        defaults = {name: p.default for name, p in inspect.signature(type(self).__init__).parameters.items()}

        def differs(name: str, value: Any) -> bool:
            default = defaults[name]
            return repr(value) != repr(default)

        shown = [f"{name}={value!r}" for name, value in self.get_params(deep=False).items() if differs(name, value)]
        return f"{type(self).__name__}({', '.join(shown)})"


class RegressorMixin:
    """`score`: the share of the targets' variance that the prediction explains."""

    _estimator_type = "regressor"

    def score(self, X: Any, y: Any, sample_weight: Any = None) -> float:
        """R2 of the prediction; of several targets the mean.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Regressors.
        y : array-like of shape (n_samples,) or (n_samples, n_targets)
            Targets.
        sample_weight : array-like of shape (n_samples,), optional
            Row weights.
        """
        truth = np.asarray(unmasked(y), dtype=np.float64)
        predicted = np.asarray(self.predict(X), dtype=np.float64)  # type: ignore[attr-defined]
        truth, predicted = truth.reshape(len(truth), -1), predicted.reshape(len(predicted), -1)
        if truth.shape != predicted.shape:
            raise ValueError(f"y has the shape {truth.shape}, the prediction {predicted.shape}")
        weight = np.ones(len(truth)) if sample_weight is None else np.asarray(sample_weight, dtype=np.float64)
        if len(truth) < 2:
            warnings.warn("R2 is not defined for fewer than two rows", UserWarning, stacklevel=2)
            return float("nan")
        mean = np.average(truth, axis=0, weights=weight)
        left = weight @ (truth - predicted) ** 2
        total = weight @ (truth - mean) ** 2
        scores = np.where(total > 0.0, 1.0 - left / np.where(total > 0.0, total, 1.0), (left == 0.0).astype(float))
        return float(scores.mean())


class ClusterMixin:
    """`fit_predict`: the labels of the rows that were fitted."""

    _estimator_type = "clusterer"

    def fit_predict(self, X: Any, y: Any = None, **kwargs: Any) -> NDArray[Any]:
        """Fits and gives the labels (n_samples,)."""
        labels: NDArray[Any] = self.fit(X, **kwargs).labels_  # type: ignore[attr-defined]
        return labels


class TransformerMixin:
    """`fit_transform`: fits, and transforms the same rows."""

    def fit_transform(self, X: Any, y: Any = None, **kwargs: Any) -> NDArray[Any]:
        """Fits and transforms (n_samples, n_outputs)."""
        fitted = self.fit(X, **kwargs) if y is None else self.fit(X, y, **kwargs)  # type: ignore[attr-defined]
        out: NDArray[Any] = fitted.transform(X)
        return out


class MultiOutputMixin:
    """Takes several targets at once."""


def check_is_fitted(estimator: Any, attributes: str | list[str] | None = None) -> None:
    """Raises :class:`NotFittedError` when `estimator` has not been fitted.

    A fitted estimator has an attribute that ends with an underscore, or the given attributes.
    """
    if attributes is None and hasattr(estimator, "__sklearn_is_fitted__"):
        fitted = bool(estimator.__sklearn_is_fitted__())
    elif attributes is None:
        fitted = any(name.endswith("_") and not name.startswith("__") for name in vars(estimator))
    else:
        names = [attributes] if isinstance(attributes, str) else attributes
        fitted = all(hasattr(estimator, name) for name in names)
    if not fitted:
        raise NotFittedError(f"this {type(estimator).__name__} instance is not fitted yet: call fit first")


def validate_data(
    estimator: Any,
    /,
    X: Any,
    y: Any = None,
    *,
    reset: bool = True,
    multi_output: bool = False,
    ensure_min_samples: int = 1,
) -> Any:
    """X as a matrix of `float32` or `float64`, and y when given.

    With `reset` number and names of the features are stored, else they are compared.
    """
    _feature_names(estimator, X, reset)
    matrix = as_matrix(X, type(estimator).__name__, ensure_min_samples)
    if reset:
        estimator.n_features_in_ = matrix.shape[1]
    elif matrix.shape[1] != estimator.n_features_in_:
        raise ValueError(
            f"X has {matrix.shape[1]} features, but {type(estimator).__name__} is expecting "
            f"{estimator.n_features_in_} features as input"
        )
    if y is None:
        return matrix
    target = as_target(y, multi_output)
    if len(target) != len(matrix):
        raise ValueError(f"X has {len(matrix)} rows and y has {len(target)}: give one target a row")
    return matrix, target


def as_matrix(X: Any, owner: str, ensure_min_samples: int = 1) -> NDArray[Any]:
    """X as a finite matrix of `float32` or `float64`, without a copy if possible."""
    if hasattr(X, "toarray") and hasattr(X, "nnz"):
        raise TypeError("X is a sparse matrix, but dense data are needed: give X.toarray()")
    array = _numbers(X, "X")
    if array.ndim != 2:
        raise ValueError(
            f"X has {array.ndim} dimensions, 2 are needed: X.reshape(-1, 1) makes one feature of them, "
            "X.reshape(1, -1) one sample"
        )
    rows, columns = array.shape
    if rows < ensure_min_samples:
        raise ValueError(f"X has {rows} sample(s) (shape={array.shape}) while {owner} needs {ensure_min_samples}")
    if columns < 1:
        raise ValueError(f"X has 0 feature(s) (shape={array.shape}) while a minimum of 1 is required by {owner}")
    return array


def as_target(y: Any, multi_output: bool) -> NDArray[Any]:
    """y as finite numbers: a vector, or a matrix if several targets are allowed."""
    array = _numbers(y, "y")
    if array.ndim == 2 and not multi_output and array.shape[1] == 1:
        warnings.warn("y is a column, and a vector is meant: give y.ravel()", DataConversionWarning, stacklevel=4)
        return array[:, 0]
    if array.ndim != 1 and not (multi_output and array.ndim == 2):
        raise ValueError(f"y should be a 1d array, got an array of shape {array.shape} instead")
    return array


def _numbers(values: Any, name: str) -> NDArray[Any]:
    array = np.asarray(unmasked(values))
    if np.iscomplexobj(array):
        raise ValueError(f"{name} holds complex numbers, which are not supported: give real ones")
    if array.dtype not in (np.float32, np.float64):
        try:
            array = array.astype(np.float64)
        except (TypeError, ValueError) as error:
            raise ValueError(f"{name} cannot be read as numbers: {error}") from error
    if not np.isfinite(array).all():
        what = "NaN" if np.isnan(array).any() else "infinity"
        raise ValueError(f"Input {name} contains {what}: drop those rows, or fill them in")
    return array


def _feature_names(estimator: Any, X: Any, reset: bool) -> None:
    columns = getattr(X, "columns", None)
    names = None
    if columns is not None and not callable(columns):
        listed = list(columns)
        if listed and all(isinstance(name, str) for name in listed):
            names = np.asarray(listed, dtype=object)
    known = getattr(estimator, "feature_names_in_", None)
    if reset:
        if names is not None:
            estimator.feature_names_in_ = names
        elif known is not None:
            del estimator.feature_names_in_
    elif names is not None and known is not None and list(names) != list(known):
        raise ValueError(
            f"the feature names differ from those of the fit: {', '.join(map(str, names))} "
            f"against {', '.join(map(str, known))}"
        )


class KFold:
    """`n_splits` folds of neighbouring rows, each held out once."""

    def __init__(self, n_splits: int = 5) -> None:
        self.n_splits = n_splits

    def split(self, X: Any, y: Any = None, groups: Any = None) -> Iterator[tuple[NDArray[Any], NDArray[Any]]]:
        """Indices of training and held-out rows, fold by fold."""
        rows = len(X)
        if self.n_splits > rows:
            raise ValueError(f"{self.n_splits} folds of {rows} rows: a fold needs at least one")
        every = np.arange(rows)
        for held_out in np.array_split(every, self.n_splits):
            yield np.setdiff1d(every, held_out, assume_unique=True), held_out


def check_cv(cv: Any, y: Any = None, classifier: bool = False) -> Any:
    """A splitter from a number of folds, a splitter, or an iterable of (train, test)."""
    if cv is None or isinstance(cv, (int, np.integer)):
        folds = 5 if cv is None else int(cv)
        if folds < 2:
            raise ValueError(f"cv is {folds}: at least 2 folds are needed")
        return KFold(folds)
    if hasattr(cv, "split") and not isinstance(cv, str):
        return cv
    if isinstance(cv, str) or not hasattr(cv, "__iter__"):
        raise ValueError(f"cv is {cv!r}: give a number of folds, a splitter, or an iterable of (train, test)")
    return _Given(list(cv))


class _Given:
    def __init__(self, splits: list[Any]) -> None:
        self.splits = splits

    def split(self, X: Any = None, y: Any = None, groups: Any = None) -> Iterator[Any]:
        yield from self.splits
