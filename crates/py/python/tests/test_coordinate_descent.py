"""Lasso, ElasticNet and their paths: optimality by numpy alone, then agreement with scikit-learn."""

from __future__ import annotations

import pickle
import warnings
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import fleetfoot as ff
from fleetfoot._base import ConvergenceWarning


def problem(rows: int = 60, features: int = 12, targets: int = 1, seed: int = 0) -> tuple[NDArray[Any], NDArray[Any]]:
    """Correlated features of different sizes about means that are not zero; a few of them make the target."""
    rng = np.random.default_rng(seed)
    X = rng.standard_normal((rows, features)) + 0.7 * rng.standard_normal((rows, 1))
    X = X * np.geomspace(0.3, 3.0, features) + rng.uniform(-2.0, 2.0, features)
    coefs = np.where(rng.random((features, targets)) < 0.4, rng.standard_normal((features, targets)), 0.0)
    y = X @ coefs + 0.5 * rng.standard_normal((rows, targets)) + 3.0
    return X, y[:, 0] if targets == 1 else y


def violation(model: Any, X: Any, y: Any, weight: Any = None, l1_ratio: float = 1.0, positive: bool = False) -> float:
    """Largest violation of the optimality conditions, over the deviations of target and feature."""
    X, y = np.asarray(X, dtype=np.float64), np.asarray(y, dtype=np.float64)
    share = np.full(len(X), 1.0 / len(X)) if weight is None else weight / np.sum(weight)
    left = y - X @ np.asarray(model.coef_, dtype=np.float64) - model.intercept_
    l1, l2 = model.alpha * l1_ratio, model.alpha * (1.0 - l1_ratio)
    gradient = X.T @ (share * left) - l2 * model.coef_
    active = model.coef_ != 0.0
    inactive = gradient if positive else np.abs(gradient)
    wrong = np.where(active, np.abs(gradient - l1 * np.sign(model.coef_)), np.maximum(inactive - l1, 0.0))
    if positive:
        assert (model.coef_ >= 0.0).all()
    deviation = np.sqrt(share @ (X - share @ X) ** 2)
    worst = wrong / deviation
    mean = abs(share @ left) if model.fit_intercept else 0.0
    return float(max(worst.max(), mean) / np.sqrt(share @ (y - share @ y) ** 2))


LAYOUTS = {
    "C": np.ascontiguousarray,
    "Fortran": np.asfortranarray,
    "strided": lambda a: np.repeat(np.repeat(a, 2, axis=0), 3, axis=1)[::2, ::3],
    "reversed": lambda a: np.ascontiguousarray(a[::-1, ::-1])[::-1, ::-1],
}


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("shape", [(60, 12), (20, 50), (5000, 9)])
@pytest.mark.parametrize("l1_ratio", [1.0, 0.4])
def test_solutions_are_optimal_in_any_layout(layout: str, shape: tuple[int, int], l1_ratio: float) -> None:
    X, y = problem(*shape)
    lying = LAYOUTS[layout](X)
    before = lying.copy()
    model = ff.ElasticNet(alpha=0.1, l1_ratio=l1_ratio).fit(lying, y)
    assert violation(model, X, y, l1_ratio=l1_ratio) < 1e-12
    assert 0 < np.count_nonzero(model.coef_)
    np.testing.assert_array_equal(lying, before)
    plain = ff.ElasticNet(alpha=0.1, l1_ratio=l1_ratio).fit(X, y)
    np.testing.assert_allclose(model.coef_, plain.coef_, rtol=1e-10, atol=1e-13)


