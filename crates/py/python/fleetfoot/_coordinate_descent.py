"""The lasso and the elastic net at given strengths, and their paths, by coordinate descent."""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Callable
from numbers import Integral
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from . import _core
from ._arrays import numbers
from ._base import MultiOutputMixin, as_given, check_rows, check_xy
from ._descent import Posed, grid, largest_alpha, pose
from ._linear import LinearModel, as_precise, row_weights
from ._multi_task import TaskPath, Tasks
from ._params import ARRAY, BOOLEAN, NONE, RANDOM_STATE, VERBOSE, Rule, check_params, integer, one_of, real
from ._plain import as_target
from .exceptions import FitError

__all__ = ["ElasticNet", "Lasso", "enet_path", "lasso_path"]

_Fitted = TypeVar("_Fitted", bound="ElasticNet")

_PATH_RULES: dict[str, tuple[Rule, ...]] = {
    "l1_ratio": (real(0, 1, "both"),),
    "eps": (real(0, closed="neither"),),
    "n_alphas": (integer(1), one_of("deprecated")),
    "alphas": (integer(1), ARRAY, NONE, one_of("warn")),
    "precompute": (one_of("auto"), BOOLEAN, ARRAY),
    "Xy": (ARRAY, NONE),
    "copy_X": (BOOLEAN,),
    "coef_init": (ARRAY, NONE),
    "verbose": (VERBOSE,),
    "return_n_iter": (BOOLEAN,),
    "positive": (BOOLEAN,),
    "check_input": (BOOLEAN,),
}


def enet_path(
    X: Any,
    y: Any,
    *,
    l1_ratio: float = 0.5,
    eps: float = 1e-3,
    n_alphas: int | str = "deprecated",
    alphas: Any = "warn",
    precompute: Any = "auto",
    Xy: Any = None,
    copy_X: bool = True,
    coef_init: Any = None,
    verbose: bool | int = False,
    return_n_iter: bool = False,
    positive: bool = False,
    check_input: bool = True,
    **params: Any,
) -> Any:
    """Elastic net coefficients at many alphas, as scikit-learn's function of this name.

    Minimises ``1 / (2 n) |y - X w|^2 + alpha l1_ratio |w|_1 + alpha (1 - l1_ratio) / 2 |w|^2`` without an intercept,
    at every alpha in descending order, each from the previous solution. All solutions are exact up to rounding where
    the data determine them.

    Parameters
    ----------
    X : array-like or sparse matrix of shape (n_samples, n_features)
        Regressors; any order of memory, `float32` or `float64`. Read once, never copied or written.
    y : array-like of shape (n_samples,) or (n_samples, n_targets)
        Target. Several targets have one support: the penalty of a feature is the length of its coefficients, as in
        scikit-learn's multi-task classes.
    l1_ratio : float in [0, 1], default=0.5
        Share of the l1 penalty: 1 is the lasso, 0 is ridge.
    eps : float, default=1e-3
        Ratio of the smallest to the largest alpha of a grid.
    n_alphas : int, deprecated
        Number of alphas; give `alphas` instead.
    alphas : int or array-like of shape (n_alphas,), default=100
        The alphas, or the number of points of a logarithmic grid. The grid descends from the least alpha at which all
        coefficients are zero.
    precompute : "auto", bool or array-like of shape (n_features, n_features), default="auto"
        The Gram matrix ``X.T @ X`` if known. With any other value the engine chooses, which affects time only.
    Xy : array-like of shape (n_features,), optional
        ``X.T @ y``, used with a given Gram matrix.
    copy_X : bool, default=True
        Accepted without effect: X is never copied or written.
    coef_init : array-like of shape (n_features,) or (n_targets, n_features), optional
        Start of the first solution. It changes the number of sweeps, not the result.
    verbose : bool or int, default=False
        Accepted without effect: nothing is printed.
    return_n_iter : bool, default=False
        Return the numbers of sweeps.
    positive : bool, default=False
        Restrict the coefficients to be non-negative.
    check_input : bool, default=True
        Check X, y and a given Gram matrix.
    **params
        `max_iter` (default 1000: largest number of sweeps per alpha) and `tol` (default 1e-4: relative duality gap
        above which an inexact solution is a `ConvergenceWarning`; see :class:`ElasticNet`). `selection`,
        `random_state`, `do_screening`, `X_offset` and `X_scale` are accepted without effect.

    Returns
    -------
    alphas : ndarray of shape (n_alphas,)
        The alphas, descending.
    coefs : ndarray of shape (n_features, n_alphas) or (n_targets, n_features, n_alphas)
        Coefficients, with the precision of X.
    dual_gaps : ndarray of shape (n_alphas,)
        Upper bounds on the objective minus its minimum.
    n_iters : list of int
        Sweeps, with `return_n_iter`.

    Raises
    ------
    ValueError
        A parameter is out of range, or the shapes of X and y differ.

    Examples
    --------
    >>> import numpy as np
    >>> import fleetfoot as ff
    >>> X = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [2.0, 1.0]])
    >>> y = X @ [2.0, 0.5]
    >>> alphas, coefs, gaps = ff.enet_path(X, y, alphas=[1.0, 0.1])
    >>> alphas
    array([1. , 0.1])
    >>> coefs.shape
    (2, 2)
    """
    values = {name: value for name, value in locals().items() if name in _PATH_RULES}
    check_params("enet_path", _PATH_RULES, **values)
    wanted = _alphas(n_alphas, alphas)
    options = _solver_options("enet_path", params)
    if check_input:
        X = check_rows(X, "enet_path")
        y = as_target(y, multi_output=True)
        if len(y) != X.shape[0]:
            raise ValueError(f"X has {X.shape[0]} rows and y has {len(y)}: give one target a row")
    else:
        X, y = as_given(X), numbers(y, "y")
    if y.ndim != 1 and positive:
        raise ValueError("positive=True is not allowed for multi-output (y.ndim != 1)")
    y = as_precise(y, X)
    posed = pose(X, y, None, intercept=False, precompute=precompute, Xy=Xy, check_gram=check_input)
    if y.ndim != 1:
        alphas_, coefs, gaps, sweeps = _task_path(X, y, posed, l1_ratio, wanted, eps, coef_init, options)
        coefs = np.asarray(coefs, dtype=X.dtype)
        return (alphas_, coefs, gaps, sweeps) if return_n_iter else (alphas_, coefs, gaps)
    if isinstance(wanted, Integral):
        path_alphas = grid(largest_alpha(posed.problems, l1_ratio, positive), eps, int(wanted))
    else:
        path_alphas = _descending(wanted)
    options["estimator"] = _core.Estimator.elastic_net(l1_ratio, options["max_iter"])
    solved = posed.solve(0, path_alphas, positive=positive, start=_start(coef_init, X.shape[1]), **options)
    coefs = np.asarray(solved.coefs.T, dtype=X.dtype)
    if return_n_iter:
        return path_alphas, coefs, solved.gaps, solved.sweeps
    return path_alphas, coefs, solved.gaps


