"""Least angle regression paths: functions and code shared with the estimators."""

from __future__ import annotations

import warnings
from typing import Any, Literal, TypedDict

import numpy as np
from numpy.typing import NDArray

from ._arrays import numbers
from ._base import ConvergenceWarning
from ._core import Design, LarsPath, lars_path_of_products, lars_paths
from ._params import ARRAY, BOOLEAN, NONE, VERBOSE, Rule, check_params, integer, one_of, real

__all__ = ["lars_path", "lars_path_gram"]

EPS = float(np.finfo(float).eps)
#: A number of steps; infinity is no limit.
STEPS = Rule("an int >= 0 or np.inf", lambda v: integer(0).holds(v) or (isinstance(v, float) and v == np.inf))


class LarsRequest(TypedDict):
    """Options of a path for the engine."""

    lasso: bool
    positive: bool
    alpha_min: float
    max_iter: int


_PATH_RULES: dict[str, tuple[Rule, ...]] = {
    "max_iter": (STEPS,),
    "alpha_min": (real(0.0),),
    "method": (one_of("lar", "lasso"),),
    "copy_X": (BOOLEAN,),
    "eps": (real(0.0, closed="neither"), NONE),
    "copy_Gram": (BOOLEAN,),
    "verbose": (VERBOSE,),
    "return_path": (BOOLEAN,),
    "return_n_iter": (BOOLEAN,),
    "positive": (BOOLEAN,),
}


def lars_path(
    X: Any,
    y: Any,
    Xy: Any = None,
    *,
    Gram: Any = None,
    max_iter: float = 500,
    alpha_min: float = 0,
    method: Literal["lar", "lasso"] = "lar",
    copy_X: bool = True,
    eps: float | None = EPS,
    copy_Gram: bool = True,
    verbose: int = 0,
    return_path: bool = True,
    return_n_iter: bool = False,
    positive: bool = False,
) -> Any:
    """The path of least angle regression, or of the lasso by it, without an intercept.

    With ``method="lasso"`` its points minimise ``1 / (2 n_samples) * |y - X w|^2 + alpha * |w|_1``. Between the exact
    knots the coefficients are linear in alpha. Rows are compressed once; the path is followed on an orthogonal factor
    of the active columns.

    Parameters
    ----------
    X : array-like of shape (n_samples, n_features)
        Regressors; `float32` or `float64`, in any memory order. Never copied as a whole or written.
    y : array-like of shape (n_samples,)
        Target.
    Xy : array-like of shape (n_features,), optional
        ``X.T @ y``, if known.
    Gram : None, 'auto', bool or array of shape (n_features, n_features), default=None
        ``X.T @ X``, if known: the path then has the accuracy of the products. With any other value the engine
        compresses the rows.
    max_iter : int, default=500
        Largest number of steps; `np.inf` for no limit.
    alpha_min : float, default=0
        End of the path, in the units of y.
    method : {'lar', 'lasso'}, default='lar'
        'lar' keeps entered columns; 'lasso' removes those whose coefficients reach zero.
    copy_X, copy_Gram : bool, default=True
        Accepted without effect: nothing is overwritten.
    eps : float, default=np.finfo(float).eps
        Accepted for compatibility; a value other than the default is a `NotImplementedError`. Rounding decides which
        columns depend on others.
    verbose : int, default=0
        Print the steps for values above 0.
    return_path : bool, default=True
        Return the whole path instead of its end.
    return_n_iter : bool, default=False
        Also return the number of steps.
    positive : bool, default=False
        Restrict the coefficients to be non-negative (``method="lasso"`` only).

    Returns
    -------
    alphas : ndarray of shape (n_alphas + 1,), or (1,) without `return_path`
        Penalty at the knots, descending.
    active : list of int
        Active columns at the end, in their order of entry.
    coefs : ndarray of shape (n_features, n_alphas + 1), or (n_features,)
        Coefficients at the knots.
    n_iter : int
        Number of steps, with `return_n_iter`.

    Raises
    ------
    ValueError
        A parameter is out of range, or shapes differ.
    FitError
        A value is not finite.

    Warns
    -----
    ConvergenceWarning
        Columns that depend on active ones stay out, or rounding ended the path.

    Examples
    --------
    >>> import numpy as np
    >>> import fleetfoot as ff
    >>> X = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]])
    >>> alphas, active, coefs = ff.lars_path(X, np.array([3.0, 6.0, 0.0]), method="lasso")
    >>> active
    [1, 0]
    >>> np.round(alphas, 6)
    array([2., 1., 0.])
    >>> np.round(coefs, 6)
    array([[0., 0., 3.],
           [0., 3., 6.]])
    """
    given = {name: value for name, value in locals().items() if name in _PATH_RULES}
    check_params("lars_path", _PATH_RULES, **given)
    if X is None and Gram is not None:
        raise ValueError("X cannot be None if Gram is not None: lars_path_gram takes products alone")
    if X is None:
        raise ValueError("X and Gram cannot both be unspecified.")
    if y is None:
        raise ValueError("y cannot be None: give a target (n_samples,)")
    request = path_request(method, positive, alpha_min, max_iter)
    check_eps("lars_path", eps)
    X, y = numbers(X, "X"), numbers(y, "y")
    if X.ndim != 2 or y.ndim != 1 or len(X) != len(y):
        raise ValueError(f"X has the shape {X.shape} and y {y.shape}: give (n_samples, n_features) and (n_samples,)")
    known = [X, y]
    products = known_gram(Gram)
    if products is None and Xy is None:
        path = lars_paths(Design(X, y, few=takes_few(request, X.shape[1])), None, False, request)[0]
    else:
        if products is None:
            products = _wide(X).T @ _wide(X)
        else:
            known.append(products)
        moments = _wide(X).T @ _wide(y) if Xy is None else numbers(Xy, "Xy")
        if Xy is not None:
            known.append(moments)
        path = path_of_products(products, moments, float(_wide(y) @ _wide(y)), len(X), request)
    return _answer(path, _dtype(known), verbose, return_path, return_n_iter)


