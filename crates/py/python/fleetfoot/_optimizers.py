"""STLSQ, SR3 and FROLS: sparse regression in pysindy's style, and as optimizers inside pysindy."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._base import (
    BaseEstimator,
    ConvergenceWarning,
    MultiOutputMixin,
    RegressorMixin,
    check_is_fitted,
    check_weight,
    check_x,
    check_xy,
)
from ._core import Design, SparseModels, frols, sr3, stlsq
from ._params import ARRAY, BOOLEAN, NONE, VERBOSE, Rule, check_params, integer, real

__all__ = ["FROLS", "SR3", "STLSQ"]

#: Options of pysindy's iterative ridge solvers: the ridge here is solved directly, and more exactly than any of them.
_SOLVER_OPTIONS = {"solver", "tol", "max_iter", "random_state", "check_input", "copy_X"}
_NUMBER = real(0.0)


class _Optimizer(MultiOutputMixin, RegressorMixin, BaseEstimator):
    """What the optimizers share: no intercept (a column of ones is a feature), coefficients (n_targets, n_features)."""

    coef_: NDArray[np.float64]
    ind_: NDArray[np.bool_]
    history_: list[NDArray[np.float64]]
    intercept_: float
    n_features_in_: int
    n_iter_: int
    _iters: int = 0

    _rules: dict[str, tuple[Rule, ...]] = {}

    def _check(self) -> None:
        check_params(self, self._rules)

    def fit(self, X: Any, y: Any, sample_weight: Any = None) -> Any:
        """Fits the coefficients.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Candidate functions, one a column. Rows in which all of X or all of y is NaN are left out, as in pysindy.
        y : array-like of shape (n_samples,) or (n_samples, n_targets)
            Targets, each with its own units.
        sample_weight : float or array-like of shape (n_samples,), default=None
            Weights of the rows' squared errors.

        Returns
        -------
        object
            Itself.

        Raises
        ------
        ValueError
            A parameter out of its range, values that are not finite.
        NotImplementedError
            A parameter that is not supported; it is named.
        """
        self._check()
        X, y, sample_weight = _without_missing(X, y, sample_weight)
        X, y = check_xy(self, X, y, multi_output=True)
        weight = check_weight(sample_weight, len(X))
        self._flat = y.ndim == 1
        targets = 1 if self._flat else y.shape[1]
        models = self._solve(Design(X, y, weight), X, weight, targets)
        self.coef_ = models.coefficients
        self.ind_ = models.decided != 0.0
        self.history_ = list(models.history)
        self.intercept_ = 0.0
        self.n_iter_ = max(models.iterations, 1)
        self._told(models)
        if getattr(self, "verbose", False):
            self._print(X, y.reshape(len(X), targets))
        return self

    def predict(self, X: Any) -> NDArray[Any]:
        """Predicts ``X @ coef_.T``.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Candidate functions.

        Returns
        -------
        ndarray of shape (n_samples, n_targets), or (n_samples,) where y was one
            Predictions, in the units of the targets.
        """
        check_is_fitted(self)
        X = check_x(self, X, reset=False)
        found: NDArray[Any] = X @ self._all_coefficients().T
        return found[:, 0] if self._flat else found

    @property
    def iters(self) -> int:
        """What the last fit counted: regressions for STLSQ, iterations for SR3; pysindy's name."""
        return self._iters

    @property
    def complexity(self) -> int:
        """Number of terms: coefficients that are not zero."""
        check_is_fitted(self)
        return int(np.count_nonzero(self.coef_)) + int(np.count_nonzero(self.intercept_))

    def _solve(
        self, design: Design, X: NDArray[Any], weight: NDArray[np.float64] | None, targets: int
    ) -> SparseModels:
        raise NotImplementedError

    def _told(self, models: SparseModels) -> None:
        """Warnings and attributes of the optimizer's own."""

    def _all_coefficients(self) -> NDArray[np.float64]:
        return self.coef_

    def _print(self, X: NDArray[Any], y: NDArray[Any]) -> None:
        print(f"{'Iteration':>10} ... {'|y - Xw|^2':>12} ... {'|w|_0':>6}")
        for number, coefficients in enumerate(self.history_):
            squared = float(((y - X @ coefficients.T) ** 2).sum())
            print(f"{number:>10} ... {squared:>12.4e} ... {np.count_nonzero(coefficients):>6}")