@pytest.mark.parametrize("positive", [False, True])
@pytest.mark.parametrize("fit_intercept", [False, True])
@pytest.mark.parametrize("shape", [(60, 12), (20, 50)])
def test_weights_signs_and_intercepts(shape: tuple[int, int], fit_intercept: bool, positive: bool) -> None:
    X, y = problem(*shape, seed=1)
    weight = np.random.default_rng(2).uniform(0.0, 3.0, len(X))
    weight[:4] = 0.0
    model = ff.ElasticNet(alpha=0.05, l1_ratio=0.7, fit_intercept=fit_intercept, positive=positive)
    model.fit(X, y, sample_weight=weight)
    assert violation(model, X, y, weight, 0.7, positive) < 1e-12
    scaled = ff.ElasticNet(alpha=0.05, l1_ratio=0.7, fit_intercept=fit_intercept, positive=positive)
    scaled.fit(X[4:], y[4:], sample_weight=17.0 * weight[4:])
    np.testing.assert_allclose(scaled.coef_, model.coef_, rtol=1e-9, atol=1e-12)
    if not fit_intercept:
        assert model.intercept_ == 0.0


def test_single_precision_stays_single() -> None:
    X, y = problem()
    single = ff.Lasso(alpha=0.1).fit(X.astype(np.float32), y)
    assert single.coef_.dtype == np.float32 and single.intercept_.dtype == np.float32
    double = ff.Lasso(alpha=0.1).fit(X.astype(np.float32).astype(np.float64), y.astype(np.float32))
    np.testing.assert_allclose(single.coef_, double.coef_.astype(np.float32), rtol=0, atol=0)


def test_targets_share_nothing_but_the_pass() -> None:
    X, Y = problem(targets=3)
    together = ff.Lasso(alpha=0.1).fit(X, Y)
    assert together.coef_.shape == (3, 12) and together.intercept_.shape == (3,) and len(together.n_iter_) == 3
    for k in range(3):
        alone = ff.Lasso(alpha=0.1).fit(X, Y[:, k])
        np.testing.assert_allclose(together.coef_[k], alone.coef_, rtol=1e-10, atol=1e-13)
        np.testing.assert_allclose(together.intercept_[k], alone.intercept_, rtol=1e-10)
    np.testing.assert_allclose(together.predict(X), X @ together.coef_.T + together.intercept_)


@pytest.mark.parametrize("max_iter", [1, 2, 1000])
def test_gap_bounds_the_suboptimality(max_iter: int) -> None:
    X, y = problem(30, 60, seed=3)

    def objective(model: Any) -> float:
        left = y - model.predict(X)
        return float(0.5 * np.mean(left**2) + model.alpha * np.abs(model.coef_).sum())

    best = objective(ff.Lasso(alpha=0.01).fit(X, y))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model = ff.Lasso(alpha=0.01, max_iter=max_iter).fit(X, y)
    excess = objective(model) - best
    assert excess <= model.dual_gap_ + 1e-14
    stopped = max_iter < 1000
    assert bool(caught) == stopped and (excess > 1e-6) == stopped
    assert all(issubclass(one.category, ConvergenceWarning) for one in caught)


def test_the_gap_of_a_tiny_penalty_is_honest() -> None:
    X, y = np.array([[-1.0, -1.0, 1.0, 1.0], [1.0, 1.0, -1.0, -1.0]]), np.array([-1.0, 1.0])
    model = ff.Lasso(alpha=1e-10, fit_intercept=False, warm_start=True, max_iter=1, tol=1e-10)
    model.coef_ = np.array([1.0, 1.0, 1.0, 1000.0])
    with pytest.warns(ConvergenceWarning, match="duality gap"):
        model.fit(X, y)
    excess = 0.5 * np.mean((y - X @ model.coef_) ** 2) + 1e-10 * np.abs(model.coef_).sum() - 1e-10
    assert 1e-8 < excess <= 1.001 * model.dual_gap_


def test_a_warm_start_saves_the_sweeps() -> None:
    X, y = problem(30, 60)
    model = ff.Lasso(alpha=0.05, warm_start=True).fit(X, y)
    cold, coefs = model.n_iter_, model.coef_.copy()
    assert cold > 0 and model.fit(X, y).n_iter_ == 0
    np.testing.assert_allclose(model.coef_, coefs, rtol=1e-10, atol=1e-13)
    with pytest.raises(ValueError, match="warm_start"):
        model.fit(X[:, :5], y)


