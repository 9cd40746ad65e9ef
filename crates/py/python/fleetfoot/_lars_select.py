"""The lasso with a chosen penalty: `LassoLarsCV` by cross-validation, `LassoLarsIC` by an information criterion."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ._base import check_finite, check_xy, is_sparse
from ._core import Design, LarsPath, lars_fold_errors, lars_paths
from ._folds import cross_validation, fold_params, fold_router
from ._lars import EPS, STEPS, LarsRequest, centred_paths, known_gram
from ._lars_models import COMMON_RULES, LarsModel
from ._params import BOOLEAN, CV, NONE, Rule, check_params, integer, one_of, real
from .exceptions import FitError

if TYPE_CHECKING:
    from typing_extensions import Self

__all__ = ["LassoLarsCV", "LassoLarsIC"]


class LassoLarsCV(LarsModel):
    """The lasso by least angle regression, its penalty chosen by cross-validation.

    Every fold follows its path with exact knots, and the held-out error is known between them. All folds share one
    pass over the rows: the products of a fold's training rows are the sum of those of the other folds.

    Parameters
    ----------
    fit_intercept : bool, default=True
        Fit an intercept without penalty.
    verbose : bool or int, default=False
        More than 1 prints the steps of the last fit.
    max_iter : int, default=500
        Largest number of steps of every path.
    precompute : bool or 'auto', default='auto'
        Accepted without effect: the engine compresses the rows.
    cv : int, splitter or iterable of (train, test), optional
        Folds; a number means spans of neighbouring rows, and `None` five of them.
    max_n_alphas : int, default=1000
        Approximate number of the folds' knots to compare.
    n_jobs : int, optional
        Accepted without effect; see :func:`set_threads`.
    eps : float, default=np.finfo(float).eps
        Accepted for compatibility: another value is a `NotImplementedError` (see :func:`lars_path`).
    copy_X : bool, default=True
        Accepted without effect: X is never copied as a whole or written.
    positive : bool, default=False
        Restrict the coefficients to be non-negative.

    Attributes
    ----------
    alpha_ : float
        The chosen penalty.
    cv_alphas_ : ndarray of shape (n_cv_alphas,)
        The compared penalties, ascending: knots of the folds' paths.
    mse_path_ : ndarray of shape (n_cv_alphas, n_folds)
        Mean squared error of every fold on its held-out rows.
    alphas_, active_, coef_path_, coef_, intercept_, n_iter_, n_features_in_, feature_names_in_
        Of the path on all rows down to `alpha_`, as in :class:`LassoLars`.

    Examples
    --------
    >>> import numpy as np
    >>> import fleetfoot as ff
    >>> t = np.linspace(0.0, 6.0, 60)
    >>> X = np.column_stack([np.sin(t), np.cos(3 * t), np.sin(5 * t)])
    >>> y = 2.0 * X[:, 0] + 0.01 * np.sin(40 * t)
    >>> model = ff.LassoLarsCV(cv=4).fit(X, y)
    >>> model.mse_path_.shape == (len(model.cv_alphas_), 4)
    True
    >>> round(float(model.score(X, y)), 3)
    1.0
    """

    method = "lasso"

    def __init__(
        self,
        *,
        fit_intercept: bool = True,
        verbose: int | bool = False,
        max_iter: float = 500,
        precompute: Any = "auto",
        cv: Any = None,
        max_n_alphas: int = 1000,
        n_jobs: int | None = None,
        eps: float = EPS,
        copy_X: bool = True,
        positive: bool = False,
    ) -> None:
        super().__init__(fit_intercept, verbose, precompute, eps, copy_X)
        self.max_iter = max_iter
        self.cv = cv
        self.max_n_alphas = max_n_alphas
        self.n_jobs = n_jobs
        self.positive = positive

    def fit(self, X: Any, y: Any, **params: Any) -> Self:
        """Fits.

        Parameters
        ----------
        X : array-like or sparse matrix of shape (n_samples, n_features)
            Regressors.
        y : array-like of shape (n_samples,)
            Target.
        **params
            For the splitter (`groups`), with scikit-learn's metadata routing.

        Returns
        -------
        self
        """
        rules: dict[str, tuple[Rule, ...]] = {
            **COMMON_RULES,
            "max_iter": (STEPS,),
            "cv": (CV,),
            "max_n_alphas": (integer(1),),
            "n_jobs": (integer(), NONE),
            "positive": (BOOLEAN,),
        }
        check_params(self, rules)
        routed = fold_params(self, params)
        if known_gram(self.precompute) is not None:
            warnings.warn(
                "precompute of LassoLarsCV is a matrix, and every fold has another one: taken for 'auto'",
                UserWarning,
                stacklevel=2,
            )
        request = self._request(0.0, self.max_iter)
        X, y = check_xy(self, X, y, finite=False, sparse=True)
        design, folds = cross_validation(X, y, self.cv, **routed)
        if design is None or not design.seen_finite:
            check_finite(self, X)
        alphas, errors = lars_fold_errors(folds.folds, self.fit_intercept, request, self.max_n_alphas)
        known = np.isfinite(errors).all(axis=1)
        alphas, errors = alphas[known], errors[known]
        best = int(np.argmin(errors.mean(axis=1)))
        self.alpha_ = float(alphas[best])
        self.cv_alphas_, self.mse_path_ = alphas, errors
        request = self._request(self.alpha_, self.max_iter)
        self._keep(X, y, lars_paths(design or Design(X, y), None, self.fit_intercept, request), True)
        return self

    def get_metadata_routing(self) -> Any:
        """Routing of extra arguments of `fit` to the splitter (scikit-learn's metadata routing)."""
        return fold_router(self)


class LassoLarsIC(LarsModel):
    """The lasso by least angle regression, its penalty chosen by Akaike's or the Bayesian information criterion.

    At every knot, with df the number of non-zero coefficients (Zou, Hastie and Tibshirani 2007) and v the noise
    variance: ``n log(2 pi v) + rss / v + c df``, where c is 2 ("aic") or log n ("bic").

    Parameters
    ----------
    criterion : {'aic', 'bic'}, default='aic'
        The criterion.
    fit_intercept, verbose, precompute, eps, copy_X, positive
        As in :class:`LassoLars`.
    max_iter : int, default=500
        Largest number of steps.
    noise_variance : float, optional
        Variance of the noise; `None` takes that of least squares on all columns (non-negative ones with `positive`),
        ``rss / (n - p - 1)``.

    Attributes
    ----------
    alpha_ : float
        The chosen penalty.
    alphas_ : ndarray of shape (n_alphas + 1,)
        Penalty at the knots, descending.
    criterion_ : ndarray of shape (n_alphas + 1,)
        The criterion there.
    noise_variance_ : float
        The noise variance.
    coef_, intercept_, n_iter_, n_features_in_, feature_names_in_
        Of the chosen knot, as in :class:`LassoLars`; `n_iter_` counts the steps of the whole path.

    Examples
    --------
    >>> import fleetfoot as ff
    >>> X = [[-2.0, 2.0], [-1.0, 1.0], [0.0, 0.0], [1.0, 1.0], [2.0, 2.0]]
    >>> model = ff.LassoLarsIC(criterion="bic").fit(X, [-2.2222, -1.1111, 0.0, -1.1111, -2.2222])
    >>> model.coef_.round(2).tolist()
    [0.0, -1.11]
    """

    method = "lasso"

    def __init__(
        self,
        criterion: str = "aic",
        *,
        fit_intercept: bool = True,
        verbose: int | bool = False,
        precompute: Any = "auto",
        max_iter: float = 500,
        eps: float = EPS,
        copy_X: bool = True,
        positive: bool = False,
        noise_variance: float | None = None,
    ) -> None:
        super().__init__(fit_intercept, verbose, precompute, eps, copy_X)
        self.criterion = criterion
        self.max_iter = max_iter
        self.positive = positive
        self.noise_variance = noise_variance

    def fit(self, X: Any, y: Any, copy_X: bool | None = None) -> Self:
        """Fits.

        Parameters
        ----------
        X : array-like or sparse matrix of shape (n_samples, n_features)
            Regressors.
        y : array-like of shape (n_samples,)
            Target.
        copy_X : bool, optional
            Accepted without effect: X is never copied as a whole or written.

        Returns
        -------
        self
        """
        rules: dict[str, tuple[Rule, ...]] = {
            **COMMON_RULES,
            "max_iter": (STEPS,),
            "positive": (BOOLEAN,),
            "criterion": (one_of("aic", "bic"),),
            "noise_variance": (real(0.0), NONE),
        }
        check_params(self, rules)
        request = self._request(0.0, self.max_iter)
        X, y = check_xy(self, X, y, sparse=True)
        rows, features = X.shape
        if self.noise_variance is None and rows <= features + self.fit_intercept:
            raise ValueError(
                "You are using LassoLarsIC in the case where the number of samples is smaller than the number of "
                f"features (n_samples={rows}, n_features={features}): least squares leaves nothing to estimate the "
                "noise from; give noise_variance"
            )
        design = Design(X, y)
        path, intercepts, mse = self._path(design, X, y, request)
        self._keep(X, y, [path], True)
        if self.noise_variance is None:
            self.noise_variance_ = self._least_squares(design, path) / (rows - features - self.fit_intercept)
        else:
            self.noise_variance_ = float(self.noise_variance)
        knots = self.coef_path_.T
        nonzero = (np.abs(knots) > np.finfo(knots.dtype).eps).sum(axis=1)
        factor = 2.0 if self.criterion == "aic" else float(np.log(rows))
        # Without noise the least error wins.
        noise = max(self.noise_variance_, float(np.finfo(np.float64).tiny))
        self.criterion_ = rows * np.log(2.0 * np.pi * noise) + rows * mse / noise + factor * nonzero
        best = int(np.argmin(self.criterion_))
        self.alpha_ = self.alphas_[best]
        self.coef_ = knots[best].copy()
        if self.fit_intercept:
            self.intercept_ = intercepts[best].astype(X.dtype)
        del self.coef_path_, self.active_
        return self

    def _path(
        self, design: Design, X: NDArray[Any], y: NDArray[Any], request: LarsRequest
    ) -> tuple[LarsPath, NDArray[np.float64], NDArray[np.float64]]:
        """The path, and the intercept and the mean squared error at its knots."""
        gram = known_gram(self.precompute)
        if gram is None or is_sparse(X):
            path = lars_paths(design, None, self.fit_intercept, request)[0]
            return path, path.intercepts, path.mse
        path, intercepts = centred_paths(X, y, gram, None, self.fit_intercept, request)[0]
        return path, intercepts, design.mean_squares(None, 0, path.coefficients.ravel(), intercepts)

    def _least_squares(self, design: Design, path: LarsPath) -> float:
        """Residual sum of squares of least squares on all columns: the end of the whole path."""
        if path.alphas[-1] > 0.0 or known_gram(self.precompute) is not None:
            path = lars_paths(design, None, self.fit_intercept, self._request(0.0, np.inf))[0]
        if path.alphas[-1] > 0.0:
            raise FitError(
                f"the noise variance of LassoLarsIC is not known: the path ends at alpha={path.alphas[-1]:.3e}, where "
                "nothing is left but rounding, and not at least squares; give noise_variance"
            )
        return float(path.mse[-1] * design.shape[0])
