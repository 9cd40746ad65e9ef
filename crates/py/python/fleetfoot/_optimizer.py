"""Shared code of the sparse optimisers with pysindy's interface."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._base import BaseEstimator, MultiOutputMixin, RegressorMixin, check_is_fitted, check_weight, check_x, check_xy
from ._numbers import unmasked
from ._params import ARRAY, BOOLEAN, NONE, VERBOSE, Rule, check_params, integer, real

#: Options of pysindy's iterative ridge solvers: the ridge here is solved directly, and more exactly than any of them.
SOLVER_OPTIONS = {"solver", "tol", "max_iter", "random_state", "check_input", "copy_X"}
NUMBER = real(0.0)
#: A ridge.
RIDGE = (Rule("a number: alpha cannot be negative", NUMBER.holds),)


class Optimizer(MultiOutputMixin, RegressorMixin, BaseEstimator):
    """Base of the optimisers: no intercept (a column of ones is a feature), coefficients (n_targets, n_features)."""

    coef_: NDArray[np.float64]
    ind_: NDArray[np.bool_]
    history_: list[NDArray[np.float64]]
    intercept_: float
    n_features_in_: int
    n_iter_: int
    _iters: int = 0

    #: Rules of the parameters that all optimizers share.
    _rules: dict[str, tuple[Rule, ...]] = {
        "max_iter": (integer(1),),
        "normalize_columns": (BOOLEAN,),
        "copy_X": (BOOLEAN,),
        "initial_guess": (ARRAY, NONE),
        "verbose": (VERBOSE,),
        "unbias": (BOOLEAN,),
    }

    def __init__(self, max_iter: int, normalize_columns: bool, copy_X: bool, verbose: bool, unbias: bool) -> None:
        self.max_iter = max_iter
        self.normalize_columns = normalize_columns
        self.copy_X = copy_X
        self.verbose = verbose
        self.unbias = unbias
        self._check()

    def _check(self) -> None:
        check_params(self, self._rules)
        check_ridge(getattr(self, "ridge_kw", None), type(self).__name__)

    def fit(self, X: Any, y: Any, sample_weight: Any = None) -> Any:
        """Fits the coefficients.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Candidate functions, one a column. Rows in which all of X or all of y is NaN are left out, as in pysindy.
        y : array-like of shape (n_samples,) or (n_samples, n_targets)
            Targets, each with its own units.
        sample_weight : float or array-like of shape (n_samples,), default=None
            Weights of the rows' squared errors.

        Returns
        -------
        object
            Itself.

        Raises
        ------
        ValueError
            A parameter is out of range, or values are not finite.
        NotImplementedError
            A parameter is not supported.
        """
        self._check()
        X, y, sample_weight = without_missing(X, y, sample_weight)
        X, y = check_xy(self, X, y, multi_output=True)
        weight = check_weight(sample_weight, len(X))
        self._flat = y.ndim == 1
        y = y.reshape(len(X), -1)
        models = self._solve(X, y, weight)
        self.coef_ = models.coefficients
        self.ind_ = models.decided != 0.0
        self.history_ = list(models.history)
        self.intercept_ = 0.0
        self.n_iter_ = max(models.iterations, 1)
        self._set_results(models)
        if self.verbose:
            self._print(X, y)
        return self

    def predict(self, X: Any) -> NDArray[Any]:
        """Predicts ``X @ coef_.T``.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Candidate functions.

        Returns
        -------
        ndarray of shape (n_samples, n_targets), or (n_samples,) where y was one
            Predictions, in the units of the targets.
        """
        check_is_fitted(self)
        X = check_x(self, X, reset=False)
        predicted: NDArray[Any] = X @ self._all_coefficients().T
        return predicted[:, 0] if self._flat else predicted

    @property
    def iters(self) -> int:
        """Count of the last fit (regressions of STLSQ, iterations of SR3), under pysindy's name."""
        return self._iters

    @property
    def complexity(self) -> int:
        """Number of terms: non-zero coefficients."""
        check_is_fitted(self)
        return int(np.count_nonzero(self.coef_)) + int(np.count_nonzero(self.intercept_))

    def _solve(self, X: NDArray[Any], y: NDArray[Any], weight: NDArray[np.float64] | None) -> Any:
        """Models of targets (n_samples, n_targets)."""
        raise NotImplementedError

    def _set_results(self, models: Any) -> None:
        """Warnings and attributes of a specific optimiser."""

    def _all_coefficients(self) -> NDArray[np.float64]:
        return self.coef_

    def _print(self, X: NDArray[Any], y: NDArray[Any]) -> None:
        print(f"{'Iteration':>10} ... {'|y - Xw|^2':>12} ... {'|w|_0':>6}")
        for number, coefficients in enumerate(self.history_):
            squared = float(((y - X @ coefficients.T) ** 2).sum())
            print(f"{number:>10} ... {squared:>12.4e} ... {np.count_nonzero(coefficients):>6}")


