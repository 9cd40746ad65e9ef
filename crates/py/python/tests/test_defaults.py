"""Results of a first call are right, or refused: simulations, optimiser objects, stamps, missing values, constants."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import fleetfoot as ff
from fleetfoot.exceptions import FitError, ModelError, RequestError


def slope(x):
    x, y, z = x.T
    return np.column_stack([10 * (y - x), x * (28 - z) - y, x * y - 8 / 3 * z])


def follow(f, start, t, parts):
    """Runge-Kutta steps, `parts` from one time to the next."""
    x, rows = np.atleast_2d(np.asarray(start, dtype=float)), []
    for k, now in enumerate(t):
        rows.append(x[0])
        if k + 1 == len(t):
            break
        h = (t[k + 1] - now) / parts
        for _ in range(parts):
            a = f(x)
            b = f(x + h / 2 * a)
            c = f(x + h / 2 * b)
            d = f(x + h * c)
            x = x + h / 6 * (a + 2 * b + 2 * c + d)
    return np.array(rows)


def lorenz(seconds=8.0, dt=0.002, start=(-8.0, 8.0, 27.0)):
    t = np.arange(round(seconds / dt)) * dt
    x = follow(slope, start, t, 4)
    return t, x, slope(x)


@pytest.fixture(scope="module")
def exact():
    """The Lorenz system from its exact derivatives."""
    t, x, x_dot = lorenz()
    return ff.SINDy(threshold=0.1, ridge=0.0, library="poly(2)").fit(x, t, x_dot)


def notes_of(call):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = call()
    return result, [str(one.message) for one in caught if issubclass(one.category, ff.FleetfootWarning)]


# -- simulations


def test_coarse_grid_is_simulated_exactly(exact):
    coarse = np.arange(0, 3.01, 0.1)
    truth = follow(slope, (-8.0, 8.0, 27.0), coarse, 2000)
    simulated = exact.simulate([-8.0, 8.0, 27.0], coarse)
    assert np.abs(simulated - truth).max() < 1e-4
    # Equal steps are those of the sampling period where no more is said; one an interval is another system.
    assert np.abs(exact.simulate([-8.0, 8.0, 27.0], coarse, method="rk4") - truth).max() < 1e-3
    assert np.abs(exact.simulate([-8.0, 8.0, 27.0], coarse, method="rk4", substeps=1) - truth).max() > 1.0
    loose = np.abs(exact.simulate([-8.0, 8.0, 27.0], coarse, rtol=1e-4) - truth).max()
    assert np.abs(simulated - truth).max() < loose < 0.1
    many = exact.simulate([[-8.0, 8.0, 27.0], [1.0, 1.0, 1.0]], coarse)
    assert np.array_equal(many[0], simulated)
    assert np.array_equal(exact.model_.simulate([1.0, 1.0, 1.0], coarse), many[1])


def test_inputs_of_time_are_sampled_every_period():
    t = np.arange(1000) * 0.01
    u = np.sin(9 * t)
    x = np.zeros(len(t))
    for k in range(len(t) - 1):
        x[k + 1] = x[k] * np.exp(-0.02) + u[k] * (1 - np.exp(-0.02)) / 2.0
    fit = ff.SINDy(library="poly(1)").fit(x, t, -2 * x + u, u=u, feature_names=["x"], input_names=["u"])
    coarse = np.arange(0, 9, 0.5)
    places = (coarse / 0.01).round().astype(int)
    # A sampled controller holds its inputs; a function of time goes in straight lines from sample to sample.
    closed = fit.simulate([0.0], coarse, lambda time, state: np.sin(9 * time))[:, 0]
    np.testing.assert_allclose(closed, x[places], atol=1e-6)
    lines = fit.simulate([0.0], t, u, interpolate=True)[places, 0]
    simulated = fit.simulate([0.0], coarse, lambda time: np.sin(9 * time))[:, 0]
    np.testing.assert_allclose(simulated, lines, atol=1e-6)
    exact = (2 * np.sin(9 * coarse) - 9 * np.cos(9 * coarse) + 9 * np.exp(-2 * coarse)) / 85
    assert np.abs(simulated - exact).max() < 1e-4 < 3e-3 < np.abs(closed - exact).max()


def test_discrete_models_keep_their_grid():
    t = np.arange(400) * 0.02
    x = np.cos(t)
    discrete = ff.SINDy(discrete_time=True, library="poly(1)").fit(np.column_stack([x, -np.sin(t)]), t).model_
    assert discrete.simulate([1.0, 0.0], t[:50]).shape == (50, 2)
    with pytest.raises(ModelError, match=r"0\.1 s after.*0\.02 s apart.*next row"):
        discrete.simulate([1.0, 0.0], np.arange(10) * 0.1)
    with pytest.raises(ModelError, match=r"t\[3\] comes 0\.04"):
        discrete.simulate([1.0, 0.0], [0.0, 0.02, 0.04, 0.08])
    narx = ff.NARX(lags_out=2, degree=1, terms=2).fit(x, t).model_
    with pytest.raises(ModelError, match="sampling|apart"):
        narx.simulate([1.0], [0.0, 1.0], history=([[1.0]], np.zeros((1, 0))))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"method": "rk5"}, "rk5.*rk45"),
        ({"method": "rk45", "substeps": 4}, "substeps=4.*rtol"),
        ({"method": "rk4", "rtol": 1e-3}, "rtol.*fixed"),
        ({"substeps": 4, "atol": 1e-3}, "atol.*fixed"),
        ({"substeps": 0}, "substeps=0"),
        ({"substeps": 1.5}, r"substeps=1\.5"),
        ({"rtol": 0.0}, "rtol=0"),
        ({"atol": [1.0, 2.0]}, r"atol has the shape \(2,\)"),
        ({"atol": -1.0}, "atol"),
    ],
)
def test_options_of_a_simulation_take_effect_or_are_refused(exact, options, words):
    with pytest.raises(ModelError, match=words):
        exact.simulate([1.0, 1.0, 1.0], [0.0, 0.1], **options)


# -- optimisers


def same_support(fitted, peer):
    coefficients, expected = fitted.coefficients(), peer.coefficients()
    assert np.array_equal(coefficients != 0, expected != 0), (fitted.equations(3), expected)
    np.testing.assert_allclose(coefficients, expected, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("whose", ["ours", "theirs"])
@pytest.mark.parametrize(
    "options",
    [
        ("FROLS", {}),
        ("FROLS", {"max_iter": 3}),
        ("FROLS", {"max_iter": 8, "kappa": 1e-7}),
        ("FROLS", {"kappa": 1e-3, "normalize_columns": True}),
        ("STLSQ", {"threshold": 0.5}),
        ("STLSQ", {"threshold": 0.5, "max_iter": 1}),
        ("STLSQ", {"threshold": 0.1, "alpha": 5.0, "max_iter": 2}),
        ("STLSQ", {"threshold": 100.0, "normalize_columns": True}),
    ],
)
def test_optimiser_objects_match_pysindy(options, whose):
    ps = pytest.importorskip("pysindy", reason="pysindy is not installed")
    t, x, x_dot = lorenz(4.0)
    # Without noise, the ratios of superfluous terms are rounding, and so is their order.
    x_dot = x_dot + 0.1 * np.random.default_rng(0).normal(size=x.shape)
    name, parameters = options
    module = ff if whose == "ours" else ps
    with warnings.catch_warnings():
        # A few regressions do not converge.
        warnings.simplefilter("ignore")
        peer = ps.SINDy(optimizer=getattr(ps, name)(**parameters), feature_library=ps.PolynomialLibrary(2))
        peer.fit(x, t=t, x_dot=x_dot)
        fitted = ff.SINDy(optimizer=getattr(module, name)(**parameters), library="poly(2)").fit(x, t, x_dot)
    same_support(fitted, peer)


def test_elimination_and_ensembles_of_pysindy_are_optimisers():
    ps = pytest.importorskip("pysindy", reason="pysindy is not installed")
    t, x, x_dot = lorenz()
    ensemble = ps.EnsembleOptimizer(ps.STLSQ(threshold=0.1), bagging=True, n_models=30)
    for given in (ps.SSR(alpha=0.0), ensemble, ff.SR3(reg_weight_lam=0.005)):
        fit = ff.SINDy(optimizer=given, library="poly(2)").fit(x, t, x_dot)
        assert np.count_nonzero(fit.coefficients(), axis=1).tolist() == [2, 3, 2], type(given).__name__
    both = ps.EnsembleOptimizer(ps.STLSQ(), bagging=True, library_ensemble=True)
    with pytest.raises(RequestError, match="EnsembleOptimizer of rows and functions at once"):
        ff.SINDy(optimizer=both).fit(x, t, x_dot)


def test_forward_regression_of_the_lorenz_system_is_sparse():
    t, x, x_dot = lorenz()
    x_dot = x_dot + 0.1 * np.random.default_rng(0).normal(size=x.shape)
    fit = ff.SINDy(optimizer=ff.FROLS(kappa=1e-7), library="poly(2)").fit(x, t, x_dot)
    # As many as pysindy keeps; the object was asked for ten at most.
    assert np.count_nonzero(fit.coefficients(), axis=1).tolist() == [2, 3, 3]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"optimizer": ff.STLSQ(unbias=False)}, "unbias=False"),
        ({"optimizer": ff.FROLS(unbias=False)}, "unbias=False"),
        ({"optimizer": ff.STLSQ(initial_guess=[[1.0]])}, "initial_guess"),
        ({"optimizer": ff.STLSQ(sparse_ind=[0])}, "sparse_ind.*fixed="),
        ({"optimizer": ff.STLSQ(verbose=True)}, "verbose=True.*progress"),
        ({"optimizer": ff.SR3(regularizer="L1")}, "SR3 with another penalty.*regularizer='L0'"),
        ({"optimizer": ff.SR3(relax_coeff_nu=0.5)}, "relax_coeff_nu=0.5"),
        ({"optimizer": ff.SR3(trimming_fraction=0.1)}, "trimming_fraction=0.1"),
        ({"optimizer": ff.STLSQ(threshold=0.1), "threshold": 0.2}, r"threshold=0\.2.*0\.1.*once"),
        ({"optimizer": ff.FROLS(), "terms": 3}, "terms=3.*10.*max_iter"),
    ],
)
def test_options_of_optimiser_objects_are_kept(arguments, words):
    t, x, x_dot = lorenz(0.5)
    with pytest.raises(RequestError, match=words):
        ff.SINDy(**arguments).fit(x, t, x_dot)


# -- stamps


def estimators():
    return [ff.SINDy(), ff.PWA(), ff.NARX(lags_out=2, degree=1, terms=3), ff.BlockSparse()]


@pytest.mark.parametrize("estimator", estimators(), ids=lambda one: type(one).__name__)
def test_a_target_is_no_clock(estimator):
    rng = np.random.default_rng(0)
    x = rng.normal(size=(100_000, 5))
    with pytest.raises(ValueError, match=r"t of run 0 goes back in row \d+.*x_dot=.*target='y'"):
        estimator.fit(x, x @ np.ones(5))
    with pytest.raises(ValueError, match=r"shape \(100000, 2\).*x_dot="):
        estimator.fit(x, x[:, :2])
    with pytest.raises(ValueError, match="stands still at 99999"):
        estimator.fit(x, np.zeros(100_000))


def test_remedy_in_the_message_works():
    rng = np.random.default_rng(0)
    x = rng.uniform(-1, 1, size=(500, 2))
    fit = ff.SINDy(target="y", library="poly(2)").fit(x, dt=0.01, columns={"y": 3 * x[:, 0] * x[:, 1]})
    assert fit.equations(3) == ["y = 3*x0*x1"]


def test_clocks_that_repeat_a_stamp_are_clocks():
    t, x, _ = lorenz(1.0)
    t = t.copy()
    t[100] = t[99]
    _, notes = notes_of(lambda: ff.PWA().fit(x, t))
    assert any("stamp of the row before" in note for note in notes), notes


@pytest.mark.parametrize("estimator", [ff.SINDy, ff.PWA, ff.BlockSparse])
def test_one_row_episodes_are_refused_early(estimator):
    """Every stamp backward, in a table, where a backward stamp begins an episode."""
    resource = pytest.importorskip("resource", reason="there are no limits of memory to read here")
    rows = 200_000
    rng = np.random.default_rng(0)
    columns = {name: rng.normal(size=rows) for name in ("a", "b", "c", "d", "y")}
    data = ff.open({"t": np.arange(rows)[::-1] * 0.01, **columns}, t="t")
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises((FitError, RequestError), match="200000 rows in 200000 episodes.*stamps do not rise"):
        estimator(target="y", inputs=["a", "b", "c", "d"]).fit(data)
    # Kilobytes; a statistic for each would be gigabytes.
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 1_000_000


# -- missing values


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("estimator", estimators(), ids=lambda one: type(one).__name__)
def test_rows_left_out_are_counted_and_placed(estimator, bad):
    t, x, _ = lorenz(2.0)
    x = x.copy()
    x[500:503, 1] = bad
    _, notes = notes_of(lambda: estimator.fit(x, t))
    counts = [note for note in notes if "left out" in note]
    assert len(counts) == 1 and "missing value" in counts[0], notes
    assert "`x1` in row 501 of run 0" in counts[0] and int(counts[0].split()[0]) >= 3
    _, notes = notes_of(lambda: estimator.fit(lorenz(2.0)[1], t))
    assert not any("left out" in note for note in notes)


# -- constants


@pytest.mark.parametrize("value", [0.0, 0.1, 5e6])
@pytest.mark.parametrize("discrete", [False, True])
def test_constant_states_are_refused_by_name(value, discrete):
    t, x, _ = lorenz(2.0)
    rows = np.column_stack([x[:, 0], np.full(len(t), value), x[:, 1], x[:, 2]])
    with pytest.raises(FitError, match=r"x1\S* has the same value"):
        ff.SINDy(library="poly(1)", discrete_time=discrete).fit(rows, t)


def test_constant_output_is_refused():
    rng = np.random.default_rng(1)
    u = rng.normal(size=2000)
    y = np.zeros(2000)
    for k in range(1, 1999):
        y[k + 1] = 0.6 * y[k] - 0.2 * y[k - 1] + 0.5 * u[k]
    rows = np.column_stack([y, np.full(2000, 0.1)])
    with pytest.raises(FitError, match=r"next\(x1\) has the same value 0.1"):
        ff.NARX(2, 2, 1).fit(rows, 0.01, u=u)
    assert ff.NARX(2, 2, 1).fit(y, 0.01, u=u).score(y, 0.01, u=u) == pytest.approx(1.0, abs=1e-9)
    # An output that rests in one of the spans.
    y[:800] = 0.0
    u[:800] = 0.0
    for k in range(799, 1999):
        y[k + 1] = 0.6 * y[k] - 0.2 * y[k - 1] + 0.5 * u[k]
    assert ff.NARX(2, 2, 1).fit(y, 0.01, u=u).score(y, 0.01, u=u) > 0.999


def test_block_sparse_finds_the_lorenz_system():
    t, x, _ = lorenz()
    fit = ff.BlockSparse(degree=2).fit(x, t)
    assert min(task["r2"] for task in fit.report_["tasks"]) > 0.999, fit.report_["tasks"]


@pytest.mark.parametrize("kind", ["array", "table"])
def test_discrete_models_report_uneven_stamps(kind):
    random = np.random.default_rng(0)
    even = np.arange(400) * 0.01
    uneven = even + random.uniform(-0.004, 0.004, 400)

    def notes(estimator, t):
        x = np.column_stack([np.cos(2 * t), -2 * np.sin(2 * t)])
        if kind == "array":
            messages = notes_of(lambda: estimator.fit(x, t))[1]
        else:
            pandas = pytest.importorskip("pandas", reason="pandas is not installed")
            messages = notes_of(lambda: estimator.fit(pandas.DataFrame({"t": t, "a": x[:, 0], "b": x[:, 1]})))[1]
        return [note for note in messages if "uneven" in note]

    for discrete in (ff.PWA(target="next"), ff.SINDy(discrete_time=True), ff.NARX(2)):
        assert len(notes(discrete, uneven)) == 1 and not notes(discrete, even)
    assert not notes(ff.PWA(), uneven)
