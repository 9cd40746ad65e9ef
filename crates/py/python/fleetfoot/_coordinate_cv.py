"""The strength of the lasso and the elastic net by cross-validation: all folds from one pass over the rows."""

from __future__ import annotations

import importlib
import warnings
from numbers import Integral, Real
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from . import _core
from ._base import HAS_SKLEARN, ConvergenceWarning, check_finite, check_xy
from ._coordinate_descent import enet_path, lasso_path
from ._descent import Posed, given_gram, grid, largest_alpha
from ._folds import FoldDesigns, cross_validation
from ._linear import LinearModel, as_precise, row_weights
from ._params import (
    ARRAY,
    BOOLEAN,
    CV,
    NONE,
    RANDOM_STATE,
    VERBOSE,
    Rule,
    check_params,
    integer,
    one_of,
    real,
)
from .exceptions import ParameterError

__all__ = ["ElasticNetCV", "LassoCV"]

_Fitted = TypeVar("_Fitted", bound="PathCV")


class PathCV(LinearModel):
    """Shared code: held-out errors on a grid of alphas, and a fit of all rows at the best one."""

    _rules: dict[str, tuple[Rule, ...]] = {
        "eps": (real(0, closed="neither"),),
        "alphas": (integer(1), ARRAY),
        "fit_intercept": (BOOLEAN,),
        "precompute": (one_of("auto"), BOOLEAN, ARRAY),
        "max_iter": (integer(1),),
        "tol": (real(0),),
        "copy_X": (BOOLEAN,),
        "cv": (CV,),
        "verbose": (VERBOSE,),
        "n_jobs": (integer(), NONE),
        "positive": (BOOLEAN,),
        "random_state": (RANDOM_STATE,),
        "selection": (one_of("cyclic", "random"),),
    }

    precompute: Any
    _sparse = True

    alpha_: float
    alphas_: NDArray[np.float64]
    mse_path_: NDArray[np.float64]
    dual_gap_: Any
    n_iter_: int

    def __init__(
        self,
        eps: float,
        alphas: Any,
        fit_intercept: bool,
        max_iter: int,
        tol: float,
        cv: Any,
        n_jobs: int | None,
        positive: bool,
    ) -> None:
        self.eps = eps
        self.alphas = alphas
        self.fit_intercept = fit_intercept
        self.max_iter = max_iter
        self.tol = tol
        self.cv = cv
        self.n_jobs = n_jobs
        self.positive = positive

    def _accept(self, precompute: Any, copy_X: bool, verbose: bool | int, random_state: Any, selection: str) -> None:
        """Checks arguments of scikit-learn's classes that have no effect."""
        self.precompute = precompute
        self.copy_X = copy_X
        self.verbose = verbose
        self.random_state = random_state
        self.selection = selection

    def _ratios(self) -> list[float]:
        return [1.0]

    def _estimator(self, ratio: float, features: int) -> _core.Estimator:
        """The estimator with this share of the l1 penalty."""
        return _core.Estimator.elastic_net(ratio, self.max_iter)

    def _largest(self, whole: Posed, ratio: float, features: int) -> float:
        return largest_alpha(whole.problems, ratio, self.positive)

    def fit(self: _Fitted, X: Any, y: Any, sample_weight: Any = None, **params: Any) -> _Fitted:
        """Chooses alpha by cross-validation, and fits all rows with it.

        Parameters
        ----------
        X : array-like or sparse matrix of shape (n_samples, n_features)
            Regressors, in any memory order. Sparse rows are read block by block, and never made dense as a whole if
            there are more rows than features.
        y : array-like of shape (n_samples,)
            Target.
        sample_weight : float or array-like of shape (n_samples,), optional
            Weights of the rows in fits and held-out errors; the mean over the folds is not weighted.
        **params
            For ``cv.split``, with scikit-learn's metadata routing enabled.

        Returns
        -------
        self

        Raises
        ------
        ValueError
            A parameter is out of range, the data are not finite or their shapes differ, or a fold has no rows on one
            side.
        """
        if params and not _routing():
            raise ValueError(
                f"{', '.join(sorted(params))} of {type(self).__name__}.fit is only supported if "
                "enable_metadata_routing=True, see sklearn.set_config"
            )
        check_params(self, self._rules)
        given = None if isinstance(self.alphas, Integral) else _checked(self.alphas)
        X, y = check_xy(self, X, y, finite=not isinstance(self.precompute, (bool, np.bool_, str)), sparse=True)
        y, weight = as_precise(y, X), row_weights(sample_weight, len(y))
        given_gram(X, weight, self.precompute, intercept=self.fit_intercept, check=True)
        ratios = self._ratios()
        design, folds = cross_validation(X, y, self.cv, weight, **params)
        if design is None:
            design = _core.Design(X, y, weight)
        if weight is not None or not design.seen_finite:
            # Rows without weight leave no trace in the sums.
            check_finite(self, X)
        whole = self._whole(design)
        estimators = [self._estimator(ratio, X.shape[1]) for ratio in ratios]
        alphas = [self._grid(whole, ratio, X.shape[1]) if given is None else given for ratio in ratios]
        kept = None if X.shape[0] <= X.shape[1] else whole
        # Rows that stay rows are as large as X: they are made again sooner than kept beside those of the folds.
        del whole
        errors = [self._errors(folds, grid, estimator) for grid, estimator in zip(alphas, estimators)]
        self.mse_path_ = np.squeeze(np.array(errors))
        self.alphas_ = np.array(alphas) if given is None and len(ratios) > 1 else alphas[0]
        means = [of_ratio.mean(axis=1) for of_ratio in errors]
        best = int(np.argmin([mean.min() for mean in means]))
        self.alpha_ = float(alphas[best][int(np.argmin(means[best]))])
        self._refit(self._whole(design) if kept is None else kept, ratios[best], estimators[best], X.dtype)
        return self

    def _whole(self, design: _core.Design) -> Posed:
        """The problem of all rows."""
        return Posed(_core.Problems.of(design, None, self.fit_intercept), None, None)

    def _grid(self, whole: Posed, ratio: float, features: int) -> NDArray[np.float64]:
        return grid(self._largest(whole, ratio, features), self.eps, int(self.alphas))

    def _errors(
        self, folds: FoldDesigns, alphas: NDArray[np.float64], estimator: _core.Estimator
    ) -> NDArray[np.float64]:
        """Mean squared errors on the held-out rows (n_alphas, n_folds)."""
        distinct, place = np.unique(-alphas, return_inverse=True)
        errors, inexact = _core.fold_errors(
            folds.folds, -distinct, self.fit_intercept, estimator, self.positive
        )
        if inexact:
            worst = -distinct[inexact]
            warnings.warn(
                f"Objective did not converge in some fold at {len(worst)} of {len(distinct)} alphas, the largest "
                f"{worst.max():.6g}. You might want to increase the number of iterations, max_iter = {self.max_iter}, "
                "or the smallest alpha",
                ConvergenceWarning,
                stacklevel=3,
            )
        fold_errors: NDArray[np.float64] = errors[place]
        return fold_errors

    def _refit(self, whole: Posed, ratio: float, estimator: _core.Estimator, dtype: Any) -> None:
        solved = whole.solve(
            0, [self.alpha_], estimator=estimator, positive=self.positive, max_iter=self.max_iter, tol=self.tol
        )
        self.coef_ = np.asarray(solved.coefs[0], dtype=dtype)
        self.intercept_ = dtype.type(solved.intercepts[0]) if self.fit_intercept else 0.0
        self.dual_gap_ = dtype.type(solved.gaps[0])
        self.n_iter_ = solved.sweeps[0]


