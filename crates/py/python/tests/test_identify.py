"""Fits of runs, tables and files: known truth, and one answer whatever the door."""

from __future__ import annotations

import copy
import json
import pickle
import warnings

import numpy as np
import pytest
from command import run

import fleetfoot as ff
from fleetfoot import _core, _recipe
from fleetfoot.exceptions import DataError, FitError, ModelError, RequestError
from recordings import recording



def lorenz(count=4000, dt=0.002, x0=(-8.0, 8.0, 27.0)):
    """A trajectory of the Lorenz system by small Runge-Kutta steps, and its derivatives."""

    def slope(x):
        return np.array([10 * (x[1] - x[0]), x[0] * (28 - x[2]) - x[1], x[0] * x[1] - 8 / 3 * x[2]])

    x, rows = np.array(x0), np.empty((count, 3))
    for k in range(count):
        rows[k] = x
        for _ in range(4):
            h = dt / 4
            a = slope(x)
            b = slope(x + h / 2 * a)
            c = slope(x + h / 2 * b)
            d = slope(x + h * c)
            x = x + h / 6 * (a + 2 * b + 2 * c + d)
    return np.arange(count) * dt, rows, np.array([slope(row) for row in rows])


def lorenz_truth(names):
    known = {
        (0, "x0"): -10,
        (0, "x1"): 10,
        (1, "x0"): 28,
        (1, "x1"): -1,
        (1, "x0*x2"): -1,
        (2, "x2"): -8 / 3,
        (2, "x0*x1"): 1,
    }
    coefficients = np.zeros((3, len(names)))
    for (state, function), value in known.items():
        coefficients[state, names.index(function)] = value
    return coefficients


def test_lorenz_is_identified():
    t, x, x_dot = lorenz()
    exact = ff.SINDy(threshold=0.1, ridge=0.0).fit(x, t, x_dot)
    assert np.abs(exact.coefficients() - lorenz_truth(exact.get_feature_names())).max() < 1e-9
    counted = ff.SINDy(terms=3).fit(x, t)
    assert (np.count_nonzero(counted.coefficients(), axis=1) <= 3).all()
    # Differences over 2 ms: their error is h^2/6 of the third derivative.
    chosen = ff.SINDy(threshold=0.1).fit(x, t)
    coefficients, expected = chosen.coefficients(), lorenz_truth(chosen.get_feature_names())
    assert np.array_equal(coefficients != 0, expected != 0)
    assert np.abs(coefficients - expected).max() < 0.02
    assert chosen.score(x, t) > 0.9999