def _descending(alphas: Any) -> NDArray[np.float64]:
    ordered: NDArray[np.float64] = np.sort(np.asarray(alphas, dtype=np.float64).reshape(-1))[::-1]
    return ordered


def _task_path(
    X: Any,
    y: NDArray[Any],
    posed: Posed,
    l1_ratio: float,
    alphas: Any,
    eps: float,
    coef_init: Any,
    options: dict[str, Any],
) -> TaskPath:
    """The path of several targets."""
    shape = (y.shape[1], X.shape[1])
    start = None if coef_init is None else np.ascontiguousarray(coef_init, dtype=np.float64)
    if start is not None and start.shape != shape:
        raise ValueError(f"coef_init has the shape {start.shape}: give one value a target and feature, {shape}")
    wanted = int(alphas) if isinstance(alphas, Integral) else _descending(alphas)
    tasks = Tasks(X, y, posed, l1_ratio, options)
    return tasks.path(wanted, eps, None if start is None else start.reshape(-1))


def lasso_path(
    X: Any,
    y: Any,
    *,
    eps: float = 1e-3,
    n_alphas: int | str = "deprecated",
    alphas: Any = "warn",
    precompute: Any = "auto",
    Xy: Any = None,
    copy_X: bool = True,
    coef_init: Any = None,
    verbose: bool | int = False,
    return_n_iter: bool = False,
    positive: bool = False,
    **params: Any,
) -> Any:
    """Lasso coefficients at many alphas, as scikit-learn's function of this name.

    It is :func:`enet_path` with ``l1_ratio=1``. Minimises ``1 / (2 n) |y - X w|^2 + alpha |w|_1`` without an intercept. For all solutions at once, exactly, see
    :func:`lars_path`.

    Parameters
    ----------
    X : array-like or sparse matrix of shape (n_samples, n_features)
        Regressors.
    y : array-like of shape (n_samples,) or (n_samples, n_targets)
        Targets.
    eps, n_alphas, alphas, precompute, Xy, copy_X, coef_init, verbose, return_n_iter, positive, **params
        As for :func:`enet_path`.

    Returns
    -------
    alphas : ndarray of shape (n_alphas,)
        The alphas, descending.
    coefs : ndarray of shape (n_features, n_alphas) or (n_targets, n_features, n_alphas)
        Coefficients, with the precision of X.
    dual_gaps : ndarray of shape (n_alphas,)
        Upper bounds on the objective minus its minimum.
    n_iters : list of int
        Sweeps, with `return_n_iter`.

    Raises
    ------
    ValueError
        As :func:`enet_path`.

    Examples
    --------
    >>> import numpy as np
    >>> import fleetfoot as ff
    >>> alphas, coefs, gaps = ff.lasso_path(np.eye(4)[:, :2], [4.0, 2.0, 0.0, 0.0], alphas=[1.0, 0.5, 0.25])
    >>> coefs
    array([[0., 2., 3.],
           [0., 0., 1.]])
    """
    return enet_path(
        X,
        y,
        l1_ratio=1.0,
        eps=eps,
        n_alphas=n_alphas,
        alphas=alphas,
        precompute=precompute,
        Xy=Xy,
        copy_X=copy_X,
        coef_init=coef_init,
        verbose=verbose,
        return_n_iter=return_n_iter,
        positive=positive,
        **params,
    )


