"""The strength of the group lasso and of the sparse-group lasso by cross-validation."""

from __future__ import annotations

from typing import Any

from . import _core
from ._coordinate_cv import PathCV, SharesCV
from ._descent import Posed
from ._group_lasso import GROUP_RULES, group_labels, group_weights
from ._params import ARRAY, real

__all__ = ["GroupLassoCV", "SparseGroupLassoCV"]

#: The parameters of all paths that the groups' have.
_OF_PATHS = {"eps", "alphas", "fit_intercept", "max_iter", "tol", "cv", "n_jobs", "positive"}


class SparseGroupLassoCV(SharesCV):
    """The sparse-group lasso, its strength and its l1 share chosen by cross-validation.

    Statistics of the rows give the folds' problems and held-out errors. If every row is held out once, one pass over
    X serves all folds.

    Parameters
    ----------
    groups : int or array-like of shape (n_features,), default=1
        The size of groups of neighbouring features, or a label for every feature.
    l1_ratio : float in [0, 1] or list of them, default=0.5
        Share of the l1 penalty, or list of shares to compare.
    weights : array-like of shape (n_groups,), optional
        As for :class:`SparseGroupLasso`.
    eps : float, default=1e-3
        Ratio of the smallest to the largest alpha of the grid.
    alphas : int or array-like of shape (n_alphas,), default=100
        The alphas, or the number of points of a logarithmic grid. The grid descends from the least alpha at which all
        coefficients are zero.
    fit_intercept : bool, default=True
        Fit an intercept, which is not penalised.
    max_iter : int, default=10000
        Largest number of sweeps per alpha.
    tol : float, default=1e-4
        As for :class:`SparseGroupLasso`.
    cv : int, splitter, iterable of (train, test) or None, default=None
        Folds; None means five spans of neighbouring rows.
    n_jobs : int or None, default=None
        Accepted without effect; see :func:`set_threads`.
    positive : bool, default=False
        Restrict the coefficients to be non-negative.

    Attributes
    ----------
    alpha_ : float
        The alpha with the least mean error over the folds.
    l1_ratio_ : float
        The chosen share of the l1 penalty.
    alphas_ : ndarray of shape (n_alphas,) or (n_l1_ratio, n_alphas)
        The compared alphas, descending.
    mse_path_ : ndarray of shape (n_l1_ratio, n_alphas, n_folds), axes of length 1 left out
        Mean squared errors on the held-out rows.
    coef_, intercept_, dual_gap_, n_iter_, n_features_in_, feature_names_in_
        As for :class:`SparseGroupLasso`, of the fit to all rows.

    Examples
    --------
    >>> import numpy as np
    >>> import fleetfoot as ff
    >>> X = np.random.default_rng(0).normal(size=(60, 4))
    >>> model = ff.SparseGroupLassoCV(groups=2, l1_ratio=[0.1, 0.9], alphas=5).fit(X, X @ [3.0, 0.0, 0.0, 0.0])
    >>> model.l1_ratio_, model.mse_path_.shape
    (0.9, (2, 5, 5))
    """

    _rules = {
        **GROUP_RULES,
        "l1_ratio": (real(0, 1, "both"), ARRAY),
        **{name: rule for name, rule in PathCV._rules.items() if name in _OF_PATHS},
    }

    #: There is no Gram matrix to give.
    precompute = False

    def __init__(
        self,
        groups: Any = 1,
        *,
        l1_ratio: Any = 0.5,
        weights: Any = None,
        eps: float = 1e-3,
        alphas: Any = 100,
        fit_intercept: bool = True,
        max_iter: int = 10000,
        tol: float = 1e-4,
        cv: Any = None,
        n_jobs: int | None = None,
        positive: bool = False,
    ) -> None:
        super().__init__(eps, alphas, fit_intercept, max_iter, tol, cv, n_jobs, positive)
        self.groups = groups
        self.l1_ratio = l1_ratio
        self.weights = weights

    def _estimator(self, ratio: float, features: int) -> _core.Estimator:
        labels = group_labels(self.groups, features)
        weights = group_weights(self.weights, labels)
        return _core.Estimator.group_lasso(labels.tolist(), weights.tolist(), ratio, self.max_iter)

    def _largest(self, whole: Posed, ratio: float, features: int) -> float:
        return whole.problems.largest_alpha(0, self._estimator(ratio, features), self.positive)


class GroupLassoCV(SparseGroupLassoCV):
    """The group lasso with its strength chosen by cross-validation.

    It is :class:`SparseGroupLassoCV` with ``l1_ratio=0``; see its notes.

    Parameters
    ----------
    groups : int or array-like of shape (n_features,), default=1
        The size of groups of neighbouring features, or a label for every feature.
    weights, eps, alphas, fit_intercept, max_iter, tol, cv, n_jobs, positive
        As for :class:`SparseGroupLassoCV`.

    Attributes
    ----------
    alpha_, alphas_, mse_path_, coef_, intercept_, dual_gap_, n_iter_, n_features_in_, feature_names_in_
        As for :class:`SparseGroupLassoCV`.

    Examples
    --------
    >>> import numpy as np
    >>> import fleetfoot as ff
    >>> X = np.random.default_rng(0).normal(size=(60, 4))
    >>> model = ff.GroupLassoCV(groups=2).fit(X, X @ [3.0, 1.0, 0.0, 0.0])
    >>> model.coef_.round(1) + 0.0
    array([3., 1., 0., 0.])
    """

    _rules = {name: rule for name, rule in SparseGroupLassoCV._rules.items() if name != "l1_ratio"}

    def __init__(
        self,
        groups: Any = 1,
        *,
        weights: Any = None,
        eps: float = 1e-3,
        alphas: Any = 100,
        fit_intercept: bool = True,
        max_iter: int = 10000,
        tol: float = 1e-4,
        cv: Any = None,
        n_jobs: int | None = None,
        positive: bool = False,
    ) -> None:
        super().__init__(
            groups=groups,
            l1_ratio=0.0,
            weights=weights,
            eps=eps,
            alphas=alphas,
            fit_intercept=fit_intercept,
            max_iter=max_iter,
            tol=tol,
            cv=cv,
            n_jobs=n_jobs,
            positive=positive,
        )