@pytest.mark.parametrize("weighted", [False, True])
def test_given_gram_matrix_is_used(weighted: bool) -> None:
    X, y = problem()
    weight = np.random.default_rng(0).uniform(0.5, 2.0, len(X)) if weighted else None
    centred = X - np.average(X, axis=0, weights=weight)
    scale = np.ones(len(X)) if weight is None else weight * len(X) / weight.sum()
    gram = centred.T @ (scale[:, None] * centred)
    plain = ff.Lasso(alpha=0.1).fit(X, y, weight)
    given = ff.Lasso(alpha=0.1, precompute=gram).fit(centred, y, weight)
    np.testing.assert_allclose(given.coef_, plain.coef_, rtol=1e-8, atol=1e-12)
    # It is the matrix that counts, once it has passed the look at one entry.
    other = gram.copy()
    other[10, 10] *= 3.0
    assert np.abs(ff.Lasso(alpha=0.1, precompute=other).fit(centred, y, weight).coef_ - plain.coef_).max() > 1e-3
    with pytest.raises(ValueError, match="did not pass validation"):
        ff.Lasso(alpha=0.1, precompute=2.0 * gram).fit(centred, y, weight)
    with pytest.warns(UserWarning, match="recomputing"):
        again = ff.Lasso(alpha=0.1, precompute=gram).fit(X, y, weight)
    np.testing.assert_allclose(again.coef_, plain.coef_, rtol=1e-10, atol=1e-13)
    with pytest.raises(ValueError, match="12 x 12"):
        ff.Lasso(precompute=np.eye(3)).fit(X, y)


def test_unsupported_options_are_named() -> None:
    X, y = problem()
    sparse = pytest.importorskip("scipy.sparse", reason="scipy, which makes sparse matrices, is not installed")
    for model in (ff.Bolasso(), ff.GroupLasso()):
        with pytest.raises(TypeError, match=r"(?i)sparse"):
            model.fit(sparse.csr_array(X), y)
    with pytest.raises(NotImplementedError, match="sample_weight"):
        ff.enet_path(X, y, sample_weight=np.ones(len(y)))


SPARSE_MODELS = {
    "Lasso": lambda: ff.Lasso(alpha=0.02),
    "ElasticNet": lambda: ff.ElasticNet(alpha=0.02, l1_ratio=0.3, fit_intercept=False),
    "LassoCV": lambda: ff.LassoCV(alphas=7, cv=3),
    "ElasticNetCV": lambda: ff.ElasticNetCV(alphas=7, cv=3),
    "Lars": lambda: ff.Lars(n_nonzero_coefs=5),
    "LassoLars": lambda: ff.LassoLars(alpha=0.02),
    "LassoLarsCV": lambda: ff.LassoLarsCV(cv=3),
    "LassoLarsIC": lambda: ff.LassoLarsIC(criterion="bic", noise_variance=0.2),
}


def few_values(rows: int, features: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """A fifth of the values are not zero."""
    rng = np.random.default_rng(6)
    X = np.where(rng.random((rows, features)) < 0.2, rng.standard_normal((rows, features)) + 0.5, 0.0)
    return X, 2.0 * X[:, 0] - X[:, 3] + 0.4 * rng.standard_normal(rows) + 1.0


@pytest.mark.parametrize("name", SPARSE_MODELS)
@pytest.mark.parametrize("form", ["csr_array", "csc_matrix", "coo_array"])
@pytest.mark.parametrize("shape", [(90, 8), (30, 50), (3000, 8)])
def test_sparse_rows_are_the_dense_ones(name: str, form: str, shape: tuple[int, int]) -> None:
    """Centring is exact: the statistic of a block is that of the dense block, to the bit."""
    sparse = pytest.importorskip("scipy.sparse", reason="scipy, which makes sparse matrices, is not installed")
    pytest.importorskip("sklearn", reason="scikit-learn, which checks sparse matrices, is not installed")
    X, y = few_values(*shape)
    lying = getattr(sparse, form)(X)
    make = SPARSE_MODELS[name]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        dense, fitted = make().fit(X, y), make().fit(lying, y)
    np.testing.assert_array_equal(fitted.coef_, dense.coef_)
    np.testing.assert_array_equal(fitted.intercept_, dense.intercept_)
    np.testing.assert_allclose(fitted.predict(lying), dense.predict(X), rtol=1e-12, atol=1e-12)
    assert fitted.score(lying, y) == pytest.approx(dense.score(X, y))


def test_paths_of_sparse_rows() -> None:
    sparse = pytest.importorskip("scipy.sparse", reason="scipy, which makes sparse matrices, is not installed")
    pytest.importorskip("sklearn", reason="scikit-learn, which checks sparse matrices, is not installed")
    X, y = few_values(90, 8)
    for path in (ff.lasso_path, ff.enet_path):
        for target in (y, np.c_[y, y[::-1]]):
            dense, sparse_path = (path(form(X), target, alphas=5) for form in (np.asarray, sparse.csc_array))
            # The products of several targets' squares are summed by scipy.
            for a, b in zip(sparse_path, dense):
                np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-13)