def _alphas(n_alphas: Any, alphas: Any) -> Any:
    """The alphas of the current and the deprecated parameter."""
    wanted = alphas
    if not isinstance(n_alphas, str):
        warnings.warn(
            "'n_alphas' was deprecated in 1.9 and will be removed in 1.11 of scikit-learn: give the number of alphas as "
            "`alphas`",
            FutureWarning,
            stacklevel=3,
        )
    count = 100 if isinstance(n_alphas, str) else n_alphas
    if alphas is None:
        warnings.warn(
            "'alphas=None' is deprecated and will be removed in 1.11 of scikit-learn: give alphas=100",
            FutureWarning,
            stacklevel=3,
        )
        wanted = count
    elif isinstance(alphas, str):
        wanted = count
    return wanted


def _solver_options(owner: str, params: dict[str, Any]) -> dict[str, Any]:
    """`max_iter` and `tol` of the further parameters of a path, with a check of the others."""
    known = {"tol", "max_iter", "random_state", "selection", "do_screening", "X_offset", "X_scale", "sample_weight"}
    unknown = sorted(set(params) - known)
    if unknown:
        raise ValueError(
            f"Unexpected parameters in params: {', '.join(unknown)}; {owner} knows {', '.join(sorted(known))}"
        )
    if params.get("selection", "cyclic") not in ("random", "cyclic"):
        raise ValueError("selection should be either random or cyclic.")
    if params.get("sample_weight") is not None:
        raise NotImplementedError(f"sample_weight of {owner}: fit ElasticNet or Lasso with it")
    options = {"max_iter": params.get("max_iter", 1000), "tol": params.get("tol", 1e-4)}
    check_params(owner, {"max_iter": (integer(1),), "tol": (real(0),)}, **options)
    return options


def _start(coef_init: Any, features: int) -> NDArray[np.float64] | None:
    if coef_init is None:
        return None
    start = np.asarray(coef_init, dtype=np.float64)
    if start.shape != (features,):
        raise ValueError(f"coef_init has the shape {start.shape}: give one value a feature, ({features},)")
    return start


