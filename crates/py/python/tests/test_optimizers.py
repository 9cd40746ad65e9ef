"""STLSQ, SR3 and FROLS against pysindy's on the same arrays, inside pysindy, and against what they are defined by."""

from __future__ import annotations

import itertools
import pickle
import warnings
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import fleetfoot as ff
from fleetfoot._base import ConvergenceWarning


def _library(n: int = 400, seed: int = 0) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Polynomials of two signals, and two sparse targets."""
    random = np.random.RandomState(seed)
    t = np.linspace(0.0, 20.0, n)
    x, v = np.sin(t) + 0.5 * np.sin(2.3 * t), np.cos(0.7 * t)
    X = np.column_stack([np.ones(n), x, v, x * x, x * v, v * v, x**3, v**3])
    y = np.column_stack([0.5 - 2.0 * x + 0.3 * x * v, 1.5 * v - 0.15 * v**3 + 0.05 * x])
    return X, y + 0.05 * random.normal(size=y.shape)


def _grid(**options: list[Any]) -> list[dict[str, Any]]:
    return [dict(zip(options, values)) for values in itertools.product(*options.values())]


STLSQ_GRID = _grid(
    threshold=[0.0, 0.04, 0.2, 0.7],
    alpha=[0.0, 0.05, 5.0],
    max_iter=[1, 2, 20],
    normalize_columns=[False, True],
    unbias=[False, True],
)
# pysindy's SR3 divides by zero where there are fewer than ten iterations.
SR3_GRID = _grid(
    reg_weight_lam=[0.0, 0.005, 0.1],
    regularizer=["L0", "l1", "L2"],
    relax_coeff_nu=[0.1, 1.0],
    max_iter=[10, 30, 400],
    normalize_columns=[False, True],
    unbias=[False, True],
)
FROLS_GRID = _grid(
    max_iter=[1, 3, 10],
    alpha=[0.0, 0.05],
    kappa=[None, 1e-6, 1e-3],
    normalize_columns=[False, True],
    unbias=[False, True],
)


def _peer(name: str) -> Any:
    return getattr(pytest.importorskip("pysindy", reason="pysindy, the peer, is not installed"), name)


def _both(name: str, options: dict[str, Any], X: Any, y: Any, weight: Any = None) -> tuple[Any, Any]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        theirs = _peer(name)(**options)
        theirs.fit(X, y, sample_weight=weight)
        return getattr(ff, name)(**options).fit(X, y, sample_weight=weight), theirs


def _same(ours: Any, theirs: Any, what: dict[str, Any]) -> None:
    np.testing.assert_allclose(ours.coef_, theirs.coef_, rtol=1e-10, atol=1e-10, err_msg=str(what))
    assert ours.complexity == theirs.complexity, what
    np.testing.assert_array_equal(ours.ind_, theirs.ind_, err_msg=str(what))
    assert len(ours.history_) == len(theirs.history_), what
    for a, b in zip(ours.history_, theirs.history_):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-10, err_msg=str(what))


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("name, grid", [("STLSQ", STLSQ_GRID), ("SR3", SR3_GRID), ("FROLS", FROLS_GRID)])
def test_answers_are_pysindys(name: str, grid: list[dict[str, Any]], weighted: bool) -> None:
    X, y = _library()
    weight = np.random.RandomState(1).uniform(0.2, 3.0, len(X)) if weighted else None
    for options in grid[:: 3 if weighted else 1]:
        ours, theirs = _both(name, options, X, y, weight)
        _same(ours, theirs, options)
        np.testing.assert_allclose(ours.predict(X), theirs.predict(X), rtol=1e-9, atol=1e-9)
        if name != "FROLS":
            assert ours.iters == theirs.iters, options
        if name == "FROLS":
            np.testing.assert_allclose(ours.ERR_global, theirs.ERR_global, rtol=1e-7, atol=1e-12)
        if name == "SR3":
            np.testing.assert_allclose(ours.coef_full_, theirs.coef_full_, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", ["STLSQ", "SR3", "FROLS"])
def test_one_target_is_as_one_of_many(name: str) -> None:
    X, y = _library()
    ours, theirs = _both(name, {}, X, y[:, 0])
    _same(ours, theirs, {})
    assert ours.coef_.shape == (1, 8) and ours.predict(X).shape == (len(X),)


def test_initial_guesses_match_pysindy() -> None:
    X, y = _library()
    with pytest.warns(ConvergenceWarning):
        first = ff.STLSQ(threshold=0.2, max_iter=1, unbias=False).fit(X, y).coef_
    other = np.where(np.arange(16).reshape(2, 8) % 3 == 0, 1.0, 0.0)
    mixed = np.vstack([first[0], other[1]])
    for guess, normalize in itertools.product([first, other, mixed], [False, True]):
        options = {"threshold": 0.2, "initial_guess": guess, "normalize_columns": normalize}
        _same(*_both("STLSQ", options, X, y), options)
        options = {"initial_guess": guess, "normalize_columns": normalize, "max_iter": 10}
        _same(*_both("SR3", options, X, y), options)
    with pytest.raises(ValueError, match="initial_guess shape"):
        ff.STLSQ(initial_guess=np.ones(3)).fit(X, y)


def test_weights_of_coefficients_match_pysindy() -> None:
    X, y = _library()
    weights = np.random.RandomState(2).uniform(0.0, 0.05, (2, 8))
    for regularizer in ("weighted_l0", "weighted_L1", "weighted_l2"):
        options = {"reg_weight_lam": weights, "regularizer": regularizer}
        _same(*_both("SR3", options, X, y), options)


def test_fixed_columns_are_neither_penalised_nor_dropped() -> None:
    X, y = _library()
    chosen = [1, 3, 4, 5, 6, 7]
    model = ff.STLSQ(threshold=0.1, alpha=0.5, sparse_ind=chosen, unbias=False).fit(X, y)
    assert model.coef_.shape == (2, 6) and model.optvar_non_sparse_.shape == (2, 2)
    assert model.ind_non_sparse_.all() and not model.ind_.all()
    for target in range(2):
        rows = np.concatenate([[0, 2], np.asarray(chosen)[model.ind_[target]]])
        penalty = np.diag(np.sqrt(0.5) * np.isin(rows, chosen))
        design, right = np.vstack([X[:, rows], penalty]), np.concatenate([y[:, target], np.zeros(len(rows))])
        expected = np.linalg.lstsq(design, right, rcond=None)[0]
        np.testing.assert_allclose(model.optvar_non_sparse_[target], expected[:2], rtol=1e-9)
        np.testing.assert_allclose(model.coef_[target][model.ind_[target]], expected[2:], rtol=1e-9)
    _, theirs = _both("STLSQ", {"threshold": 0.1, "alpha": 0.5, "sparse_ind": chosen, "unbias": False}, X, y)
    np.testing.assert_allclose(model.coef_, theirs.coef_, rtol=1e-9, atol=1e-10)


def test_rows_without_target_are_left_out() -> None:
    X, y = _library()
    gone, left = y.copy(), np.arange(len(y)) % 7 != 0
    gone[~left] = np.nan
    np.testing.assert_array_equal(ff.STLSQ().fit(X, gone).coef_, ff.STLSQ().fit(X[left], y[left]).coef_)
    gone = X.copy()
    gone[5, 2] = np.nan
    with pytest.raises(ValueError, match="NaN"):
        ff.STLSQ().fit(gone, y)


@pytest.mark.parametrize(
    "name, options", [("STLSQ", {"threshold": 0.2}), ("SR3", {"reg_weight_lam": 0.1}), ("FROLS", {"max_iter": 3})]
)
@pytest.mark.parametrize("ensemble", [False, True])
def test_models_of_pysindy_are_the_same_with_ours_inside(name: str, options: dict[str, Any], ensemble: bool) -> None:
    ps = pytest.importorskip("pysindy", reason="pysindy, the peer, is not installed")
    t = np.arange(0.0, 10.0, 0.01)
    x = np.column_stack([np.exp(-0.1 * t) * np.cos(2.0 * t), np.exp(-0.1 * t) * np.sin(2.0 * t)])
    models = []
    for module in (ff, ps):
        optimizer = getattr(module, name)(**options)
        if ensemble:
            optimizer = ps.EnsembleOptimizer(optimizer, bagging=True, library_ensemble=True, n_models=5)
        np.random.seed(0)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            model = ps.SINDy(optimizer=optimizer, feature_library=ps.PolynomialLibrary(degree=2))
            model.fit(x, t=0.01, feature_names=["x", "y"])
        models.append(model)
    ours, theirs = models
    np.testing.assert_allclose(ours.coefficients(), theirs.coefficients(), rtol=1e-8, atol=1e-9)
    assert ours.equations() == theirs.equations() and ours.complexity == theirs.complexity
    np.testing.assert_allclose(ours.score(x, t=0.01), theirs.score(x, t=0.01), rtol=1e-9)
    np.testing.assert_allclose(ours.predict(x), theirs.predict(x), rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("normalize", [False, True])
def test_trimmed_rows_match_pysindy(normalize: bool, weighted: bool) -> None:
    X, y = _library()
    y = y.copy()
    y[[5, 50, 120]] += 30.0
    weight = np.random.RandomState(1).uniform(0.5, 2.0, len(X)) if weighted else None
    for options in ({}, {"regularizer": "l1"}, {"trimming_step_size": 0.1, "max_iter": 12}):
        options = {"trimming_fraction": 0.05, "normalize_columns": normalize, **options}
        ours, theirs = _both("SR3", options, X, y, weight)
        np.testing.assert_allclose(ours.trimming_array, theirs.trimming_array, atol=1e-8, err_msg=str(options))
        np.testing.assert_allclose(ours.coef_, theirs.coef_, rtol=1e-7, atol=1e-8, err_msg=str(options))
        assert ours.iters == theirs.iters
        assert not ours.trimming_array[[5, 50, 120]].any() and ours.trimming_array.sum() == pytest.approx(0.95 * len(X))


def test_shares_of_rows_are_the_nearest() -> None:
    from fleetfoot._trimming import on_capped_simplex

    random = np.random.default_rng(3)
    for count, fraction in [(1, 0.5), (7, 0.3), (40, 0.0), (40, 0.95), (200, 0.1)]:
        values = random.normal(0.5, 1.5, count)
        shares = on_capped_simplex(values, fraction)
        assert shares.min() >= 0.0 and shares.max() <= 1.0
        assert shares.sum() == pytest.approx((1.0 - fraction) * count)
        # The optimality conditions: one shift for all that are between the bounds, more of it below, less above.
        shift = values - shares
        between = (shares > 0.0) & (shares < 1.0)
        if between.any():
            level = shift[between]
            assert np.ptp(level) < 1e-12
            assert (shift[shares == 0.0] <= level[0] + 1e-12).all() and (shift[shares == 1.0] >= level[0] - 1e-12).all()


def test_unsupported_options_are_named() -> None:
    X, y = _library()
    with pytest.raises(NotImplementedError, match="regularizer"):
        ff.SR3(regularizer="l7")
    with pytest.raises(NotImplementedError, match="positive"):
        ff.STLSQ(ridge_kw={"positive": True})
    assert (ff.STLSQ(ridge_kw={"solver": "svd"}).fit(X, y).coef_ == ff.STLSQ().fit(X, y).coef_).all()
    for make in (
        lambda: ff.STLSQ(threshold=-1.0),
        lambda: ff.STLSQ(alpha=-1.0),
        lambda: ff.STLSQ(max_iter=0),
        lambda: ff.SR3(relax_coeff_nu=0.0),
        lambda: ff.SR3(tol=0.0),
        lambda: ff.SR3(reg_weight_lam=-1.0),
        lambda: ff.SR3(regularizer="weighted_l0"),
        lambda: ff.SR3(trimming_fraction=1.0),
        lambda: ff.SR3(trimming_fraction=0.1, unbias=True),
        lambda: ff.FROLS(max_iter=0),
        lambda: ff.STLSQ(sparse_ind=[0, 99]).fit(X, y),
    ):
        with pytest.raises(ValueError):
            make()
    assert ff.SR3.calculate_l0_weight(0.2, 0.5) == pytest.approx(0.04)


def test_warnings_and_pickles() -> None:
    X, y = _library()
    with pytest.warns(UserWarning, match="Sparsity parameter is too big"):
        model = ff.STLSQ(threshold=100.0).fit(X, y)
    assert not model.coef_.any() and model.complexity == 0
    with pytest.warns(ConvergenceWarning, match="did not converge after 1 iterations"):
        ff.STLSQ(threshold=0.2, max_iter=1).fit(X, y)
    with pytest.warns(ConvergenceWarning, match="SR3 did not converge"):
        ff.SR3(max_iter=1).fit(X, y)
    model = ff.STLSQ().fit(X, y)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(model)).predict(X), model.predict(X))


def test_options_without_effect_in_sindy_are_refused() -> None:
    t = np.arange(300) * 0.01
    x = np.column_stack([np.cos(2 * t), -2 * np.sin(2 * t)])
    ps = pytest.importorskip("pysindy", reason="pysindy is not installed")
    for optimizer, option in (
        (ff.SR3(max_iter=7), "max_iter=7"),
        (ff.SR3(tol=0.1), "tol=0.1"),
        (ps.SR3(max_iter=7), "max_iter=7"),
        (ps.SSR(max_iter=7), "max_iter=7"),
    ):
        with pytest.raises(ff.exceptions.RequestError, match=f"with {option} is not supported"):
            ff.SINDy(optimizer, library="poly(1)").fit(x, t)
    for optimizer in (ff.SR3(), ps.SR3(), ps.SSR(), ps.EnsembleOptimizer(ps.STLSQ(threshold=0.5), bagging=True, n_models=9)):
        assert ff.SINDy(optimizer, library="poly(1)").fit(x, t).complexity >= 2