def lars_path_gram(
    Xy: Any,
    Gram: Any,
    *,
    n_samples: int,
    max_iter: float = 500,
    alpha_min: float = 0,
    method: Literal["lar", "lasso"] = "lar",
    copy_X: bool = True,
    eps: float | None = EPS,
    copy_Gram: bool = True,
    verbose: int = 0,
    return_path: bool = True,
    return_n_iter: bool = False,
    positive: bool = False,
) -> Any:
    """The path of :func:`lars_path` from products, without rows.

    Parameters
    ----------
    Xy : array-like of shape (n_features,)
        ``X.T @ y``.
    Gram : array-like of shape (n_features, n_features)
        ``X.T @ X``. Accuracy falls with the square of the condition number of X.
    n_samples : int
        Number of rows behind the products, which scales the alphas.
    max_iter, alpha_min, method, copy_X, eps, copy_Gram, verbose, return_path, return_n_iter, positive
        As in :func:`lars_path`.

    Returns
    -------
    alphas, active, coefs, n_iter
        As in :func:`lars_path`.

    Raises
    ------
    ValueError
        A parameter is out of range, or shapes differ.
    FitError
        The products are not those of any rows.

    Examples
    --------
    >>> import numpy as np
    >>> import fleetfoot as ff
    >>> alphas, active, coefs = ff.lars_path_gram(np.array([3.0, 6.0]), np.eye(2), n_samples=3, method="lasso")
    >>> np.round(alphas, 6), active
    (array([2., 1., 0.]), [1, 0])
    """
    given = {name: value for name, value in locals().items() if name in _PATH_RULES}
    rules = {**_PATH_RULES, "n_samples": (integer(0),), "Xy": (ARRAY,), "Gram": (ARRAY,)}
    check_params("lars_path_gram", rules, **given, n_samples=n_samples, Xy=Xy, Gram=Gram)
    request = path_request(method, positive, alpha_min, max_iter)
    check_eps("lars_path_gram", eps)
    products, moments = numbers(Gram, "Gram"), numbers(Xy, "Xy")
    path = path_of_products(products, moments, None, n_samples, request)
    return _answer(path, _dtype([products, moments]), verbose, return_path, return_n_iter)


def path_request(method: str, positive: bool, alpha_min: float, max_iter: float) -> LarsRequest:
    """The request to the engine."""
    if method == "lar" and positive:
        raise ValueError("Positive constraint not supported for 'lar' coding method.")
    steps = 2**62 if max_iter == np.inf else int(max_iter)
    return {"lasso": method == "lasso", "positive": bool(positive), "alpha_min": float(alpha_min), "max_iter": steps}


def takes_few(request: LarsRequest, features: int) -> bool:
    """True if a path may end with most features inactive."""
    return request["alpha_min"] > 0.0 or 4 * request["max_iter"] <= features


def check_eps(owner: str, eps: float | None) -> None:
    """Refuses an unsupported regularisation of the factor."""
    if eps is not None and eps != EPS:
        raise NotImplementedError(
            f"eps={eps} of {owner} is not supported: columns that depend on others are known by their rounding, "
            "and no diagonal is regularised; leave eps at its default"
        )