def test_a_sparse_matrix_that_lies_is_refused() -> None:
    sparse = pytest.importorskip("scipy.sparse", reason="scipy, which makes sparse matrices, is not installed")
    X, y = few_values(90, 8)
    broken = sparse.csr_array(X)
    broken.indices[3] = 8
    with pytest.raises(ValueError, match="column 8 of 8"):
        ff.Lasso().fit(broken, y, check_input=False)
    broken = sparse.csr_array(X)
    broken.indptr[5] = 10**6
    with pytest.raises(ValueError, match="do not follow each other"):
        ff.Lasso().fit(broken, y, check_input=False)
    holed = sparse.csr_array(X)
    holed.data[0] = np.nan
    for model in (ff.Lasso(), ff.LassoCV(cv=3), ff.LassoLarsCV(cv=3)):
        with pytest.raises(ValueError, match="NaN"):
            model.fit(holed, y)


def task_violation(
    X: NDArray[Any], Y: NDArray[Any], coefs: NDArray[Any], alpha: float, l1_ratio: float
) -> float:
    """Largest violation of the optimality conditions of the multi-task elastic net, relative to the penalty."""
    gradient = (X.T @ (Y - X @ coefs.T) / len(X)).T - alpha * (1.0 - l1_ratio) * coefs
    length = np.linalg.norm(coefs, axis=0)
    limit = alpha * l1_ratio
    aim = limit * coefs / np.where(length > 0.0, length, 1.0)
    active = np.linalg.norm(gradient - aim, axis=0)
    inactive = np.maximum(np.linalg.norm(gradient, axis=0) - limit, 0.0)
    return float(np.where(length > 0.0, active, inactive).max() / alpha)


@pytest.mark.parametrize("l1_ratio", [1.0, 0.6])
@pytest.mark.parametrize("shape", [(60, 12), (20, 40)])
def test_path_of_several_targets_is_multi_task(l1_ratio: float, shape: tuple[int, int]) -> None:
    X, Y = problem(*shape, targets=3)
    alphas, coefs, gaps, sweeps = ff.enet_path(X, Y, l1_ratio=l1_ratio, alphas=6, return_n_iter=True)
    assert coefs.shape == (3, shape[1], 6) and gaps.shape == (6,) and len(sweeps) == 6
    assert not coefs[:, :, 0].any() and coefs[:, :, 1].any()
    for k, alpha in enumerate(alphas):
        assert task_violation(X, Y, coefs[:, :, k], alpha, l1_ratio) < 1e-6
        assert 0.0 <= gaps[k] < 1e-9 * np.mean(Y**2)
    again = ff.enet_path(X, Y, l1_ratio=l1_ratio, alphas=alphas[3:4], coef_init=coefs[:, :, 2])
    np.testing.assert_allclose(again[1][:, :, 0], coefs[:, :, 3], rtol=1e-6, atol=1e-9)
    with pytest.raises(ValueError, match="coef_init"):
        ff.enet_path(X, Y, coef_init=coefs[0, :, 2])
    peer = pytest.importorskip("sklearn.linear_model", reason="scikit-learn, the peer, is not installed")
    theirs = peer.enet_path(X, Y, l1_ratio=l1_ratio, alphas=alphas, tol=1e-12, max_iter=100_000)
    np.testing.assert_allclose(coefs, theirs[1], rtol=0, atol=1e-5 * np.abs(theirs[1]).max())