def _without_missing(X: Any, y: Any, sample_weight: Any) -> tuple[Any, Any, Any]:
    """Leaves out the rows in which all of X or all of y is missing; what is no array of floats passes as it is."""
    if not (isinstance(X, np.ndarray) and isinstance(y, np.ndarray)):
        return X, y, sample_weight
    # Subclasses (pysindy's arrays with named axes) become plain.
    X, y = np.asarray(X), np.asarray(y)
    floats = np.issubdtype(X.dtype, np.floating) and np.issubdtype(y.dtype, np.floating)
    if not floats or X.ndim != 2 or y.ndim not in (1, 2) or len(X) != len(y):
        return X, y, sample_weight
    # A row that has its first values is there.
    if not (np.isnan(X[:, :1]).any() or np.isnan(y.reshape(len(y), -1)[:, :1]).any()):
        return X, y, sample_weight
    there = ~np.isnan(X).all(axis=1) & ~np.isnan(y.reshape(len(y), -1)).all(axis=1)
    if there.all() or not there.any():
        return X, y, sample_weight
    if sample_weight is not None and np.ndim(sample_weight) == 1:
        sample_weight = np.asarray(sample_weight)[there]
    return X[there], y[there], sample_weight


def _check_ridge(options: dict[str, Any] | None, owner: str) -> None:
    """Refuses options of pysindy's ridge that would change its answer."""
    if options is None:
        return
    if not isinstance(options, dict):
        raise ValueError(f"ridge_kw of {owner} must be a dict or None. Got {options!r} instead.")
    other = sorted(set(options) - _SOLVER_OPTIONS)
    if other:
        raise NotImplementedError(
            f"ridge_kw={{{other[0]!r}: ...}} of {owner} is not supported: the ridge is solved directly; "
            f"{', '.join(sorted(_SOLVER_OPTIONS))} are accepted, and change nothing"
        )


def _guess(guess: Any, shape: tuple[int, int]) -> NDArray[np.float64] | None:
    """A first guess as matrix (n_targets, n_features)."""
    if guess is None:
        return None
    found = np.atleast_2d(np.asarray(guess, dtype=np.float64))
    if found.shape != shape:
        raise ValueError(
            "initial_guess shape is incompatible with training data. "
            f"Expected: {shape}. Received: {found.shape}."
        )
    if not np.isfinite(found).all():
        raise ValueError("initial_guess contains NaN or infinity")
    return found


