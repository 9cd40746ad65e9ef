"""Shared code of linear estimators: row weights, starts of a fit, intercepts, predictions."""

from __future__ import annotations

from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._base import HAS_SKLEARN, BaseEstimator, RegressorMixin, check_is_fitted, check_weight, check_x


class LinearModel(RegressorMixin, BaseEstimator):
    """A prediction ``X @ coef_.T + intercept_``."""

    coef_: NDArray[Any]
    intercept_: Any
    fit_intercept: bool

    #: True if X may be a sparse matrix.
    _sparse = False

    if HAS_SKLEARN:

        def __sklearn_tags__(self) -> Any:
            """scikit-learn's description of the estimator."""
            tags = super().__sklearn_tags__()  # type: ignore[misc, unused-ignore]
            tags.input_tags.sparse = self._sparse
            return tags

    def predict(self, X: Any) -> NDArray[Any]:
        """Predicts.

        Parameters
        ----------
        X : array-like or sparse matrix of shape (n_samples, n_features)
            Regressors; sparse if `fit` supports it.

        Returns
        -------
        ndarray of shape (n_samples,) or (n_samples, n_targets)
            Predictions, in the units of the target.
        """
        check_is_fitted(self)
        X = check_x(self, X, reset=False, sparse=self._sparse)
        predicted: NDArray[Any] = np.asarray(X @ np.asarray(self.coef_).T + self.intercept_)
        return predicted

    def _warm_start(self, targets: int, features: int) -> NDArray[Any] | None:
        """The coefficients (n_targets, n_features) of the previous fit, with `warm_start`."""
        if not getattr(self, "warm_start", False) or not hasattr(self, "coef_"):
            return None
        start = np.atleast_2d(self.coef_)
        if start.shape != (targets, features):
            raise ValueError(
                f"warm_start: coef_ has the shape {np.shape(self.coef_)}, and there are {targets} targets of {features} "
                "features: set warm_start=False, or give data of the same shape"
            )
        return start

    def _set_intercepts(self, intercepts: Any, dtype: Any, *, single: bool) -> None:
        """The intercepts of all targets, or of the single one as a number; 0.0 without one."""
        if not self.fit_intercept:
            self.intercept_ = 0.0
            return
        intercepts_kept = np.array(intercepts, dtype=dtype)
        self.intercept_ = intercepts_kept[0] if single else intercepts_kept


def as_precise(y: NDArray[Any], X: Any) -> NDArray[Any]:
    """The target in single precision if X has it."""
    return np.asarray(y, dtype=np.float32) if X.dtype == np.float32 else y


def row_weights(sample_weight: Any, rows: int) -> NDArray[np.float64] | None:
    """The weights of the rows; one number for all has no effect."""
    return None if isinstance(sample_weight, Real) else check_weight(sample_weight, rows)