class ElasticNet(MultiOutputMixin, LinearModel):
    """Linear regression with an l1 and an l2 penalty, as scikit-learn's class of this name.

    Minimises ``1 / (2 n) sum_i s_i (y_i - x_i w - b)^2 + alpha l1_ratio |w|_1 + alpha (1 - l1_ratio) / 2 |w|^2`` over
    w and the intercept b, with row weights s of sum n. Several targets are fitted separately, in one pass over X.

    X is compressed in one pass, in parallel and without a copy. Coordinate descent then runs on at most n_features
    rows and ends with Newton steps on the support. Solutions are exact up to rounding for any `tol` (see
    `dual_gap_`). For one target, more than 512 features with up to four times as many rows are not compressed: the
    solver works on a copy of the rows.

    Parameters
    ----------
    alpha : float, default=1.0
        Strength of the penalty; 0 is least squares.
    l1_ratio : float in [0, 1], default=0.5
        Share of the l1 penalty: 1 is the lasso, 0 is ridge.
    fit_intercept : bool, default=True
        Fit an intercept, which is not penalised.
    precompute : bool or array-like of shape (n_features, n_features), default=False
        The Gram matrix of the (centred, weighted) features if known. With True and False the engine chooses.
    max_iter : int, default=1000
        Largest number of sweeps over the coordinates.
    copy_X : bool, default=True
        Accepted without effect: X is never copied or written.
    tol : float, default=1e-4
        Tolerance of the duality gap, relative to the target's mean square. An inexact solution after `max_iter`
        sweeps with a larger gap is a `ConvergenceWarning`.
    warm_start : bool, default=False
        Start from `coef_` of the previous fit. This changes the number of sweeps, not the result.
    positive : bool, default=False
        Restrict the coefficients to be non-negative.
    random_state : int, RandomState or None, default=None
        Accepted without effect: nothing is random.
    selection : {"cyclic", "random"}, default="cyclic"
        Accepted without effect: the result does not depend on the order of coordinates.

    Attributes
    ----------
    coef_ : ndarray of shape (n_features,) or (n_targets, n_features)
        Coefficients w, with the precision of X.
    intercept_ : float or ndarray of shape (n_targets,)
        Intercept, 0.0 without one.
    dual_gap_ : float or ndarray of shape (n_targets,)
        Upper bound on the objective minus its minimum, in the units of the target's square.
    n_iter_ : int or list of int
        Sweeps over the coordinates; 0 if the start was the solution.
    sparse_coef_ : scipy sparse matrix of shape (1, n_features) or (n_targets, n_features)
        `coef_` without its zeros; needs scipy.
    n_features_in_ : int
        Number of features.
    feature_names_in_ : ndarray of shape (n_features,)
        Names of the features, if X has names.

    See Also
    --------
    Lasso : With the l1 penalty alone.
    enet_path : At many alphas.

    Examples
    --------
    >>> import numpy as np
    >>> import fleetfoot as ff
    >>> X = np.array([[-1.0], [0.0], [1.0]])
    >>> model = ff.ElasticNet(alpha=0.5).fit(X, [-1.0, 0.0, 1.0])
    >>> model.coef_.round(6)
    array([0.454545])
    """

    path: Callable[..., Any] = staticmethod(enet_path)

    _rules: dict[str, tuple[Rule, ...]] = {
        "alpha": (real(0),),
        "l1_ratio": (real(0, 1, "both"),),
        "fit_intercept": (BOOLEAN,),
        "precompute": (BOOLEAN, ARRAY),
        "max_iter": (integer(1),),
        "copy_X": (BOOLEAN,),
        "tol": (real(0),),
        "warm_start": (BOOLEAN,),
        "positive": (BOOLEAN,),
        "random_state": (RANDOM_STATE,),
        "selection": (one_of("cyclic", "random"),),
    }

    coef_: NDArray[Any]
    intercept_: Any
    dual_gap_: Any
    n_iter_: Any

    def __init__(
        self,
        alpha: float = 1.0,
        *,
        l1_ratio: float = 0.5,
        fit_intercept: bool = True,
        precompute: Any = False,
        max_iter: int = 1000,
        copy_X: bool = True,
        tol: float = 1e-4,
        warm_start: bool = False,
        positive: bool = False,
        random_state: Any = None,
        selection: str = "cyclic",
    ) -> None:
        self.alpha = alpha
        self.l1_ratio = l1_ratio
        self.fit_intercept = fit_intercept
        self.precompute = precompute
        self.max_iter = max_iter
        self.copy_X = copy_X
        self.tol = tol
        self.warm_start = warm_start
        self.positive = positive
        self.random_state = random_state
        self.selection = selection

    _sparse = True

    def fit(self: _Fitted, X: Any, y: Any, sample_weight: Any = None, check_input: bool = True) -> _Fitted:
        """Fits all targets in one pass over X.

        Parameters
        ----------
        X : array-like or sparse matrix of shape (n_samples, n_features)
            Regressors, in any memory order. Sparse rows are read block by block, and never made dense as a whole if
            there are more rows than features.
        y : array-like of shape (n_samples,) or (n_samples, n_targets)
            Targets.
        sample_weight : float or array-like of shape (n_samples,), optional
            Non-negative weights of the rows; only their ratios matter.
        check_input : bool, default=True
            Check X and y; otherwise they must be finite arrays of `float32` or `float64`.

        Returns
        -------
        self

        Raises
        ------
        ValueError
            A parameter is out of range, or the data are not finite or their shapes differ.
        """
        check_params(self, self._rules)
        if check_input:
            X, y = check_xy(self, X, y, multi_output=True, sparse=True)
        else:
            X, y = as_given(X), numbers(y, "y")
            self.n_features_in_ = X.shape[1]
        y, weight = as_precise(y, X), row_weights(sample_weight, len(y))
        targets = 1 if y.ndim == 1 else y.shape[1]
        options: dict[str, Any] = {"precompute": self.precompute, "check_gram": check_input, "few": targets == 1}
        try:
            posed = pose(X, y, weight, intercept=self.fit_intercept, **options)
        except FitError as error:
            largest = float(abs(X).max()) if X.shape[0] else 0.0
            if largest * largest * X.shape[0] < float(np.finfo(np.float64).max):
                raise
            # Words by which other libraries describe it.
            raise FitError(
                "Coordinate descent iterations resulted in non-finite parameter values, or would: squares of X overflow. "
                f"{error}"
            ) from error
        start = self._warm_start(targets, X.shape[1])
        starts = [None] * targets if start is None else list(start)
        estimator = _core.Estimator.elastic_net(self.l1_ratio, self.max_iter)
        options = {"estimator": estimator, "positive": self.positive, "max_iter": self.max_iter, "tol": self.tol}
        solved = [posed.solve(k, [self.alpha], start=starts[k], **options) for k in range(targets)]
        self._keep(solved, X.dtype, y.ndim)
        return self

    def _keep(self, solved: list[Any], dtype: Any, dimensions: int) -> None:
        coefs = np.array([one.coefs[0] for one in solved], dtype=dtype)
        gaps = np.array([one.gaps[0] for one in solved], dtype=dtype)
        sweeps = [one.sweeps[0] for one in solved]
        single = len(solved) == 1
        self.coef_ = coefs[0] if single else coefs
        self.dual_gap_ = gaps[0] if single else gaps
        self.n_iter_ = sweeps[0] if single else sweeps
        self._set_intercepts([one.intercepts[0] for one in solved], dtype, single=dimensions == 1)

    @property
    def sparse_coef_(self) -> Any:
        """`coef_` as a sparse matrix by rows (n_targets, n_features)."""
        try:
            sparse: Any = importlib.import_module("scipy.sparse")
        except ImportError as error:
            raise ImportError("sparse_coef_ needs scipy: pip install scipy, or read coef_") from error
        return sparse.csr_matrix(np.atleast_2d(self.coef_))