def _routing() -> bool:
    if not HAS_SKLEARN:
        return False
    config: dict[str, Any] = importlib.import_module("sklearn").get_config()
    return bool(config.get("enable_metadata_routing", False))


def _checked(alphas: Any) -> NDArray[np.float64]:
    """Given alphas, descending."""
    for index, alpha in enumerate(alphas):
        if not isinstance(alpha, Real):
            raise ParameterError(f"alphas[{index}] must be an instance of float, not {type(alpha).__name__}.")
        if not 0.0 <= float(alpha) < np.inf:
            raise ParameterError(f"alphas[{index}] == {alpha}, must be >= 0.0.")
    ordered = np.sort(np.asarray(alphas, dtype=np.float64))[::-1]
    if ordered.size == 0:
        raise ParameterError("alphas is empty: give at least one, or their number")
    return ordered


class SharesCV(PathCV):
    """Cross-validation over several shares of the l1 penalty."""

    l1_ratio: Any
    l1_ratio_: float

    def _ratios(self) -> list[float]:
        ratios = [float(ratio) for ratio in np.atleast_1d(self.l1_ratio)]
        if not ratios or not all(0.0 <= ratio <= 1.0 for ratio in ratios):
            raise ParameterError(f"l1_ratio is {self.l1_ratio!r}: every share lies in [0, 1]")
        return ratios

    def _refit(self, whole: Posed, ratio: float, estimator: _core.Estimator, dtype: Any) -> None:
        super()._refit(whole, ratio, estimator, dtype)
        self.l1_ratio_ = ratio


