"""Shared code of coordinate descent: problems, solutions, and warnings of convergence."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import _core
from ._arrays import floats, numbers
from ._base import ConvergenceWarning, is_sparse

#: The smallest alpha that a grid starts from: that of a target which no feature explains.
RESOLUTION = float(np.finfo(np.float64).resolution)


class Solved(NamedTuple):
    """Solutions of one target at some alphas."""

    #: Coefficients (n_alphas, n_features).
    coefs: NDArray[np.float64]
    #: Intercepts (n_alphas,).
    intercepts: NDArray[np.float64]
    #: Duality gaps in the units of the objective (n_alphas,).
    gaps: NDArray[np.float64]
    #: Sweeps over the coordinates (n_alphas,).
    sweeps: list[int]


class Posed(NamedTuple):
    """The least-squares problems of all targets, compressed."""

    problems: _core.Problems
    #: Means of the features, where the problems are given as products of centred columns.
    offset: NDArray[np.float64] | None
    #: Means of the targets, likewise.
    target_offset: NDArray[np.float64] | None

    def solve(
        self,
        target: int,
        alphas: Sequence[float] | NDArray[np.float64],
        *,
        estimator: _core.Estimator,
        positive: bool,
        max_iter: int,
        tol: float,
        start: NDArray[Any] | None = None,
    ) -> Solved:
        """Solves one target at all alphas, each from the previous one; a missed tolerance is a
        `ConvergenceWarning`."""
        strengths = np.ascontiguousarray(alphas, dtype=np.float64)
        first = None if start is None else np.ascontiguousarray(start, dtype=np.float64)
        solutions = self.problems.descend(target, strengths, estimator, positive, first)
        coefs, intercepts, gaps, relative, sweeps, converged = solutions
        # A gap of `tol` times the target's mean square is what scikit-learn asks for; the engine asks for more.
        missed = ~converged & ~(relative <= tol)
        if missed.any():
            worst = int(np.argmax(np.where(missed, relative, -np.inf)))
            warnings.warn(
                "Objective did not converge. You might want to increase the number of iterations. "
                f"At alpha = {strengths[worst]:.6g} the duality gap is {relative[worst]:.3g} of the target's mean "
                f"square after {sweeps[worst]} of at most max_iter = {max_iter} sweeps; tol = {tol:g}",
                ConvergenceWarning,
                stacklevel=3,
            )
        if self.offset is not None and self.target_offset is not None:
            intercepts = self.target_offset[target] - coefs @ self.offset
        return Solved(coefs, intercepts, gaps, sweeps)


def pose(
    X: NDArray[Any],
    y: NDArray[Any],
    weight: NDArray[np.float64] | None,
    *,
    intercept: bool,
    precompute: Any = False,
    Xy: Any = None,
    check_gram: bool = True,
    few: bool = False,
) -> Posed:
    """Compresses X and y (n_samples,) or (n_samples, n_targets) in one pass, or takes a Gram matrix in place of X.

    For `few` solutions, many columns are not compressed.
    """
    gram = given_gram(X, weight, precompute, intercept=intercept, check=check_gram)
    if gram is None:
        return Posed(_core.Problems.of(_core.Design(X, y, weight, few=few), None, intercept), None, None)
    rows = X.shape[0]
    # As in the Gram matrix, the weights sum to the number of rows.
    scaled = None if weight is None else weight * (rows / weight.sum())
    offset = np.average(X, axis=0, weights=scaled).astype(np.float64) if intercept else np.zeros(X.shape[1])
    targets = floats(y, "y").reshape(rows, -1)
    target_offset = np.average(targets, axis=0, weights=scaled) if intercept else np.zeros(targets.shape[1])
    left = targets - target_offset
    right = left if scaled is None else left * scaled[:, None]
    if Xy is None:
        products = X.T @ right
    else:
        products = floats(Xy, "Xy").reshape(X.shape[1], -1)
        if products.shape[1] != targets.shape[1]:
            raise ValueError(f"Xy has {products.shape[1]} columns and y has {targets.shape[1]}: give X.T @ y")
    squares = np.einsum("ij,ij->j", left, right)
    problems = _core.Problems.products(gram, np.asfortranarray(products, dtype=np.float64), squares, float(rows))
    return Posed(problems, offset, target_offset)


def given_gram(
    X: NDArray[Any], weight: NDArray[np.float64] | None, precompute: Any, *, intercept: bool, check: bool
) -> NDArray[np.float64] | None:
    """The Gram matrix of `precompute`, if it matches the rows.

    With an intercept, a matrix of uncentred columns is ignored with a `UserWarning`. A matrix that is not that of X
    is a `ValueError`. For sparse rows the products are always recomputed.
    """
    if isinstance(precompute, (bool, np.bool_, str)) or is_sparse(X):
        return None
    gram = numbers(precompute, "precompute")
    features = X.shape[1]
    if gram.shape != (features, features):
        raise ValueError(
            f"precompute has the shape {gram.shape}: the Gram matrix of {features} features is {features} x {features}"
        )
    offset = np.average(X, axis=0, weights=weight) if intercept else np.zeros(features)
    if intercept and not np.allclose(offset, 0.0):
        warnings.warn(
            "Gram matrix was provided but X was centered to fit intercept: recomputing Gram matrix.",
            UserWarning,
            stacklevel=4,
        )
        return None
    if check:
        _compare(X, weight, gram, offset)
    return np.ascontiguousarray(gram, dtype=np.float64)


def _compare(X: NDArray[Any], weight: NDArray[np.float64] | None, gram: NDArray[Any], offset: NDArray[Any]) -> None:
    """Compares one entry of a Gram matrix with that of the rows."""
    features = X.shape[1]
    i = features // 2
    j = min(i + 1, features - 1)
    scaled = np.ones(len(X)) if weight is None else weight * (len(X) / weight.sum())
    a, b = (np.asarray(X[:, column], dtype=np.float64) - offset[column] for column in (i, j))
    expected = float(np.dot(scaled * a, b))
    rough = np.float32 in (gram.dtype, X.dtype)
    if not np.isclose(expected, gram[i, j], rtol=1e-4 if rough else 1e-7, atol=1e-5):
        raise ValueError(
            f"Gram matrix given as `precompute` did not pass validation: entry ({i}, {j}) is {gram[i, j]}, and {expected} "
            "of the rows; with an intercept it is that of the centred columns, with weights that of the rows times the "
            "roots of the weights, which sum to the number of rows"
        )


def grid(largest: float, eps: float, count: int) -> NDArray[np.float64]:
    """`count` alphas in equal factors from `largest` down to `eps` times that."""
    if largest <= RESOLUTION:
        return np.full(count, RESOLUTION)
    return np.geomspace(largest, largest * eps, num=count)


def largest_alpha(problems: _core.Problems, l1_ratio: float, positive: bool) -> float:
    """The least alpha at which all coefficients of the first target are zero."""
    if l1_ratio == 0:
        raise ValueError(
            "Automatic alpha grid generation is not supported for l1_ratio=0. Please supply a grid by providing your "
            "estimator with the appropriate `alphas=` argument."
        )
    return problems.largest_alpha(0, _core.Estimator.elastic_net(1.0, 1), positive) / l1_ratio