def without_missing(X: Any, y: Any, sample_weight: Any) -> tuple[Any, Any, Any]:
    """Drops the rows in which all of X or all of y is missing; other than float arrays pass unchanged."""
    X, y = unmasked(X), unmasked(y)
    if not (isinstance(X, np.ndarray) and isinstance(y, np.ndarray)):
        return X, y, sample_weight
    # Subclasses (pysindy's arrays with named axes) become plain.
    X, y = np.asarray(X), np.asarray(y)
    floats = np.issubdtype(X.dtype, np.floating) and np.issubdtype(y.dtype, np.floating)
    if not floats or X.ndim != 2 or y.ndim not in (1, 2) or len(X) != len(y):
        return X, y, sample_weight
    # A row that has its first values is there.
    if not (np.isnan(X[:, :1]).any() or np.isnan(y.reshape(len(y), -1)[:, :1]).any()):
        return X, y, sample_weight
    there = ~np.isnan(X).all(axis=1) & ~np.isnan(y.reshape(len(y), -1)).all(axis=1)
    if there.all() or not there.any():
        return X, y, sample_weight
    if sample_weight is not None and np.ndim(sample_weight) == 1:
        sample_weight = np.asarray(sample_weight)[there]
    return X[there], y[there], sample_weight


def check_ridge(options: dict[str, Any] | None, owner: str) -> None:
    """Refuses options of pysindy's ridge that would change its answer."""
    if options is None:
        return
    if not isinstance(options, dict):
        raise ValueError(f"ridge_kw of {owner} must be a dict or None. Got {options!r} instead.")
    other = sorted(set(options) - SOLVER_OPTIONS)
    if other:
        raise NotImplementedError(
            f"ridge_kw={{{other[0]!r}: ...}} of {owner} is not supported: the ridge is solved directly; "
            f"{', '.join(sorted(SOLVER_OPTIONS))} are accepted, and change nothing"
        )


def checked_guess(guess: Any, shape: tuple[int, int]) -> NDArray[np.float64] | None:
    """A first guess as matrix (n_targets, n_features)."""
    if guess is None:
        return None
    checked = np.atleast_2d(np.asarray(guess, dtype=np.float64))
    if checked.shape != shape:
        raise ValueError(
            "initial_guess shape is incompatible with training data. "
            f"Expected: {shape}. Received: {checked.shape}."
        )
    if not np.isfinite(checked).all():
        raise ValueError("initial_guess contains NaN or infinity")
    return checked


def lengths(X: NDArray[Any], weight: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """Lengths of the columns; 1 where they are zero."""
    if weight is None:
        squared = np.einsum("ij,ij->j", X, X, dtype=np.float64)
    else:
        squared = np.einsum("ij,ij,i->j", X, X, weight, dtype=np.float64)
    norms: NDArray[np.float64] = np.sqrt(squared)
    norms[norms == 0.0] = 1.0
    return norms
