"""Least angle regression: optimality first, then agreement with scikit-learn, then the interface."""

from __future__ import annotations

import pickle
import threading
import warnings
from typing import Any

import numpy as np
import pytest

import fleetfoot as ff
from fleetfoot._base import ConvergenceWarning
from fleetfoot.exceptions import ParameterError


def correlated(rows: int, columns: int, seed: int = 0, noise: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(rows, columns)) @ rng.normal(size=(columns, columns)) + rng.normal(size=columns)
    return X, X[:, : min(5, columns)].sum(axis=1) + noise * rng.normal(size=rows)


def violation(X: Any, y: Any, alpha: float, w: np.ndarray, positive: bool = False) -> float:
    """Distance of w from a minimum of the lasso, relative to the largest correlation there could be."""
    X, y = np.asarray(X, dtype=float), np.asarray(y, dtype=float)
    gradient = X.T @ (y - X @ w) / len(y)
    active = w != 0
    worst = np.abs(gradient - alpha * np.sign(w))[active].max(initial=0.0)
    idle = gradient if positive else np.abs(gradient)
    worst = max(worst, (idle[~active] - alpha).max(initial=0.0))
    return worst / (np.linalg.norm(X, axis=0).max() * np.linalg.norm(y) / len(y))


def spread(X: np.ndarray, y: np.ndarray, w: np.ndarray) -> float:
    """By how much the active columns' correlations with the residual differ: nothing, in least angle regression."""
    correlations = np.abs(X.T @ (y - X @ w))
    active = correlations[w != 0]
    return float((correlations.max() - active.min()) / np.abs(X.T @ y).max()) if len(active) else 0.0


PROBLEMS = {
    "tall": correlated(300, 12),
    "wide": correlated(30, 60),
    "square": correlated(25, 25),
    "duplicated": (lambda X, y: (np.c_[X, X[:, 2], np.zeros(len(X)), 2 * X[:, 0] - X[:, 1]], y))(*correlated(80, 6)),
}


@pytest.mark.parametrize("positive", [False, True])
@pytest.mark.parametrize("name", PROBLEMS)
def test_every_knot_of_the_lasso_is_a_minimum(name: str, positive: bool) -> None:
    X, y = PROBLEMS[name]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        alphas, active, coefs = ff.lars_path(X, y, method="lasso", positive=positive)
    assert alphas[-1] == 0.0 and np.all(np.diff(alphas) < 0.0)
    assert sorted(active) == list(np.flatnonzero(coefs[:, -1]))
    for alpha, w in zip(alphas, coefs.T):
        assert violation(X, y, alpha, w, positive) < 1e-13
        assert not positive or (w >= 0.0).all()


@pytest.mark.parametrize("name", PROBLEMS)
def test_active_columns_of_least_angle_regression_are_equally_correlated(name: str) -> None:
    X, y = PROBLEMS[name]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        alphas, active, coefs = ff.lars_path(X, y, method="lar")
    rank = np.linalg.matrix_rank(X)
    # One column a step, and none leaves.
    assert len(alphas) == rank + 1 and len(active) == rank
    assert [np.count_nonzero(w) for w in coefs.T] == list(range(rank + 1))
    assert max(spread(X, y, w) for w in coefs.T) < 1e-11
    least = np.linalg.lstsq(X, y, rcond=None)[0]
    assert np.allclose(X @ coefs[:, -1], X @ least, atol=1e-9 * np.abs(y).max())


