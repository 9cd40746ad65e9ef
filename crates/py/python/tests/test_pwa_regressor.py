"""PWARegressor: exact on piecewise-affine data, and the regressions those of numpy."""

from __future__ import annotations

import pickle
import warnings

import numpy as np
import pytest
from numpy.typing import NDArray

import fleetfoot as ff
from fleetfoot._base import ConvergenceWarning

CENTERS = np.array([[-4.0, 0.0], [4.0, 0.0], [0.0, 7.0]])
COEF = np.array([[[1.0, -2.0], [0.5, 0.0]], [[-3.0, 0.25], [2.0, 1.0]], [[0.0, 4.0], [-1.0, -1.0]]])
INTERCEPT = np.array([[1.0, 2.0], [-5.0, 0.0], [3.0, 30.0]])


def _data(n: int = 900, noise: float = 0.0) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    random = np.random.RandomState(0)
    region = np.arange(n) % 3
    X = CENTERS[region] + random.uniform(-1.0, 1.0, (n, 2))
    y = np.einsum("nqp,np->nq", COEF[region], X) + INTERCEPT[region]
    return X, y + noise * random.normal(size=y.shape), region


def test_refined_regions_follow_the_targets() -> None:
    # Two maps of rows that lie on both sides of the border alike.
    random = np.random.RandomState(1)
    X = random.uniform(-3.0, 3.0, (600, 2))
    y = np.where(X[:, 0] > X[:, 1], X @ [1.0, -2.0] + 1.0, X @ [-3.0, 0.5] + 1.0) + 0.01 * random.normal(size=len(X))
    refined = ff.PWARegressor(partition="refined", n_regions=2).fit(X, y)
    assert refined.partition_ == "refined:2" and refined.n_regions_ == 2
    assert refined.centers_ is None
    agreement = np.mean(refined.labels_ == (X[:, 0] > X[:, 1]))
    assert max(agreement, 1.0 - agreement) > 0.98
    assert refined.score(X, y) > 0.99
    clustered = ff.PWARegressor(n_regions=2).fit(X, y)
    assert refined.score(X, y) > clustered.score(X, y) + 0.01
    again = pickle.loads(pickle.dumps(refined))
    np.testing.assert_array_equal(again.predict(X), refined.predict(X))
    chosen = ff.PWARegressor(partition="refined", n_regions=[1, 2]).fit(X, y)
    ranged = ff.PWARegressor(partition="refined:1..2").fit(X, y)
    assert chosen.partition_ == ranged.partition_ == "refined:2"
    np.testing.assert_array_equal(chosen.labels_, refined.labels_)
    np.testing.assert_array_equal(ranged.labels_, refined.labels_)


def test_cells_are_joined_to_regions() -> None:
    # One map holds on both sides of another. (Cells that a border cuts are worth a third region, at their size.)
    random = np.random.RandomState(1)
    X = random.uniform(-3.0, 3.0, (1000, 1))
    y = np.where(np.abs(X[:, 0]) < 1.0, 2.0 * X[:, 0], 1.0 - X[:, 0]) + 0.01 * random.normal(size=len(X))
    lattice = ff.PWARegressor(partition="lattice", n_regions=[1, 2]).fit(X, y)
    assert lattice.partition_ == "lattice:2" and lattice.n_regions_ == 2
    assert lattice.centers_ is None
    agreement = np.mean(lattice.labels_ == (np.abs(X[:, 0]) < 1.0))
    assert max(agreement, 1.0 - agreement) > 0.98
    again = pickle.loads(pickle.dumps(lattice))
    np.testing.assert_array_equal(again.predict(X), lattice.predict(X))
    ranged = ff.PWARegressor(partition="lattice:1..2").fit(X, y)
    np.testing.assert_array_equal(ranged.labels_, lattice.labels_)


