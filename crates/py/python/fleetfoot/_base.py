"""Base classes of the estimators: those of scikit-learn 1.6 or newer if installed, else small substitutes.

Use: `fit` calls :func:`check_params` and :func:`check_xy` (or :func:`check_x`), `predict` and `transform` call
:func:`check_is_fitted` and ``check_x(self, X, reset=False)``. Arrays of `float32` and `float64` are returned without
a copy.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from . import _plain
from ._arrays import numbers
from ._keywords import hinting
from ._numbers import unmasked
from ._plain import (
    BaseEstimator,
    ClusterMixin,
    ConvergenceWarning,
    DataConversionWarning,
    KFold,
    MultiOutputMixin,
    NotFittedError,
    RegressorMixin,
    TransformerMixin,
    check_cv,
    check_is_fitted,
)

HAS_SKLEARN: bool = False
_check_array: Any = None
_validate: Any = None
if not TYPE_CHECKING:
    # The newest name first: an older scikit-learn is none at all.
    with suppress(ImportError):
        from sklearn.utils.validation import validate_data as _validate
        from sklearn.base import BaseEstimator, ClusterMixin, MultiOutputMixin, RegressorMixin, TransformerMixin
        from sklearn.exceptions import ConvergenceWarning, DataConversionWarning, NotFittedError
        from sklearn.model_selection import KFold, check_cv
        from sklearn.utils.validation import check_array as _check_array
        from sklearn.utils.validation import check_is_fitted

        HAS_SKLEARN = True

if not TYPE_CHECKING:
    _Base = BaseEstimator

    class BaseEstimator(_Base):
        """Base of all estimators. The error for an unknown keyword names the right one."""

        def __init_subclass__(cls, **options: Any) -> None:
            super().__init_subclass__(**options)
            if "__init__" in vars(cls):
                cls.__init__ = hinting(cls.__init__, cls.__name__)


__all__ = [
    "HAS_SKLEARN",
    "BaseEstimator",
    "ClusterMixin",
    "ConvergenceWarning",
    "DataConversionWarning",
    "KFold",
    "MultiOutputMixin",
    "NotFittedError",
    "RegressorMixin",
    "TransformerMixin",
    "check_cv",
    "as_given",
    "check_finite",
    "check_is_fitted",
    "check_rows",
    "check_weight",
    "check_x",
    "check_xy",
    "is_sparse",
    "random_numbers",
    "random_seed",
    "splits",
]


def check_x(estimator: Any, X: Any, *, reset: bool, min_samples: int = 1, sparse: bool = False) -> NDArray[Any]:
    """X as a finite matrix (n_samples, n_features) of `float32` or `float64`.

    With `reset` it sets `n_features_in_` and `feature_names_in_`, else it compares with them. With `sparse` (needs
    scikit-learn) a sparse matrix becomes compressed rows, else it is a `TypeError`. A matrix with values that are not
    finite numbers is a `ValueError`.
    """
    X = unmasked(X)
    if HAS_SKLEARN:
        options: dict[str, Any] = {
            "dtype": [np.float64, np.float32],
            "ensure_min_samples": min_samples,
            "accept_sparse": "csr" if sparse else False,
        }
        validated: NDArray[Any] = _validate(estimator, X, reset=reset, **options)
        return validated
    plain: NDArray[Any] = _plain.validate_data(estimator, X, reset=reset, ensure_min_samples=min_samples)
    return plain


def check_xy(
    estimator: Any,
    X: Any,
    y: Any,
    *,
    multi_output: bool = False,
    min_samples: int = 1,
    finite: bool = True,
    sparse: bool = False,
) -> tuple[NDArray[Any], NDArray[Any]]:
    """X as :func:`check_x` makes it (`reset`), and y as finite `float32` or `float64` of as many rows.

    y is a vector (n_samples,); with `multi_output` it may be (n_samples, n_targets). Without `finite` the check that
    X is finite is left to :func:`check_finite`.
    """
    if y is None:
        raise ValueError(
            f"This {type(estimator).__name__} estimator requires y to be passed, but the target y is None."
        )
    X, y = unmasked(X), unmasked(y)
    if HAS_SKLEARN:
        options: dict[str, Any] = {
            "dtype": [np.float64, np.float32],
            "y_numeric": True,
            "multi_output": multi_output,
            "ensure_min_samples": min_samples,
            "ensure_all_finite": finite,
            "accept_sparse": "csr" if sparse else False,
        }
        matrix, target = _validate(estimator, X, y, **options)
        if target.dtype not in (np.float32, np.float64):
            target = target.astype(np.float64)
        return matrix, target
    matrix, target = _plain.validate_data(estimator, X, y, multi_output=multi_output, ensure_min_samples=min_samples)
    return matrix, target


def is_sparse(X: Any) -> bool:
    """True for scipy's sparse matrices and arrays."""
    return hasattr(X, "tocsr") and hasattr(X, "nnz")


