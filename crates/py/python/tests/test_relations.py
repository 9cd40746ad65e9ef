"""Correlations and lag curves beside numpy."""

from __future__ import annotations

import numpy as np
import pytest

import fleetfoot as ff


def runs() -> list[np.ndarray]:
    random = np.random.default_rng(4)
    episodes = []
    for rows in (700, 300):
        r = np.repeat(random.normal(size=rows // 50), 50)
        v = np.zeros(rows)
        for k in range(1, rows):
            v[k] = v[k - 1] + 0.1 * (r[max(k - 5, 0)] - v[k - 1])
        episodes.append(np.column_stack([r, v, 1e6 + random.normal(size=rows) - v]))
    return episodes


def opened(arrays: list[np.ndarray]) -> ff.Dataset:
    data = [ff.open(dict(zip("rvw", run.T, strict=True)), dt=0.02) for run in arrays]
    return data[0] + data[1]


def test_correlations_equal_numpys():
    arrays = runs()
    report = ff.correlations(opened(arrays), ["r", "v", "w"])
    np.testing.assert_allclose(report["matrix"], np.corrcoef(np.vstack(arrays).T), rtol=1e-8)
    assert report["rows"] == 1000
    gap = np.array([1.0, np.nan, 2.0, 5.0, 3.0])
    other = np.array([2.0, 9.0, np.nan, 1.0, 0.0])
    both = ff.correlations(ff.open({"a": gap, "b": other, "c": np.ones(5)}, dt=0.1), ["a", "b", "c"])["matrix"]
    kept = np.isfinite(gap) & np.isfinite(other)
    np.testing.assert_allclose(both[0][1], np.corrcoef(gap[kept], other[kept])[0, 1], rtol=1e-12)
    assert both[0][2] is None
    with pytest.raises(ff.exceptions.FleetfootError, match="q"):
        ff.correlations(opened(arrays), ["r", "q"])


def test_lag_curves_equal_numpys_within_episodes():
    arrays = runs()
    curve = ff.lag_curve(opened(arrays), "r", "v", reach=30)
    assert [one["rows"] for one in curve["shifts"]] == list(range(-30, 31))
    for one in curve["shifts"]:
        k = one["rows"]
        pairs = [
            (run[: len(run) - k, 0], run[k:, 1]) if k >= 0 else (run[-k:, 0], run[: len(run) + k, 1]) for run in arrays
        ]
        a, b = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
        assert one["pairs"] == a.size
        np.testing.assert_allclose(one["difference"], np.abs(b - a).mean(), rtol=1e-10)
        np.testing.assert_allclose(one["deviation"], np.abs(b - a).std(), rtol=1e-8)
        np.testing.assert_allclose(one["correlation"], np.corrcoef(a, b)[0, 1], rtol=1e-8)
    best = min(curve["shifts"], key=lambda one: one["difference"])
    assert curve["nearest"] == best["rows"] > 5
    with pytest.raises(ff.exceptions.FleetfootError, match="longest"):
        ff.lag_curve(opened(arrays), "r", "v", reach=5000)
