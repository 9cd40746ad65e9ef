"""Least angle regression as estimators: `Lars` and `LassoLars`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ._base import MultiOutputMixin, check_xy, is_sparse, random_numbers
from ._core import Design, LarsPath, lars_paths
from ._lars import EPS, STEPS, LarsRequest, centred_paths, check_eps, known_gram, path_request, takes_few, tell
from ._linear import LinearModel
from ._params import ARRAY, BOOLEAN, NONE, RANDOM_STATE, VERBOSE, Rule, check_params, one_of, real

__all__ = ["Lars", "LassoLars"]

if TYPE_CHECKING:
    from typing_extensions import Self

COMMON_RULES: dict[str, tuple[Rule, ...]] = {
    "fit_intercept": (BOOLEAN,),
    "verbose": (VERBOSE,),
    "precompute": (BOOLEAN, one_of("auto"), ARRAY, NONE),
    "eps": (real(0.0),),
    "copy_X": (BOOLEAN,),
}


class LarsModel(LinearModel):
    """Shared code of the estimators of least angle regression: a path, and the model at its end."""

    method = "lasso"
    positive = False
    _sparse = True

    alphas_: Any
    active_: Any
    coef_path_: Any
    n_iter_: Any

    def __init__(self, fit_intercept: bool, verbose: int | bool, precompute: Any, eps: float, copy_X: bool) -> None:
        self.fit_intercept = fit_intercept
        self.verbose = verbose
        self.precompute = precompute
        self.eps = eps
        self.copy_X = copy_X

    def _request(self, alpha_min: float, max_iter: float) -> LarsRequest:
        check_eps(type(self).__name__, self.eps)
        return path_request(self.method, self.positive, alpha_min, max_iter)

    def _keep(self, X: NDArray[Any], y: NDArray[Any], paths: list[LarsPath], fit_path: bool) -> None:
        """Sets the fitted attributes: values for one target, lists for several."""
        dtype = X.dtype
        for path in paths:
            tell(path, max(0, int(self.verbose) - 1))
        alphas = [path.alphas.astype(dtype, copy=False) for path in paths]
        coefs = [path.coefficients.astype(dtype, copy=False) for path in paths]
        steps = [len(knots) - 1 for knots in alphas]
        active = [path.active for path in paths]
        one = len(paths) == 1
        self.n_iter_ = steps[0] if one else steps
        ends = [knots[-1:] for knots in alphas]
        if fit_path:
            self.alphas_ = alphas[0] if one else alphas
            self.active_ = active[0] if one else active
            self.coef_path_ = coefs[0].T if one else [path.T for path in coefs]
        else:
            self.alphas_ = ends[0] if one else ends
        # As in scikit-learn, one target is a vector where the path is kept, and a matrix of one row where it is not.
        flat = one and fit_path
        self.coef_ = coefs[0][-1].copy() if flat else np.stack([path[-1] for path in coefs])
        self._set_ends(X, y, [path.intercepts[-1] for path in paths])

    def _set_ends(self, X: NDArray[Any], y: NDArray[Any], intercepts: list[Any]) -> None:
        """The intercepts at the ends of the paths, in the shape of the coefficients."""
        self._set_intercepts(intercepts, X.dtype, single=y.ndim == 1 and self.coef_.ndim == 1)


class Lars(MultiOutputMixin, LarsModel):
    """Least angle regression: columns enter one after the other, and none leaves.

    Parameters
    ----------
    fit_intercept : bool, default=True
        Fit an intercept without penalty.
    verbose : bool or int, default=False
        Print the steps for values above 1.
    precompute : bool, 'auto' or array of shape (n_features, n_features), default='auto'
        The Gram matrix of the regressors (centred, with an intercept), if known: the path then has the accuracy of
        the products. With any other value the engine compresses the rows.
    n_nonzero_coefs : int, default=500
        Largest number of steps, and so of coefficients; `np.inf` for no limit.
    eps : float, default=np.finfo(float).eps
        Accepted for compatibility: another value is a `NotImplementedError` (see :func:`lars_path`).
    copy_X : bool, default=True
        Accepted without effect: X is never copied as a whole or written.
    fit_path : bool, default=True
        Keep the whole path.
    jitter : float, optional
        Upper bound of uniform noise that is added to the target, which breaks ties.
    random_state : int, RandomState or Generator, optional
        Random numbers of the noise.

    Attributes
    ----------
    alphas_ : ndarray of shape (n_alphas + 1,), or a list of them for several targets
        Penalty at the knots, descending; the last one alone (1,) without `fit_path`.
    active_ : list of int, or a list of them
        Active columns at the end, in their order of entry.
    coef_path_ : ndarray of shape (n_features, n_alphas + 1), or a list of them
        Coefficients at the knots.
    coef_ : ndarray of shape (n_features,) or (n_targets, n_features)
        Coefficients at the end.
    intercept_ : float or ndarray of shape (n_targets,)
        Intercept.
    n_iter_ : int or list of int
        Number of steps.
    n_features_in_ : int
        Number of features.
    feature_names_in_ : ndarray of shape ``(n_features_in_,)``
        Names of the features, if X has names.

    Examples
    --------
    >>> import fleetfoot as ff
    >>> model = ff.Lars(n_nonzero_coefs=1).fit([[-1.0, 1.0], [0.0, 0.0], [1.0, 1.0]], [-1.1111, 0.0, -1.1111])
    >>> model.coef_.round(4).tolist()
    [0.0, -1.1111]
    """

    method = "lar"

    def __init__(
        self,
        *,
        fit_intercept: bool = True,
        verbose: int | bool = False,
        precompute: Any = "auto",
        n_nonzero_coefs: float = 500,
        eps: float = EPS,
        copy_X: bool = True,
        fit_path: bool = True,
        jitter: float | None = None,
        random_state: Any = None,
    ) -> None:
        super().__init__(fit_intercept, verbose, precompute, eps, copy_X)
        self.n_nonzero_coefs = n_nonzero_coefs
        self.fit_path = fit_path
        self.jitter = jitter
        self.random_state = random_state

    def _rules(self) -> dict[str, tuple[Rule, ...]]:
        steps = Rule("an int >= 1 or np.inf", lambda v: STEPS.holds(v) and v >= 1)
        rules = {"fit_path": (BOOLEAN,), "jitter": (real(0.0), NONE), "random_state": (RANDOM_STATE,)}
        return {**COMMON_RULES, **rules, "n_nonzero_coefs": (steps,)}

    def _end(self) -> tuple[float, float]:
        """End of the path: alpha, and the number of steps."""
        return 0.0, self.n_nonzero_coefs

    def fit(self, X: Any, y: Any, Xy: Any = None) -> Self:
        """Fits.

        Parameters
        ----------
        X : array-like or sparse matrix of shape (n_samples, n_features)
            Regressors.
        y : array-like of shape (n_samples,) or (n_samples, n_targets)
            Targets.
        Xy : array-like of shape (n_features,) or (n_features, n_targets), optional
            ``X.T @ y`` (of centred columns, with an intercept), if known.

        Returns
        -------
        self
        """
        check_params(self, self._rules())
        request = self._request(*self._end())
        X, y = check_xy(self, X, y, multi_output=True, sparse=True)
        if self.jitter is not None:
            noise = random_numbers(self.random_state).uniform(high=self.jitter, size=len(y))
            y = y + (noise if y.ndim == 1 else noise[:, np.newaxis])
        gram = known_gram(self.precompute)
        # Of sparse rows the products are always summed anew.
        if (gram is None and Xy is None) or is_sparse(X):
            design = Design(X, y, few=takes_few(request, X.shape[1]))
            paths = lars_paths(design, None, self.fit_intercept, request)
            self._keep(X, y, paths, self.fit_path)
            return self
        known = centred_paths(X, y, gram, Xy, self.fit_intercept, request)
        self._keep(X, y, [path for path, _ in known], self.fit_path)
        self._set_ends(X, y, [intercepts[-1] for _, intercepts in known])
        return self


class LassoLars(Lars):
    """The lasso by least angle regression: ``1 / (2 n_samples) * |y - X w - b|^2 + alpha * |w|_1``.

    Parameters
    ----------
    alpha : float, default=1.0
        Penalty, in the units of the target times those of the regressors.
    fit_intercept, verbose, precompute, eps, copy_X, fit_path, jitter, random_state
        As in :class:`Lars`.
    max_iter : int, default=500
        Largest number of steps.
    positive : bool, default=False
        Restrict the coefficients to be non-negative.

    Attributes
    ----------
    alphas_, active_, coef_path_, coef_, intercept_, n_iter_, n_features_in_, feature_names_in_
        As in :class:`Lars`.

    Examples
    --------
    >>> import fleetfoot as ff
    >>> model = ff.LassoLars(alpha=0.01).fit([[-1.0, 1.0], [0.0, 0.0], [1.0, 1.0]], [-1.0, 0.0, -1.0])
    >>> model.coef_.round(3).tolist()
    [0.0, -0.955]
    """

    method = "lasso"

    def __init__(
        self,
        alpha: float = 1.0,
        *,
        fit_intercept: bool = True,
        verbose: int | bool = False,
        precompute: Any = "auto",
        max_iter: float = 500,
        eps: float = EPS,
        copy_X: bool = True,
        fit_path: bool = True,
        positive: bool = False,
        jitter: float | None = None,
        random_state: Any = None,
    ) -> None:
        LarsModel.__init__(self, fit_intercept, verbose, precompute, eps, copy_X)
        self.alpha = alpha
        self.max_iter = max_iter
        self.fit_path = fit_path
        self.positive = positive
        self.jitter = jitter
        self.random_state = random_state

    def _rules(self) -> dict[str, tuple[Rule, ...]]:
        rules: dict[str, tuple[Rule, ...]] = {"alpha": (real(0.0),), "max_iter": (STEPS,), "positive": (BOOLEAN,)}
        path = {"fit_path": (BOOLEAN,), "jitter": (real(0.0), NONE), "random_state": (RANDOM_STATE,)}
        return {**COMMON_RULES, **path, **rules}

    def _end(self) -> tuple[float, float]:
        return self.alpha, self.max_iter