@pytest.mark.parametrize("shape", [(1400, 530), (700, 530)])
def test_one_solution_of_many_features_is_optimal(shape: tuple[int, int]) -> None:
    """A single solution does not form the products of all features."""
    X, y = problem(*shape)
    weight = np.random.default_rng(2).uniform(0.0, 2.0, len(y))
    for alpha in (0.5, 0.05):
        model = ff.ElasticNet(alpha=alpha, l1_ratio=0.9).fit(X, y, weight)
        assert violation(model, X, y, weight, l1_ratio=0.9) < 1e-9
        # Two targets share the Gram matrix.
        both = ff.ElasticNet(alpha=alpha, l1_ratio=0.9).fit(X, np.c_[y, y], weight)
        np.testing.assert_allclose(both.coef_[0], model.coef_, rtol=1e-6, atol=1e-9 * np.abs(model.coef_).max())


@pytest.mark.parametrize(
    ("parameters", "name"),
    [
        ({"alpha": -1.0}, "alpha"),
        ({"max_iter": 0}, "max_iter"),
        ({"tol": -1e-3}, "tol"),
        ({"selection": "best"}, "selection"),
        ({"positive": "yes"}, "positive"),
        ({"precompute": "auto"}, "precompute"),
    ],
)
def test_parameters_are_checked(parameters: dict[str, Any], name: str) -> None:
    X, y = problem()
    with pytest.raises(ValueError, match=name):
        ff.Lasso(**parameters).fit(X, y)


def test_columns_that_overflow_are_refused() -> None:
    X = np.finfo(np.float64).max * np.random.default_rng(0).uniform(size=(10, 2))
    with pytest.raises(ValueError, match="column 0"):
        ff.Lasso(alpha=0.1).fit(X, np.arange(10.0))


def test_estimators_are_values() -> None:
    X, y = problem()
    model = ff.ElasticNet(alpha=0.05, l1_ratio=0.3).fit(X, y)
    again = pickle.loads(pickle.dumps(model))
    np.testing.assert_array_equal(again.predict(X), model.predict(X))
    assert again.get_params() == model.get_params()
    assert "l1_ratio" not in ff.Lasso().get_params()
    assert ff.Lasso(alpha=3.0).set_params(alpha=2.0).alpha == 2.0


def test_a_path_is_the_fits_one_after_the_other() -> None:
    X, y = problem()
    alphas, coefs, gaps, sweeps = ff.enet_path(X, y, l1_ratio=0.6, alphas=7, eps=1e-2, return_n_iter=True)
    assert alphas[0] == pytest.approx(np.abs(X.T @ y).max() / (0.6 * len(y)), rel=1e-12)
    np.testing.assert_allclose(alphas, np.geomspace(alphas[0], 1e-2 * alphas[0], 7), rtol=1e-12)
    assert coefs.shape == (12, 7) and gaps.shape == (7,) and len(sweeps) == 7
    assert not coefs[:, 0].any() and (gaps <= 1e-12 * np.mean(y**2)).all()
    for k, alpha in enumerate(alphas):
        one = ff.ElasticNet(alpha=alpha, l1_ratio=0.6, fit_intercept=False).fit(X, y)
        np.testing.assert_allclose(coefs[:, k], one.coef_, rtol=1e-9, atol=1e-12)
    again = ff.enet_path(X, y, l1_ratio=0.6, alphas=[alphas[3]], coef_init=coefs[:, 3], return_n_iter=True)
    assert again[3] == [0]
    given = ff.enet_path(X, y, l1_ratio=0.6, alphas=alphas, precompute=X.T @ X, Xy=X.T @ y)
    np.testing.assert_allclose(given[1], coefs, rtol=1e-7, atol=1e-9)
    with pytest.raises(ValueError, match="Unexpected parameters"):
        ff.lasso_path(X, y, normalise=True)