class Lasso(ElasticNet):
    """Linear regression with an l1 penalty, as scikit-learn's class of this name.

    Minimises ``1 / (2 n) sum_i s_i (y_i - x_i w - b)^2 + alpha |w|_1`` over w and the intercept b, with row weights s
    of sum n. See :class:`ElasticNet` with ``l1_ratio=1``.

    Parameters
    ----------
    alpha : float, default=1.0
        Strength of the penalty, in units of the target times those of the features; 0 is least squares.
    fit_intercept, precompute, copy_X, max_iter, tol, warm_start, positive, random_state, selection
        As for :class:`ElasticNet`.

    Attributes
    ----------
    coef_, intercept_, dual_gap_, n_iter_, sparse_coef_
        As for :class:`ElasticNet`, with ``n_features_in_`` and ``feature_names_in_``.

    See Also
    --------
    LassoCV : Chooses alpha by cross-validation.
    Bolasso : Keeps the features that most resamples of the rows select.

    Examples
    --------
    >>> import numpy as np
    >>> import fleetfoot as ff
    >>> X = np.array([[-1.0], [0.0], [1.0]])
    >>> model = ff.Lasso(alpha=0.5).fit(X, [-1.0, 0.0, 1.0])
    >>> model.coef_
    array([0.25])
    >>> model.predict([[2.0]])
    array([0.5])
    """

    path = staticmethod(enet_path)

    _rules = {name: rule for name, rule in ElasticNet._rules.items() if name != "l1_ratio"}

    def __init__(
        self,
        alpha: float = 1.0,
        *,
        fit_intercept: bool = True,
        precompute: Any = False,
        copy_X: bool = True,
        max_iter: int = 1000,
        tol: float = 1e-4,
        warm_start: bool = False,
        positive: bool = False,
        random_state: Any = None,
        selection: str = "cyclic",
    ) -> None:
        super().__init__(
            alpha=alpha,
            l1_ratio=1.0,
            fit_intercept=fit_intercept,
            precompute=precompute,
            copy_X=copy_X,
            max_iter=max_iter,
            tol=tol,
            warm_start=warm_start,
            positive=positive,
            random_state=random_state,
            selection=selection,
        )
