"""The group lasso and the sparse-group lasso at given strengths."""

from __future__ import annotations

from numbers import Integral
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from . import _core
from ._base import MultiOutputMixin, check_xy
from ._descent import pose
from ._linear import LinearModel, as_precise, row_weights
from ._params import ARRAY, BOOLEAN, NONE, Rule, check_params, integer, real
from .exceptions import ParameterError

__all__ = ["GroupLasso", "SparseGroupLasso"]

_Fitted = TypeVar("_Fitted", bound="SparseGroupLasso")

#: Parameters of all estimators of groups.
GROUP_RULES: dict[str, tuple[Rule, ...]] = {"groups": (integer(1), ARRAY), "weights": (ARRAY, NONE)}


def group_labels(groups: Any, features: int) -> NDArray[np.int64]:
    """Group index of every feature: neighbours for a size, order of values for labels."""
    if isinstance(groups, Integral):
        return np.arange(features, dtype=np.int64) // int(groups)
    labels = np.asarray(groups)
    if labels.shape != (features,):
        raise ParameterError(
            f"groups has the shape {labels.shape}: give the size of groups of neighbours, or one label a feature, ({features},)"
        )
    _, numbers = np.unique(labels, return_inverse=True)
    return numbers.reshape(-1).astype(np.int64)


def group_weights(weights: Any, labels: NDArray[np.int64]) -> NDArray[np.float64]:
    """Weight of every group: by default the square root of its size."""
    count = int(labels.max(initial=-1)) + 1
    if weights is None:
        sizes: NDArray[np.float64] = np.sqrt(np.bincount(labels, minlength=count).astype(np.float64))
        return sizes
    checked = np.asarray(weights, dtype=np.float64)
    if checked.shape != (count,):
        raise ParameterError(f"weights has the shape {checked.shape}: give one weight a group, ({count},)")
    if not (np.isfinite(checked).all() and (checked >= 0.0).all()):
        raise ParameterError("weights: every weight is finite and not negative")
    return checked


class SparseGroupLasso(MultiOutputMixin, LinearModel):
    """Linear regression whose features enter group by group, with sparsity within groups.

    Minimises ``1 / (2 n) sum_i s_i |y_i - x_i w - b|^2 + alpha ((1 - l1_ratio) sum_g v_g |w_g| + l1_ratio |w|_1)``
    over w and the intercept b, with row weights s of sum n, the weight v_g of group g, and the Euclidean length
    ``|w_g|`` of its coefficients. Several targets are fitted together: ``w_g`` are the coefficients of the group's
    features in all targets. With ``l1_ratio=0``, ``groups=1`` that is scikit-learn's ``MultiTaskLasso``.

    X is compressed in one pass, in parallel and without a copy. Solutions are exact up to rounding for any `tol` (see
    `dual_gap_`).

    Parameters
    ----------
    groups : int or array-like of shape (n_features,), default=1
        The size of groups of neighbouring features, or a label for every feature.
    alpha : float, default=1.0
        Strength of the penalty; 0 is least squares.
    l1_ratio : float in [0, 1], default=0.5
        Share of the l1 penalty: 0 is the group lasso, 1 is the lasso.
    weights : array-like of shape (n_groups,), optional
        Weights of the groups, in the order of their labels; default: the square roots of their numbers of features.
    fit_intercept : bool, default=True
        Fit an intercept, which is not penalised.
    max_iter : int, default=10000
        Largest number of sweeps over the groups.
    tol : float, default=1e-4
        Tolerance of the duality gap, relative to the target's mean square. An inexact solution after `max_iter`
        sweeps with a larger gap is a `ConvergenceWarning`.
    warm_start : bool, default=False
        Start from `coef_` of the previous fit. This changes the number of sweeps, not the result.
    positive : bool, default=False
        Restrict the coefficients to be non-negative.

    Attributes
    ----------
    coef_ : ndarray of shape (n_features,) or (n_targets, n_features)
        Coefficients w, with the precision of X.
    intercept_ : float or ndarray of shape (n_targets,)
        Intercept, 0.0 without one.
    groups_ : ndarray of shape (n_features,)
        The number of every feature's group.
    dual_gap_ : float
        Upper bound on the objective minus its minimum.
    n_iter_ : int
        Sweeps over the groups.
    n_features_in_ : int
        Number of features.
    feature_names_in_ : ndarray of shape (n_features,)
        Names of the features, if X has names.

    See Also
    --------
    GroupLasso : Without the l1 penalty.
    SparseGroupLassoCV : Chooses alpha by cross-validation.

    Examples
    --------
    >>> import numpy as np
    >>> import fleetfoot as ff
    >>> X = np.random.default_rng(0).normal(size=(60, 6))
    >>> y = X @ [2.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    >>> model = ff.SparseGroupLasso(groups=[0, 0, 0, 1, 1, 1], alpha=0.3).fit(X, y)
    >>> model.coef_ != 0.0
    array([ True, False, False, False, False, False])
    """

    _rules: dict[str, tuple[Rule, ...]] = {
        **GROUP_RULES,
        "alpha": (real(0),),
        "l1_ratio": (real(0, 1, "both"),),
        "fit_intercept": (BOOLEAN,),
        "max_iter": (integer(1),),
        "tol": (real(0),),
        "warm_start": (BOOLEAN,),
        "positive": (BOOLEAN,),
    }

    coef_: NDArray[Any]
    intercept_: Any
    groups_: NDArray[np.int64]
    dual_gap_: Any
    n_iter_: int

    def __init__(
        self,
        groups: Any = 1,
        alpha: float = 1.0,
        *,
        l1_ratio: float = 0.5,
        weights: Any = None,
        fit_intercept: bool = True,
        max_iter: int = 10000,
        tol: float = 1e-4,
        warm_start: bool = False,
        positive: bool = False,
    ) -> None:
        self.groups = groups
        self.alpha = alpha
        self.l1_ratio = l1_ratio
        self.weights = weights
        self.fit_intercept = fit_intercept
        self.max_iter = max_iter
        self.tol = tol
        self.warm_start = warm_start
        self.positive = positive

    def fit(self: _Fitted, X: Any, y: Any, sample_weight: Any = None) -> _Fitted:
        """Fits all targets in one pass over X.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Dense regressors, in any memory order.
        y : array-like of shape (n_samples,) or (n_samples, n_targets)
            Targets.
        sample_weight : float or array-like of shape (n_samples,), optional
            Non-negative weights of the rows; only their ratios matter.

        Returns
        -------
        self

        Raises
        ------
        ValueError
            A parameter is out of range, or the data are not finite or their shapes differ.
        TypeError
            X is sparse.
        """
        check_params(self, self._rules)
        X, y = check_xy(self, X, y, multi_output=True)
        y, weight = as_precise(y, X), row_weights(sample_weight, len(y))
        labels = group_labels(self.groups, X.shape[1])
        weights = group_weights(self.weights, labels)
        posed = pose(X, y, weight, intercept=self.fit_intercept)
        targets = len(posed.problems)
        start = self._warm_start(targets, X.shape[1])
        # The coefficients of all targets are one list, the first target's first.
        estimator = _core.Estimator.group_lasso(
            np.tile(labels, targets).tolist(), weights.tolist(), self.l1_ratio, self.max_iter
        )
        together = posed if targets == 1 else posed._replace(problems=posed.problems.joined())
        solved = together.solve(
            0,
            [self.alpha],
            estimator=estimator,
            positive=self.positive,
            max_iter=self.max_iter,
            tol=self.tol,
            start=None if start is None else start.reshape(-1),
        )
        coefs = solved.coefs[0].reshape(targets, X.shape[1])
        intercepts = [posed.problems.intercept(t, np.ascontiguousarray(coefs[t])) for t in range(targets)]
        self.groups_ = labels
        self.coef_ = (coefs[0] if targets == 1 else coefs).astype(X.dtype)
        self._set_intercepts(intercepts, X.dtype, single=y.ndim == 1)
        self.dual_gap_ = X.dtype.type(solved.gaps[0])
        self.n_iter_ = solved.sweeps[0]
        return self