# -- against scikit-learn


def linear_model() -> Any:
    return pytest.importorskip("sklearn.linear_model", reason="scikit-learn, the peer, is not installed")


def cases() -> dict[str, tuple[NDArray[Any], NDArray[Any]]]:
    problems = {"tall": problem(200, 15), "wide": problem(40, 100, seed=5)}
    try:
        from sklearn.datasets import load_diabetes
    except ImportError:
        return problems
    problems["diabetes"] = load_diabetes(return_X_y=True)
    return problems


@pytest.mark.parametrize("case", ["tall", "wide", "diabetes"])
@pytest.mark.parametrize("options", [{}, {"positive": True}, {"fit_intercept": False}], ids=str)
@pytest.mark.parametrize("name", ["Lasso", "ElasticNet"])
def test_coefficients_match_scikit_learn(case: str, options: dict[str, Any], name: str) -> None:
    peer = linear_model()
    X, y = cases()[case]
    weight = np.random.default_rng(9).uniform(0.2, 2.0, len(y))
    for alpha in (0.02, 0.2):
        for sample_weight in (None, weight):
            ours = getattr(ff, name)(alpha=alpha, **options).fit(X, y, sample_weight)
            theirs = getattr(peer, name)(alpha=alpha, tol=1e-13, max_iter=1_000_000, **options).fit(X, y, sample_weight)
            size = np.abs(theirs.coef_).max()
            np.testing.assert_allclose(ours.coef_, theirs.coef_, rtol=0, atol=1e-8 * size)
            np.testing.assert_allclose(ours.intercept_, theirs.intercept_, rtol=1e-8, atol=1e-8 * np.abs(y).max())
            np.testing.assert_array_equal(np.sign(ours.coef_), np.sign(theirs.coef_))


@pytest.mark.parametrize("name", ["lasso_path", "enet_path"])
@pytest.mark.parametrize("positive", [False, True])
def test_paths_match_scikit_learn(name: str, positive: bool) -> None:
    peer = linear_model()
    X, y = problem(80, 20, seed=4)
    options = {"alphas": 30, "eps": 1e-2, "positive": positive}
    alphas, coefs, _ = getattr(ff, name)(X, y, **options)
    wanted = getattr(peer, name)(X, y, tol=1e-13, max_iter=1_000_000, **options)
    np.testing.assert_allclose(alphas, wanted[0], rtol=1e-12)
    np.testing.assert_allclose(coefs, wanted[1], rtol=0, atol=1e-8 * np.abs(wanted[1]).max())


