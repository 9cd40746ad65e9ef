"""Bolasso: the features that the lassos of most resamples of the rows select, and least squares on them."""

from __future__ import annotations

import warnings
from typing import Any, TypedDict, TypeVar

import numpy as np
from numpy.typing import NDArray

from . import _core
from ._base import ConvergenceWarning, MultiOutputMixin, check_is_fitted, check_xy, random_seed
from ._descent import pose
from ._linear import LinearModel, row_weights
from ._params import ARRAY, BOOLEAN, NONE, RANDOM_STATE, Rule, check_params, integer, one_of, real
from .exceptions import ParameterError

__all__ = ["Bolasso"]

_Fitted = TypeVar("_Fitted", bound="Bolasso")

#: Blocks that a recording is cut into, about, where their length is not given.
_BLOCKS = 200


class BolassoRequest(TypedDict):
    """Resampling options for the engine."""

    alphas: list[float]
    scales: list[float]
    intercept: bool
    positive: bool
    replicates: int
    seed: int
    unit: str
    lengths: list[int]


class Bolasso(MultiOutputMixin, LinearModel):
    """Features that the lassos of most bootstrap replicates select, and least squares on them.

    The lasso keeps the features of the target, but also correlated ones. The latter change from replicate to
    replicate, and the features that (nearly) all replicates select are the right ones (Bach 2008). Every replicate
    minimises the objective of :class:`Lasso` with each row weighted by its count of draws. The last fit is least
    squares on the features that at least `threshold` of the replicates select.

    With ``bootstrap="rows"`` one pass over X gives the moments of all replicates; blocks and groups need one
    statistic each. X is never copied. The penalty applies to unscaled features, as in :class:`Lasso`; scale them if
    necessary.

    Parameters
    ----------
    n_estimators : int, default=128
        Number of bootstrap replicates.
    alpha : float, array-like of shape (n_targets,), "aic", "bic" or "ebic", default="bic"
        Penalty of the replicates' lassos. A word chooses the knot of the lasso path of all rows by that criterion,
        target by target. The bolasso is consistent for penalties that fall like ``n_samples ** -0.5``.
    threshold : float in (0, 1], default=0.9
        Share of the replicates that must select a feature; 1 keeps the intersection of their supports.
    bootstrap : {"rows", "blocks", "groups"}, default="rows"
        Units of the resampling: rows, independently (the counts have the Poisson distribution of mean 1); blocks of
        neighbouring rows, for recordings with correlated rows; or whole groups, such as episodes.
    block_length : int or None, default=None
        Rows of a block, longer than the correlation; None means the larger of the cube root and a 200th of the rows.
    fit_intercept : bool, default=True
        Fit an intercept, which is not penalised.
    positive : bool, default=False
        Restrict the coefficients to be non-negative.
    random_state : int, RandomState, Generator or None, default=None
        Seed of the draws. The draw of a row depends only on the seed, the replicate and the row's index.

    Attributes
    ----------
    selection_frequency_ : ndarray of shape (n_features,) or (n_targets, n_features)
        Share of the replicates that select each feature.
    selection_sign_ : ndarray of shape (n_features,) or (n_targets, n_features)
        Mean sign of each coefficient over the replicates that select it: 1 or -1 where they agree.
    support_ : ndarray of bool of shape (n_features,) or (n_targets, n_features)
        The selected features.
    coef_ : ndarray of shape (n_features,) or (n_targets, n_features)
        Least squares on the selected features, zero elsewhere.
    intercept_ : float or ndarray of shape (n_targets,)
        Intercept, 0.0 without one.
    alpha_ : float or ndarray of shape (n_targets,)
        Penalty of the replicates' lassos.
    coef_samples_ : ndarray of shape (n_estimators, n_features) or (n_estimators, n_targets, n_features)
        Coefficients of the replicates' lassos.
    intercept_samples_ : ndarray of shape (n_estimators,) or (n_estimators, n_targets)
        Their intercepts.
    kkt_ : float
        Largest violation of the optimality conditions of any replicate, as a correlation.
    n_features_in_ : int
        Number of features.
    feature_names_in_ : ndarray of shape (n_features,)
        Names of the features, if X has names.

    See Also
    --------
    Lasso : One lasso of all rows.

    References
    ----------
    F. Bach, "Bolasso: model consistent Lasso estimation through the bootstrap", ICML 2008.

    Examples
    --------
    >>> import numpy as np
    >>> import fleetfoot as ff
    >>> rng = np.random.default_rng(0)
    >>> X = rng.standard_normal((400, 6))
    >>> y = 2.0 * X[:, 1] - X[:, 4] + 0.5 * rng.standard_normal(400)
    >>> model = ff.Bolasso(alpha=0.1, random_state=0).fit(X, y)
    >>> model.get_support(indices=True)
    array([1, 4])
    >>> model.coef_.round(1) + 0.0
    array([ 0.,  2.,  0.,  0., -1.,  0.])
    """

    _rules: dict[str, tuple[Rule, ...]] = {
        "n_estimators": (integer(1),),
        "alpha": (real(0), one_of("aic", "bic", "ebic"), ARRAY),
        "threshold": (real(0, 1, "right"),),
        "bootstrap": (one_of("rows", "blocks", "groups"),),
        "block_length": (integer(1), NONE),
        "fit_intercept": (BOOLEAN,),
        "positive": (BOOLEAN,),
        "random_state": (RANDOM_STATE,),
    }

    def __init__(
        self,
        n_estimators: int = 128,
        *,
        alpha: Any = "bic",
        threshold: float = 0.9,
        bootstrap: str = "rows",
        block_length: int | None = None,
        fit_intercept: bool = True,
        positive: bool = False,
        random_state: Any = None,
    ) -> None:
        self.n_estimators = n_estimators
        self.alpha = alpha
        self.threshold = threshold
        self.bootstrap = bootstrap
        self.block_length = block_length
        self.fit_intercept = fit_intercept
        self.positive = positive
        self.random_state = random_state

    def fit(self: _Fitted, X: Any, y: Any, sample_weight: Any = None, groups: Any = None) -> _Fitted:
        """Fits the lassos of all replicates, and least squares on the common features.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Dense regressors, in any memory order.
        y : array-like of shape (n_samples,) or (n_samples, n_targets)
            Targets; several targets share only the drawn rows.
        sample_weight : float or array-like of shape (n_samples,), optional
            Weights of the rows, multiplied by the count of draws.
        groups : array-like of shape (n_samples,), optional
            Group of every row, for ``bootstrap="groups"``; the rows of a group are neighbours.

        Returns
        -------
        self

        Raises
        ------
        ValueError
            A parameter is out of range, the data are not finite or their shapes differ, or groups are missing or
            scattered.
        TypeError
            X is sparse.
        """
        check_params(self, self._rules)
        X, y = check_xy(self, X, y, multi_output=True)
        weight = row_weights(sample_weight, len(X))
        self._lengths = self._units(len(X), groups)
        self._seed = random_seed(self.random_state)
        problems = pose(X, y, weight, intercept=self.fit_intercept).problems
        targets = 1 if y.ndim == 1 else y.shape[1]
        alphas = self._alphas(problems, targets)
        request: BolassoRequest = {
            "alphas": alphas,
            "scales": [problems.deviation(k) for k in range(targets)],
            "intercept": self.fit_intercept,
            "positive": self.positive,
            "replicates": int(self.n_estimators),
            "seed": self._seed,
            "unit": self.bootstrap,
            "lengths": self._lengths,
        }
        frequency, sign, coefs, intercepts, self.kkt_, missed, _ = _core.bolasso(X, y, weight, request)
        if missed:
            warnings.warn(
                f"{missed} of {self.n_estimators} replicates did not converge: the largest violation of the optimality "
                f"conditions is {self.kkt_:.3g} as a correlation; give a larger alpha",
                ConvergenceWarning,
                stacklevel=2,
            )
        # A share is a quotient of integers: 0.9 must not miss 9 of 10 for rounding.
        support = (frequency > 0.0) & (frequency >= self.threshold * (1.0 - 4.0 * np.finfo(np.float64).eps))
        fits = [problems.refit(k, [int(j) for j in np.flatnonzero(support[k])], self.positive) for k in range(targets)]
        several = y.ndim > 1

        def shaped(values: NDArray[Any], axis: int = 0) -> NDArray[Any]:
            return values if several else np.take(values, 0, axis=axis)

        self.selection_frequency_ = shaped(frequency)
        self.selection_sign_ = shaped(sign)
        self.support_ = shaped(support)
        self.coef_samples_ = shaped(coefs, axis=1)
        self.intercept_samples_ = shaped(intercepts, axis=1)
        self.alpha_ = np.array(alphas) if several else alphas[0]
        self.coef_ = shaped(np.array([coef for coef, _ in fits], dtype=X.dtype))
        constants = shaped(np.array([constant for _, constant in fits], dtype=X.dtype))
        self.intercept_ = constants if self.fit_intercept else 0.0
        return self

    def get_support(self, indices: bool = False) -> Any:
        """The selected features.

        Parameters
        ----------
        indices : bool, default=False
            Return indices instead of a mask.

        Returns
        -------
        ndarray of bool of shape (n_features,) or (n_targets, n_features)
            Mask of the selected features; with `indices` their indices (n_kept,), for several targets a list of
            these.
        """
        check_is_fitted(self)
        if not indices:
            return self.support_
        supports = [np.flatnonzero(row) for row in np.atleast_2d(self.support_)]
        return supports if self.support_.ndim > 1 else supports[0]

    def resampling_counts(self) -> NDArray[np.float64]:
        """Counts of draws of every row in every replicate (n_estimators, n_samples).

        Used as row weights, one row of the result reproduces a replicate.
        """
        check_is_fitted(self)
        if self.bootstrap == "rows":
            return _core.row_counts(self._seed, self._lengths, int(self.n_estimators))
        counts = _core.unit_counts(self._seed, len(self._lengths), int(self.n_estimators))
        return np.repeat(counts, self._lengths, axis=1)

    def _units(self, rows: int, groups: Any) -> list[int]:
        """Rows of every unit of the resampling."""
        if self.bootstrap != "groups":
            if groups is not None:
                drawn = f'bootstrap="{self.bootstrap}"'
                raise ValueError(f'groups are given, and {drawn} does not draw them: set bootstrap="groups"')
            if self.bootstrap == "rows":
                return [rows]
            default = max(int(np.ceil(np.cbrt(rows))), -(-rows // _BLOCKS))
            length = min(rows, default if self.block_length is None else int(self.block_length))
            return [min(length, rows - first) for first in range(0, rows, length)]
        if groups is None:
            raise ValueError('bootstrap="groups" draws whole groups: give fit the group of every row as `groups`')
        labels = np.asarray(groups)
        if labels.shape != (rows,):
            raise ValueError(f"groups has the shape {labels.shape}: give one label a row, ({rows},)")
        starts = np.flatnonzero(np.concatenate([[True], labels[1:] != labels[:-1]]))
        if len(np.unique(labels)) != len(starts):
            raise ValueError("the rows of a group are not neighbours: sort X, y and groups by group")
        return [int(length) for length in np.diff(np.append(starts, rows))]

    def _alphas(self, problems: _core.Problems, targets: int) -> list[float]:
        """The penalty of every target."""
        if isinstance(self.alpha, str):
            return [problems.criterion_alpha(k, self.positive, self.alpha) for k in range(targets)]
        given = np.asarray(self.alpha, dtype=np.float64).reshape(-1)
        if np.ndim(self.alpha) and len(given) != targets:
            raise ParameterError(f"alpha has {len(given)} values for {targets} targets: give one, or one a target")
        if not (np.isfinite(given) & (given >= 0.0)).all():
            raise ParameterError(f"alpha is {self.alpha!r}: penalties are 0 or more")
        return [float(value) for value in np.broadcast_to(given, (targets,))]
