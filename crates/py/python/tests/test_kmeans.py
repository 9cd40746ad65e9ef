"""KMeans against scikit-learn's, and against the definition."""

from __future__ import annotations

import pickle
import warnings
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import fleetfoot as ff
from fleetfoot._base import ConvergenceWarning


def _rows(seed: int, n: int = 3000, d: int = 4, offset: float = 10.0) -> NDArray[np.float64]:
    random = np.random.RandomState(seed)
    centers = random.uniform(-5.0, 5.0, (6, d))
    return centers[random.randint(6, size=n)] + random.normal(size=(n, d)) + offset


def _nearest(X: NDArray[Any], centers: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    squared = ((X[:, None, :].astype(float) - centers[None].astype(float)) ** 2).sum(axis=2)
    return squared.argmin(axis=1), squared.min(axis=1)


@pytest.mark.parametrize("init", ["k-means++", "random", "array", "callable"])
@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_same_random_numbers_give_scikit_learns_result(init: str, weighted: bool, seed: int) -> None:
    cluster = pytest.importorskip("sklearn.cluster", reason="scikit-learn, the peer, is not installed")
    X = _rows(seed)
    weight = np.random.RandomState(seed).uniform(size=len(X)) if weighted else None
    drawn = {"array": X[:7], "callable": lambda X, k, random_state: X[random_state.permutation(len(X))[:k]]}
    options: dict[str, Any] = {"n_clusters": 7, "init": drawn.get(init, init), "random_state": seed}
    options["n_init"] = 1 if init == "array" else 3
    ours = ff.KMeans(**options).fit(X, sample_weight=weight)
    theirs = cluster.KMeans(**options).fit(X, sample_weight=weight)
    np.testing.assert_array_equal(ours.labels_, theirs.labels_)
    np.testing.assert_allclose(ours.cluster_centers_, theirs.cluster_centers_, rtol=1e-12)
    np.testing.assert_allclose(ours.inertia_, theirs.inertia_, rtol=1e-12)
    assert ours.n_iter_ == theirs.n_iter_ > 2
    np.testing.assert_allclose(ours.transform(X), theirs.transform(X), rtol=1e-9)
    np.testing.assert_allclose(ours.score(X, sample_weight=weight), theirs.score(X, sample_weight=weight), rtol=1e-12)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize("order", ["C", "F", "strided"])
def test_result_is_a_fixed_point(kind: Any, order: str) -> None:
    plain = _rows(3, offset=0.0).astype(kind)
    X: Any = {"C": plain, "F": np.asfortranarray(plain), "strided": np.repeat(plain, 2, axis=0)[::2]}[order]
    model = ff.KMeans(5, tol=0.0, random_state=0).fit(X)
    labels, squared = _nearest(plain, model.cluster_centers_)
    np.testing.assert_array_equal(model.labels_, labels)
    np.testing.assert_allclose(model.inertia_, squared.sum(), rtol=1e-6 if kind is np.float32 else 1e-12)
    means = np.array([plain[labels == k].astype(float).mean(axis=0) for k in range(5)])
    np.testing.assert_allclose(model.cluster_centers_, means, atol=3e-7 if kind is np.float32 else 1e-13)
    assert model.cluster_centers_.dtype == kind and model.transform(X).dtype == kind
    np.testing.assert_array_equal(model.predict(X), model.labels_)
    assert model.score(X) == -model.inertia_


def test_rows_of_weight_zero_start_nothing_and_move_nothing() -> None:
    X = _rows(4)
    weight = np.random.RandomState(4).uniform(size=len(X))
    weight[::2] = 0.0
    for init in ("k-means++", "random"):
        all_rows = ff.KMeans(12, init=init, max_iter=1, tol=0.0, n_init=1, random_state=1).fit(X, sample_weight=weight)
        assert np.isfinite(all_rows.cluster_centers_).all()
    start = X[1:13:2]
    whole = ff.KMeans(6, init=start).fit(X, sample_weight=weight)
    some = ff.KMeans(6, init=start).fit(X[1::2], sample_weight=weight[1::2])
    np.testing.assert_allclose(whole.cluster_centers_, some.cluster_centers_, rtol=1e-12)
    plain = ff.KMeans(6, init=start).fit(X)
    assert np.abs(plain.cluster_centers_ - whole.cluster_centers_).max() > 1e-3


def test_threads_do_not_show() -> None:
    X = _rows(5, n=50_000)
    models = []
    for threads in (1, 2):
        ff.set_threads(threads)
        models.append(ff.KMeans(9, random_state=0).fit(X))
    ff.set_threads(0)
    assert (models[0].cluster_centers_ == models[1].cluster_centers_).all()
    assert (models[0].labels_ == models[1].labels_).all() and models[0].inertia_ == models[1].inertia_


@pytest.mark.parametrize("scale", [1e-60, 1e-12, 1e25])
def test_the_unit_of_the_features_does_not_show(scale: float) -> None:
    X = _rows(6, offset=0.0)
    plain = ff.KMeans(5, random_state=0).fit(X)
    scaled = ff.KMeans(5, random_state=0).fit(X * scale)
    np.testing.assert_allclose(scaled.cluster_centers_, plain.cluster_centers_ * scale, rtol=1e-9)
    assert (scaled.labels_ == plain.labels_).mean() == 1.0


def test_fewer_different_rows_than_clusters() -> None:
    X = np.array([[0.0, 0.0], [1.0, 1.0], [1.0, 1.0], [1.0, 0.0]])
    with pytest.warns(ConvergenceWarning, match=r"distinct clusters \(3\) found smaller than n_clusters \(4\)"):
        model = ff.KMeans(4, random_state=0).fit(X)
    assert model.inertia_ == 0.0 and model.cluster_centers_.shape == (4, 2)


def test_bad_input_is_refused() -> None:
    X = _rows(7, n=50)
    for bad, text in [
        ({"n_clusters": 0}, "n_clusters"),
        ({"n_clusters": 51}, "n_samples=50 should be >= n_clusters=51"),
        ({"init": X[:3]}, "does not match the number of clusters 8"),
        ({"init": X[:8, :2]}, "does not match the number of features"),
        ({"init": np.full((8, 4), np.nan)}, "init contains NaN"),
        ({"init": "kmeans"}, "init"),
        ({"tol": -1.0}, "tol"),
        ({"max_iter": 0}, "max_iter"),
        ({"algorithm": "full"}, "algorithm"),
    ]:
        with pytest.raises(ValueError, match=text):
            ff.KMeans(**{"n_init": 1, **bad}).fit(X)
    for weight in (-np.ones(50), np.zeros(50), np.ones(3), np.full(50, np.nan)):
        with pytest.raises(ValueError, match="weight"):
            ff.KMeans(2).fit(X, sample_weight=weight)
    with pytest.raises(ValueError, match="NaN|missing"):
        ff.KMeans(2).fit(np.where(X == X[3, 1], np.nan, X))


def test_pickled_model_keeps_feature_names() -> None:
    X = _rows(8)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model = ff.KMeans(3, random_state=1).fit(X)
    again = pickle.loads(pickle.dumps(model))
    np.testing.assert_array_equal(again.predict(X), model.labels_)
    assert list(model.get_feature_names_out()) == ["kmeans0", "kmeans1", "kmeans2"]
    assert (ff.KMeans(3, random_state=1).fit_predict(X) == model.labels_).all()


@pytest.mark.parametrize("init", ["k-means++", "random"])
def test_sparse_rows_match_dense_rows(init: str) -> None:
    sparse = pytest.importorskip("scipy.sparse", reason="scipy is not installed")
    dense = np.where(np.random.RandomState(1).uniform(size=(5000, 7)) < 0.6, 0.0, _rows(11, 5000, 7))
    expected = ff.KMeans(4, init=init, n_init=2, random_state=0).fit(dense)
    for make in (sparse.csr_array, sparse.csc_matrix):
        X = make(dense)
        model = ff.KMeans(4, init=init, n_init=2, random_state=0).fit(X)
        np.testing.assert_array_equal(model.cluster_centers_, expected.cluster_centers_)
        np.testing.assert_array_equal(model.labels_, expected.labels_)
        np.testing.assert_array_equal(model.predict(X), expected.labels_)
        np.testing.assert_array_equal(model.transform(X), expected.transform(dense))
        assert model.score(X) == expected.score(dense) == -model.inertia_


def test_iterations_are_printed(capsys: pytest.CaptureFixture[str]) -> None:
    model = ff.KMeans(4, random_state=0, tol=0.0, verbose=1).fit(_rows(9))
    lines = capsys.readouterr().out.splitlines()
    inertias = [float(line.split()[-1].rstrip(".")) for line in lines if line.startswith("Iteration")]
    assert len(inertias) == model.n_iter_ and inertias == sorted(inertias, reverse=True)
    np.testing.assert_allclose(inertias[-1], model.inertia_, rtol=1e-12)
