"""Forward regression with orthogonal least squares."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._base import check_is_fitted
from ._core import Design, SparseModels, frols
from ._optimizer import NUMBER, RIDGE, Optimizer
from ._params import NONE


class FROLS(Optimizer):
    """Forward regression by orthogonal least squares.

    Columns enter one by one, each with the largest error reduction ratio. One of the models on the way is chosen by
    pysindy's rule: the one before the term with the least ``ratio + kappa cond(X) terms``, where the ratios of a
    target and of all previous targets are summed. Parameters and defaults are those of pysindy's `FROLS`, which it
    can replace inside `pysindy.SINDy`.

    Parameters
    ----------
    normalize_columns : bool, default=False
        Apply the ridge to coefficients of columns of length 1; the order of entry does not change.
    copy_X : bool, default=True
        Accepted without effect: X is never written.
    kappa : float or None, default=None
        Weight of the number of terms, relative to the condition number of X.
    max_iter : int, default=10
        Largest number of terms.
    alpha : float, default=0.05
        Ridge in the system that converts the orthogonal terms to the columns.
    ridge_kw : dict or None, default=None
        Options of a solver, accepted without effect because the ridge is solved directly. Others raise an error.
    verbose : bool, default=False
        Print the steps.
    unbias : bool, default=True
        Refit the chosen terms by least squares.

    Attributes
    ----------
    coef_ : ndarray of shape (n_targets, n_features)
        Coefficients, the target's units over the column's.
    ind_ : ndarray of shape (n_targets, n_features), bool
        The terms of the models.
    history_ : list of ndarray of shape (n_targets, n_features)
        Coefficients of the models with 0, 1, ... terms, with the ridge.
    ERR_global : ndarray of shape (n_features, n_targets)
        Error reduction ratio of each term in the order of entry; 0 beyond the last term tried.
    n_iter_ : int
        Terms that were tried.
    intercept_ : float
        0: a column of ones is a feature like the others.
    n_features_in_ : int
        Number of features.

    Notes
    -----
    Columns that depend on entered ones are left out; pysindy uses their rounding errors, or raises. Coefficients
    below 1e-10 are kept; pysindy sets them to zero.

    Examples
    --------
    >>> import numpy as np
    >>> import fleetfoot as ff
    >>> t = np.linspace(0.0, 3.0, 200)
    >>> X = np.column_stack([np.ones(200), t, np.sin(5 * t)])
    >>> model = ff.FROLS(max_iter=2).fit(X, 2.0 * t - 0.5 * np.sin(5 * t))
    >>> model.coef_.round(6)
    array([[ 0. ,  2. , -0.5]])
    """

    _rules = {**Optimizer._rules, "kappa": (NUMBER, NONE), "alpha": RIDGE}

    _ratios: NDArray[np.float64]
    #: pysindy's ensembles ask for it.
    initial_guess: Any = None

    def __init__(
        self,
        normalize_columns: bool = False,
        copy_X: bool = True,
        kappa: float | None = None,
        max_iter: int = 10,
        alpha: float = 0.05,
        ridge_kw: dict[str, Any] | None = None,
        verbose: bool = False,
        unbias: bool = True,
    ) -> None:
        self.kappa = kappa
        self.alpha = alpha
        self.ridge_kw = ridge_kw
        super().__init__(max_iter, normalize_columns, copy_X, verbose, unbias)

    @property
    def ERR_global(self) -> NDArray[np.float64]:
        """Error reduction ratios (n_features, n_targets): pysindy's name."""
        check_is_fitted(self)
        return self._ratios

    def _solve(self, X: NDArray[Any], y: NDArray[Any], weight: NDArray[np.float64] | None) -> SparseModels:
        return frols(
            Design(X, y, weight),
            {
                "max_terms": int(self.max_iter),
                "alpha": float(self.alpha),
                "kappa": float(self.kappa or 0.0),
                "normalize": bool(self.normalize_columns),
                "unbias": bool(self.unbias),
            },
        )

    def _set_results(self, models: SparseModels) -> None:
        self._ratios = np.zeros((self.n_features_in_, len(self.coef_)))
        for target, ratios in enumerate(models.ratios):
            self._ratios[: len(ratios), target] = ratios