def test_pysindy_gives_the_same():
    ps = pytest.importorskip("pysindy", reason="pysindy is not installed")
    t, x, _ = lorenz()
    peer = ps.SINDy(optimizer=ps.STLSQ(threshold=0.1)).fit(x, t=t)
    fitted = ff.SINDy(
        optimizer=ps.STLSQ(threshold=0.1),
        feature_library=ps.PolynomialLibrary(degree=2),
        differentiation_method=ps.FiniteDifference(),
    ).fit(x, t)
    assert [name.replace(" ", "*") for name in peer.get_feature_names()] == fitted.get_feature_names()
    np.testing.assert_allclose(fitted.coefficients(), peer.coefficients(), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(fitted.predict(x), peer.predict(x), rtol=1e-9, atol=1e-7)
    assert fitted.score(x, t) == pytest.approx(peer.score(x, t), abs=1e-9)
    # One second of a chaotic system; both integrators are accurate.
    times = t[:500]
    np.testing.assert_allclose(fitted.simulate(x[0], times), peer.simulate(x[0], times), rtol=1e-4, atol=1e-3)


def test_pysindy_with_inputs_and_runs():
    ps = pytest.importorskip("pysindy", reason="pysindy is not installed")
    t = np.arange(600) * 0.01
    runs, inputs = [], []
    for phase in (0.0, 1.0):
        u = np.sin(3 * t + phase)
        x = np.empty((len(t), 2))
        x[0] = 1.0, phase
        for k in range(len(t) - 1):
            x[k + 1] = x[k] + 0.01 * np.array([x[k, 1], -4 * x[k, 0] - 0.5 * x[k, 1] + 2 * u[k]])
        runs.append(x)
        inputs.append(u)
    peer = ps.SINDy(optimizer=ps.STLSQ(threshold=0.2), feature_library=ps.PolynomialLibrary(2))
    peer.fit(runs, t=t, u=inputs)
    fitted = ff.SINDy(threshold=0.2, library="poly(2)", differentiation_method=ps.FiniteDifference()).fit(runs, t, u=inputs)
    assert fitted.model_.inputs == ("u0",)
    np.testing.assert_allclose(fitted.coefficients(), peer.coefficients(), rtol=1e-8, atol=1e-8)


def hybrid():
    path = recording("hybrid-diff-drive.csv")
    return path, np.genfromtxt(path, delimiter=",", names=True)


HYBRID_STATES = {
    "x": {"derivative": "dx", "regressor": False},
    "phi": {"derivative": "dphi", "regressor": False},
    "xd": {"derivative": "ddx"},
    "phid": {"derivative": "ddphi"},
}


def hybrid_truth(names):
    """Regions x equations x (1, xd, phid, u1, u2)."""
    assert names == ["1", "xd", "phid", "u1", "u2"]
    common = [[0, 1, 0, 0, 0], [0, 0, 1, 0, 0], [0, -0.175, 0, 0.5, 0], [0, 0, -0.8 / 3, 0, 0.6]]
    both = np.array([common, common])
    both[1, 0, 0], both[1, 1, 0] = -1.0, 1.0
    return both


def test_hybrid_robot_is_recovered_through_every_door():
    path, raw = hybrid()
    options = {"partition": "labels:region", "folds": 0, "tsqr": True}
    file = ff.PWA(states=HYBRID_STATES, inputs=["u1", "u2"], **options).fit(path)
    names = file.get_feature_names()
    assert np.abs(file.coefficients() - hybrid_truth(names)).max() < 1e-12
    table = {name: raw[name] for name in raw.dtype.names}
    memory = ff.PWA(states=HYBRID_STATES, inputs=["u1", "u2"], **options).fit(ff.open(table, t="t"))
    x, u, x_dot = (
        np.column_stack([raw[name] for name in columns])
        for columns in (("x", "phi", "xd", "phid"), ("u1", "u2"), ("dx", "dphi", "ddx", "ddphi"))
    )
    labels = {"columns": {"region": raw["region"]}}
    unread = {name: {"regressor": False} for name in ("x", "phi")}
    arrays = ff.PWA(states=unread, **options)
    arrays.fit(x, raw["t"], x_dot, u, ["x", "phi", "xd", "phid"], ["u1", "u2"], **labels)
    assert arrays.get_feature_names() == names
    for other in (memory, arrays):
        assert np.array_equal(other.coefficients(), file.coefficients()), "the same rows, the same bits"
    assert arrays.model_.regions == ("0", "1")
    assert arrays.score(x, raw["t"], x_dot, u, **labels) == pytest.approx(1.0, abs=1e-12)


def test_arrays_and_arrow_equal_the_file(tmp_path):
    pa = pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    t, x, _ = lorenz(800)
    x = x.astype(np.float32).astype(np.float64)
    fits = [ff.SINDy().fit(kind, t).coefficients() for kind in (x, np.asfortranarray(x), x.astype(np.float32))]
    wide = np.zeros((len(t), 7))
    wide[:, ::3] = x
    fits.append(ff.SINDy().fit(wide[:, ::3], t).coefficients())
    table = pa.table({"t": t, **{f"x{i}": x[:, i] for i in range(3)}})
    parquet.write_table(table, tmp_path / "run.parquet")
    for source in (table, tmp_path / "run.parquet"):
        fits.append(ff.SINDy(states=["x0", "x1", "x2"]).fit(source, "t").coefficients())
    for other in fits[1:]:
        assert np.array_equal(other, fits[0])


def test_runs_are_episodes():
    t, x, x_dot = lorenz(600)
    s, y, y_dot = lorenz(500, x0=(3.0, -4.0, 20.0))
    both = ff.SINDy(threshold=0.1).fit([x, y], [t, s], [x_dot, y_dot])
    assert both.report_["episodes"] == 2 and both.report_["rows"] == 1100
    # Differences need neighbours, three on either side up to the sixth order, and none of another run.
    period = ff.SINDy(threshold=0.1).fit([x[:500], y], dt=0.002)
    assert period.report_["rows"] == 2 * (500 - 6)
    for clock in (0.002, [0.002, 0.002]):
        other = ff.SINDy(threshold=0.1).fit([x[:500], y], clock)
        assert np.array_equal(period.coefficients(), other.coefficients())


def test_the_command_line_and_python_agree(tmp_path):
    t, x, _ = lorenz(600)
    rows = np.column_stack([t, x])
    np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header="t,x0,x1,x2", comments="", fmt="%.17g")
    arguments = ["fit", "pwa", "run.csv", "--states", "x0,x1,x2", "--time", "t", "-p", "kmeans:3", "-o", "model.json"]
    run(*arguments, folder=tmp_path)
    fitted = ff.PWA(3).fit(x, t)
    assert np.array_equal(ff.load(tmp_path / "model.json").coefficients(), fitted.coefficients())
    fitted.save(tmp_path / "own.json")
    shown = run("show", "own.json", "--json", folder=tmp_path)
    assert json.loads(shown.stdout) == json.loads(fitted.model_.to_json())