def as_given(X: Any) -> Any:
    """X without a check: an array, or compressed rows of a sparse matrix."""
    return X.tocsr() if is_sparse(X) else numbers(X, "X")


def check_rows(X: Any, owner: str) -> Any:
    """X of a function: a finite matrix of `float32` or `float64`, or compressed rows of a sparse one."""
    if HAS_SKLEARN and is_sparse(X):
        return _check_array(X, dtype=[np.float64, np.float32], accept_sparse="csr", estimator=owner, input_name="X")
    return _plain.as_matrix(X, owner)


def check_finite(estimator: Any, X: NDArray[Any]) -> None:
    """Raises the `ValueError` of :func:`check_xy` if X is not finite."""
    if HAS_SKLEARN:
        _check_array(X, dtype=None, estimator=estimator, input_name="X", accept_sparse=True)
    else:
        _plain.as_matrix(X, type(estimator).__name__)


def check_weight(sample_weight: Any, rows: int) -> NDArray[np.float64] | None:
    """Row weights (n_samples,) as `float64`; a number is the weight of every row, `None` stays.

    Raises `ValueError` if a weight is negative or not finite, all are zero, or their number differs from that of the
    rows.
    """
    if sample_weight is None:
        return None
    if isinstance(sample_weight, (int, float, np.number)):
        weight = np.full(rows, float(sample_weight))
    else:
        weight = numbers(sample_weight, "sample_weight").astype(np.float64, copy=False)
    if weight.ndim != 1:
        raise ValueError(f"Sample weights must be 1D array or scalar, got {weight.ndim}D array.")
    if weight.shape != (rows,):
        raise ValueError(f"sample_weight.shape == {weight.shape}, expected {(rows,)}!")
    if not np.isfinite(weight).all():
        what = "NaN" if np.isnan(weight).any() else "infinity"
        raise ValueError(f"Input sample_weight contains {what}: a row without weight has the weight 0")
    if (weight < 0.0).any():
        raise ValueError("Negative values in sample_weight: weights are 0 or more")
    if rows and not weight.any():
        raise ValueError("Every sample weight is zero: at least one row needs a sample_weight above zero")
    return weight


def random_seed(random_state: Any) -> int:
    """The seed of `random_state`.

    An integer is the seed. A `numpy.random.RandomState` or `Generator` draws it, `None` draws it from numpy's global
    state (set by `numpy.random.seed`).
    """
    if random_state is None or random_state is np.random:
        return int(np.random.randint(np.iinfo(np.int32).max))
    if isinstance(random_state, (int, np.integer)) and not isinstance(random_state, bool):
        if not 0 <= random_state <= 2**32 - 1:
            raise ValueError(f"random_state is {random_state}: a seed lies between 0 and 2**32 - 1")
        return int(random_state)
    if isinstance(random_state, np.random.RandomState):
        return int(random_state.randint(np.iinfo(np.int32).max))
    if isinstance(random_state, np.random.Generator):
        return int(random_state.integers(np.iinfo(np.int32).max))
    raise ValueError(
        f"{random_state!r} cannot be used to seed: give an integer, a numpy RandomState or Generator, or None"
    )


def random_numbers(random_state: Any) -> Any:
    """numpy's random numbers of `random_state`.

    A seed makes a `RandomState`, `None` is numpy's global one, and a generator is used as it is.
    """
    if random_state is None or random_state is np.random:
        return np.random
    if isinstance(random_state, (np.random.RandomState, np.random.Generator)):
        return random_state
    return np.random.RandomState(random_seed(random_state))


def splits(cv: Any, X: Any, y: Any, **params: Any) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Indices of the training rows and of the held-out rows of every fold.

    `cv` is a number of folds (neighbouring rows), a splitter, an iterable of (train, test), or `None` for five folds.
    """
    folds: Iterable[Any] = check_cv(cv, classifier=False).split(X, y, **params)
    rows = np.arange(X.shape[0])
    # Masks and negative indices become indices.
    return [(rows[np.asarray(train)], rows[np.asarray(test)]) for train, test in folds]
