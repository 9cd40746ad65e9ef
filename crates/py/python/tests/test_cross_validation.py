"""The cross-validated estimators: errors against the rows, laws of the answer, agreement with scikit-learn at many shapes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import fleetfoot as ff
from fleetfoot._folds import cross_validation, fold_groups, neighbour_groups

Maker = Callable[..., Any]


def rows_of(n: int, p: int, seed: int = 0, noise: float = 0.5, far: float = 2.0) -> tuple[NDArray[Any], NDArray[Any]]:
    """Correlated features about means of size `far`; a few of them make the target."""
    rng = np.random.default_rng(seed)
    X = rng.standard_normal((n, p)) + 0.5 * rng.standard_normal((n, 1)) + far * rng.uniform(-1.0, 1.0, p)
    coefs = np.where(np.arange(p) % max(3, p // 8) == 0, rng.standard_normal(p), 0.0)
    return X, X @ coefs + noise * rng.standard_normal(n) + 3.0


def neighbours(n: int, k: int) -> list[tuple[NDArray[Any], NDArray[Any]]]:
    every = np.arange(n)
    return [(np.setdiff1d(every, held), held) for held in np.array_split(every, k)]


def estimators(**options: Any) -> dict[str, Callable[[Any], Any]]:
    return {
        "LassoCV": lambda cv: ff.LassoCV(cv=cv, alphas=15, eps=1e-2, **options),
        "ElasticNetCV": lambda cv: ff.ElasticNetCV(cv=cv, alphas=15, eps=1e-2, l1_ratio=0.7, **options),
        "LassoLarsCV": lambda cv: ff.LassoLarsCV(cv=cv, max_iter=5_000, **options),
    }


def alphas_of(model: Any) -> NDArray[Any]:
    alphas: NDArray[Any] = model.cv_alphas_ if hasattr(model, "cv_alphas_") else model.alphas_
    return alphas


# -- groups of rows


def test_neighbours_need_no_lists() -> None:
    for n, k in [(10, 2), (23, 4), (1000, 7), (300, 256), (5, 5)]:
        splitter = ff._base.check_cv(k)
        without_lists, wanted = neighbour_groups(splitter, n), fold_groups(neighbours(n, k), n)
        assert without_lists is not None and wanted is not None
        # Names differ, what they mean does not.
        for fold, (train, test) in enumerate(neighbours(n, k)):
            for groups in (without_lists, wanted):
                assert np.array_equal(np.flatnonzero(np.isin(groups.labels, groups.trains[fold])), train)
                assert np.array_equal(np.flatnonzero(np.isin(groups.labels, groups.tests[fold])), test)
    assert neighbour_groups(ff._base.check_cv(300), 1000) is None
    assert neighbour_groups(ff._base.check_cv(neighbours(9, 3)), 9) is None
    X, y = rows_of(9, 2)
    with pytest.raises(ValueError, match="10"):
        cross_validation(X, y, 10)


def test_shuffled_and_repeated_folds_are_groups() -> None:
    selection = pytest.importorskip("sklearn.model_selection", reason="scikit-learn is not installed")
    X, y = rows_of(60, 4)
    label = np.arange(60) % 7
    splitter: Any
    for splitter in (
        selection.KFold(4, shuffle=True, random_state=1),
        selection.RepeatedKFold(n_splits=3, n_repeats=2, random_state=1),
        selection.ShuffleSplit(3, random_state=0),
        selection.TimeSeriesSplit(3),
        list(selection.GroupKFold(3).split(X, y, label)),
        (fold for fold in neighbours(60, 3)),
        [(np.arange(60) < 40, np.arange(60) >= 40)],
    ):
        if hasattr(splitter, "send"):
            lists = neighbours(60, 3)
        else:
            every = np.arange(60)
            lists = [(every[train], every[test]) for train, test in ff._base.check_cv(splitter).split(X, y)]
        errors, wanted = (ff.LassoCV(cv=cv, alphas=6).fit(X, y).mse_path_ for cv in (splitter, lists))
        np.testing.assert_array_equal(errors, wanted)
        order = np.random.default_rng(0).permutation(60)
        shuffled = [(order[np.isin(order, train)], order[np.isin(order, test)]) for train, test in lists]
        np.testing.assert_array_equal(ff.LassoCV(cv=shuffled, alphas=6).fit(X, y).mse_path_, wanted)


# -- errors against the rows


@pytest.mark.parametrize("name", ["LassoCV", "ElasticNetCV", "LassoLarsCV"])
@pytest.mark.parametrize(
    ("shape", "noise", "far", "tolerance"),
    [
        # Few rows, sums of rows, fewer rows than columns, many columns.
        ((200, 8), 0.5, 2.0, 1e-8),
        ((30_000, 45), 0.5, 2.0, 1e-8),
        ((60, 120), 0.5, 2.0, 1e-7),
        ((1_500, 520), 0.5, 2.0, 1e-7),
        # Nothing is lost to means that are a million times the deviation, nor to fits that leave a ten-millionth of the target.
        ((30_000, 45), 0.5, 1e6, 1e-6),
        ((30_000, 45), 1e-7, 2.0, 1e-6),
        # Plain products, of more than 512 columns, know what is left as well as the root of their rounding.
        ((1_500, 520), 1e-4, 2.0, 1e-6),
    ],
)
def test_errors_match_the_held_out_rows(
    name: str, shape: tuple[int, int], noise: float, far: float, tolerance: float
) -> None:
    X, y = rows_of(*shape, noise=noise, far=far)
    folds = neighbours(len(y), 3)
    model = estimators()[name](3).fit(X, y)
    alphas = alphas_of(model)
    # Paths go on to zero, where what is active hangs by a thread.
    known = np.flatnonzero(alphas > 1e-3 * alphas.max())
    for place in known[np.linspace(0, len(known) - 1, 4).astype(int)]:
        alpha = float(alphas[place])
        for fold, (train, test) in enumerate(folds):
            one = ff.ElasticNet(alpha=alpha, l1_ratio=getattr(model, "l1_ratio_", 1.0)).fit(X[train], y[train])
            # Predictions about the mean: what a plain product would round at a mean of 1e6 is no error of the model.
            centre = X[train].mean(axis=0)
            left = (y[test] - y[train].mean()) - (X[test] - centre) @ one.coef_
            error = np.mean(left**2)
            assert model.mse_path_[place, fold] == pytest.approx(error, rel=tolerance, abs=1e-24)


@pytest.mark.parametrize("name", ["LassoCV", "ElasticNetCV", "LassoLarsCV"])
@pytest.mark.parametrize("shape", [(60, 5), (30_000, 45), (20, 40)])
def test_values_that_are_not_finite_are_named(name: str, shape: tuple[int, int]) -> None:
    X, y = rows_of(*shape)
    for value, word in [(np.nan, "NaN"), (np.inf, "infinity"), (-np.inf, "infinity")]:
        wrong = X.copy()
        wrong[len(y) // 3, 2] = value
        with pytest.raises(ValueError, match=f"X contains {word}"):
            estimators()[name](3).fit(wrong, y)
        if name != "LassoLarsCV":
            # A row without weight leaves no trace in the sums, and is looked at all the same.
            with pytest.raises(ValueError, match=f"X contains {word}"):
                estimators()[name](3).fit(wrong, y, np.where(np.isfinite(wrong[:, 2]), 1.0, 0.0))
        with pytest.raises(ValueError, match="y contains"):
            estimators()[name](3).fit(X, np.where(np.arange(len(y)) == 7, value, y))


# -- laws of the answer


@pytest.mark.parametrize("name", ["LassoCV", "ElasticNetCV", "LassoLarsCV"])
@pytest.mark.parametrize("shape", [(90, 6), (60_000, 30), (40, 70)])
def test_the_order_of_rows_within_folds_does_not_matter(name: str, shape: tuple[int, int]) -> None:
    X, y = rows_of(*shape, seed=1)
    folds = neighbours(len(y), 3)
    rng = np.random.default_rng(2)
    order = np.concatenate([rng.permutation(test) for _, test in folds])
    a, b = (estimators()[name](3).fit(X[rows], y[rows]) for rows in (slice(None), order))
    np.testing.assert_allclose(a.coef_, b.coef_, rtol=0, atol=1e-8 * np.abs(a.coef_).max())
    assert a.alpha_ == pytest.approx(b.alpha_, rel=1e-8)
    if name != "LassoLarsCV":
        np.testing.assert_allclose(a.mse_path_, b.mse_path_, rtol=1e-7)


@pytest.mark.parametrize("name", ["LassoCV", "ElasticNetCV", "LassoLarsCV"])
@pytest.mark.parametrize("shape", [(90, 6), (60_000, 30), (40, 70), (1_300, 530)])
def test_the_bits_do_not_depend_on_the_threads(name: str, shape: tuple[int, int]) -> None:
    X, y = rows_of(*shape, seed=3)
    results = []
    for threads in (1, 3):
        ff.set_threads(threads)
        try:
            model = estimators()[name](3).fit(X, y)
        finally:
            ff.set_threads(0)
        results.append((model.coef_.tobytes(), model.mse_path_.tobytes(), alphas_of(model).tobytes(), model.alpha_))
    assert results[0] == results[1]


@pytest.mark.parametrize("shape", [(90, 6), (60_000, 30), (40, 70), (1_300, 530)])
@pytest.mark.parametrize("factor", [2.0**40, 2.0**-40, 1e-3])
def test_units_of_the_target_scale_the_answer(shape: tuple[int, int], factor: float) -> None:
    X, y = rows_of(*shape, seed=4)
    # Not that of the elastic net, whose squares have no unit of the target.
    for name in ("LassoCV", "LassoLarsCV"):
        make = estimators()[name]
        a, b = make(3).fit(X, y), make(3).fit(X, factor * y)
        assert b.alpha_ == pytest.approx(factor * a.alpha_, rel=1e-7)
        np.testing.assert_allclose(b.coef_ / factor, a.coef_, rtol=0, atol=1e-7 * np.abs(a.coef_).max())
        if hasattr(a, "cv_alphas_"):
            continue
        np.testing.assert_allclose(b.mse_path_ / factor**2, a.mse_path_, rtol=1e-6)


@pytest.mark.parametrize("shape", [(90, 6), (60_000, 30)])
def test_weight_of_two_equals_repeated_row(shape: tuple[int, int]) -> None:
    X, y = rows_of(*shape, seed=5)
    weight = np.random.default_rng(6).integers(0, 3, len(y)).astype(float)
    weight[0] = 1.0
    times = weight.astype(int)
    label = np.arange(len(y)) * 3 // len(y)
    folds = [(np.flatnonzero(label != k), np.flatnonzero(label == k)) for k in range(3)]
    repeated = np.repeat(label, times)
    again = [(np.flatnonzero(repeated != k), np.flatnonzero(repeated == k)) for k in range(3)]
    for kind in (ff.LassoCV, ff.ElasticNetCV):
        a = kind(cv=folds, alphas=9, eps=1e-2).fit(X, y, weight)
        b = kind(cv=again, alphas=9, eps=1e-2).fit(np.repeat(X, times, axis=0), np.repeat(y, times))
        np.testing.assert_allclose(a.mse_path_, b.mse_path_, rtol=1e-7)
        np.testing.assert_allclose(a.coef_, b.coef_, rtol=0, atol=1e-8 * np.abs(b.coef_).max())


@pytest.mark.parametrize("name", ["LassoCV", "ElasticNetCV", "LassoLarsCV"])
@pytest.mark.parametrize("shape", [(300, 9), (60_000, 30), (30, 40)])
def test_layouts_and_types_give_one_answer(name: str, shape: tuple[int, int]) -> None:
    X, y = rows_of(*shape, seed=7)
    X, y = X.astype(np.float32).astype(np.float64), y.astype(np.float32).astype(np.float64)
    plain = estimators()[name](4).fit(X, y)
    wide = np.zeros((2 * len(y), 3 * X.shape[1]))
    wide[::2, 1::3] = X
    for other in (np.asfortranarray(X), wide[::2, 1::3], X[::-1].copy()[::-1]):
        fitted = estimators()[name](4).fit(other, y)
        np.testing.assert_array_equal(fitted.mse_path_, plain.mse_path_)
        np.testing.assert_array_equal(fitted.coef_, plain.coef_)
    single = estimators()[name](4).fit(X.astype(np.float32), y.astype(np.float32))
    np.testing.assert_allclose(single.mse_path_, plain.mse_path_, rtol=1e-12)
    assert single.coef_.dtype == np.float32
    whole = np.round(8 * X)
    counted = estimators()[name](4).fit(whole.astype(np.int64), y)
    np.testing.assert_array_equal(counted.mse_path_, estimators()[name](4).fit(whole, y).mse_path_)


# -- against scikit-learn

SHAPES = [(50, 5), (400, 3), (2_000, 20), (20_000, 50), (60, 60), (300, 1_000), (900, 600)]


@pytest.mark.parametrize("shape", SHAPES, ids=str)
@pytest.mark.parametrize("name", ["LassoCV", "ElasticNetCV"])
def test_descents_match_scikit_learn(name: str, shape: tuple[int, int]) -> None:
    peer = pytest.importorskip("sklearn.linear_model", reason="scikit-learn, the peer, is not installed")
    X, y = rows_of(*shape, seed=8)
    options: dict[str, Any] = {"cv": 3, "alphas": 8, "eps": 3e-2}
    if name == "ElasticNetCV":
        options["l1_ratio"] = 0.8
    ours = getattr(ff, name)(**options).fit(X, y)
    theirs = getattr(peer, name)(tol=1e-11, max_iter=100_000, **options).fit(X, y)
    np.testing.assert_allclose(ours.alphas_, theirs.alphas_, rtol=1e-11)
    # Their gap of 1e-11 of the target's square is a root of that in the coefficients.
    np.testing.assert_allclose(ours.mse_path_, theirs.mse_path_, rtol=1e-4)
    assert ours.alpha_ == pytest.approx(theirs.alpha_, rel=1e-11)
    np.testing.assert_allclose(ours.coef_, theirs.coef_, rtol=0, atol=3e-5 * np.abs(theirs.coef_).max())
    assert ours.intercept_ == pytest.approx(theirs.intercept_, rel=1e-3, abs=1e-3)
    assert ours.dual_gap_ <= 1e-9 * np.var(y)


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_paths_match_scikit_learn(shape: tuple[int, int]) -> None:
    peer = pytest.importorskip("sklearn.linear_model", reason="scikit-learn, the peer, is not installed")
    X, y = rows_of(*shape, seed=9)
    ours, theirs = (module.LassoLarsCV(cv=3, max_iter=40).fit(X, y) for module in (ff, peer))
    assert len(ours.cv_alphas_) == len(theirs.cv_alphas_)
    np.testing.assert_allclose(ours.cv_alphas_, theirs.cv_alphas_, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(ours.mse_path_, theirs.mse_path_, rtol=1e-7)
    assert ours.alpha_ == pytest.approx(theirs.alpha_, rel=1e-8, abs=1e-12)
    np.testing.assert_allclose(ours.coef_, theirs.coef_, rtol=0, atol=1e-7 * np.abs(theirs.coef_).max())