def test_certificates_decide_differences_to_scikit_learn() -> None:
    linear_model = pytest.importorskip("sklearn.linear_model", reason="scikit-learn is not installed")
    # A coefficient crosses zero: scikit-learn's "lar" path is not equiangular from there on.
    X, y = correlated(300, 40, seed=0)
    theirs = linear_model.lars_path(X.copy(), y.copy(), method="lar")[2]
    ours = ff.lars_path(X, y, method="lar")[2]
    assert max(spread(X, y, w) for w in ours.T) < 1e-10 < max(spread(X, y, w) for w in theirs.T)
    # The end of a positive path: non-negative least squares.
    optimize = pytest.importorskip("scipy.optimize", reason="scipy is not installed")
    best = optimize.nnls(X, y)[0]
    theirs = linear_model.lars_path(X.copy(), y.copy(), method="lasso", positive=True)[2][:, -1]
    ours = ff.lars_path(X, y, method="lasso", positive=True)[2][:, -1]
    assert np.abs(ours - best).max() < 1e-10 < np.abs(theirs - best).max()
    # Two columns tie at the first knot.
    X, y = np.array([[0.0, 0.0, 0.0, -1.0, 0.0], [0.0, -1.0, 0.0, 0.0, 0.0]]), np.array([-2.5, -2.5])
    ours = ff.LassoLars(alpha=1e-3, fit_intercept=False).fit(X, y).coef_
    theirs = linear_model.LassoLars(alpha=1e-3, fit_intercept=False).fit(X.copy(), y).coef_
    scale = np.linalg.norm(y) / 2
    assert violation(X, y, 1e-3, ours) < 1e-15
    assert abs(scale * violation(X, y, 1e-3, theirs) - 1.25) < 0.01
    # Columns of lengths 1e20 and 1: the whole objective, intercept included.
    X, y = np.array([[1e20, 1e20, 0.0], [-1e-32, 0.0, 0.0], [1.0, 1.0, 1.0]]), np.array([10.0, 10.0, 1.0])

    def objective(model: Any) -> float:
        return float(((y - model.predict(X)) ** 2).sum() / 6 + 1e-4 * np.abs(model.coef_).sum())

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        ours, theirs = (kind(alpha=1e-4).fit(X.copy(), y) for kind in (ff.LassoLars, linear_model.LassoLars))
    assert objective(ours) < 1e-3 < 6.0 < objective(theirs)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("layout", ["C", "F", "strided"])
def test_paths_match_scikit_learn(layout: str, dtype: type) -> None:
    linear_model = pytest.importorskip("sklearn.linear_model", reason="scikit-learn is not installed")
    X, y = correlated(200, 15, seed=3)
    X, y = X.astype(dtype), y.astype(dtype)
    given = {"C": X, "F": np.asfortranarray(X), "strided": np.repeat(np.repeat(X, 2, 0), 3, 1)[::2, ::3]}[layout]
    kept = given.copy()
    for options in [{}, {"alpha_min": 0.3}, {"max_iter": 4}, {"Gram": True}, {"return_path": False}]:
        theirs = linear_model.lars_path(X.copy(), y.copy(), method="lasso", return_n_iter=True, **options)
        ours = ff.lars_path(given, y, method="lasso", return_n_iter=True, **options)
        # Rounding of single precision is theirs: here sums are in double precision.
        tolerance = 1e-12 if dtype == np.float64 else 1e-3
        assert ours[1] == list(theirs[1]) and ours[3] == theirs[3]
        assert [part.dtype for part in (ours[0], ours[2])] == [dtype, dtype]
        assert ours[0].shape == theirs[0].shape and ours[2].shape == theirs[2].shape
        assert np.abs(ours[0] - theirs[0]).max() <= tolerance * theirs[0].max()
        assert np.abs(ours[2] - theirs[2]).max() <= tolerance * np.abs(theirs[2]).max()
    assert np.array_equal(kept, given)


def test_single_precision_is_summed_in_double() -> None:
    X, y = correlated(200, 15, seed=3)
    X, y = X.astype(np.float32), y.astype(np.float32)
    single = ff.lars_path(X, y, method="lasso")[2]
    double = ff.lars_path(X.astype(float), y.astype(float), method="lasso")[2]
    assert np.array_equal(single, double.astype(np.float32))