def test_piecewise_models_are_chosen():
    rng = np.random.default_rng(3)
    x = rng.uniform(-1, 1, size=(4000, 2))
    y = np.where(x[:, 0] > 0, 2 * x[:, 0] + x[:, 1], -3 * x[:, 0] + x[:, 1]) + 0.01 * rng.normal(size=4000)
    data = ff.open({"a": x[:, 0], "b": x[:, 1], "y": y}, dt=0.1)
    fit = ff.PWA(["average", 2, 8], target="y", inputs=["a", "b"], partition_on=["a"], keep_all=True).fit(data)
    assert [one["partition"] for one in fit.report_["candidates"]] == ["average", "kmeans:2", "kmeans:8"]
    assert fit.report_["chosen"] > 0 and len(fit.models_) == 3
    assert fit.score(data) > 0.99
    assert fit.model_.states == () and fit.model_.inputs == ("a", "b")
    rows = fit.predict(data)
    np.testing.assert_array_equal(fit.predict(None, x), rows["predicted"])
    np.testing.assert_array_equal(rows["measured"][:, 0], y)


def narx_run(count, seed):
    rng = np.random.default_rng(seed)
    u, y = rng.normal(size=count), np.zeros(count)
    for k in range(1, count - 1):
        y[k + 1] = 0.6 * y[k] - 0.2 * y[k - 1] + 0.5 * u[k] + 0.1 * u[k - 1] ** 2
    return y, u


def test_narx_finds_the_recursion():
    (y, u), (z, v) = narx_run(600, 0), narx_run(500, 1)
    narx = ff.NARX(2, 2, 2, terms=4).fit([y, z], u=[u, v], feature_names=["y"], input_names=["u"])
    terms = {term["function"]: term["coefficient"] for term in narx.report_["regions"][0]["equations"][0]["terms"]}
    expected = {"y": 0.6, "lag(y, 1)": -0.2, "u": 0.5, "lag(u, 1)^2": 0.1}
    assert terms.keys() == expected.keys()
    for function, value in expected.items():
        assert terms[function] == pytest.approx(value, abs=1e-10)
    model = narx.model_
    assert model.lags == 1 and not model.is_continuous
    free = model.simulate([y[1]], np.arange(1, 600), u[1:], history=([[y[0]]], [[u[0]]]))
    np.testing.assert_allclose(free[:, 0], y[1:], atol=1e-9)
    assert narx.score([y], u=[u]) == pytest.approx(1.0, abs=1e-12)


