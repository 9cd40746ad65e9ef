"""Sparse relaxed regularised regression."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._base import ConvergenceWarning
from ._core import Design, sr3
from ._optimizer import Optimizer, checked_guess, lengths
from ._params import Rule, real
from ._requests import Sr3Request
from ._trimming import Trimmed, trimmed


class SR3(Optimizer):
    """Sparse relaxed regularised regression.

    Alternates between coefficients w that fit the data and sparse coefficients v:
    ``0.5 |y - X w|^2 + reg_weight_lam R(v) + 0.5 / relax_coeff_nu |w - v|^2``, on sums over the rows, without an
    intercept. Parameters, defaults and stopping rule are those of pysindy's `SR3`, which it can replace inside
    `pysindy.SINDy`.

    Parameters
    ----------
    reg_weight_lam : float or array-like of shape (n_targets, n_features), default=0.005
        Weight of R, for all or for each coefficient.
    regularizer : {'l0', 'l1', 'l2', 'weighted_l0', 'weighted_l1', 'weighted_l2'}, default='L0'
        R: number of coefficients, sum of absolute values, or of squares, in upper or lower case. The weighted ones
        need an array of weights.
    relax_coeff_nu : float, default=1.0
        Relaxation: a smaller value brings w nearer to v.
    tol : float, default=1e-5
        The iteration ends when the step of v over `relax_coeff_nu` is shorter.
    trimming_fraction : float, default=0.0
        Share of worst-fitting rows that are ignored; each iteration reweighs the rows.
    trimming_step_size : float, default=1.0
        Length of the step of the rows' weights.
    max_iter : int, default=30
        Largest number of iterations.
    copy_X : bool, default=True
        Accepted without effect: X is never written.
    initial_guess : array-like of shape (n_features,) or (n_targets, n_features), default=None
        Start of v, in units of normalised columns if they are normalised; default: least squares.
    normalize_columns : bool, default=False
        Use coefficients of columns of length 1 throughout.
    verbose : bool, default=False
        Print the iterations.
    unbias : bool, default=False
        Refit the terms of v by least squares.

    Attributes
    ----------
    coef_ : ndarray of shape (n_targets, n_features)
        v, the target's units over the column's.
    coef_full_ : ndarray of shape (n_targets, n_features)
        w.
    ind_ : ndarray of shape (n_targets, n_features), bool
        The remaining terms.
    history_ : list of ndarray of shape (n_targets, n_features)
        v at the start and after each iteration.
    trimming_array : ndarray of shape (n_samples,)
        Remaining weights of the rows, with trimming.
    intercept_ : float
        0: a column of ones is a feature like the others.
    n_iter_, iters : int
        Number of iterations.
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
        "trimming_fraction": (real(0.0, 1.0, "left"),),
        "trimming_step_size": (real(0.0, closed="neither"),),
        **Optimizer._rules,
    }

    coef_full_: NDArray[np.float64]
    trimming_array: NDArray[np.float64]

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
        self.initial_guess = initial_guess
        super().__init__(max_iter, normalize_columns, copy_X, verbose, unbias)

    @staticmethod
    def calculate_l0_weight(threshold: Any, relax_coeff_nu: float) -> Any:
        """The weight at which l0 drops coefficients up to `threshold`: ``threshold**2 / (2 relax_coeff_nu)``."""
        return threshold**2 / (2 * relax_coeff_nu)

    def enable_trimming(self, trimming_fraction: float) -> None:
        """The same as setting `trimming_fraction`."""
        self.trimming_fraction = trimming_fraction
        self._check()

    def disable_trimming(self) -> None:
        """Keeps all rows in the next fit."""
        self.trimming_fraction = 0.0

    def _check(self) -> None:
        super()._check()
        kinds = ("l0", "l1", "l2", "weighted_l0", "weighted_l1", "weighted_l2")
        if self.regularizer.lower() not in kinds:
            raise NotImplementedError(f"regularizer={self.regularizer!r} is none of {', '.join(kinds)}")
        if self.trimming_fraction > 0.0 and self.unbias:
            raise ValueError(
                f"trimming_fraction={self.trimming_fraction} with unbias=True: a refit would take the rows back in that were "
                "given up; choose one"
            )
        weights = np.asarray(self.reg_weight_lam)
        if not np.issubdtype(weights.dtype, np.number) or weights.ndim not in (0, 2):
            raise ValueError("reg_weight_lam must be a number or an array (n_targets, n_features)")
        if not (np.isfinite(weights).all() and (weights >= 0).all()):
            raise ValueError("reg_weight_lam cannot contain negative entries, NaN or infinity")
        if self.regularizer.lower().startswith("weighted") and weights.ndim != 2:
            raise ValueError("weighted regularization requires the reg_weight_lam parameter to be a 2d array")

    def _solve(self, X: NDArray[Any], y: NDArray[Any], weight: NDArray[np.float64] | None) -> Any:
        shape = (y.shape[1], X.shape[1])
        weights = np.asarray(self.reg_weight_lam, dtype=np.float64)
        if weights.ndim == 2 and weights.shape != shape:
            raise ValueError(f"reg_weight_lam has the shape {weights.shape}, expected {shape}: (n_targets, n_features)")
        weights = np.ascontiguousarray(np.broadcast_to(weights, shape))
        guess = checked_guess(self.initial_guess, shape)
        request: Sr3Request = {
            "regularizer": self.regularizer.lower()[-2:],
            "nu": float(self.relax_coeff_nu),
            "tol": float(self.tol),
            "max_iter": int(self.max_iter),
            "normalize": bool(self.normalize_columns),
            "unbias": bool(self.unbias),
        }
        if self.trimming_fraction > 0.0:
            return self._trim(X, y, weight, (request, weights, guess))
        if guess is not None and self.normalize_columns:
            guess = guess / lengths(X, weight)
        return sr3(Design(X, y, weight), request, weights, guess)

    def _trim(
        self, X: NDArray[Any], y: NDArray[Any], weight: NDArray[np.float64] | None, given: tuple[Any, Any, Any]
    ) -> Trimmed:
        """Models in units of normalised columns, where they are normalised, and back."""
        request, weights, start = given
        size = lengths(X, weight) if self.normalize_columns else np.ones(X.shape[1])
        root = np.ones((len(X), 1)) if weight is None else np.sqrt(weight)[:, None]
        X, y = root * X / size, root * y
        if start is None:
            start = np.linalg.lstsq(X, y)[0].T
        kept = trimmed(
            X, y, request, weights, np.ascontiguousarray(start), self.trimming_fraction, self.trimming_step_size
        )
        raw = {name: getattr(kept, name) / size for name in ("coefficients", "decided", "history", "relaxed")}
        return replace(kept, **raw)

    def _set_results(self, models: Any) -> None:
        self.coef_full_ = models.relaxed
        if isinstance(models, Trimmed):
            self.trimming_array = models.shares
        self._iters = models.iterations
        if not models.converged:
            warnings.warn(f"SR3 did not converge after {self.max_iter} iterations.", ConvergenceWarning, stacklevel=3)