def folds(kind: str, rows: int) -> Any:
    rng = np.random.default_rng(0)
    if kind == "neighbours":
        return 4
    if kind == "overlapping":
        return [(order[5:], order[:20]) for order in (rng.permutation(rows) for _ in range(3))]
    return [(rng.integers(0, rows, rows), rng.integers(0, rows, rows // 2)) for _ in range(3)]


@pytest.mark.parametrize("kind", ["neighbours", "overlapping", "with replacement"])
@pytest.mark.parametrize("case", ["tall", "wide", "diabetes"])
@pytest.mark.parametrize("weighted", [False, True])
def test_cross_validation_is_that_of_scikit_learn(kind: str, case: str, weighted: bool) -> None:
    peer = linear_model()
    X, y = cases()[case]
    weight = np.random.default_rng(9).uniform(0.2, 2.0, len(y)) if weighted else None
    options = {"alphas": 25, "eps": 1e-2, "cv": folds(kind, len(y))}
    ours = ff.LassoCV(**options).fit(X, y, weight)
    theirs = peer.LassoCV(tol=1e-13, max_iter=1_000_000, **options).fit(X, y, weight)
    np.testing.assert_allclose(ours.alphas_, theirs.alphas_, rtol=1e-12)
    np.testing.assert_allclose(ours.mse_path_, theirs.mse_path_, rtol=1e-8)
    assert ours.alpha_ == pytest.approx(theirs.alpha_, rel=1e-12)
    np.testing.assert_allclose(ours.coef_, theirs.coef_, rtol=0, atol=1e-8 * np.abs(theirs.coef_).max())
    assert ours.intercept_ == pytest.approx(theirs.intercept_, rel=1e-8)


def test_cross_validation_of_many_rows_reads_them_once() -> None:
    peer = linear_model()
    X, y = problem(30_000, 45, seed=6)
    for single in (False, True):
        if single:
            X, y = X.astype(np.float32), y.astype(np.float32)
        options = {"alphas": 12, "cv": 5}
        ours = ff.LassoCV(**options).fit(X, y)
        theirs = peer.LassoCV(tol=1e-12, max_iter=100_000, **options).fit(X.astype(np.float64), y.astype(np.float64))
        np.testing.assert_allclose(ours.mse_path_, theirs.mse_path_, rtol=1e-9)
        assert ours.coef_.dtype == X.dtype
        np.testing.assert_allclose(ours.coef_, theirs.coef_, rtol=0, atol=3e-7 if single else 1e-9)


def test_the_elastic_net_s_share_is_chosen_too() -> None:
    peer = linear_model()
    X, y = problem(80, 10, seed=7)
    for options in ({"l1_ratio": [0.2, 0.5, 0.95], "alphas": 9}, {"l1_ratio": 0.5, "alphas": [0.1, 0.01, 1.0]}):
        ours = ff.ElasticNetCV(cv=3, **options).fit(X, y)
        theirs = peer.ElasticNetCV(cv=3, tol=1e-13, max_iter=1_000_000, **options).fit(X, y)
        assert ours.l1_ratio_ == theirs.l1_ratio_ and ours.alpha_ == pytest.approx(theirs.alpha_, rel=1e-12)
        assert ours.mse_path_.shape == theirs.mse_path_.shape and ours.alphas_.shape == theirs.alphas_.shape
        np.testing.assert_allclose(ours.mse_path_, theirs.mse_path_, rtol=1e-8)
        np.testing.assert_allclose(ours.coef_, theirs.coef_, rtol=0, atol=1e-8)


def test_one_task_is_the_multi_task_solution() -> None:
    peer = linear_model()
    X, y = problem(50, 10)
    ours = ff.ElasticNetCV(alphas=5, eps=2e-3, l1_ratio=[0.5, 0.7]).fit(X, y)
    theirs = peer.MultiTaskElasticNetCV(alphas=5, eps=2e-3, l1_ratio=[0.5, 0.7], tol=1e-12, max_iter=1_000_000)
    theirs.fit(X, y[:, np.newaxis])
    np.testing.assert_allclose(ours.coef_, theirs.coef_[0], rtol=0, atol=1e-8 * np.abs(ours.coef_).max())
    ours = ff.LassoCV(alphas=5, eps=2e-3).fit(X, y)
    theirs = peer.MultiTaskLassoCV(alphas=5, eps=2e-3, tol=1e-12, max_iter=1_000_000).fit(X, y[:, np.newaxis])
    np.testing.assert_allclose(ours.coef_, theirs.coef_[0], rtol=0, atol=1e-8 * np.abs(ours.coef_).max())


def test_signatures_match_scikit_learn() -> None:
    import inspect

    peer = linear_model()
    for name in ("Lasso", "ElasticNet", "LassoCV", "ElasticNetCV", "lasso_path", "enet_path"):
        ours, theirs = (inspect.signature(getattr(module, name)).parameters for module in (ff, peer))
        assert list(ours) == list(theirs), name
        for parameter in ours:
            # scikit-learn spells some switches as 0.
            parsed, wanted = ours[parameter], theirs[parameter]
            assert (parsed.default, parsed.kind) == (wanted.default, wanted.kind)
