"""The group lasso and the sparse-group lasso: optimality from the rows, limits, and peers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import fleetfoot as ff

GROUPS = np.array([0, 1, 0, 2, 2, 1, 0, 2, 3, 3])


def made(seed: int = 0, rows: int = 200, targets: int | None = None) -> tuple[Any, Any]:
    rng = np.random.default_rng(seed)
    X = rng.standard_normal((rows, len(GROUPS)))
    X[:, 1:] += 0.6 * X[:, :-1]
    X = X * 10.0 ** rng.uniform(-1, 1, len(GROUPS)) + 2.0
    truth = np.where(np.isin(GROUPS, (0, 3)), rng.standard_normal(len(GROUPS)), 0.0) / X.std(axis=0)
    shape = rows if targets is None else (rows, targets)
    y = X @ truth
    y = y if targets is None else np.outer(y, np.linspace(-1.0, 2.0, targets))
    return X, y + 0.5 * rng.standard_normal(shape) + 3.0


def violation(X: Any, y: Any, model: Any, alpha: float, ratio: float, weights: Any, sample_weight: Any = None) -> float:
    """Distance of coefficients from optimality, relative to the largest gradient at zero."""
    s = np.ones(len(X)) if sample_weight is None else sample_weight
    s = s / s.sum()
    coef = np.atleast_2d(model.coef_)
    Y = y.reshape(len(y), -1)
    left = Y - X @ coef.T - np.atleast_1d(model.intercept_)
    centred, first = X - s @ X, Y - s @ Y
    gradient = (left * s[:, None]).T @ centred
    scale = np.abs((first * s[:, None]).T @ centred).max()
    worst = np.abs(s @ left).max() / scale
    for group, weight in enumerate(weights):
        members = np.asarray(model.groups_) == group
        b, g = coef[:, members], gradient[:, members]
        beyond = np.sign(g) * np.maximum(np.abs(g) - alpha * ratio, 0.0)
        limit = alpha * (1.0 - ratio) * weight
        if not b.any():
            worst = max(worst, (np.linalg.norm(beyond) - limit) / scale)
            continue
        wanted = alpha * ratio * np.sign(b) + limit * b / np.linalg.norm(b)
        worst = max(worst, np.abs(np.where(b == 0.0, beyond, g - wanted)).max() / scale)
    return float(worst)


@pytest.mark.parametrize("ratio", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("targets", [None, 1, 3])
@pytest.mark.parametrize("weighted", [False, True])
def test_solutions_are_optimal_on_the_rows(ratio: float, targets: int | None, weighted: bool) -> None:
    X, y = made(targets=targets)
    sample_weight = np.random.default_rng(1).uniform(0.1, 2.0, len(X)) if weighted else None
    weights = np.sqrt(np.bincount(GROUPS))
    for alpha in (0.01, 0.1, 1.0):
        model = ff.SparseGroupLasso(GROUPS, alpha, l1_ratio=ratio).fit(X, y, sample_weight)
        assert violation(X, y, model, alpha, ratio, weights, sample_weight) < 1e-8
        assert model.coef_.shape == ((len(GROUPS),) if targets in (None, 1) else (targets, len(GROUPS)))
        assert np.shape(model.intercept_) == (() if targets is None else (targets,))
        assert abs(model.dual_gap_) < 1e-9 * np.var(y, axis=0).sum()
        assert np.shape(model.predict(X)) in (np.shape(y), (len(X),))


def test_limits_are_the_lasso() -> None:
    X, y = made(3)
    lasso = ff.Lasso(0.05).fit(X, y)
    for model in (ff.GroupLasso(1, 0.05), ff.SparseGroupLasso(GROUPS, 0.05, l1_ratio=1.0)):
        assert np.allclose(model.fit(X, y).coef_, lasso.coef_, rtol=1e-8, atol=1e-10)
        assert np.isclose(model.intercept_, lasso.intercept_, rtol=1e-10)


def test_labels_sizes_weights_and_starts() -> None:
    X, y = made(4)
    by_size = ff.GroupLasso(5, 0.1).fit(X, y)
    by_name = ff.GroupLasso(["b"] * 5 + ["c"] * 5, 0.1).fit(X, y)
    assert np.array_equal(by_size.coef_, by_name.coef_)
    assert by_name.groups_.tolist() == [0] * 5 + [1] * 5
    free = ff.GroupLasso(5, 0.3, weights=[0.0, 2.0]).fit(X, y)
    assert free.coef_[:5].all()
    assert violation(X, y, free, 0.3, 0.0, [0.0, 2.0]) < 1e-8
    again = ff.GroupLasso(5, 0.1, warm_start=True).fit(X, y)
    assert again.fit(X, y).n_iter_ == 0
    positive = ff.SparseGroupLasso(GROUPS, 0.01, positive=True).fit(X, y)
    assert (positive.coef_ >= 0.0).all() and positive.coef_.any()


def test_values_out_of_range_are_refused() -> None:
    X, y = made()
    for model, word in [
        (ff.GroupLasso([0, 1]), "one label a feature"),
        (ff.GroupLasso(0), "groups"),
        (ff.GroupLasso(5, weights=[1.0]), "one weight a group"),
        (ff.GroupLasso(5, weights=[1.0, -1.0]), "not negative"),
        (ff.SparseGroupLasso(5, l1_ratio=1.5), "l1_ratio"),
        (ff.GroupLasso(5, -1.0), "alpha"),
        (ff.SparseGroupLassoCV(5, l1_ratio=[2.0]), "l1_ratio"),
    ]:
        with pytest.raises(ValueError, match=word):
            model.fit(X, y)  # type: ignore[attr-defined]


def test_cross_validation_is_that_of_the_folds() -> None:
    X, y = made(5, rows=150)
    model = ff.SparseGroupLassoCV(GROUPS, l1_ratio=[0.0, 0.5], alphas=8, eps=1e-3, cv=5).fit(X, y)
    assert model.mse_path_.shape == (2, 8, 5)
    assert (model.alphas_[:, 0] > model.alphas_[:, -1]).all()
    for row, ratio in enumerate((0.0, 0.5)):
        above = ff.SparseGroupLasso(GROUPS, model.alphas_[row, 0] * (1 + 1e-9), l1_ratio=ratio).fit(X, y)
        assert not above.coef_.any()
    test = np.arange(30, 60)
    train = np.setdiff1d(np.arange(150), test)
    for k in (0, 3, 7):
        alpha = model.alphas_[1, k]
        one = ff.SparseGroupLasso(GROUPS, alpha, l1_ratio=0.5).fit(X[train], y[train])
        error = np.mean((y[test] - one.predict(X[test])) ** 2)
        assert np.isclose(model.mse_path_[1, k, 1], error, rtol=1e-8)
    best = ff.SparseGroupLasso(GROUPS, model.alpha_, l1_ratio=model.l1_ratio_).fit(X, y)
    assert np.allclose(model.coef_, best.coef_, rtol=1e-9, atol=1e-12)
    plain = ff.GroupLassoCV(GROUPS, alphas=8, eps=1e-3, cv=5).fit(X, y)
    assert np.array_equal(plain.mse_path_, model.mse_path_[0])


def test_many_tasks_match_scikit_learn() -> None:
    linear = pytest.importorskip("sklearn.linear_model", reason="scikit-learn, the peer, is not installed")
    X, y = made(6, targets=4)
    for alpha in (0.05, 0.5):
        # Its groups have no weight: a feature in four targets.
        theirs = linear.MultiTaskLasso(alpha, tol=1e-12, max_iter=200_000).fit(X, y)
        ours = ff.GroupLasso(1, alpha).fit(X, y)
        assert np.allclose(ours.coef_, theirs.coef_, rtol=1e-5, atol=1e-6 * np.abs(ours.coef_).max())
        assert np.array_equal(ours.coef_ != 0.0, theirs.coef_ != 0.0)
        assert np.allclose(ours.intercept_, theirs.intercept_, rtol=1e-5)


def test_paths_match_adelie() -> None:
    # Not among the required peers: pysindy, which is, has no use for that numpy.
    adelie = pytest.importorskip("adelie", reason="adelie wants numpy 1 and cannot stand beside the other peers")
    rng = np.random.default_rng(8)
    X = np.asfortranarray(rng.standard_normal((500, 20)) + 0.5 * rng.standard_normal((500, 1)))
    y = X[:, :4] @ [1.0, -2.0, 0.5, 1.0] + X[:, 12:16] @ [0.3, 0.0, -0.5, 1.0] + rng.standard_normal(500)
    alphas = np.geomspace(1.0, 0.005, 12)
    state = adelie.grpnet(
        X=X,
        glm=adelie.glm.gaussian(y=y),
        groups=np.arange(0, 20, 4),
        lmda_path=alphas,
        tol=1e-14,
        early_exit=False,
        progress_bar=False,
    )
    coefficients_at = dict(zip(state.lmdas.tolist(), state.betas.toarray()))
    compared = 0
    for alpha in alphas:
        ours = ff.GroupLasso(4, alpha).fit(X, y)
        theirs = coefficients_at.get(float(alpha), np.zeros(20))
        assert np.array_equal(ours.coef_ != 0.0, theirs != 0.0)
        assert np.allclose(ours.coef_, theirs, rtol=1e-4, atol=1e-5)
        compared += int(ours.coef_.any())
    assert compared > 6


def test_recordings_take_groups() -> None:
    rng = np.random.default_rng(1)
    a, b, c = rng.normal(size=(3, 500))
    force = 2.0 * a - 0.5 * a**2 + b + 0.1 * rng.normal(size=500)
    data = ff.open({"a": a, "b": b, "c": c, "force": force}, dt=0.01)
    latents = {"F": {"of": ["a", "b", "c"], "degree": 3}}
    for groups, name in (("signal", "group lasso"), ({"first": ["a", "b"]}, "group lasso"), ("term", "group lasso")):
        fit = ff.BlockSparse(latents=latents, tasks={"along": ("force", "F")}, groups=groups, select="bic").fit(data)
        assert name in fit.report_["selection"]
        assert fit.report_["certificate"]["gap"] < 1e-9
        selected = {one["function"] for one in fit.report_["latents"][0]["functions"] if one["selected"]}
        assert {"a", "a^2", "b"} <= selected
        assert groups == "term" or "a^3" in selected
    t = np.arange(0, 10, 0.01)
    x = np.column_stack([np.cos(2 * t), -2 * np.sin(2 * t)])
    sindy = ff.SINDy(groups="signal", terms=2, library="poly(2)").fit(x, t, feature_names=["q", "v"])
    assert sindy.report_["regions"][0]["equations"][0]["r2"] > 0.999
    with pytest.raises(ff.exceptions.RequestError, match="groups"):
        ff.SINDy(groups=3).fit(x, t, feature_names=["q", "v"])  # type: ignore[arg-type]