def test_block_sparse_finds_shared_functions():
    rng = np.random.default_rng(5)
    a, b, c = rng.uniform(1, 2, 2000), rng.uniform(0, 1, 2000), rng.uniform(-1, 1, 2000)
    thrust, drag = a * (2.0 + 3.0 * b), 0.7 * b**2
    noise = 1e-3 * rng.normal(size=(2, 2000))
    columns = {"a": a, "b": b, "c": c, "along": thrust - drag + noise[0], "across": c * thrust + noise[1]}
    fit = ff.BlockSparse(
        latents={"T": {"times": "a", "of": ["b", "c"], "degree": 2}, "D": {"functions": ["b", "b^2", "b^3"]}},
        tasks={"first": ("along", "T - D"), "second": {"target": "across", "right": "c*T"}},
        select="bic",
    ).fit(ff.open(columns, dt=0.01))
    coefficients = {
        (latent["name"], one["function"]): one["coefficient"]
        for latent in fit.report_["latents"]
        for one in latent["functions"]
        if one["selected"]
    }
    for key, value in {("T", "a"): 2.0, ("T", "a*b"): 3.0, ("D", "b^2"): 0.7}.items():
        assert coefficients.pop(key) == pytest.approx(value, abs=0.02)
    assert all(abs(value) < 0.02 for value in coefficients.values()), coefficients
    assert fit.report_["certificate"]["kkt"] < 1e-6
    assert fit.coefficients(latent="D").shape == (4,)
    with pytest.raises(ModelError, match="latent="):
        fit.coefficients()


def test_recipes_reach_every_option():
    t, x, _ = lorenz(800)
    plain = ff.SINDy(threshold=0.1, library="poly(2)").fit(x, t).coefficients()
    text = '[sindy]\nthreshold = 0.1\n[library]\nfunctions = ["poly(2)"]\n'
    for recipe in (text, {"sindy": {"threshold": 0.1}, "library": {"functions": ["poly(2)"]}}):
        assert np.array_equal(ff.SINDy(recipe=recipe).fit(x, t).coefficients(), plain)
    # An argument stands above the recipe.
    assert np.array_equal(ff.SINDy(threshold=0.1, recipe={"sindy": {"threshold": 5.0}}).fit(x, t).coefficients(), plain)
    # The recipe of the method stands above that of the data.
    data = ff.open({"t": t, "x0": x[:, 0], "x1": x[:, 1], "x2": x[:, 2]}, recipe={"sindy": {"threshold": 5.0}}, t="t")
    method = ff.SINDy(states=["x0", "x1", "x2"], recipe={"sindy": {"threshold": 0.1}})
    assert np.array_equal(method.fit(data).coefficients(), plain)


def test_known_derivatives_and_angles():
    t = np.arange(2000) * 0.01
    yaw = 0.9 * t + np.sin(t)
    speed = 1 + 0.3 * np.sin(2 * t)
    x = np.cumsum(speed * np.cos(yaw)) * 0.01
    rows = np.column_stack([x, (yaw + np.pi) % (2 * np.pi) - np.pi, speed])
    fit = ff.PWA(known={"x": "v*cos(yaw)"}, angles=["yaw"], states={"x": {"regressor": False}})
    fit.fit(rows, t, feature_names=["x", "yaw", "v"])
    assert fit.model_.outputs == ("d(yaw)/dt", "d(v)/dt")
    assert fit.get_feature_names() == ["1", "cos(yaw)", "sin(yaw)", "v"]
    assert fit.equations()[0] == "d(x)/dt = v*cos(yaw)"
    # The jump of the angle at pi is none of its derivative, which is 0.9 + cos(t).
    report = fit.model_.score(rows, t)
    assert report["targets"][0]["max"] < 2.0
    assert report["in_sample_episodes"], "these very rows trained the model"


