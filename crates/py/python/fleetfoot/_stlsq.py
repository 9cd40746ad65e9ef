"""Sequentially thresholded least squares."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._base import ConvergenceWarning, check_is_fitted
from ._core import Design, SparseModels, stlsq
from ._optimizer import NUMBER, RIDGE, Optimizer, checked_guess, lengths
from ._params import ARRAY, NONE, Rule


class STLSQ(Optimizer):
    """Sequentially thresholded least squares.

    Fits with a ridge, drops the coefficients below the threshold and refits, until no coefficient is dropped:
    ``|y - X w|^2 + alpha |w|^2``, on sums over the rows, without an intercept. Parameters, defaults and stopping rule
    are those of pysindy's `STLSQ`, which it can replace inside `pysindy.SINDy` and `pysindy.EnsembleOptimizer`.

    Parameters
    ----------
    threshold : float, default=0.1
        Coefficients below it are dropped.
    alpha : float, default=0.05
        The ridge.
    max_iter : int, default=20
        Largest number of regressions.
    ridge_kw : dict or None, default=None
        Options of a solver, accepted without effect because the ridge is solved directly. Others raise an error.
    normalize_columns : bool, default=False
        Apply threshold and ridge to coefficients of columns of length 1.
    copy_X : bool, default=True
        Accepted without effect: X is never written.
    initial_guess : array-like of shape (n_features,) or (n_targets, n_features), default=None
        The iteration ends if the first regression keeps exactly the non-zero terms of this array.
    verbose : bool, default=False
        Print the iterations.
    sparse_ind : list of int or None, default=None
        Columns that are penalised and may be dropped; the others always stay, without ridge. `coef_` and `ind_` then
        hold only these columns, `optvar_non_sparse_` and `ind_non_sparse_` the others.
    unbias : bool, default=True
        Refit the remaining terms without the ridge.

    Attributes
    ----------
    coef_ : ndarray of shape (n_targets, n_features)
        Coefficients, the target's units over the column's.
    ind_ : ndarray of shape (n_targets, n_features), bool
        The remaining terms.
    history_ : list of ndarray of shape (n_targets, n_features)
        Coefficients at the start (least squares, or the first guess) and after each iteration.
    intercept_ : float
        0: a column of ones is a feature like the others.
    iters : int
        Number of regressions, all targets together.
    n_iter_ : int
        Largest number of iterations of a target.
    n_features_in_ : int
        Number of features.

    Notes
    -----
    The result is pysindy's to rounding, except for dependent columns: coefficients then have least norm in units of
    the columns' lengths, in pysindy in raw units. The data are read once, and the iterations use their triangular
    factor.

    Examples
    --------
    >>> import numpy as np
    >>> import fleetfoot as ff
    >>> t = np.linspace(0.0, 3.0, 200)
    >>> X = np.column_stack([np.ones(200), t, np.sin(5 * t)])
    >>> model = ff.STLSQ(threshold=0.1).fit(X, 2.0 * t - 0.5 * np.sin(5 * t))
    >>> model.coef_.round(6)
    array([[ 0. ,  2. , -0.5]])
    >>> model.complexity
    2
    """

    _rules = {
        "threshold": (Rule("a number: threshold cannot be negative", NUMBER.holds),),
        "alpha": RIDGE,
        **Optimizer._rules,
        "sparse_ind": (ARRAY, NONE),
    }

    optvar_non_sparse_: NDArray[np.float64]
    ind_non_sparse_: NDArray[np.bool_]

    def __init__(
        self,
        threshold: float = 0.1,
        alpha: float = 0.05,
        max_iter: int = 20,
        ridge_kw: dict[str, Any] | None = None,
        normalize_columns: bool = False,
        copy_X: bool = True,
        initial_guess: Any = None,
        verbose: bool = False,
        sparse_ind: Any = None,
        unbias: bool = True,
    ) -> None:
        self.threshold = threshold
        self.alpha = alpha
        self.ridge_kw = ridge_kw
        self.initial_guess = initial_guess
        self.sparse_ind = sparse_ind
        super().__init__(max_iter, normalize_columns, copy_X, verbose, unbias)

    @property
    def complexity(self) -> int:
        """Number of terms; one more for a threshold of 0, as pysindy counts the intercept."""
        check_is_fitted(self)
        return int(np.count_nonzero(self.coef_)) + int(abs(self.intercept_) >= self.threshold)

    def _others(self, features: int) -> NDArray[np.intp]:
        """Columns that always stay."""
        if self.sparse_ind is None:
            return np.zeros(0, dtype=np.intp)
        chosen = np.asarray(self.sparse_ind)
        if chosen.ndim != 1 or not np.issubdtype(chosen.dtype, np.integer) or len(np.unique(chosen)) != len(chosen):
            raise ValueError("sparse_ind must be a list of different column numbers")
        if len(chosen) and not (0 <= chosen.min() and chosen.max() < features):
            raise ValueError(f"sparse_ind names columns beyond 0 to {features - 1}")
        return np.setdiff1d(np.arange(features), chosen)

    def _solve(self, X: NDArray[Any], y: NDArray[Any], weight: NDArray[np.float64] | None) -> SparseModels:
        guess = checked_guess(self.initial_guess, (y.shape[1], X.shape[1]))
        if guess is not None and self.normalize_columns:
            guess = guess / lengths(X, weight)
        return stlsq(
            Design(X, y, weight),
            {
                "threshold": float(self.threshold),
                "alpha": float(self.alpha),
                "max_iter": int(self.max_iter),
                "normalize": bool(self.normalize_columns),
                "unbias": bool(self.unbias),
                "fixed": self._others(X.shape[1]).tolist(),
            },
            guess,
        )

    def _set_results(self, models: SparseModels) -> None:
        before = [np.ones(len(self.coef_), dtype=bool)] + [h.any(axis=1) for h in self.history_[1:-1]]
        self._iters = int(sum(alive.sum() for alive in before))
        for _ in models.empty:
            warnings.warn(
                f"Sparsity parameter is too big ({self.threshold}) and eliminated all coefficients", stacklevel=3
            )
        if not models.converged:
            warnings.warn(
                f"STLSQ did not converge after {self.max_iter} iterations.", ConvergenceWarning, stacklevel=3
            )
        if self.sparse_ind is not None:
            others, chosen = self._others(self.n_features_in_), np.asarray(self.sparse_ind, dtype=np.intp)
            self._coefficients = self.coef_
            self.optvar_non_sparse_, self.ind_non_sparse_ = self.coef_[:, others], self.ind_[:, others]
            self.coef_, self.ind_ = self.coef_[:, chosen], self.ind_[:, chosen]

    def _all_coefficients(self) -> NDArray[np.float64]:
        return self.coef_ if self.sparse_ind is None else self._coefficients
