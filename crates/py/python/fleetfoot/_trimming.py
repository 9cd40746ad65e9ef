"""SR3 with trimming of the worst-fitting rows, as in pysindy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ._core import Design, sr3
from ._requests import Sr3Request

__all__ = ["Trimmed", "on_capped_simplex", "trimmed"]


@dataclass(frozen=True)
class Trimmed:
    """The result of :class:`fleetfoot._core.SparseModels`, and the remaining weights of the rows."""

    coefficients: NDArray[np.float64]
    decided: NDArray[np.float64]
    history: NDArray[np.float64]
    relaxed: NDArray[np.float64]
    iterations: int
    converged: bool
    shares: NDArray[np.float64]


def trimmed(
    X: NDArray[np.float64],
    y: NDArray[np.float64],
    request: Sr3Request,
    weights: NDArray[np.float64],
    start: NDArray[np.float64],
    fraction: float,
    step_size: float,
) -> Trimmed:
    """Alternates one iteration of SR3 on weighted rows with a step of their weights.

    Minimises SR3's objective with every row's squared error times its share s over 0 <= s <= 1 that sum to
    ``(1 - fraction) n``: a projected gradient step of length `step_size` in s after each iteration (Champion, Zheng,
    Aravkin, Brunton, Kutz 2020, section III.B). X (n_samples, n_features) and y (n_samples, n_targets) with the roots
    of the rows' weights in them, penalties `weights` and `start` (n_targets, n_features). Every iteration reads the rows.
    """
    once: Sr3Request = {**request, "max_iter": 1, "normalize": False, "unbias": False}
    shares = np.full(len(X), 1.0 - fraction)
    sparse = relaxed = start
    history = [start]
    converged = False
    while not converged and len(history) <= request["max_iter"]:
        errors = 0.5 * ((y - X @ relaxed.T) ** 2).sum(axis=1)
        solved = sr3(Design(X, y, shares), once, weights, sparse)
        sparse, relaxed, before = solved.coefficients, solved.relaxed, sparse
        kept, shares = shares, on_capped_simplex(shares - step_size * errors, fraction)
        history.append(sparse)
        moved = float(np.linalg.norm(sparse - before)) / request["nu"] + float(np.linalg.norm(shares - kept)) / step_size
        converged = moved < request["tol"]
    return Trimmed(sparse, sparse, np.array(history), relaxed, len(history) - 1, converged, shares)


def on_capped_simplex(values: NDArray[np.float64], fraction: float) -> NDArray[np.float64]:
    """The nearest point (n,) with entries in [0, 1] that sum to ``(1 - fraction) n``.

    It is ``clip(values - x, 0, 1)``, whose sum is piecewise linear in x with breakpoints at the entries and the
    entries less one. Sorting them gives the piece with the required sum.
    """
    wanted = (1.0 - fraction) * len(values)
    ends = np.concatenate([values - 1.0, values])
    order = np.argsort(ends, kind="stable")
    ends = ends[order]
    # Entries strictly between 0 and 1 behind each end.
    between = np.cumsum(np.where(order < len(values), 1, -1))
    sums = len(values) - np.concatenate([[0.0], np.cumsum(between[:-1] * np.diff(ends))])
    rounding = 1e-12 * len(values)
    at = int(np.argmax(sums <= wanted + rounding))
    if sums[at] < wanted - rounding:
        shift = ends[at - 1] + (sums[at - 1] - wanted) / between[at - 1]
    elif between[at] == 0 and at + 1 < len(ends):
        # Level: anywhere in the piece whole rows are kept, and whole ones given up.
        shift = 0.5 * (ends[at] + ends[at + 1])
    else:
        shift = ends[at]
    clipped: NDArray[np.float64] = np.clip(values - shift, 0.0, 1.0)
    return clipped