@pytest.mark.parametrize("fit_intercept", [True, False])
def test_estimators_match_scikit_learn(fit_intercept: bool) -> None:
    linear_model = pytest.importorskip("sklearn.linear_model", reason="scikit-learn is not installed")
    X, y = correlated(150, 10, seed=5)
    Y = np.c_[y, np.sin(y), X @ np.arange(10.0)]
    C = X - X.mean(axis=0)
    cases: list[tuple[str, dict[str, Any]]] = [
        ("LassoLars", {"alpha": 0.05}),
        ("LassoLars", {"alpha": 0.05, "fit_path": False}),
        ("LassoLars", {"alpha": 0.0, "max_iter": 3}),
        ("LassoLars", {"alpha": 0.05, "positive": True}),
        ("LassoLars", {"alpha": 0.05, "jitter": 0.1, "random_state": 7}),
        ("LassoLars", {"alpha": 0.05, "precompute": C.T @ C if fit_intercept else X.T @ X}),
        ("Lars", {"n_nonzero_coefs": 4}),
    ]
    for name, options in cases:
        options = {"fit_intercept": fit_intercept, **options}
        for target in [y, Y, y[:, np.newaxis]]:
            # Noise of scikit-learn has one row's shape; its positive paths are wrong below their last knot (above).
            if ("jitter" in options or "positive" in options) and target.ndim == 2:
                continue
            theirs = getattr(linear_model, name)(**options).fit(X.copy(), target.copy())
            ours = getattr(ff, name)(**options).fit(X, target)
            assert set(vars(ours)) >= {key for key in vars(theirs) if key.endswith("_")}
            assert ours.coef_.shape == theirs.coef_.shape
            assert np.shape(ours.intercept_) == np.shape(theirs.intercept_)
            assert ours.predict(X).shape == theirs.predict(X).shape
            assert ours.n_iter_ == theirs.n_iter_
            assert np.allclose(ours.coef_, theirs.coef_, rtol=1e-10, atol=1e-12)
            assert np.allclose(ours.intercept_, theirs.intercept_, rtol=1e-10, atol=1e-12)
            assert np.allclose(ours.predict(X), theirs.predict(X), rtol=1e-10, atol=1e-11)
            mine, other = ours.alphas_, theirs.alphas_
            pairs = [(mine, other)] if target.ndim == 1 or target.shape[1] == 1 else list(zip(mine, other))
            assert all(a.shape == b.shape and np.allclose(a, b, atol=1e-12) for a, b in pairs)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"cv": 3, "fit_intercept": False},
        {"positive": True},
        {"max_iter": 6},
        {"cv": "shuffled"},
        {"cv": "bootstrap"},
    ],
    ids=str,
)
@pytest.mark.parametrize("shape", [(150, 10), (40, 60)])
def test_cross_validation_is_that_of_scikit_learn(shape: tuple[int, int], options: dict[str, Any]) -> None:
    linear_model = pytest.importorskip("sklearn.linear_model", reason="scikit-learn is not installed")
    X, y = correlated(*shape, seed=6, noise=5.0)
    rng = np.random.default_rng(0)
    every = np.arange(len(y))
    if options.get("cv") == "shuffled":
        held = [rng.permutation(len(y))[: len(y) // 4] for _ in range(4)]
        options = {"cv": [(np.setdiff1d(every, part), part) for part in held]}
    elif options.get("cv") == "bootstrap":
        drawn = [rng.integers(len(y), size=len(y)) for _ in range(3)]
        options = {"cv": [(part, np.setdiff1d(every, part)) for part in drawn]}
    theirs = linear_model.LassoLarsCV(**options).fit(X.copy(), y.copy())
    ours = ff.LassoLarsCV(**options).fit(X, y)
    assert abs(ours.alpha_ - theirs.alpha_) <= 1e-10 * theirs.alpha_
    assert np.abs(ours.coef_ - theirs.coef_).max() <= 1e-10 * np.abs(theirs.coef_).max()
    assert np.allclose(ours.intercept_, theirs.intercept_, rtol=1e-10, atol=1e-12)
    assert ours.n_iter_ == theirs.n_iter_
    # scikit-learn takes out of `active_` what would leave at the knot below the end, though its coefficient is not
    # zero.
    assert sorted(ours.active_) == list(np.flatnonzero(ours.coef_)) and set(theirs.active_) <= set(ours.active_)
    # Positive paths of scikit-learn are wrong between their last knot and 0.
    known = theirs.cv_alphas_ > (0.05 * theirs.cv_alphas_[-1] if options.get("positive") else 0.0)
    for fold in range(ours.mse_path_.shape[1]):
        errors = np.interp(theirs.cv_alphas_[known], ours.cv_alphas_, ours.mse_path_[:, fold])
        assert np.allclose(errors, theirs.mse_path_[known, fold], rtol=1e-8)


@pytest.mark.parametrize(
    "options",
    [{}, {"criterion": "bic"}, {"noise_variance": 3.0}, {"fit_intercept": False}, {"positive": True}, {"max_iter": 3}],
    ids=str,
)
def test_criteria_match_scikit_learn(options: dict[str, Any]) -> None:
    linear_model = pytest.importorskip("sklearn.linear_model", reason="scikit-learn is not installed")
    X, y = correlated(150, 10, seed=8)
    theirs, ours = linear_model.LassoLarsIC(**options).fit(X.copy(), y.copy()), ff.LassoLarsIC(**options).fit(X, y)
    assert np.allclose(ours.criterion_[:-1], theirs.criterion_[:-1], rtol=1e-12)
    assert ours.criterion_[-1] <= theirs.criterion_[-1] * (1 + 1e-12)
    assert abs(ours.noise_variance_ - theirs.noise_variance_) <= 1e-12 * theirs.noise_variance_
    assert abs(ours.alpha_ - theirs.alpha_) <= 1e-12
    assert np.allclose(ours.coef_, theirs.coef_, atol=1e-12) and np.allclose(
        ours.intercept_, theirs.intercept_, atol=1e-12
    )


def test_criterion_matches_definition() -> None:
    X, y = correlated(60, 5, seed=9)
    model = ff.LassoLarsIC("bic").fit(X, y)
    A = np.c_[np.ones(60), X]
    left = y - A @ np.linalg.lstsq(A, y, rcond=None)[0]
    v = left @ left / (60 - 6)
    assert abs(model.noise_variance_ - v) < 1e-12 * v
    C, z = X - X.mean(axis=0), y - y.mean()
    for alpha, criterion in zip(model.alphas_, model.criterion_):
        lasso = ff.LassoLars(alpha=alpha).fit(X, y)
        rss = ((z - C @ lasso.coef_) ** 2).sum()
        assert violation(C, z, alpha, lasso.coef_) < 1e-13
        expected = 60 * np.log(2 * np.pi * v) + rss / v + np.log(60) * np.count_nonzero(lasso.coef_)
        assert abs(criterion - expected) < 1e-9 * abs(expected)


def test_many_rows_are_summed_and_few_are_factored() -> None:
    # 6e5 rows of 10 columns go through the pass; their first 1e4 rows do not.
    rng = np.random.default_rng(2)
    X = rng.normal(size=(600_000, 9)).astype(np.float32) + 5.0
    y = X @ np.arange(9.0, dtype=np.float32) + rng.normal(size=len(X)).astype(np.float32)
    whole = ff.LassoLarsCV(cv=3).fit(X, y)
    C, z = X.astype(float), y.astype(float)
    C, z = C - C.mean(axis=0), z - z.mean()
    assert violation(C, z, whole.alpha_, whole.coef_.astype(float)) < 1e-7
    _, _, coefs = ff.lars_path_gram(C.T @ z, C.T @ C, n_samples=len(z), method="lasso", alpha_min=0.1)
    model = ff.LassoLars(alpha=0.1).fit(X.astype(float), y.astype(float))
    assert np.allclose(model.coef_, coefs[:, -1], rtol=1e-9)
    held = np.arange(200_000)
    rest = np.setdiff1d(np.arange(len(y)), held)
    path = ff.LassoLars(alpha=float(whole.cv_alphas_[3])).fit(X[rest].astype(float), y[rest].astype(float))
    error = np.mean((y[held] - path.predict(X[held].astype(float))) ** 2)
    assert abs(whole.mse_path_[3, 0] / error - 1) < 1e-6


def test_products_give_the_path_of_their_rows() -> None:
    X, y = correlated(120, 8, seed=4)
    for method in ("lar", "lasso"):
        rows = ff.lars_path(X, y, method=method)
        for products in [
            ff.lars_path_gram(X.T @ y, X.T @ X, n_samples=len(y), method=method),
            ff.lars_path(X, y, Gram=X.T @ X, method=method),
            ff.lars_path(X, y, Xy=X.T @ y, method=method),
        ]:
            assert products[1] == rows[1]
            assert np.allclose(products[0], rows[0], atol=1e-10 * rows[0][0])
            assert np.allclose(products[2], rows[2], atol=1e-9)
    with pytest.raises(ff.exceptions.FitError, match="not those of any rows"):
        ff.lars_path_gram(np.array([1.0, 1.0]), np.array([[1.0, 2.0], [2.0, 1.0]]), n_samples=2)
    with pytest.raises(ValueError, match="do not match"):
        ff.lars_path_gram(np.array([1.0, 1.0]), np.eye(3), n_samples=2)


def test_scale_does_not_matter() -> None:
    X, y = correlated(60, 6, seed=11)
    alphas, active, coefs = ff.lars_path(X, y, method="lasso")
    for size in (1e-9, 1e9):
        small = ff.lars_path(X, size * y, method="lasso")
        assert small[1] == active and np.allclose(small[2] / size, coefs, rtol=1e-9, atol=1e-12)
        assert np.allclose(small[0] / size, alphas, rtol=1e-9, atol=1e-12)


def test_warnings_name_the_cause() -> None:
    X, y = correlated(50, 4, seed=12)
    with pytest.warns(ConvergenceWarning, match=r"Columns [014] are combinations"):
        ff.LassoLars(alpha=0.0).fit(np.c_[X, X[:, 0] + X[:, 1]], y)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ff.LassoLars(alpha=0.0).fit(X, y)
        ff.LassoLars(alpha=0.0).fit(*PROBLEMS["wide"])


@pytest.mark.parametrize("kind", [ff.Lars, ff.LassoLars, ff.LassoLarsCV, ff.LassoLarsIC])
def test_bad_parameters_are_named(kind: Any) -> None:
    X, y = correlated(30, 3)
    for name, value in [("fit_intercept", "yes"), ("precompute", "maybe"), ("eps", -1.0), ("copy_X", 3)]:
        with pytest.raises(ParameterError, match=f"{name}.*{kind.__name__}"):
            kind(**{name: value}).fit(X, y)
    with pytest.raises(NotImplementedError, match=f"eps=0.1 of {kind.__name__}"):
        kind(eps=0.1).fit(X, y)


def test_bad_input_is_named() -> None:
    X, y = correlated(30, 3)
    with pytest.raises(ParameterError, match=r"alpha.*LassoLars.*-1"):
        ff.LassoLars(alpha=-1).fit(X, y)
    with pytest.raises(ParameterError, match="method"):
        ff.lars_path(X, y, method="ols")
    with pytest.raises(ValueError, match="Positive constraint"):
        ff.lars_path(X, y, method="lar", positive=True)
    with pytest.raises(ValueError, match="cannot both be unspecified"):
        ff.lars_path(None, y)
    with pytest.raises(ValueError, match="lars_path_gram"):
        ff.lars_path(None, y, Gram=X.T @ X)
    with pytest.raises(ValueError, match="shape"):
        ff.lars_path(X, y[:-1])
    with pytest.raises(ff.exceptions.FitError, match="not finite"):
        ff.lars_path(X, np.where(np.arange(30) == 3, np.nan, y))
    with pytest.raises(ValueError, match="noise_variance"):
        ff.LassoLarsIC().fit(*correlated(10, 12))
    with pytest.raises(ValueError, match="no rows to test"):
        ff.LassoLarsCV(cv=[(np.arange(10), np.arange(0))]).fit(X, y)


def test_verbose_prints_the_steps(capsys: pytest.CaptureFixture[str]) -> None:
    X, y = correlated(30, 3)
    ff.lars_path(X, y, verbose=1)
    assert len(capsys.readouterr().out.splitlines()) == 5


def test_models_are_pickled() -> None:
    X, y = correlated(30, 3)
    model = ff.LassoLars(alpha=0.1).fit(X, y)
    again = pickle.loads(pickle.dumps(model))
    assert np.array_equal(again.predict(X), model.predict(X)) and again.get_params() == model.get_params()


def test_threads_may_fit_at_once() -> None:
    X, y = correlated(400, 20, seed=13)
    paths: list[Any] = [None] * 4

    def fit(at: int) -> None:
        paths[at] = ff.LassoLarsCV(cv=4).fit(X, y).coef_

    threads = [threading.Thread(target=fit, args=(at,)) for at in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(np.array_equal(coef, ff.LassoLarsCV(cv=4).fit(X, y).coef_) for coef in paths)


def test_a_target_that_does_not_vary() -> None:
    X, _ = correlated(30, 3)
    for kind in (ff.Lars, ff.LassoLars, ff.LassoLarsCV, ff.LassoLarsIC):
        model = kind().fit(X, np.full(30, 2.5))
        assert not model.coef_.any() and model.intercept_ == 2.5