@pytest.mark.parametrize(
    ("arguments", "keywords", "error", "words"),
    [
        ((np.zeros((5, 2)),), {}, ValueError, "dt="),
        ((np.zeros((5, 2)), np.zeros(4)), {}, ValueError, "5 rows"),
        (([np.zeros((5, 2)), np.zeros((5, 3))], 0.1), {}, ValueError, "2, 3 columns"),
        ((np.zeros((5, 2)), 0.1), {"u": np.zeros(4)}, ValueError, "u of run 0 has 4 rows"),
        ((np.zeros((5, 2)), 0.1), {"x_dot": np.zeros((5, 1))}, ValueError, "x_dot has 1 columns"),
        ((np.zeros((5, 2)), 0.1), {"feature_names": ["a"]}, ValueError, "feature_names has 1"),
        ((np.zeros((5, 2)), 0.1), {"feature_names": ["a", "a"]}, ValueError, "a stands for two"),
        ((np.zeros((5, 2)), 0.1), {"columns": {"x0": np.zeros(5)}}, ValueError, "x0 stands for two"),
        ((np.zeros((5, 2)), 0.1), {"input_names": ["a"]}, ValueError, "u is not"),
        ((np.zeros((5, 2, 2)), 0.1), {}, ValueError, "3 dimensions"),
        ((np.zeros((0, 2)), 0.1), {}, ValueError, "without rows"),
        ((np.zeros((5, 2)), -0.1), {}, RequestError, "dt"),
        ((np.array([["a"], ["b"]]), 0.1), {}, DataError, "numbers"),
        (([np.zeros(5), np.zeros(5)], [0.1, 0.2]), {}, ValueError, "one rate"),
        ((np.zeros((5, 2)), 0.1), {"dt": 0.1}, ValueError, "both given"),
        (("nowhere/*.mcap",), {}, DataError, "nowhere"),
        (("nowhere/*.mcap",), {"u": np.zeros(4)}, ValueError, "belong to arrays"),
    ],
)
def test_bad_data_are_refused_by_name(arguments, keywords, error, words):
    with pytest.raises(error, match=words):
        ff.SINDy().fit(*arguments, **keywords)


@pytest.mark.parametrize(
    ("estimator", "words"),
    [
        (lambda: ff.PWA(0), "partition=0"),
        (lambda: ff.PWA("kmeens:3"), "kmeens"),
        (lambda: ff.PWA(folds=-1), "folds=-1"),
        (lambda: ff.PWA(select="best"), "select"),
        (lambda: ff.PWA(shrinkage="much"), "shrinkage='much': give a number, or one of 'auto', 'none'"),
        (lambda: ff.PWA(angles=["yaw"]), "yaw"),
        (lambda: ff.PWA(known={"z": "1"}), "'z' is not a state"),
        (lambda: ff.SINDy(optimizer="stlqs"), "stlqs"),
        (lambda: ff.SINDy(optimizer=object()), "object"),
        (lambda: ff.SINDy(library="poly("), "poly"),
        (lambda: ff.SINDy(threshold=0.1, terms=2), "terms"),
        (lambda: ff.SINDy(library="sin", feature_library="cos"), "one argument"),
        (lambda: ff.SINDy(discrete_time=True, target="delta"), "discrete_time"),
        (lambda: ff.SINDy(recipe={"sindy": {"thresold": 1}}), "thresold"),
        (lambda: ff.NARX(lags_out=0, lags_in=0), "nothing is left"),
        (lambda: ff.NARX(terms="many"), "many"),
        (lambda: ff.NARX(2, lags="6:3"), "both set the number of earlier rows"),
        (lambda: ff.NARX(lags="3:6"), "50:5"),
        (lambda: ff.BlockSparse(lam="big"), "big"),
        (lambda: ff.BlockSparse(latents={"T": {"of": ["x0"]}}), "tasks"),
    ],
)
def test_bad_options_are_refused_by_name(estimator, words):
    t, x, _ = lorenz(60)
    with pytest.raises((RequestError, FitError), match=words):
        estimator().fit(x, t)


def test_autoregressions_range_over_gleaned_rows():
    """The present row and every third of the last six, as for every other method."""
    t, x, _ = lorenz(400)
    for lags in ("6:3", {"last": 6, "every": 3}):
        narx = ff.NARX(lags=lags, degree=1, terms="all").fit(x[:, :1], t, feature_names=["x"])
        assert narx.report_["order"] == {"lags_out": 3, "lags_in": 0, "every": 3, "degree": 1}
        functions = {term["function"] for term in narx.report_["regions"][0]["equations"][0]["terms"]}
        assert functions - {"1"} == {"x", "lag(x, 3)", "lag(x, 6)"}


