"""Base classes with and without scikit-learn, and the checks of parameters and data."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fleetfoot as ff
from fleetfoot import _base, _plain
from fleetfoot._folds import fold_designs, fold_groups
from fleetfoot._params import BOOLEAN, NONE, check_params, integer, one_of, real
from fleetfoot.exceptions import ParameterError

WITHOUT = """
import sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in "sklearn scipy pandas polars pyarrow dask ray matplotlib tqdm pysindy".split():
            raise ImportError(name + " is blocked")

sys.meta_path.insert(0, Blocked())
import pickle
import warnings
import numpy as np
import fleetfoot as ff
from fleetfoot import _base

assert not _base.HAS_SKLEARN and "sklearn" not in sys.modules
rng = np.random.default_rng(0)
X = rng.normal(size=(60, 5)).astype(np.float32)
y = X[:, 0] - 2 * X[:, 3] + 0.1 * rng.normal(size=60)
for model in [ff.Lars(), ff.LassoLars(alpha=0.01), ff.LassoLarsCV(cv=4), ff.LassoLarsIC("bic")]:
    for call in (model.predict, lambda X: model.score(X, y)):
        try:
            call(X)
        except _base.NotFittedError as error:
            assert type(model).__name__ in str(error)
        else:
            raise AssertionError("not fitted")
    assert model.fit(X, y) is model
    assert model.n_features_in_ == 5 and model.coef_.dtype == np.float32
    assert model.score(X, y) > 0.98
    again = type(model)(**model.get_params()).fit(X, y)
    assert np.array_equal(again.coef_, model.coef_)
    assert np.array_equal(pickle.loads(pickle.dumps(model)).coef_, model.coef_)
    try:
        model.predict(X[:, :3])
    except ValueError as error:
        assert "3 features" in str(error)
    else:
        raise AssertionError("other features")
assert repr(ff.LassoLars(alpha=0.5)) == "LassoLars(alpha=0.5)"
assert ff.LassoLars().set_params(alpha=0.5).alpha == 0.5
with warnings.catch_warnings(record=True) as found:
    warnings.simplefilter("always")
    ff.LassoLars(alpha=0.0).fit(np.c_[X, X[:, 0]], y)
assert any(issubclass(warning.category, _base.ConvergenceWarning) for warning in found)
t = np.arange(300) * 0.01
x = np.column_stack([np.cos(2 * t), -2 * np.sin(2 * t)])
for model in [ff.SINDy(dt=0.01, library="poly(1)"), ff.PWA(dt=0.01), ff.NARX(2, degree=1, terms=2), ff.BlockSparse(degree=1, dt=0.01)]:
    try:
        model.predict(x)
    except _base.NotFittedError as error:
        assert type(model).__name__ in str(error)
    else:
        raise AssertionError("not fitted")
    warnings.simplefilter("ignore")
    assert model.fit(x).score(x) > 0.99 and model.n_features_in_ == 2
    again = type(model)(**model.get_params()).fit(x)
    assert np.array_equal(pickle.loads(pickle.dumps(again)).predict(x), model.predict(x), equal_nan=True)
    warnings.resetwarnings()
