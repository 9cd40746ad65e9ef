"""Bolasso: every replicate against a lasso of the rows that it drew, by numpy and by scikit-learn."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import fleetfoot as ff

GROUPS = np.repeat(np.arange(25), 8)
BOOTSTRAPS: list[dict[str, Any]] = [
    {"bootstrap": "rows"},
    {"bootstrap": "blocks", "block_length": 7},
    {"bootstrap": "groups"},
]


def problem(targets: int = 1) -> tuple[NDArray[Any], NDArray[Any]]:
    rng = np.random.default_rng(0)
    X = rng.standard_normal((200, 8)) * np.geomspace(0.5, 2.0, 8) + 1.0
    X[:, 3] = X[:, 0] + 0.3 * rng.standard_normal(200)
    Y = np.c_[X[:, 0] - 2.0 * X[:, 5], 300.0 * X[:, 2] - 90.0 * X[:, 7]] + rng.standard_normal((200, 2)) * [1.0, 100.0]
    return X, Y if targets == 2 else Y[:, 0]


def fitted(X: Any, y: Any, weight: Any = None, **options: Any) -> ff.Bolasso:
    model = ff.Bolasso(n_estimators=12, random_state=3, **options)
    return model.fit(X, y, weight, groups=GROUPS if options.get("bootstrap") == "groups" else None)


def violation(
    X: NDArray[Any],
    y: NDArray[Any],
    counts: NDArray[Any],
    coef: NDArray[Any],
    constant: float,
    alpha: float,
    positive: bool,
) -> float:
    """Largest violation of the optimality conditions of the lasso of counted rows, relative to the penalty."""
    share = counts / counts.sum()
    left = y - X @ coef - constant
    gradient = X.T @ (share * left)
    inactive = gradient if positive else np.abs(gradient)
    wrong = np.where(coef != 0.0, np.abs(gradient - alpha * np.sign(coef)), np.maximum(inactive - alpha, 0.0))
    return float(max(wrong.max(), abs(share @ left)) / alpha)


@pytest.mark.parametrize("how", BOOTSTRAPS, ids=lambda how: how["bootstrap"])
@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("positive", [False, True])
def test_replicates_are_lassos_of_their_rows(how: dict[str, Any], weighted: bool, positive: bool) -> None:
    X, Y = problem(2)
    weight = np.random.default_rng(1).uniform(0.2, 2.0, len(X)) if weighted else None
    model = fitted(X, Y, weight, alpha=[0.05, 3.0], positive=positive, **how)
    counts = model.resampling_counts()
    assert counts.shape == (12, 200) and model.coef_samples_.shape == (12, 2, 8)
    counts = counts if weight is None else counts * weight
    for b in range(12):
        for k in range(2):
            replicate = (model.coef_samples_[b, k], model.intercept_samples_[b, k], model.alpha_[k], positive)
            assert violation(X, Y[:, k], counts[b], *replicate) < 1e-9
            assert not positive or (model.coef_samples_[b] >= 0.0).all()
    assert model.kkt_ < 1e-10


@pytest.mark.parametrize("how", BOOTSTRAPS, ids=lambda how: how["bootstrap"])
@pytest.mark.parametrize("rows", [200, 600])
def test_replicates_of_many_features_are_lassos_of_their_rows(how: dict[str, Any], rows: int) -> None:
    """More features than a replicate's products are worth, and fewer or more of them than rows."""
    rng = np.random.default_rng(4)
    X = rng.standard_normal((rows, 530)) + rng.standard_normal((rows, 1)) + 2.0
    Y = np.c_[X[:, 0] - 2.0 * X[:, 500], 300.0 * X[:, 2]] + rng.standard_normal((rows, 2)) * [1.0, 100.0]
    weight = rng.uniform(0.2, 2.0, rows)
    options = {"alpha": [0.3, 30.0], "n_estimators": 3, "random_state": 3, "positive": how["bootstrap"] == "rows", **how}
    groups = np.repeat(np.arange(rows // 8), 8) if how["bootstrap"] == "groups" else None
    model = ff.Bolasso(**options).fit(X, Y, weight, groups=groups)
    for b, counts in enumerate(model.resampling_counts() * weight):
        for k in range(2):
            replicate = (model.coef_samples_[b, k], model.intercept_samples_[b, k], model.alpha_[k], options["positive"])
            assert violation(X, Y[:, k], counts, *replicate) < 1e-8
    assert model.kkt_ < 1e-9
    assert model.support_[1, 2] and not model.support_.all()


@pytest.mark.parametrize("how", BOOTSTRAPS, ids=lambda how: how["bootstrap"])
def test_every_replicate_is_that_of_scikit_learn(how: dict[str, Any]) -> None:
    peer = pytest.importorskip("sklearn.linear_model", reason="scikit-learn, the peer, is not installed")
    X, y = problem()
    for fit_intercept in (True, False):
        model = fitted(X, y, alpha=0.05, fit_intercept=fit_intercept, **how)
        for counts, coef, constant in zip(model.resampling_counts(), model.coef_samples_, model.intercept_samples_):
            drawn = np.repeat(np.arange(len(X)), counts.astype(int))
            lars = peer.LassoLars(alpha=0.05, fit_intercept=fit_intercept).fit(X[drawn], y[drawn])
            np.testing.assert_allclose(coef, lars.coef_, rtol=0, atol=1e-9)
            np.testing.assert_allclose(constant, lars.intercept_, rtol=0, atol=1e-9)


@pytest.mark.parametrize("how", BOOTSTRAPS, ids=lambda how: how["bootstrap"])
@pytest.mark.parametrize("weighted", [False, True])
def test_support_holds_frequent_columns(how: dict[str, Any], weighted: bool) -> None:
    X, Y = problem(2)
    weight = np.random.default_rng(1).uniform(0.2, 2.0, len(X)) if weighted else None
    model = fitted(X, Y, weight, alpha=[0.05, 3.0], threshold=0.75, **how)
    selected = model.coef_samples_ != 0.0
    np.testing.assert_allclose(model.selection_frequency_, selected.mean(axis=0), rtol=1e-15)
    signs = np.sign(model.coef_samples_).sum(axis=0) / np.maximum(selected.sum(axis=0), 1)
    np.testing.assert_allclose(model.selection_sign_, signs, rtol=1e-15)
    np.testing.assert_array_equal(model.support_, selected.sum(axis=0) >= 9)
    root = np.ones(len(X)) if weight is None else np.sqrt(weight)
    for k in range(2):
        kept = np.flatnonzero(model.support_[k])
        assert 0 < len(kept) < 8
        design = root[:, None] * np.c_[X[:, kept], np.ones(len(X))]
        wanted = np.linalg.lstsq(design, root * Y[:, k], rcond=None)[0]
        np.testing.assert_allclose(model.coef_[k, kept], wanted[:-1], rtol=1e-9)
        np.testing.assert_allclose(model.intercept_[k], wanted[-1], rtol=1e-8)
        assert not model.coef_[k, ~model.support_[k]].any()
    np.testing.assert_array_equal(model.get_support(), model.support_)
    np.testing.assert_array_equal(model.get_support(indices=True)[1], np.flatnonzero(model.support_[1]))
    np.testing.assert_allclose(model.predict(X), X @ model.coef_.T + model.intercept_)


def test_targets_share_only_drawn_rows() -> None:
    X, Y = problem(2)
    together = fitted(X, Y, alpha=[0.05, 3.0])
    for k, alpha in enumerate([0.05, 3.0]):
        alone = fitted(X, Y[:, k], alpha=alpha)
        assert alone.coef_samples_.shape == (12, 8) and alone.alpha_ == alpha
        size = np.abs(alone.coef_samples_).max()
        np.testing.assert_allclose(together.coef_samples_[:, k], alone.coef_samples_, rtol=0, atol=1e-10 * size)
        np.testing.assert_array_equal(together.selection_frequency_[k], alone.selection_frequency_)
        np.testing.assert_allclose(together.coef_[k], alone.coef_, rtol=1e-9)


def test_seed_decides_drawn_rows() -> None:
    X, y = problem()
    first, second = (ff.Bolasso(n_estimators=40, alpha=0.05, random_state=seed).fit(X, y) for seed in (3, 4))
    again = ff.Bolasso(n_estimators=40, alpha=0.05, random_state=3).fit(np.asfortranarray(X), y)
    np.testing.assert_array_equal(first.coef_samples_, again.coef_samples_)
    assert (first.resampling_counts() != second.resampling_counts()).any()
    fewer = ff.Bolasso(n_estimators=5, alpha=0.05, random_state=3).fit(X, y)
    np.testing.assert_array_equal(fewer.resampling_counts(), first.resampling_counts()[:5])
    np.testing.assert_allclose(fewer.coef_samples_, first.coef_samples_[:5], rtol=1e-12)
    counts = first.resampling_counts()
    # Poisson counts of mean 1 and variance 1: 8000 of them, within five standard errors.
    assert abs(counts.mean() - 1.0) < 5.0 / np.sqrt(counts.size)
    assert abs(counts.var() - 1.0) < 5.0 * np.sqrt(3.0 / counts.size)
    units = fitted(X, y, alpha=0.05, bootstrap="groups").resampling_counts()[:, ::8]
    assert (units.sum(axis=1) == 25).all()


def test_a_criterion_chooses_the_penalty() -> None:
    peer = pytest.importorskip("sklearn.linear_model", reason="scikit-learn, the peer, is not installed")
    X, Y = problem(2)
    rows = len(X)
    for criterion, price in (("aic", 2.0), ("bic", np.log(rows))):
        model = fitted(X, Y, alpha=criterion)
        for k in range(2):
            alphas, _, coefs = peer.lars_path(X - X.mean(0), Y[:, k] - Y[:, k].mean(), method="lasso")
            left = (Y[:, k] - Y[:, k].mean())[:, None] - (X - X.mean(0)) @ coefs
            scores = rows * np.log(np.mean(left**2, axis=0)) + price * (coefs != 0.0).sum(axis=0)
            assert model.alpha_[k] == pytest.approx(alphas[np.argmin(scores)], rel=1e-9, abs=1e-12)


def test_single_precision_and_values() -> None:
    X, y = problem()
    model = fitted(X.astype(np.float32), y.astype(np.float32), alpha=0.05)
    assert model.coef_.dtype == np.float32
    again = pickle.loads(pickle.dumps(model))
    np.testing.assert_array_equal(again.resampling_counts(), model.resampling_counts())
    np.testing.assert_array_equal(again.predict(X), model.predict(X))


def test_wrong_arguments_are_refused() -> None:
    X, y = problem()
    with pytest.raises(ValueError, match="groups"):
        ff.Bolasso(bootstrap="groups").fit(X, y)
    with pytest.raises(ValueError, match="sort"):
        ff.Bolasso(bootstrap="groups").fit(X, y, groups=np.arange(200) % 3)
    with pytest.raises(ValueError, match="bootstrap"):
        ff.Bolasso().fit(X, y, groups=GROUPS)
    with pytest.raises(ValueError, match="2 values for 1 targets"):
        ff.Bolasso(alpha=[1.0, 2.0]).fit(X, y)
    with pytest.raises(ValueError, match="threshold"):
        ff.Bolasso(threshold=0.0).fit(X, y)
    with pytest.raises(ValueError, match="alpha"):
        ff.Bolasso(alpha=[-1.0]).fit(X, y)
    with pytest.raises(ValueError, match="fit"):
        ff.Bolasso().get_support()