#: Entries that are words or switches: a value, and another one. The others take numbers.
WORDS = {
    "select": ("bic", "cv"),
    "unseen_labels": ("pool", "refuse"),
    "outside": ("hold", "average"),
    "order": ("auto", "fixed"),
    "effort": ("low", "high"),
    "ensemble": ("chunks:5", "library:5"),
    "bolasso": ("chunks:5", "rows:5"),
    "optimizer": ("stlsq", "sr3"),
    "groups": ("signal", "term"),
    "passive": ("f:v", "f:v:0.1"),
    "phase": ("alpha_l:24", "labels:stance"),
    "objective": ("steps:3", "one-step"),
    "smooth_states": ("on", "off"),
    **dict.fromkeys(("tsqr", "continuous", "direct", "adaptive", "stability", "unscaled", "normalize"), (True, False)),
}


@pytest.mark.parametrize(
    ("estimator", "section"), [(ff.PWA, "pwa"), (ff.BlockSparse, "sparse"), (ff.SINDy, "sindy"), (ff.NARX, "narx")]
)
def test_every_option_is_an_overriding_argument(estimator, section):
    entries = dict(_core.settings())[section]
    assert len(entries) > 9
    assert section not in estimator()._method_recipe(), "what is not said stays with the recipe"
    for entry in entries:
        value, other = WORDS.get(entry, (2, 3))
        given = estimator(**{{"lambda": "lam"}.get(entry, entry): value})._method_recipe()
        assert list(given) == [section] and list(given[section]) == [entry]
        if isinstance(given[section][entry], str):
            other = str(other)
        below = {section: {entry: other}}
        assert _recipe.override(given, below) == given, entry
        assert _recipe.override({section: {}}, below) == below, entry


def test_simulation_objective_is_reported():
    """A decay that is measured with noise: one step pulls it to zero, simulations do not."""
    rng = np.random.default_rng(3)
    runs = []
    for _ in range(6):
        x, u = np.zeros(300), rng.normal(size=300)
        for k in range(299):
            x[k + 1] = 0.9 * x[k] + u[k]
        runs.append((x + rng.normal(size=300), u))
    x, u = [run[0] for run in runs], [run[1] for run in runs]
    given = {"t": 0.1, "u": u, "feature_names": ["x"], "input_names": ["u"]}
    fits = {how: ff.PWA(1, target="next", folds=0, objective=how).fit(x, **given) for how in ("one-step", "steps:10")}
    at = fits["one-step"].get_feature_names().index("x")
    slope = {how: float(fit.coefficients()[0, at]) for how, fit in fits.items()}
    assert abs(slope["steps:10"] - 0.9) < 0.5 * abs(slope["one-step"] - 0.9), slope
    report = fits["steps:10"].report_["objective"]
    assert report["written"] and report["steps"] == 10 and "objective" not in fits["one-step"].report_
    before, after = report["rollouts_over_persistence"]
    assert after < before
    with pytest.raises(ff.exceptions.FleetfootError, match="one-step, free-run, or steps:N"):
        ff.PWA(objective="many").fit(x, **given)


def test_arguments_remove_contradicting_entries():
    t, x, _ = lorenz(400)
    recipe = {"sindy": {"terms": 1}}
    given = ff.SINDy(threshold=0.1, recipe=recipe).fit(x, t)
    assert np.array_equal(given.coefficients(), ff.SINDy(threshold=0.1).fit(x, t).coefficients())
    assert "terms" not in given.report_["recipe"]


def test_a_saved_recipe_fits_the_same_model(tmp_path):
    t, x, _ = lorenz(600)
    data = ff.open({"t": t, **{f"x{i}": x[:, i] for i in range(3)}}, t="t")
    states = ["x0", "x1", "x2"]
    for given in (
        ff.PWA(["average", 2], states=states, folds=4, shrinkage=5.0, seed=3, restarts=2, memory=1 << 20),
        ff.SINDy(threshold=0.2, states=states, ensemble="chunks:10", seed=2),
        ff.NARX(2, 0, 1, states=states[:1], terms=2, folds=4),
        ff.BlockSparse(states=states, degree=2, select="cv", folds=4),
    ):
        model = given.fit(data).model_
        again = type(given)(recipe=model.recipe).fit(data).model_
        assert again.to_json() == model.to_json(), type(given).__name__


