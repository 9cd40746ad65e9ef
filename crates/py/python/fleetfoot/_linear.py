"""What all linear estimators do once they are fitted."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._base import HAS_SKLEARN, BaseEstimator, RegressorMixin, check_is_fitted, check_x


class LinearModel(RegressorMixin, BaseEstimator):
    """A prediction ``X @ coef_.T + intercept_``."""

    coef_: NDArray[Any]
    intercept_: Any

    #: Whether X may be a sparse matrix.
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
            Regressors; sparse where `fit` takes them so.

        Returns
        -------
        ndarray of shape (n_samples,) or (n_samples, n_targets)
            Predictions, in the units of the target.
        """
        check_is_fitted(self)
        X = check_x(self, X, reset=False, sparse=self._sparse)
        found: NDArray[Any] = np.asarray(X @ np.asarray(self.coef_).T + self.intercept_)
        return found