class GroupLasso(SparseGroupLasso):
    """Linear regression whose features enter group by group.

    Minimises ``1 / (2 n) sum_i s_i |y_i - x_i w - b|^2 + alpha sum_g v_g |w_g|`` over w and the intercept b:
    :class:`SparseGroupLasso` with ``l1_ratio=0``; see its notes.

    Parameters
    ----------
    groups : int or array-like of shape (n_features,), default=1
        The size of groups of neighbouring features, or a label for every feature.
    alpha : float, default=1.0
        Strength of the penalty; 0 is least squares.
    weights, fit_intercept, max_iter, tol, warm_start, positive
        As for :class:`SparseGroupLasso`.

    Attributes
    ----------
    coef_, intercept_, groups_, dual_gap_, n_iter_, n_features_in_, feature_names_in_
        As for :class:`SparseGroupLasso`.

    See Also
    --------
    GroupLassoCV : Chooses alpha by cross-validation.

    Examples
    --------
    >>> import numpy as np
    >>> import fleetfoot as ff
    >>> X = np.random.default_rng(0).normal(size=(60, 4))
    >>> model = ff.GroupLasso(groups=2, alpha=0.3).fit(X, X @ [2.0, 1.0, 0.0, 0.0])
    >>> model.coef_ != 0.0
    array([ True,  True, False, False])
    """

    _rules = {name: rule for name, rule in SparseGroupLasso._rules.items() if name != "l1_ratio"}

    def __init__(
        self,
        groups: Any = 1,
        alpha: float = 1.0,
        *,
        weights: Any = None,
        fit_intercept: bool = True,
        max_iter: int = 10000,
        tol: float = 1e-4,
        warm_start: bool = False,
        positive: bool = False,
    ) -> None:
        super().__init__(
            groups=groups,
            alpha=alpha,
            l1_ratio=0.0,
            weights=weights,
            fit_intercept=fit_intercept,
            max_iter=max_iter,
            tol=tol,
            warm_start=warm_start,
            positive=positive,
        )