def test_parameters_behave_as_in_scikit_learn():
    estimator = ff.SINDy(threshold=0.2, library=["poly(2)"])
    assert repr(estimator) == "SINDy(library=['poly(2)'], threshold=0.2)"
    assert estimator.get_params()["threshold"] == 0.2
    assert estimator.set_params(threshold=0.3).threshold == 0.3
    with pytest.raises(ValueError, match="treshold"):
        estimator.set_params(treshold=0.1)
    with pytest.raises(AttributeError, match="not fitted"):
        estimator.equations()
    base = pytest.importorskip("sklearn.base", reason="scikit-learn is not installed")
    for fit in (ff.PWA(3), estimator, ff.NARX(2), ff.BlockSparse(lam=0.1)):
        assert base.clone(fit).get_params() == fit.get_params()


def test_fits_are_copied_and_pickled():
    t, x, _ = lorenz(300)
    fit = ff.PWA(2).fit(x, t)
    for twin in (pickle.loads(pickle.dumps(fit)), copy.deepcopy(fit)):
        assert twin.model_ == fit.model_ and twin.model_.to_json() == fit.model_.to_json()
        assert np.array_equal(twin.predict(x), fit.predict(x))


def test_raising_progress_stops_the_work():
    rows = np.random.default_rng(0).normal(size=(200_000, 3))
    seen = []
    ff.PWA(8, progress=lambda stage, done, total: seen.append(stage)).fit(rows, 0.01)
    assert seen and all(isinstance(stage, str) for stage in seen)
    with pytest.raises(ZeroDivisionError):
        ff.PWA(8, progress=lambda *_: 1 / 0).fit(rows, 0.01)


def test_notes_are_warnings_of_the_callers_line():
    t, x, _ = lorenz(300)
    twins = np.column_stack([x[:, 0], 2.0 * x[:, 0]])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        fit = ff.PWA().fit(twins, t)
    notes = [one for one in caught if issubclass(one.category, ff.FleetfootWarning)]
    assert [str(one.message) for one in notes] == fit.report_["notes"] and notes
    assert {one.filename for one in notes} == {__file__}


def test_statistic_is_fitted_without_rows(tmp_path):
    t, x, _ = lorenz(3000)
    rows = np.column_stack([t, x])
    np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header="t,x0,x1,x2", comments="", fmt="%.17g")
    recipe = tmp_path / "lorenz.toml"
    # A statistic has differences of order 2; logs would choose a higher one.
    states = "".join(f'{name} = {{ derivative = "central" }}\n' for name in ("x0", "x1", "x2"))
    recipe.write_text(f'[states]\n{states}[time]\ncolumn = "t"\n[model]\ndegree = 2\n')
    arguments = ["scan", "-c", str(recipe), "run.csv", "-o", "run.stats"]
    run(*arguments, folder=tmp_path)
    known = ff.SINDy(threshold=0.1, recipe=recipe, library="poly(2)").fit(tmp_path / "run.csv")
    fitted = ff.SINDy(threshold=0.1, library="poly(2)").fit(tmp_path / "run.stats")
    assert fitted.get_feature_names() == known.get_feature_names()
    np.testing.assert_allclose(fitted.coefficients(), known.coefficients(), rtol=1e-9, atol=1e-9)
    sparse = ff.BlockSparse(select="bic").fit(tmp_path / "run.stats")
    assert [task["name"] for task in sparse.report_["tasks"]] == ["d(x0)/dt", "d(x1)/dt", "d(x2)/dt"]
    assert min(task["r2"] for task in sparse.report_["tasks"]) > 0.999
    with pytest.raises(RequestError, match="rows|statistic"):
        ff.SINDy(nominal={"x0": "x1"}).fit(tmp_path / "run.stats")