def known_gram(Gram: Any) -> NDArray[Any] | None:
    """A given Gram matrix; `None` for other values of `precompute`."""
    if Gram is None or isinstance(Gram, (bool, np.bool_)) or (isinstance(Gram, str) and Gram == "auto"):
        return None
    if isinstance(Gram, str):
        raise ValueError(f"Gram is {Gram!r}: give 'auto', a bool, None, or X.T @ X")
    return numbers(Gram, "Gram")


def path_of_products(
    gram: NDArray[Any], xy: NDArray[Any], yy: float | None, rows: int, request: LarsRequest
) -> LarsPath:
    """The path of products of `rows` rows."""
    if xy.ndim != 1 or gram.shape != (len(xy), len(xy)):
        raise ValueError("The shapes of the inputs Gram and Xy do not match.")
    return lars_path_of_products(_wide(gram), _wide(xy), yy, float(rows), request)


def centred_paths(
    X: NDArray[Any], y: NDArray[Any], gram: NDArray[Any] | None, Xy: Any, fit_intercept: bool, request: LarsRequest
) -> list[tuple[LarsPath, NDArray[np.float64]]]:
    """Paths of all targets from partly known products, and the intercepts at their knots.

    With an intercept, the products are those of centred columns.
    """
    columns, targets = _wide(X), _wide(y).reshape(len(y), -1)
    means, centre = np.zeros(columns.shape[1]), np.zeros(targets.shape[1])
    if fit_intercept:
        means, centre = columns.mean(axis=0), targets.mean(axis=0)
        columns, targets = columns - means, targets - centre
    gram = columns.T @ columns if gram is None else gram
    moments = columns.T @ targets if Xy is None else _wide(Xy)
    moments = moments.reshape(len(moments), -1)
    if moments.shape[1] != targets.shape[1]:
        raise ValueError(f"Xy is of {moments.shape[1]} targets, and y of {targets.shape[1]}")
    squares = np.einsum("ij,ij->j", targets, targets)
    paths = [path_of_products(gram, moments[:, k], float(squares[k]), len(X), request) for k in range(len(squares))]
    return [(path, centre[k] - path.coefficients @ means) for k, path in enumerate(paths)]


def tell(path: LarsPath, verbose: int) -> None:
    """Warns of dependent columns and rounding, and prints the steps on request."""
    alphas = path.alphas
    if path.stalled:
        warnings.warn(
            f"Early stopping the lars path: at alpha={alphas[-1]:.3e}, after {len(alphas) - 1} steps, nothing is left "
            "but rounding. The path is right down to there",
            ConvergenceWarning,
            stacklevel=3,
        )
    if path.collinear and not path.interpolating:
        names = ", ".join(map(str, path.collinear[:10])) + (", ..." if len(path.collinear) > 10 else "")
        warnings.warn(
            f"Regressors in active set degenerate. Columns {names} are combinations of the active ones up to rounding, "
            "and stay out",
            ConvergenceWarning,
            stacklevel=3,
        )
    if verbose:
        _print_steps(path)


def _print_steps(path: LarsPath) -> None:
    print(f"{'step':>5} {'alpha':>12} {'active':>7}  entered / left")
    before: set[int] = set()
    for step, (alpha, coefficients) in enumerate(zip(path.alphas, path.coefficients)):
        now = {int(j) for j in np.flatnonzero(coefficients)}
        moved = [f"+{j}" for j in sorted(now - before)] + [f"-{j}" for j in sorted(before - now)]
        print(f"{step:>5} {alpha:>12.5g} {len(now):>7}  {' '.join(moved)}")
        before = now


def _answer(path: LarsPath, dtype: Any, verbose: int, return_path: bool, return_n_iter: bool) -> Any:
    tell(path, verbose)
    alphas, coefs = path.alphas.astype(dtype, copy=False), path.coefficients.astype(dtype, copy=False)
    steps = len(alphas) - 1
    answer: tuple[Any, ...] = (alphas, path.active, coefs.T) if return_path else (alphas[-1:], path.active, coefs[-1])
    return (*answer, steps) if return_n_iter else answer


def _dtype(known: list[NDArray[Any]]) -> Any:
    """The common type `float32` or `float64` of all arrays, else `float64`."""
    kinds = {array.dtype for array in known}
    return kinds.pop() if kinds in ({np.dtype(np.float32)}, {np.dtype(np.float64)}) else np.dtype(np.float64)


def _wide(values: NDArray[Any]) -> NDArray[np.float64]:
    return np.asarray(values, dtype=np.float64)