assert ff.SINDy(optimizer=ff.STLSQ()).set_params(optimizer__threshold=0.5).get_params()["optimizer__threshold"] == 0.5
print("fitted without", ff.LassoLarsCV(cv=4).fit(X.astype(float), y).alpha_)
"""


def test_wrong_parameters_raise_parameter_error():
    assert issubclass(ff.exceptions.ParameterError, ValueError) and "ParameterError" in ff.exceptions.__all__
    with pytest.raises(ff.exceptions.ParameterError, match="n_clusters"):
        ff.KMeans(n_clusters=0).fit([[1.0], [2.0]])


def test_the_package_works_with_numpy_alone() -> None:
    given = [str(Path(path).resolve()) for path in os.environ.get("PYTHONPATH", "").split(os.pathsep) if path]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(given)}
    process = subprocess.run(
        [sys.executable, "-c", WITHOUT], capture_output=True, text=True, env=environment, check=False
    )
    assert process.returncode == 0, process.stderr
    # The same answer as here, with scikit-learn's classes if it is installed.
    rng = np.random.default_rng(0)
    X = rng.normal(size=(60, 5)).astype(np.float32)
    y = X[:, 0] - 2 * X[:, 3] + 0.1 * rng.normal(size=60)
    assert process.stdout.split()[-1] == str(ff.LassoLarsCV(cv=4).fit(X.astype(float), y).alpha_)


class Estimator(_base.BaseEstimator):
    def __init__(self, size: Any = 1.0, inner: Any = None) -> None:
        self.size = size
        self.inner = inner


class Plain(_plain.BaseEstimator):
    def __init__(self, size: Any = 1.0, inner: Any = None) -> None:
        self.size = size
        self.inner = inner


def checked(plain: bool, X: Any, y: Any = None, *, reset: bool = True, estimator: Any = None, **options: Any) -> Any:
    """Checked data of either library."""
    if plain:
        return _plain.validate_data(estimator or Plain(), X, y, reset=reset, **options)
    if y is None:
        return _base.check_x(estimator or Estimator(), X, reset=reset)
    return _base.check_xy(estimator or Estimator(), X, y, **options)


@pytest.mark.parametrize("plain", [False, True])
def test_arrays_of_floats_are_taken_as_they_are(plain: bool) -> None:
    for dtype in (np.float32, np.float64):
        for X in (np.ones((4, 3), dtype), np.asfortranarray(np.ones((4, 3), dtype)), np.ones((8, 6), dtype)[::2, ::2]):
            assert np.shares_memory(checked(plain, X), X)
    array = checked(plain, [[1, 2], [3, 4]])
    assert array.dtype == np.float64


@pytest.mark.parametrize("plain", [False, True])
def test_bad_data_are_refused(plain: bool) -> None:
    good = np.arange(6.0).reshape(3, 2)
    for X in [
        good[0],
        np.ones((2, 2, 2)),
        np.full((2, 2), np.nan),
        np.full((2, 2), np.inf),
        np.ones((0, 3)),
        np.ones((3, 0)),
    ]:
        with pytest.raises(ValueError, match=r"X|array|sample|feature"):
            checked(plain, X)
    with pytest.raises(ValueError, match="omplex"):
        checked(plain, good + 1j)
    with pytest.raises(ValueError, match="could not convert"):
        checked(plain, np.array([["a", "b"]], dtype=object))
    with pytest.raises(ValueError, match=r"1d array|1D"):
        checked(plain, good, np.ones((3, 2)))
    with pytest.raises(ValueError):
        checked(plain, good, np.ones(4))
    with pytest.raises(ValueError, match="y contains NaN"):
        checked(plain, good, np.array([1.0, np.nan, 2.0]))
    X, y = checked(plain, good, np.ones((3, 2)), multi_output=True)
    assert y.shape == (3, 2)
    with pytest.warns(_plain.DataConversionWarning if plain else _base.DataConversionWarning):
        assert checked(plain, good, np.ones((3, 1)))[1].shape == (3,)
    sparse = pytest.importorskip("scipy.sparse", reason="scipy is not installed")
    with pytest.raises(TypeError, match="parse"):
        checked(plain, sparse.csr_matrix(good))


@pytest.mark.parametrize("plain", [False, True])
def test_features_are_counted_and_named(plain: bool) -> None:
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    estimator = Plain() if plain else Estimator()
    table = pandas.DataFrame({"a": [1.0, 2.0], "b": [3.0, 4.0]})
    checked(plain, table, estimator=estimator)
    assert estimator.n_features_in_ == 2 and list(estimator.feature_names_in_) == ["a", "b"]
    with pytest.raises(ValueError, match="expecting 2 features"):
        checked(plain, np.ones((2, 3)), reset=False, estimator=estimator)
    with pytest.raises(ValueError, match="feature names"):
        checked(plain, table.rename(columns={"a": "c"}), reset=False, estimator=estimator)
    checked(plain, table.to_numpy(), estimator=estimator)
    assert not hasattr(estimator, "feature_names_in_")


def test_parameters_by_name() -> None:
    outer = Plain(inner=Plain(size=3))
    assert outer.get_params()["inner__size"] == 3 and "inner__size" not in outer.get_params(deep=False)
    assert outer.set_params(inner__size=4, size=2).inner.size == 4
    with pytest.raises(ValueError, match="no parameter 'width'"):
        outer.set_params(width=1)
    assert repr(outer) == "Plain(inner=Plain(size=4), size=2)"


def test_scores_match_scikit_learn() -> None:
    metrics = pytest.importorskip("sklearn.metrics", reason="scikit-learn is not installed")
    rng = np.random.default_rng(1)

    class Model(_plain.RegressorMixin):
        def predict(self, X: Any) -> Any:
            return X

    for shape in [(20,), (20, 3)]:
        truth, predicted, weight = rng.normal(size=shape), rng.normal(size=shape), rng.random(20)
        for w in (None, weight):
            expected = metrics.r2_score(truth, predicted, sample_weight=w)
            assert abs(Model().score(predicted, truth, w) - expected) < 1e-13


def test_weights_and_seeds() -> None:
    assert _base.check_weight(None, 3) is None
    assert np.array_equal(_base.check_weight(2, 3), [2.0, 2.0, 2.0])
    for bad in ([1.0], [[1.0, 1.0, 1.0]], [1.0, -1.0, 1.0], [1.0, np.nan, 1.0], [0.0, 0.0, 0.0]):
        with pytest.raises(ValueError, match=r"(?i)sample.weight"):
            _base.check_weight(bad, 3)
    assert _base.random_seed(7) == 7
    assert _base.random_seed(np.random.RandomState(3)) == _base.random_seed(np.random.RandomState(3))
    assert _base.random_seed(np.random.default_rng(3)) == _base.random_seed(np.random.default_rng(3))
    np.random.seed(5)
    first = _base.random_seed(None)
    np.random.seed(5)
    assert _base.random_seed(None) == first
    for bad in (-1, 2**32, "seed", 1.5, True):
        with pytest.raises(ValueError, match="seed"):
            _base.random_seed(bad)


def test_rules_name_the_parameter() -> None:
    rules = {
        "size": (real(0.0, 1.0, "neither"), NONE),
        "kind": (one_of("a", "b"),),
        "count": (integer(1),),
        "flag": (BOOLEAN,),
    }
    good = {"size": 0.5, "kind": "a", "count": 3, "flag": np.True_}
    check_params("thing", rules, **good)
    check_params("thing", rules, **{**good, "size": None})
    for name, value in [
        ("size", 0.0),
        ("size", True),
        ("size", np.nan),
        ("kind", "c"),
        ("count", 1.0),
        ("count", 0),
        ("flag", 1),
    ]:
        with pytest.raises(ParameterError, match=f"'{name}' parameter of thing must be .* Got {value!r}") as caught:
            check_params("thing", rules, **{**good, name: value})
        assert isinstance(caught.value, (ValueError, TypeError)) and isinstance(
            caught.value, ff.exceptions.FleetfootError
        )


def test_plain_folds_match_scikit_learn() -> None:
    selection = pytest.importorskip("sklearn.model_selection", reason="scikit-learn is not installed")
    X = np.zeros((23, 1))
    for cv in (None, 4, selection.ShuffleSplit(3, random_state=0), [(np.arange(5), np.arange(5, 23))]):
        ours = list(_plain.check_cv(cv).split(X, None))
        theirs = list(selection.check_cv(cv).split(X, None))
        assert len(ours) == len(theirs)
        assert all(np.array_equal(a, b) for one, two in zip(ours, theirs) for a, b in zip(one, two))
    for bad in (1, "five", 2.5):
        with pytest.raises(ValueError):
            _plain.check_cv(bad)
    with pytest.raises(ValueError, match="24 folds of 23 rows"):
        list(_plain.check_cv(24).split(X))


def test_folds_are_unions_of_groups() -> None:
    rng = np.random.default_rng(4)
    every = np.arange(50)
    held = [rng.permutation(50)[:12] for _ in range(5)]
    splits = [(np.setdiff1d(every, part), part) for part in held]
    labels, trains, tests = fold_groups(splits, 50) or pytest.fail("there are few groups")
    for (train, test), trains_on, tests_on in zip(splits, trains, tests):
        assert np.array_equal(np.flatnonzero(np.isin(labels, trains_on)), np.sort(train))
        assert np.array_equal(np.flatnonzero(np.isin(labels, tests_on)), np.sort(test))
    # A row that counts twice, and more kinds of rows than are worth it.
    assert fold_groups([(np.array([0, 0, 1]), np.array([2]))], 50) is None
    many = [(np.setdiff1d(np.arange(3000), part), part) for part in (rng.permutation(3000)[:1500] for _ in range(10))]
    assert fold_groups(many, 3000) is None
    X, y = rng.normal(size=(50, 3)), rng.normal(size=50)
    one, folds = fold_designs(X, y, splits)
    assert one is not None and all(held is one for held, _, _ in folds.folds)
    weight = rng.random(50)
    for separate, shared in zip(
        fold_designs(X, y, [(np.r_[train, train[:1]], test) for train, test in splits])[1].folds,
        fold_designs(X, y, splits, weight)[1].folds,
    ):
        assert separate[0].shape[0] == 51 and shared[0].shape[0] == 50
    errors = folds.folds[0][0].mean_squares(folds.folds[0][2], 0, np.zeros(3), np.zeros(1))
    assert abs(errors[0] - np.mean(y[held[0]] ** 2)) < 1e-14