class LassoCV(PathCV):
    """The lasso with its strength chosen by cross-validation, as scikit-learn's class of this name.

    Statistics of the rows give the folds' problems and held-out errors. If every row is held out once, one pass over
    X serves all folds, and every fold follows its exact path.

    Parameters
    ----------
    eps : float, default=1e-3
        Ratio of the smallest to the largest alpha of the grid.
    alphas : int or array-like of shape (n_alphas,), default=100
        The alphas, or the number of points of a logarithmic grid. The grid descends from the least alpha at which all
        coefficients are zero.
    fit_intercept : bool, default=True
        Fit an intercept, which is not penalised.
    precompute : "auto", bool or array-like of shape (n_features, n_features), default="auto"
        Accepted without effect; a given Gram matrix is checked. Folds need the rows.
    max_iter : int, default=1000
        Largest number of sweeps per alpha.
    tol : float, default=1e-4
        As for :class:`ElasticNet`.
    copy_X : bool, default=True
        Accepted without effect: X is never copied or written.
    cv : int, splitter, iterable of (train, test) or None, default=None
        Folds; None means five spans of neighbouring rows.
    verbose : bool or int, default=False
        Accepted without effect: nothing is printed.
    n_jobs : int or None, default=None
        Accepted without effect; see :func:`set_threads`.
    positive : bool, default=False
        Restrict the coefficients to be non-negative.
    random_state, selection
        Accepted without effect: nothing is random.

    Attributes
    ----------
    alpha_ : float
        The alpha with the least mean error over the folds.
    alphas_ : ndarray of shape (n_alphas,)
        The compared alphas, descending.
    mse_path_ : ndarray of shape (n_alphas, n_folds)
        Mean squared errors on the held-out rows, in the units of the target's square.
    coef_ : ndarray of shape (n_features,)
        Coefficients of the fit to all rows.
    intercept_ : float
        Its intercept.
    dual_gap_ : float
        Upper bound on its objective minus the minimum.
    n_iter_ : int
        Its sweeps.
    n_features_in_ : int
        Number of features.
    feature_names_in_ : ndarray of shape (n_features,)
        Names of the features, if X has names.

    See Also
    --------
    LassoLarsCV : On the knots of the paths instead of a grid.

    Examples
    --------
    >>> import numpy as np
    >>> import fleetfoot as ff
    >>> X = np.arange(40.0).reshape(20, 2) % 7
    >>> model = ff.LassoCV(cv=4).fit(X, X @ [3.0, 0.0] + 1.0)
    >>> model.coef_.round(1) + 0.0
    array([3., 0.])
    >>> model.mse_path_.shape
    (100, 4)
    """

    path = staticmethod(lasso_path)

    def __init__(
        self,
        *,
        eps: float = 1e-3,
        alphas: Any = 100,
        fit_intercept: bool = True,
        precompute: Any = "auto",
        max_iter: int = 1000,
        tol: float = 1e-4,
        copy_X: bool = True,
        cv: Any = None,
        verbose: bool | int = False,
        n_jobs: int | None = None,
        positive: bool = False,
        random_state: Any = None,
        selection: str = "cyclic",
    ) -> None:
        super().__init__(eps, alphas, fit_intercept, max_iter, tol, cv, n_jobs, positive)
        self._accept(precompute, copy_X, verbose, random_state, selection)


class ElasticNetCV(SharesCV):
    """The elastic net, its strength and its l1 share chosen by cross-validation, as scikit-learn's class of this name.

    Parameters
    ----------
    l1_ratio : float in [0, 1] or list of them, default=0.5
        Share of the l1 penalty, or list of shares to compare.
    eps, alphas, fit_intercept, precompute, max_iter, tol, cv, copy_X, verbose, n_jobs, positive, random_state, selection
        As for :class:`LassoCV`.

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
    coef_, intercept_, dual_gap_, n_iter_
        As for :class:`LassoCV`, with ``n_features_in_`` and ``feature_names_in_``.

    Examples
    --------
    >>> import numpy as np
    >>> import fleetfoot as ff
    >>> X = np.arange(40.0).reshape(20, 2) % 7
    >>> model = ff.ElasticNetCV(l1_ratio=[0.5, 0.9], alphas=5, cv=4).fit(X, X @ [3.0, 0.0] + 1.0)
    >>> model.l1_ratio_, model.mse_path_.shape
    (0.9, (2, 5, 4))
    """

    path = staticmethod(enet_path)

    _rules = {**PathCV._rules, "l1_ratio": (real(0, 1, "both"), ARRAY)}

    def __init__(
        self,
        *,
        l1_ratio: Any = 0.5,
        eps: float = 1e-3,
        alphas: Any = 100,
        fit_intercept: bool = True,
        precompute: Any = "auto",
        max_iter: int = 1000,
        tol: float = 1e-4,
        cv: Any = None,
        copy_X: bool = True,
        verbose: bool | int = 0,
        n_jobs: int | None = None,
        positive: bool = False,
        random_state: Any = None,
        selection: str = "cyclic",
    ) -> None:
        super().__init__(eps, alphas, fit_intercept, max_iter, tol, cv, n_jobs, positive)
        self._accept(precompute, copy_X, verbose, random_state, selection)
        self.l1_ratio = l1_ratio
