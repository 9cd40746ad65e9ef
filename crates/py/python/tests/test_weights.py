"""The scale of weights says nothing: an estimator finds the same whether they are counts or shares."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest

import fleetfoot as ff

RANDOM = np.random.default_rng(17)
X = RANDOM.uniform(-1.0, 1.0, (400, 3))
#: Four regions of the first two columns.
TARGET = np.where(X[:, 0] > 0, 3.0, -2.0) * X[:, 1] + np.where(X[:, 1] > 0.1, 2.0, 0.0) * X[:, 0] + 0.5 * X[:, 2]
WEIGHTS = {"equal": np.ones(400), "graded": RANDOM.uniform(0.2, 3.0, 400), "some zero": (np.arange(400) % 3 > 0) * 1.0}
SCALES = [1e-9, 1.0 / 400.0, 7.0, 1e9]
ESTIMATORS: dict[str, Any] = {
    "refined": lambda: ff.PWARegressor(4, partition="refined", random_state=0),
    "kmeans, chosen": lambda: ff.PWARegressor([1, 2, 4], random_state=0),
    "kmeans, shrunk": lambda: ff.PWARegressor(4, shrinkage=3.0, random_state=0),
    "tree": lambda: ff.PWARegressor(4, partition="tree", random_state=0),
    "bic": lambda: ff.PWARegressor([1, 2, 4], selection="bic", random_state=0),
    "Lasso": lambda: ff.Lasso(0.01),
    "ElasticNet": lambda: ff.ElasticNet(0.01),
    "GroupLasso": lambda: ff.GroupLasso(groups=[0, 0, 1], alpha=0.01),
    "LassoCV": lambda: ff.LassoCV(alphas=8, cv=4),
    # The ridge of pysindy's optimizers stands against sums of squares, not means: without it scales say nothing.
    "STLSQ": lambda: ff.STLSQ(0.1, alpha=0.0),
    "FROLS": lambda: ff.FROLS(max_iter=2),
    "KMeans": lambda: ff.KMeans(3, random_state=0),
}


def predicted(make: Any, weight: np.ndarray | None) -> np.ndarray:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = make()
        fitted = model.fit(X, sample_weight=weight) if isinstance(model, ff.KMeans) else model.fit(X, TARGET, weight)
    return np.asarray(fitted.predict(X), dtype=float)


@pytest.mark.parametrize("weight", WEIGHTS.values(), ids=WEIGHTS)
@pytest.mark.parametrize("make", ESTIMATORS.values(), ids=ESTIMATORS)
def test_scale_of_weights_changes_nothing(make: Any, weight: np.ndarray) -> None:
    expected = predicted(make, weight)
    for scale in SCALES:
        np.testing.assert_allclose(predicted(make, scale * weight), expected, rtol=1e-6, atol=1e-6, err_msg=f"{scale}")


def test_weights_of_shares_find_all_regions() -> None:
    for partition in ("refined", "tree"):
        make = ff.PWARegressor(4, partition=partition, random_state=0)
        plain = make.fit(X, TARGET).n_regions_
        shares = make.fit(X, TARGET, np.full(400, 1.0 / 400.0))
        assert shares.n_regions_ == plain and shares.score(X, TARGET) > 0.9, partition