def _lengths(X: NDArray[Any], weight: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """Lengths of the columns; 1 where they are zero."""
    if weight is None:
        squared = np.einsum("ij,ij->j", X, X, dtype=np.float64)
    else:
        squared = np.einsum("ij,ij,i->j", X, X, weight, dtype=np.float64)
    found: NDArray[np.float64] = np.sqrt(squared)
    found[found == 0.0] = 1.0
    return found


class STLSQ(_Optimizer):
    """Sequentially thresholded least squares.

    Regresses with a ridge, drops the coefficients below the threshold, regresses on the rest, until nothing is dropped:
    ``|y - X w|^2 + alpha |w|^2``, on sums over the rows, without an intercept. Parameters, defaults and stopping rule
    are those of pysindy's `STLSQ`; as an optimizer inside `pysindy.SINDy` and `pysindy.EnsembleOptimizer` it takes that
    one's place.

    Parameters
    ----------
    threshold : float, default=0.1
        Coefficients below it are dropped.
    alpha : float, default=0.05
        The ridge.
    max_iter : int, default=20
        Regressions at most.
    ridge_kw : dict or None, default=None
        Options of a solver: accepted, and without effect, because the ridge is solved directly. Others raise.
    normalize_columns : bool, default=False
        Whether threshold and ridge are on the coefficients of columns of length 1.
    copy_X : bool, default=True
        Accepted, and without effect: X is never written to.
    initial_guess : array-like of shape (n_features,) or (n_targets, n_features), default=None
        The iteration ends when the first regression keeps exactly the terms that are not zero here.
    verbose : bool, default=False
        Whether the iterations are printed.
    sparse_ind : list of int or None, default=None
        Columns that are penalised and may be dropped; the others are always in, without ridge. `coef_` and `ind_` then
        have these columns alone, and `optvar_non_sparse_` and `ind_non_sparse_` the others.
    unbias : bool, default=True
        Whether the terms that are left are fitted again without the ridge.

    Attributes
    ----------
    coef_ : ndarray of shape (n_targets, n_features)
        Coefficients, the target's units over the column's.
    ind_ : ndarray of shape (n_targets, n_features), bool
        The terms that are left.
    history_ : list of ndarray of shape (n_targets, n_features)
        Coefficients at the start (least squares, or the first guess) and after each iteration.
    intercept_ : float
        0: a column of ones is a feature like the others.
    iters : int
        Regressions that were made, all targets together.
    n_iter_ : int
        Iterations: the most of any target.
    n_features_in_ : int
        Number of features.

    Notes
    -----
    The answer is pysindy's to rounding, except where columns depend on each other: coefficients are then
    those of least norm in units of the columns' lengths, in pysindy in raw units. The data are read once, and what is
    iterated is their triangular factor.

    Examples
    --------
    >>> import numpy as np
    >>> import fleetfoot as ff
    >>> t = np.linspace(0.0, 3.0, 200)
    >>> X = np.column_stack([np.ones(200), t, np.sin(5 * t)])
    >>> model = ff.STLSQ(threshold=0.1).fit(X, 2.0 * t - 0.5 * np.sin(5 * t))
    >>> model.coef_.round(6)
    array([[ 0. ,  2. , -0.5]])
    >>> model.complexity
    2
    """

    _rules = {
        "threshold": (Rule("a number: threshold cannot be negative", _NUMBER.holds),),
        "alpha": (Rule("a number: alpha cannot be negative", _NUMBER.holds),),
        "max_iter": (integer(1),),
        "normalize_columns": (BOOLEAN,),
        "copy_X": (BOOLEAN,),
        "initial_guess": (ARRAY, NONE),
        "verbose": (VERBOSE,),
        "sparse_ind": (ARRAY, NONE),
        "unbias": (BOOLEAN,),
    }

    optvar_non_sparse_: NDArray[np.float64]
    ind_non_sparse_: NDArray[np.bool_]

    def __init__(
        self,
        threshold: float = 0.1,
        alpha: float = 0.05,
        max_iter: int = 20,
        ridge_kw: dict[str, Any] | None = None,
        normalize_columns: bool = False,
        copy_X: bool = True,
        initial_guess: Any = None,
        verbose: bool = False,
        sparse_ind: Any = None,
        unbias: bool = True,
    ) -> None:
        self.threshold = threshold
        self.alpha = alpha
        self.max_iter = max_iter
        self.ridge_kw = ridge_kw
        self.normalize_columns = normalize_columns
        self.copy_X = copy_X
        self.initial_guess = initial_guess
        self.verbose = verbose
        self.sparse_ind = sparse_ind
        self.unbias = unbias
        self._check()

    @property
    def complexity(self) -> int:
        """Number of terms; one more where the threshold is 0, as pysindy counts the intercept."""
        check_is_fitted(self)
        return int(np.count_nonzero(self.coef_)) + int(abs(self.intercept_) >= self.threshold)

    def _check(self) -> None:
        super()._check()
        _check_ridge(self.ridge_kw, "STLSQ")

    def _others(self, features: int) -> NDArray[np.intp]:
        """Columns that are always in."""
        if self.sparse_ind is None:
            return np.zeros(0, dtype=np.intp)
        chosen = np.asarray(self.sparse_ind)
        if chosen.ndim != 1 or not np.issubdtype(chosen.dtype, np.integer) or len(np.unique(chosen)) != len(chosen):
            raise ValueError("sparse_ind must be a list of different column numbers")
        if len(chosen) and not (0 <= chosen.min() and chosen.max() < features):
            raise ValueError(f"sparse_ind names columns beyond 0 to {features - 1}")
        return np.setdiff1d(np.arange(features), chosen)

    def _solve(
        self, design: Design, X: NDArray[Any], weight: NDArray[np.float64] | None, targets: int
    ) -> SparseModels:
        guess = _guess(self.initial_guess, (targets, X.shape[1]))
        if guess is not None and self.normalize_columns:
            guess = guess / _lengths(X, weight)
        return stlsq(
            design,
            {
                "threshold": float(self.threshold),
                "alpha": float(self.alpha),
                "max_iter": int(self.max_iter),
                "normalize": bool(self.normalize_columns),
                "unbias": bool(self.unbias),
                "fixed": self._others(X.shape[1]).tolist(),
            },
            guess,
        )

    def _told(self, models: SparseModels) -> None:
        before = [np.ones(len(self.coef_), dtype=bool)] + [h.any(axis=1) for h in self.history_[1:-1]]
        self._iters = int(sum(alive.sum() for alive in before))
        for _ in models.empty:
            warnings.warn(
                f"Sparsity parameter is too big ({self.threshold}) and eliminated all coefficients", stacklevel=3
            )
        if not models.converged:
            warnings.warn(
                f"STLSQ did not converge after {self.max_iter} iterations.", ConvergenceWarning, stacklevel=3
            )
        if self.sparse_ind is not None:
            others, chosen = self._others(self.n_features_in_), np.asarray(self.sparse_ind, dtype=np.intp)
            self._coefficients = self.coef_
            self.optvar_non_sparse_, self.ind_non_sparse_ = self.coef_[:, others], self.ind_[:, others]
            self.coef_, self.ind_ = self.coef_[:, chosen], self.ind_[:, chosen]

    def _all_coefficients(self) -> NDArray[np.float64]:
        return self.coef_ if self.sparse_ind is None else self._coefficients


class SR3(_Optimizer):
    """Sparse relaxed regularised regression.

    Alternates between coefficients w that fit and coefficients v that are sparse: ``0.5 |y - X w|^2 + reg_weight_lam
    R(v) + 0.5 / relax_coeff_nu |w - v|^2``, on sums over the rows, without an intercept. Parameters, defaults and
    stopping rule are those of pysindy's `SR3`; inside `pysindy.SINDy` it takes that one's place.

    Parameters
    ----------
    reg_weight_lam : float or array-like of shape (n_targets, n_features), default=0.005
        Weight of R, one for all or one a coefficient.
    regularizer : {'l0', 'l1', 'l2', 'weighted_l0', 'weighted_l1', 'weighted_l2'}, default='L0'
        R: number of coefficients, sum of their sizes, or of their squares; in any case of letters. The weighted ones
        need an array of weights.
    relax_coeff_nu : float, default=1.0
        Relaxation: the smaller, the nearer w is to v.
    tol : float, default=1e-5
        The iteration ends when the step of v over `relax_coeff_nu` is shorter.
    trimming_fraction : float, default=0.0
        Not supported but for 0: trimming weighs single rows, which the statistic that is iterated here does not know.
    trimming_step_size : float, default=1.0
        Without effect.
    max_iter : int, default=30
        Iterations at most.
    copy_X : bool, default=True
        Accepted, and without effect: X is never written to.
    initial_guess : array-like of shape (n_features,) or (n_targets, n_features), default=None
        Where v starts, in units of normalised columns where they are normalised; default: least squares.
    normalize_columns : bool, default=False
        Whether all of it is about the coefficients of columns of length 1.
    verbose : bool, default=False
        Whether the iterations are printed.
    unbias : bool, default=False
        Whether the terms of v are fitted again by least squares.

    Attributes
    ----------
    coef_ : ndarray of shape (n_targets, n_features)
        v, the target's units over the column's.
    coef_full_ : ndarray of shape (n_targets, n_features)
        w.
    ind_ : ndarray of shape (n_targets, n_features), bool
        The terms that are left.
    history_ : list of ndarray of shape (n_targets, n_features)
        v at the start and after each iteration.
    intercept_ : float
        0: a column of ones is a feature like the others.
    n_iter_, iters : int
        Iterations that were made.
    n_features_in_ : int
        Number of features.

    Examples
    --------
    >>> import numpy as np
    >>> import fleetfoot as ff
    >>> t = np.linspace(0.0, 3.0, 200)
    >>> X = np.column_stack([np.ones(200), t, np.sin(5 * t)])
    >>> model = ff.SR3(reg_weight_lam=0.005).fit(X, 2.0 * t - 0.5 * np.sin(5 * t))
    >>> model.coef_.round(6)
    array([[ 0. ,  2. , -0.5]])
    """

    _rules = {
        "regularizer": (Rule("a str", lambda value: isinstance(value, str)),),
        "relax_coeff_nu": (Rule("a number: relax_coeff_nu must be positive", real(0.0, closed="neither").holds),),
        "tol": (Rule("a number: tol must be positive", real(0.0, closed="neither").holds),),
        "trimming_fraction": (real(0.0, 1.0, "both"),),
        "trimming_step_size": (real(),),
        "max_iter": (integer(1),),
        "copy_X": (BOOLEAN,),
        "initial_guess": (ARRAY, NONE),
        "normalize_columns": (BOOLEAN,),
        "verbose": (VERBOSE,),
        "unbias": (BOOLEAN,),
    }

    coef_full_: NDArray[np.float64]

    def __init__(
        self,
        reg_weight_lam: Any = 0.005,
        regularizer: str = "L0",
        relax_coeff_nu: float = 1.0,
        tol: float = 1e-5,
        trimming_fraction: float = 0.0,
        trimming_step_size: float = 1.0,
        max_iter: int = 30,
        copy_X: bool = True,
        initial_guess: Any = None,
        normalize_columns: bool = False,
        verbose: bool = False,
        unbias: bool = False,
    ) -> None:
        self.reg_weight_lam = reg_weight_lam
        self.regularizer = regularizer
        self.relax_coeff_nu = relax_coeff_nu
        self.tol = tol
        self.trimming_fraction = trimming_fraction
        self.trimming_step_size = trimming_step_size
        self.max_iter = max_iter
        self.copy_X = copy_X
        self.initial_guess = initial_guess
        self.normalize_columns = normalize_columns
        self.verbose = verbose
        self.unbias = unbias
        self._check()

    @staticmethod
    def calculate_l0_weight(threshold: Any, relax_coeff_nu: float) -> Any:
        """The weight at which l0 drops coefficients up to `threshold`: ``threshold**2 / (2 relax_coeff_nu)``."""
        return threshold**2 / (2 * relax_coeff_nu)

    def enable_trimming(self, trimming_fraction: float) -> None:
        """Not supported: see `trimming_fraction`."""
        raise NotImplementedError(f"trimming_fraction={trimming_fraction}: SR3 here does not trim rows")

    def disable_trimming(self) -> None:
        """Nothing is trimmed anyway."""

    def _check(self) -> None:
        super()._check()
        kinds = ("l0", "l1", "l2", "weighted_l0", "weighted_l1", "weighted_l2")
        if self.regularizer.lower() not in kinds:
            raise NotImplementedError(f"regularizer={self.regularizer!r} is none of {', '.join(kinds)}")
        if self.trimming_fraction != 0.0:
            raise NotImplementedError(
                f"trimming_fraction={self.trimming_fraction}: SR3 here does not trim rows; give sample_weight, or 0"
            )
        weights = np.asarray(self.reg_weight_lam)
        if not np.issubdtype(weights.dtype, np.number) or weights.ndim not in (0, 2):
            raise ValueError("reg_weight_lam must be a number or an array (n_targets, n_features)")
        if not (np.isfinite(weights).all() and (weights >= 0).all()):
            raise ValueError("reg_weight_lam cannot contain negative entries, NaN or infinity")
        if self.regularizer.lower().startswith("weighted") and weights.ndim != 2:
            raise ValueError("weighted regularization requires the reg_weight_lam parameter to be a 2d array")

    def _solve(
        self, design: Design, X: NDArray[Any], weight: NDArray[np.float64] | None, targets: int
    ) -> SparseModels:
        shape = (targets, X.shape[1])
        weights = np.asarray(self.reg_weight_lam, dtype=np.float64)
        if weights.ndim == 2 and weights.shape != shape:
            raise ValueError(f"reg_weight_lam has the shape {weights.shape}, expected {shape}: (n_targets, n_features)")
        guess = _guess(self.initial_guess, shape)
        if guess is not None and self.normalize_columns:
            guess = guess / _lengths(X, weight)
        return sr3(
            design,
            {
                "regularizer": self.regularizer.lower()[-2:],
                "nu": float(self.relax_coeff_nu),
                "tol": float(self.tol),
                "max_iter": int(self.max_iter),
                "normalize": bool(self.normalize_columns),
                "unbias": bool(self.unbias),
            },
            np.ascontiguousarray(np.broadcast_to(weights, shape)),
            guess,
        )

    def _told(self, models: SparseModels) -> None:
        self.coef_full_ = models.relaxed
        self._iters = models.iterations
        if not models.converged:
            warnings.warn(f"SR3 did not converge after {self.max_iter} iterations.", ConvergenceWarning, stacklevel=3)


class FROLS(_Optimizer):
    """Forward regression by orthogonal least squares.

    Takes one column after the other, always the one with the largest error reduction ratio, and chooses one of the
    models on the way by pysindy's rule: the one before the term with the least ``ratio + kappa cond(X) terms``, where
    the ratios of a target and of all targets before it are added up. Parameters and defaults are those of pysindy's
    `FROLS`; inside `pysindy.SINDy` it takes that one's place.

    Parameters
    ----------
    normalize_columns : bool, default=False
        Whether the ridge is on the coefficients of columns of length 1; the order of entry does not depend on it.
    copy_X : bool, default=True
        Accepted, and without effect: X is never written to.
    kappa : float or None, default=None
        Weight of the number of terms, relative to the condition number of X.
    max_iter : int, default=10
        Terms at most.
    alpha : float, default=0.05
        Ridge in the system that leads from the orthogonal terms back to the columns.
    ridge_kw : dict or None, default=None
        Options of a solver: accepted, and without effect, because the ridge is solved directly. Others raise.
    verbose : bool, default=False
        Whether the steps are printed.
    unbias : bool, default=True
        Whether the chosen terms are fitted again by least squares.

    Attributes
    ----------
    coef_ : ndarray of shape (n_targets, n_features)
        Coefficients, the target's units over the column's.
    ind_ : ndarray of shape (n_targets, n_features), bool
        The terms of the models.
    history_ : list of ndarray of shape (n_targets, n_features)
        Coefficients of the models with 0, 1, ... terms, with the ridge.
    ERR_global : ndarray of shape (n_features, n_targets)
        Error reduction ratio of each term in the order of entry; 0 beyond the last that was looked at.
    n_iter_ : int
        Terms that were tried.
    intercept_ : float
        0: a column of ones is a feature like the others.
    n_features_in_ : int
        Number of features.

    Notes
    -----
    Columns that depend on those that are in are left out; pysindy goes on with their rounding errors, or
    raises. Coefficients below 1e-10 are kept; pysindy sets them to zero.

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

    _rules = {
        "normalize_columns": (BOOLEAN,),
        "copy_X": (BOOLEAN,),
        "kappa": (_NUMBER, NONE),
        "max_iter": (integer(1),),
        "alpha": (Rule("a number: alpha cannot be negative", _NUMBER.holds),),
        "verbose": (VERBOSE,),
        "unbias": (BOOLEAN,),
    }

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
        self.normalize_columns = normalize_columns
        self.copy_X = copy_X
        self.kappa = kappa
        self.max_iter = max_iter
        self.alpha = alpha
        self.ridge_kw = ridge_kw
        self.verbose = verbose
        self.unbias = unbias
        self._check()

    @property
    def ERR_global(self) -> NDArray[np.float64]:
        """Error reduction ratios (n_features, n_targets): pysindy's name."""
        check_is_fitted(self)
        return self._ratios

    def _check(self) -> None:
        super()._check()
        _check_ridge(self.ridge_kw, "FROLS")

    def _solve(
        self, design: Design, X: NDArray[Any], weight: NDArray[np.float64] | None, targets: int
    ) -> SparseModels:
        return frols(
            design,
            {
                "max_terms": int(self.max_iter),
                "alpha": float(self.alpha),
                "kappa": float(self.kappa or 0.0),
                "normalize": bool(self.normalize_columns),
                "unbias": bool(self.unbias),
            },
        )

    def _told(self, models: SparseModels) -> None:
        self._ratios = np.zeros((self.n_features_in_, len(self.coef_)))
        for target, ratios in enumerate(models.ratios):
            self._ratios[: len(ratios), target] = ratios
