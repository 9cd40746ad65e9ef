"""The path of several targets with one support for all: the multi-task lasso and elastic net."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import _core
from ._descent import Posed, grid


class TaskPath(NamedTuple):
    """Solutions of all targets together."""

    alphas: NDArray[np.float64]
    #: Coefficients (n_targets, n_features, n_alphas).
    coefs: NDArray[np.float64]
    #: Duality gaps in the units of the objective (n_alphas,).
    gaps: NDArray[np.float64]
    #: Sweeps (n_alphas,).
    sweeps: list[int]


class Tasks:
    """Minimises ``1 / (2 n) |Y - X W'|^2 + alpha l1_ratio sum_j |W_j| + alpha (1 - l1_ratio) / 2 |W|^2``.

    `W_j` are the coefficients of feature j for all targets. This is a group lasso on the stacked coefficients of all
    targets, with one group per feature. The elastic net needs the Gram matrix, as its squares are added to the
    products of the columns.
    """

    def __init__(self, X: Any, y: NDArray[Any], posed: Posed, l1_ratio: float, options: dict[str, Any]) -> None:
        self._features, self._targets = X.shape[1], y.shape[1]
        self._rows, self._l1_ratio = float(X.shape[0]), l1_ratio
        groups = np.tile(np.arange(self._features), self._targets).tolist()
        weights = np.ones(self._features).tolist()
        self._estimator = _core.Estimator.group_lasso(groups, weights, 0.0, options["max_iter"])
        self._options = options
        self._lasso = posed.problems.joined()
        self._products: tuple[NDArray[np.float64], ...] | None = None
        if l1_ratio < 1.0:
            wide, target = _float(X), _float(y)
            gram = wide.T @ wide
            self._products = (
                np.asarray(gram.toarray() if hasattr(gram, "toarray") else gram),
                np.asfortranarray(wide.T @ target),
                np.einsum("ij,ij->j", target, target),
            )

    def largest_alpha(self) -> float:
        """The least alpha at which all coefficients are zero."""
        if self._l1_ratio == 0:
            raise ValueError(
                "Automatic alpha grid generation is not supported for l1_ratio=0. Please supply a grid by providing "
                "your estimator with the appropriate `alphas=` argument."
            )
        return self._lasso.largest_alpha(0, self._estimator, False) / self._l1_ratio

    def path(self, alphas: int | NDArray[np.float64], eps: float, start: NDArray[np.float64] | None) -> TaskPath:
        """The solutions at these alphas, or at a number of alphas down to `eps` times the largest, descending."""
        if isinstance(alphas, int):
            alphas = grid(self.largest_alpha(), eps, alphas)
        paths = []
        if self._products is None:
            paths = [self._solve(self._lasso, alphas, start)]
        else:
            for alpha in alphas:
                solved = self._solve(self._ridged(alpha), np.array([self._l1_ratio * alpha]), start)
                paths.append(solved)
                start = solved.coefs[-1]
        coefs = np.concatenate([one.coefs for one in paths]).reshape(len(alphas), self._targets, self._features)
        gaps = np.concatenate([one.gaps for one in paths])
        sweeps = [count for one in paths for count in one.sweeps]
        return TaskPath(alphas, np.moveaxis(coefs, 0, -1), gaps, sweeps)

    def _solve(self, problems: _core.Problems, alphas: NDArray[np.float64], start: Any) -> Any:
        joined = Posed(problems, None, None)
        return joined.solve(0, alphas, estimator=self._estimator, positive=False, start=start, **self._options)

    def _ridged(self, alpha: float) -> _core.Problems:
        """The problem with the squares at one alpha."""
        assert self._products is not None
        gram, products, squares = self._products
        ridge = self._rows * alpha * (1.0 - self._l1_ratio)
        ridged = gram + ridge * np.eye(self._features)
        return _core.Problems.products(ridged, products, squares, self._rows).joined()


def _float(values: Any) -> Any:
    return values.astype(np.float64)