def test_trees_cut_single_features() -> None:
    random = np.random.RandomState(1)
    X = random.uniform(-3.0, 3.0, (2000, 3))
    low = X[:, 1] < 0.5
    y = np.where(low, X[:, 0], np.where(X[:, 2] < -1.0, 2.0 - X[:, 0], 5.0 + X[:, 1])) + 0.05 * random.normal(size=2000)
    tree = ff.PWARegressor(partition="tree", n_regions=8, partition_features=[1, 2]).fit(X, y)
    # The third cut does not pay.
    assert tree.partition_ == "tree:3" and tree.n_regions_ == 3 and tree.centers_ is None
    assert tree.cuts_ is not None
    (first, threshold, below, above), (second, other, *_) = tree.cuts_
    assert (first, second, below, above) == (1, 2, -1, 1)
    assert abs(threshold - 0.5) < 0.02 and abs(other + 1.0) < 0.02
    assert np.mean((tree.labels_ == 0) == low) > 0.998
    again = pickle.loads(pickle.dumps(tree))
    np.testing.assert_array_equal(again.predict(X), tree.predict(X))
    assert np.sqrt(np.mean((tree.predict(X) - y) ** 2)) < 0.1
    assert ff.PWARegressor(partition="tree:1..4").fit(X, y).partition_ == "tree:2"
    assert ff.PWARegressor(partition="tree", n_regions=1).fit(X, y).partition_ == "average"


