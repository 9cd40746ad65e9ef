"""Calls of a notebook with every estimator, on the arrays and tables of every library alike: the same coefficients, to the bit."""

from __future__ import annotations

import inspect
import warnings
from typing import Any

import numpy as np
import pytest

import fleetfoot as ff
from fleetfoot._base import BaseEstimator

pd = pytest.importorskip("pandas", reason="pandas is not installed")
pl = pytest.importorskip("polars", reason="polars is not installed")
pa = pytest.importorskip("pyarrow", reason="pyarrow is not installed")
xr = pytest.importorskip("xarray", reason="xarray is not installed")

NAMES = ["speed", "slope", "load", "heat", "wear", "age"]
GROUPS = [0, 0, 1, 1, 2, 2]
RANDOM = np.random.default_rng(21)
X = RANDOM.standard_normal((240, len(NAMES)))
TARGET = 1.0 + X @ [2.0, 0.0, -1.0, 0.0, 0.5, 0.0] + np.abs(X[:, 0]) + 0.1 * RANDOM.standard_normal(len(X))

#: X and y as each library holds them.
KINDS = {
    "numpy, Fortran": lambda: (np.asfortranarray(X), TARGET),
    "pandas": lambda: (pd.DataFrame(X, columns=NAMES), pd.Series(TARGET, name="effort")),
    "polars": lambda: (pl.DataFrame(X, schema=NAMES), pl.Series("effort", TARGET)),
    "xarray": lambda: (
        xr.DataArray(X, dims=("row", "column"), coords={"column": NAMES}),
        xr.DataArray(TARGET, dims="row"),
    ),
    "Arrow": lambda: (pa.table({name: X[:, k] for k, name in enumerate(NAMES)}), pa.chunked_array([TARGET])),
}

#: The estimators on rows, each as a notebook would make it. Those of recordings have their tables in test_tables.py.
ESTIMATORS: dict[str, Any] = {
    "Bolasso": lambda: ff.Bolasso(n_estimators=8, random_state=0),
    "ElasticNet": lambda: ff.ElasticNet(0.1),
    "ElasticNetCV": lambda: ff.ElasticNetCV(alphas=20, cv=4),
    "FROLS": lambda: ff.FROLS(max_iter=4),
    "GroupLasso": lambda: ff.GroupLasso(groups=GROUPS, alpha=0.1),
    "GroupLassoCV": lambda: ff.GroupLassoCV(groups=GROUPS, alphas=20, cv=4),
    "KMeans": lambda: ff.KMeans(3, random_state=0),
    "Lars": lambda: ff.Lars(n_nonzero_coefs=3),
    "Lasso": lambda: ff.Lasso(0.1),
    "LassoCV": lambda: ff.LassoCV(alphas=20, cv=4),
    "LassoLars": lambda: ff.LassoLars(0.1),
    "LassoLarsCV": lambda: ff.LassoLarsCV(cv=4),
    "LassoLarsIC": lambda: ff.LassoLarsIC(),
    "PWARegressor": lambda: ff.PWARegressor(n_regions=2, random_state=0),
    "SR3": lambda: ff.SR3(reg_weight_lam=0.05),
    "STLSQ": lambda: ff.STLSQ(threshold=0.2),
    "SparseGroupLasso": lambda: ff.SparseGroupLasso(groups=GROUPS, alpha=0.1),
    "SparseGroupLassoCV": lambda: ff.SparseGroupLassoCV(groups=GROUPS, alphas=20, cv=4),
}
ON_RECORDINGS = {"SINDy", "PWA", "NARX", "Network", "BlockSparse", "Parameters"}


def notebook(make: Any, X: Any, y: Any) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Fit, look; predict, score."""
    model = make().fit(X, y)
    results = [model.cluster_centers_] if isinstance(model, ff.KMeans) else [model.coef_]
    if hasattr(model, "intercept_"):
        results.append(model.intercept_)
    return [np.asarray(value) for value in results], [np.asarray(model.predict(X)), np.asarray(model.score(X, y))]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("make", ESTIMATORS.values(), ids=ESTIMATORS)
def test_every_library_gives_the_same_coefficients(make: Any, kind: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        expected = notebook(make, X, TARGET)
        results = notebook(make, *KINDS[kind]())
    for a, b in zip(results[0], expected[0], strict=True):
        np.testing.assert_array_equal(a, b)
    # numpy multiplies rows in another order of memory in another order.
    for a, b in zip(results[1], expected[1], strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("make", ESTIMATORS.values(), ids=ESTIMATORS)
def test_names_of_columns_are_kept(make: Any) -> None:
    frame, y = KINDS["pandas"]()
    model = make().fit(frame, y)
    if hasattr(model, "feature_names_in_"):
        assert list(model.feature_names_in_) == NAMES


def test_no_estimator_is_left_out() -> None:
    exported = (getattr(ff, name) for name in ff.__all__)
    estimators = {one.__name__ for one in exported if inspect.isclass(one) and issubclass(one, BaseEstimator)}
    assert estimators == set(ESTIMATORS) | ON_RECORDINGS