def test_maps_of_separate_regions_are_recovered() -> None:
    X, y, region = _data()
    model = ff.PWARegressor(n_regions=3, n_init=5).fit(X, y)
    assert model.n_regions_ == 3 and model.centers_ is not None
    order = [int(np.argmin(((model.centers_ - center) ** 2).sum(axis=1))) for center in CENTERS]
    assert sorted(order) == [0, 1, 2]
    np.testing.assert_allclose(model.coef_[order], COEF, atol=1e-9)
    np.testing.assert_allclose(model.intercept_[order], INTERCEPT, atol=1e-8)
    np.testing.assert_array_equal(model.apply(X), np.asarray(order)[region])
    np.testing.assert_array_equal(model.labels_, model.apply(X))
    np.testing.assert_allclose(model.predict(X), y, atol=1e-8)
    assert model.score(X, y) > 1.0 - 1e-12
    np.testing.assert_array_equal(model.counts_, [300, 300, 300])


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("partition", ["kmeans:7", "zscore:1.2", "zbox:1.2", "average", "null"])
def test_regions_are_least_squares_fits(partition: str, weighted: bool) -> None:
    X, y, _ = _data(noise=0.5)
    weight = np.random.RandomState(1).uniform(0.5, 2.0, len(X)) if weighted else None
    model = ff.PWARegressor(partition=partition).fit(X, y, sample_weight=weight)
    assert model.partition_ == partition
    root = np.ones(len(X)) if weight is None else np.sqrt(weight)
    for region in range(model.n_regions_):
        rows = model.labels_ == region
        design = np.column_stack([np.ones(rows.sum()), X[rows]])
        if partition == "null":
            design = design[:, :1]
        expected = np.linalg.lstsq(design * root[rows, None], y[rows] * root[rows, None], rcond=None)[0]
        np.testing.assert_allclose(model.intercept_[region], expected[0], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(model.coef_[region], expected[1:].T if len(expected) > 1 else 0.0, atol=1e-9)
    if partition == "zscore:1.2":
        z = (X - X.mean(axis=0)) / X.std(axis=0)
        np.testing.assert_array_equal(model.labels_, ((z**2).sum(axis=1) > 1.2**2).astype(int))
    if partition == "zbox:1.2":
        z = (X - X.mean(axis=0)) / X.std(axis=0)
        np.testing.assert_array_equal(model.labels_, (np.abs(z).max(axis=1) > 1.2).astype(int))
        np.testing.assert_array_equal(model.labels_, model.apply(X))


def test_the_number_of_regions_is_chosen_by_cross_validation() -> None:
    X, y, _ = _data(noise=0.3)
    order = np.random.RandomState(2).permutation(len(X))
    X, y = X[order], y[order]
    model = ff.PWARegressor(n_regions=[1, 2, 3, 12], n_init=5).fit(X, y)
    results = model.cv_results_
    assert results["partition"] == ["kmeans:1", "kmeans:2", "kmeans:3", "kmeans:12"]
    assert model.n_regions_ == 3 and model.best_index_ == 2
    assert results["split_test_loss"].shape == (4, 5)
    np.testing.assert_allclose(results["split_test_loss"].mean(axis=1), results["mean_test_loss"])
    assert results["mean_test_loss"][2] < 0.5 * results["mean_test_loss"][1]
    assert ff.PWARegressor(n_regions=[1, 3], selection="bic", n_init=5).fit(X, y).n_regions_ == 3


def test_groups_are_folds() -> None:
    # A function learned in one group holds in no other: by group it is worthless on held-out rows, by rows it is not.
    random = np.random.RandomState(3)
    groups = np.repeat(np.arange(6), 50)
    X = groups[:, None] * 10.0 + random.uniform(size=(300, 1))
    y = random.normal(size=6)[groups] + X[:, 0] % 1.0
    shuffled = random.permutation(300)

    def loss(rows: NDArray[np.int64]) -> float:
        model = ff.PWARegressor(n_regions=[6, 2], folds=6, n_init=5).fit(X[rows], y[rows], groups=groups[rows])
        return float(model.cv_results_["mean_test_loss"][0])

    by_group = loss(np.arange(300))
    np.testing.assert_allclose(loss(shuffled), by_group, rtol=0.5)
    rows = ff.PWARegressor(n_regions=[6, 2], folds=6, n_init=5).fit(X[shuffled], y[shuffled])
    assert rows.cv_results_["mean_test_loss"][0] < 0.1 * by_group


def test_regions_may_look_at_some_features_only() -> None:
    X, y, _ = _data(noise=0.1)
    model = ff.PWARegressor(n_regions=2, partition_features=[1]).fit(X, y[:, 0])
    assert model.centers_ is not None and model.centers_.shape == (2, 1) and model.coef_.shape == (2, 1, 2)
    moved = X + [100.0, 0.0]
    np.testing.assert_array_equal(model.apply(moved), model.apply(X))
    assert model.predict(X).shape == (len(X),)
    again = pickle.loads(pickle.dumps(model))
    np.testing.assert_array_equal(again.predict(X), model.predict(X))


def test_layout_and_type_do_not_show() -> None:
    X, y, _ = _data(noise=0.1)
    plain = ff.PWARegressor(n_regions=3).fit(X, y)
    for other in (np.asfortranarray(X), np.repeat(X, 2, axis=1)[:, ::2]):
        np.testing.assert_array_equal(ff.PWARegressor(n_regions=3).fit(other, y).predict(X), plain.predict(X))
    single = ff.PWARegressor(n_regions=3).fit(X.astype(np.float32), y.astype(np.float32))
    np.testing.assert_allclose(single.predict(X), plain.predict(X), atol=1e-4)


def test_bad_input_is_refused() -> None:
    X, y, _ = _data(60)
    for options, text in [
        ({"n_regions": 0}, "n_regions"),
        ({"n_regions": [2, 0]}, "n_regions"),
        ({"partition": "voronoi:3"}, "partition `voronoi:3`"),
        ({"partition_features": [2]}, "partition_features"),
        ({"folds": 1}, "folds"),
        ({"shrinkage": -1.0}, "shrinkage"),
    ]:
        with pytest.raises(ValueError, match=text):
            ff.PWARegressor(**options).fit(X, y)
    with pytest.raises(NotImplementedError, match="labels"):
        ff.PWARegressor(partition="labels:x0").fit(X, y)
    with pytest.raises(ValueError, match="same value"):
        ff.PWARegressor(2).fit(X, np.ones(60))
    with pytest.raises(ValueError, match="groups"):
        ff.PWARegressor(2).fit(X, y, groups=np.ones(3))
    with pytest.raises(ValueError, match="too few"):
        ff.PWARegressor(2).fit(X[:3], y[:3])


def test_a_clustering_that_did_not_converge_is_warned_of() -> None:
    rng = np.random.default_rng(5)
    X = rng.normal(size=(400, 2))
    y = np.abs(X[:, 0]) + 0.1 * X[:, 1]
    short = ff.PWARegressor(6, max_kmeans_iter=1)
    with pytest.warns(ConvergenceWarning, match="not converged after 1 iterations"):
        short.fit(X, y)
    # Another sentence with that word is no such warning.
    with warnings.catch_warnings():
        warnings.simplefilter("error", ConvergenceWarning)
        ff.PWARegressor(2).fit(X, y)
