"""`SINDy`, `PWA`, `NARX`, `BlockSparse` as scikit-learn's tools use them: parameters, clones, folds, searches, pipelines."""

from __future__ import annotations

import copy
import json
import pickle
import re
import xml.etree.ElementTree

import numpy as np
import pytest

import fleetfoot as ff
from fleetfoot import _core, exceptions
from recordings import CHECKOUT

CLASSES = [ff.SINDy, ff.PWA, ff.NARX, ff.BlockSparse]
PERIOD = 0.01


def oscillation(phase, rows=300, pull=4.0):
    """A run of x'' = -pull x, its states and their derivatives."""
    t = np.arange(rows) * PERIOD
    rate = np.sqrt(pull)
    x = np.column_stack([np.cos(rate * t + phase), -rate * np.sin(rate * t + phase)])
    return t, x, np.column_stack([x[:, 1], -pull * x[:, 0]])


def runs(count=6):
    return [oscillation(0.3 * k)[1] for k in range(count)]


def small():
    """Each estimator as it fits a run of an oscillation."""
    return [
        ff.SINDy(library="poly(1)", dt=PERIOD),
        ff.PWA(dt=PERIOD),
        ff.NARX(lags_out=2, degree=1, terms=2, dt=PERIOD),
        ff.BlockSparse(degree=1, dt=PERIOD),
    ]


ids = {"ids": lambda one: (one if isinstance(one, type) else type(one)).__name__}


# -- parameters


@pytest.mark.parametrize("estimator_class", CLASSES, **ids)
def test_defaults_match_the_command_reference(estimator_class):
    command, settings = {
        ff.SINDy: ("sindy", "sindy"),
        ff.PWA: ("pwa", "pwa"),
        ff.NARX: ("narx", "narx"),
        ff.BlockSparse: ("sparse", "sparse"),
    }[estimator_class]
    reference = (CHECKOUT / "docs" / "reference" / "cli.md").read_text()
    # Options that several commands share stand once, above them.
    sections = ["Options of several commands", f"fleetfoot fit {command}"]
    parts = [reference.split(f"## {section}\n")[1].split("\n## ")[0] for section in sections]
    options = "\n".join(parts).replace("\n  ", " ")
    defaults = {flag.replace("-", "_"): text for flag, text in re.findall(r"^- `(?:-\w, )?--([\w-]+).*?default: (.*?)(?:[;,)]|\.(?!\d))", options, re.M)}
    params, compared = estimator_class().get_params(), 0
    for entry in dict(_core.settings())[settings]:
        value = params[{"lambda": "lam"}.get(entry, entry)]
        if value is None:
            # Defaults that depend on the data or on other arguments.
            continue
        wanted = defaults[entry].strip()
        if entry == "memory":
            wanted, value = float(wanted), value / 2**20
        assert str(value).lower() == str(wanted).lower() or float(value) == float(wanted), entry
        compared += 1
    assert compared >= 6


@pytest.mark.parametrize("estimator_class", CLASSES, **ids)
def test_every_default_stands_in_the_documentation(estimator_class):
    for name, value in estimator_class().get_params().items():
        written = re.search(rf"^    (?:[\w, ]+, )?{name}(?:, \w+)* : (.*)$", estimator_class.__doc__, re.M)
        assert written, f"{name} is not documented"
        if isinstance(value, (str, int, float)) and not isinstance(value, bool):
            assert "default=" in written[1], f"{name} : {written[1]}"


def test_default_arguments_keep_the_recipe():
    t, x, _ = oscillation(0.0)
    recipe = {"pwa": {"folds": 3}, "model": {"degree": 2}}
    assert "folds = 3" in ff.PWA(recipe=recipe).fit(x, t).model_.recipe
    assert "folds = 4" in ff.PWA(folds=4, recipe=recipe).fit(x, t).model_.recipe
    assert "folds" not in ff.PWA().fit(x, t).model_.recipe


def test_parameters_of_objects_are_set_by_their_path():
    sindy = ff.SINDy(optimizer=ff.STLSQ(threshold=0.1), dt=PERIOD)
    assert sindy.get_params()["optimizer__threshold"] == 0.1
    assert sindy.set_params(optimizer__threshold=0.5, library="poly(1)").optimizer.threshold == 0.5
    _, x, x_dot = oscillation(0.0)
    assert sindy.fit(x, x_dot).equations(3) == ["d(x0)/dt = 1*x1", "d(x1)/dt = -4*x0"]
    # Above the larger coefficient nothing is left.
    empty = sindy.set_params(optimizer__threshold=50.0).fit(x, x_dot)
    assert empty.equations(3) == ["d(x0)/dt = 0", "d(x1)/dt = 0"]


@pytest.mark.parametrize("estimator", small(), **ids)
def test_unfitted_estimators_raise(estimator):
    base = pytest.importorskip("sklearn.exceptions", reason="scikit-learn is not installed")
    for call in (
        lambda: estimator.predict(np.zeros((3, 2))),
        lambda: estimator.score(np.zeros((3, 2))),
        estimator.equations,
        estimator.coefficients,
        lambda: estimator.save("model.json"),
    ):
        with pytest.raises(base.NotFittedError, match="not fitted"):
            call()
    assert not hasattr(estimator, "n_features_in_")


@pytest.mark.parametrize("estimator", small(), **ids)
def test_fits_are_cloned_copied_and_pickled(estimator):
    base = pytest.importorskip("sklearn.base", reason="scikit-learn is not installed")
    x = runs(2)
    fitted = base.clone(estimator).fit(x)
    assert not hasattr(base.clone(fitted), "model_")
    assert base.clone(fitted).get_params() == estimator.get_params()
    for twin in (copy.deepcopy(fitted), pickle.loads(pickle.dumps(fitted))):
        np.testing.assert_array_equal(twin.predict(x[0]), fitted.predict(x[0]))
        assert twin.get_params() == fitted.get_params()
    assert fitted.n_features_in_ == 2


def test_recordings_among_the_parameters_are_cloned_and_pickled(tmp_path):
    base = pytest.importorskip("sklearn.base", reason="scikit-learn is not installed")
    _, x, _ = oscillation(0.0)
    data = ff.open({"x0": x[:, 0]}, dt=PERIOD, name="other") + ff.open([2 * x[:, :1]], dt=PERIOD)
    narx = ff.NARX(2, 0, 1, terms=2, free_run=data)
    twin = pickle.loads(pickle.dumps(base.clone(narx)))
    assert twin.free_run.names == ["other", "run 0"] and twin.free_run.recipe == data.recipe
    np.testing.assert_array_equal(ff.read(twin.free_run)["x0"], ff.read(data)["x0"])


# -- targets and clocks


def test_targets_are_no_stamps():
    t, x, x_dot = oscillation(0.0)
    wanted = ff.SINDy(library="poly(1)").fit(x, t, x_dot)
    for fitted in (
        ff.SINDy(library="poly(1)").fit(x, t, y=x_dot),
        ff.SINDy(library="poly(1)").fit(x, dt=PERIOD, y=x_dot),
        ff.SINDy(library="poly(1)", dt=PERIOD).fit(x, x_dot),
        ff.SINDy(library="poly(1)", dt=PERIOD).fit(x, y=x_dot),
    ):
        np.testing.assert_allclose(fitted.coefficients(), wanted.coefficients(), atol=1e-12)
        assert fitted.score(x, y=x_dot) == pytest.approx(1.0, abs=1e-12)
    # The keyword t is a clock, whatever the constructor says.
    clocked = ff.SINDy(library="poly(1)", dt=1.0).fit(x, t=t, x_dot=x_dot)
    np.testing.assert_allclose(clocked.coefficients(), wanted.coefficients(), atol=1e-12)
    with pytest.raises(ValueError, match="both given"):
        ff.SINDy().fit(x, t, x_dot, y=x_dot)
    with pytest.raises(exceptions.RequestError, match="given twice"):
        ff.SINDy(dt=PERIOD).fit(x, x_dot, y=x_dot)
    with pytest.raises(exceptions.RequestError, match="y"):
        ff.BlockSparse(tasks={"a": ("x0", "F")}, latents={"F": {"of": ["x1"]}}).fit(x, t, y=x_dot).score(x, t)


@pytest.mark.parametrize("discrete", [{"discrete_time": True}, {"target": "delta"}], ids=["next", "delta"])
def test_next_values_respect_run_ends(discrete):
    x = np.vstack(runs(3))
    lengths = [300, 300, 300]
    separate = [x[sum(lengths[:k]) : sum(lengths[: k + 1])] for k in range(3)]
    wanted = ff.SINDy(library="poly(1)", **discrete).fit(separate)
    before, after = np.vstack([run[:-1] for run in separate]), np.vstack([run[1:] for run in separate])
    y = after - before if "target" in discrete else after
    given = ff.SINDy(library="poly(1)", dt=1.0, **discrete).fit(before, y)
    assert given.report_["rows"] == wanted.report_["rows"] == 897
    np.testing.assert_allclose(given.coefficients(), wanted.coefficients(), atol=1e-12)
    # Rows in any order are the same pairs.
    order = np.random.default_rng(0).permutation(len(before))
    mixed = ff.SINDy(library="poly(1)", dt=1.0, **discrete).fit(before[order], y[order])
    assert mixed.report_["rows"] == 897
    np.testing.assert_allclose(mixed.coefficients(), wanted.coefficients(), atol=1e-12)
    assert mixed.score(before[order], y[order]) == pytest.approx(1.0, abs=1e-9)
    with pytest.raises(ValueError, match="next values"):
        given.fit(before, y[:, :1])


def test_next_values_with_inputs():
    rng = np.random.default_rng(0)
    u, x = rng.normal(size=(400, 1)), np.zeros((400, 1))
    for k in range(399):
        x[k + 1] = 0.8 * x[k] + 0.5 * u[k]
    order = rng.permutation(399)
    for estimator in (ff.SINDy(library="poly(1)", discrete_time=True), ff.PWA(target="next"), ff.NARX(1, 1, 1, direct=False, terms="all")):
        for rows in (np.arange(399), order)[: 1 if isinstance(estimator, ff.NARX) else 2]:
            estimator.fit(x[:-1][rows], y=x[1:][rows], u=u[:-1][rows])
            coefficients = dict(zip(estimator.get_feature_names(), estimator.coefficients()[0]))
            assert coefficients["x0"] == pytest.approx(0.8) and coefficients["u0"] == pytest.approx(0.5)
            assert estimator.report_["notes"] == []
    with pytest.raises(ValueError, match="u has other rows"):
        estimator.fit(x[:-1], y=x[1:], u=u)


def test_a_column_is_predicted_from_others():
    rng = np.random.default_rng(0)
    X = rng.normal(size=(500, 3))
    y = np.where(X[:, 0] > 0, 2.0, -1.0) * X[:, 0] + X[:, 2]
    # Stamps that would be in order: a target all the same.
    for target in (y, np.sort(y)):
        fit = ff.PWA(["average", 2], target="y", partition_on=["x0"]).fit(X, target)
        assert fit.predict(X).shape == (500,) and fit.n_features_in_ == 3
        assert fit.score(X, target) == pytest.approx(1 - np.var(target - fit.predict(X)) / np.var(target), abs=1e-9)
    assert ff.PWA(2, target="y", partition_on=["x0"]).fit(X, y).score(X, y) > 0.98
    with pytest.raises(ValueError, match="X has 2 features, but PWA is expecting 3"):
        fit.predict(X[:, :2])
    with pytest.raises(ValueError, match="y is missing"):
        fit.score(X)


def test_one_row_is_predicted_like_many():
    t = np.arange(200) * PERIOD
    u = np.sin(3 * t)
    _, x, _ = oscillation(0.0, 200)
    fit = ff.SINDy(library="poly(1)").fit(x, t, u=u)
    all_ = fit.predict(x, u)
    for one in (fit.predict(x[:1], u[:1]), fit.predict(x[:1], u[:1, None]), fit.predict(x[0][None], u[:1])):
        np.testing.assert_array_equal(one, all_[:1])
    listed = fit.predict([x[:50], x[50:]], [u[:50], u[50:]])
    np.testing.assert_array_equal(np.vstack(listed), all_)


# -- scikit-learn's tools


def tools():
    return pytest.importorskip("sklearn.model_selection", reason="scikit-learn is not installed")


@pytest.mark.parametrize("estimator", small(), **ids)
def test_episodes_are_the_samples_of_cross_validation(estimator):
    selection = tools()
    x = runs(6)
    # Whole episodes are held out, those of one day together.
    scores = selection.cross_val_score(estimator, x, groups=[0, 0, 1, 1, 2, 2], cv=selection.GroupKFold(3))
    assert scores.shape == (3,) and (scores > 0.999).all()
    # The same by hand.
    for score, (train, test) in zip(scores, selection.GroupKFold(3).split(x, groups=[0, 0, 1, 1, 2, 2])):
        fitted = copy.deepcopy(estimator).fit([x[k] for k in train])
        assert fitted.score([x[k] for k in test]) == score


def test_search_selects_predictive_settings():
    selection = tools()
    episodes = [oscillation(0.3 * k) for k in range(6)]
    x, t, x_dot = ([one[k] for one in episodes] for k in (1, 0, 2))
    grid = {"threshold": [0.1, 50.0], "library": ["poly(1)", "poly(3)"]}
    search = selection.GridSearchCV(ff.SINDy(dt=PERIOD), grid, cv=selection.GroupKFold(3), error_score="raise")
    search.fit(x, x_dot, groups=[0, 0, 1, 1, 2, 2])
    assert search.best_params_["threshold"] == 0.1 and search.best_score_ > 0.999
    assert search.best_estimator_.equations(3) == ["d(x0)/dt = 1*x1", "d(x1)/dt = -4*x0"]
    # Stamps are cut like the runs, and objects' parameters are searched.
    nested = selection.GridSearchCV(
        ff.SINDy(optimizer=ff.STLSQ(), library="poly(1)"), {"optimizer__threshold": [0.1, 50.0]}, cv=3, n_jobs=2
    )
    assert nested.fit(x, t=t).best_params_ == {"optimizer__threshold": 0.1}


def test_a_fit_is_the_last_step_of_a_pipeline():
    tools()
    pipeline = pytest.importorskip("sklearn.pipeline", reason="scikit-learn is not installed")
    preprocessing = pytest.importorskip("sklearn.preprocessing", reason="scikit-learn is not installed")
    t, x, _ = oscillation(0.0, 600)
    scaled = pipeline.make_pipeline(preprocessing.StandardScaler(), ff.SINDy(library="poly(1)", dt=PERIOD)).fit(x)
    assert scaled.score(x) > 0.999
    assert pipeline.make_pipeline(preprocessing.StandardScaler(), ff.PWA()).fit(x, pwa__t=t).score(x) > 0.999
    rng = np.random.default_rng(1)
    X = rng.normal(size=(400, 3)) * [1.0, 10.0, 0.1]
    y = X @ [1.0, -0.2, 5.0] + 1.0
    plain = pipeline.make_pipeline(preprocessing.StandardScaler(), ff.PWA(target="y")).fit(X, y)
    np.testing.assert_allclose(plain.predict(X), y, atol=1e-9)
    assert plain.score(X, y) == pytest.approx(1.0)


def test_metadata_are_routed_by_name():
    selection = tools()
    sklearn = pytest.importorskip("sklearn", reason="scikit-learn is not installed")
    episodes = [oscillation(0.3 * k) for k in range(4)]
    with sklearn.config_context(enable_metadata_routing=True):
        asked = ff.SINDy(library="poly(1)").set_fit_request(t=True, x_dot=True).set_score_request(t=True, x_dot=True)
        scores = selection.cross_val_score(
            asked, [one[1] for one in episodes], cv=2, params={"t": [one[0] for one in episodes], "x_dot": [one[2] for one in episodes]}
        )
    np.testing.assert_allclose(scores, 1.0, atol=1e-12)


def test_estimator_types_in_scikit_learn():
    base = pytest.importorskip("sklearn.base", reason="scikit-learn is not installed")
    utils = pytest.importorskip("sklearn.utils", reason="scikit-learn is not installed")
    for estimator in small():
        tags = utils.get_tags(estimator)
        assert base.is_regressor(estimator) and tags.input_tags.allow_nan and not tags.target_tags.required
        assert tags.target_tags.multi_output
    assert not utils.get_tags(ff.PWA(target="y")).target_tags.multi_output


# -- pysindy's words


def test_derivatives_match_the_fit():
    t, x, x_dot = oscillation(0.0)
    central = ff.SINDy(derivative="central").fit(x, t)
    derivatives = central.differentiate(x, t)
    np.testing.assert_allclose(derivatives[1:-1], (x[2:] - x[:-2]) / (2 * PERIOD), rtol=1e-9)
    assert np.isnan(derivatives[0]).all() and np.isnan(derivatives[-1]).all()
    # Of order six, chosen by the data: better by far.
    better = ff.SINDy().fit(x, t).differentiate([x[:100], x[100:]], PERIOD)
    assert [len(one) for one in better] == [100, 200]
    assert np.nanmax(np.abs(np.vstack(better) - x_dot)) < 1e-9 < np.nanmax(np.abs(derivatives - x_dot))
    fitted = ff.SINDy(differentiation_method=lambda x, t: np.gradient(x, t, axis=0)).fit(x, t)
    np.testing.assert_array_equal(fitted.differentiate(x, t), np.gradient(x, t, axis=0))
    with pytest.raises(exceptions.RequestError, match="one argument"):
        ff.SINDy(derivative="central", differentiation_method=np.gradient).fit(x, t)


def test_discrete_models_are_simulated_by_rows():
    _, x, _ = oscillation(0.0)
    discrete = ff.SINDy(library="poly(1)", discrete_time=True, dt=PERIOD).fit(x)
    np.testing.assert_allclose(discrete.simulate(x[0], 50), x[:50], atol=1e-9)
    np.testing.assert_array_equal(discrete.simulate(x[0], 50), discrete.simulate(x[0], np.arange(50) * PERIOD))
    with pytest.raises(exceptions.ModelError, match="give the times"):
        ff.SINDy(library="poly(1)", dt=PERIOD).fit(x).simulate(x[0], 50)
    with pytest.raises(exceptions.ModelError, match="1 row or more"):
        discrete.simulate(x[0], 0)


def test_inputs_are_held_or_joined_by_lines():
    t = np.arange(400) * PERIOD
    u = np.sin(3 * t)
    fit = ff.SINDy(library="poly(1)").fit(np.cos(t), t, -2 * np.cos(t) + u, u=u)
    coarse = t[::20]
    # The answer to straight lines, by small steps: x' = -2x + u.
    exact, x = [1.0], 1.0
    for k in range(len(coarse) - 1):
        for part in range(2000):
            now = u[::20][k] + (u[::20][k + 1] - u[::20][k]) * (part + 0.5) / 2000
            x = x + (0.2 / 2000) * (-2 * x + now)
        exact.append(x)
    lines = fit.simulate([1.0], coarse, u[::20], interpolate=True)[:, 0]
    held = fit.simulate([1.0], coarse, u[::20])[:, 0]
    assert np.abs(lines - exact).max() < 1e-4 < 0.02 < np.abs(held - exact).max()
    with pytest.raises(exceptions.ModelError, match="20 rows, one for each time$"):
        fit.simulate([1.0], coarse, u[:3], interpolate=True)


@pytest.mark.parametrize("estimator", small(), **ids)
def test_terms_are_named_and_counted_after_any_fit(estimator):
    x = runs(2)
    names = estimator.fit(x).get_feature_names()
    coefficients = estimator.coefficients()
    assert coefficients.shape == (2, len(names)) and names[0] == "1"
    assert estimator.complexity == np.count_nonzero(coefficients) == estimator.model_.complexity


def test_products_of_different_variables():
    ps = pytest.importorskip("pysindy", reason="pysindy is not installed")
    t, x, _ = oscillation(0.0)
    library = ps.PolynomialLibrary(degree=2, interaction_only=True)
    assert ff.SINDy(feature_library=library).fit(x, t).get_feature_names() == ["1", "x0", "x1", "x0*x1"]


def test_functions_are_read_as_expressions():
    t, x, x_dot = oscillation(0.0)
    library = ["poly(1)", lambda x: x * abs(x), np.cos, lambda x, y: np.exp(-(x**2) / 2.0) * y - 1]
    fit = ff.SINDy(library=library, threshold=0.1).fit(x, t, x_dot, feature_names=["q", "a v"])
    rows = fit.differentiate(x, t)
    names = fit.get_feature_names()
    assert names[:5] == ["1", "q", "`a v`", "q*abs(q)", "`a v`*abs(`a v`)"] and len(names) == 8 and len(rows) == len(x)
    # The candidates have the values of the functions: the same regression by hand.
    q, v = x.T
    values = np.column_stack([q * 0 + 1, q, v, q * abs(q), v * abs(v), np.cos(q), np.cos(v), np.exp(-(q**2) / 2) * v - 1])
    mixed = values @ [0.5, 1.0, -2.0, 3.0, 0.2, -1.0, 0.7, 0.3]
    fitted = ff.SINDy(library=library, optimizer="ols", target="y").fit(x, mixed, feature_names=["q", "a v"])
    np.testing.assert_allclose(fitted.predict(x), mixed, atol=1e-9)
    inputs = ff.SINDy(library=["poly(1)", np.maximum]).fit(x, t, u=np.sin(t))
    assert [name for name in inputs.get_feature_names() if "max" in name] == ["max(x0, x1)", "max(x0, u0)", "max(x1, u0)"]
    for bad in (lambda x: x if x > 0 else 0.0, np.cumsum, lambda x: np.where(x > 0, x, 0), lambda x: float(x)):
        with pytest.raises(exceptions.RequestError, match="cannot be written as an expression"):
            ff.SINDy(library=["poly(1)", bad]).fit(x, t)


def test_custom_libraries_of_pysindy():
    ps = pytest.importorskip("pysindy", reason="pysindy is not installed")
    rng = np.random.default_rng(0)
    t, x = np.arange(300) * PERIOD, rng.normal(size=(300, 2))
    x_dot = np.column_stack([np.sin(x[:, 0]) - x[:, 1], x[:, 0] * x[:, 1] ** 2])
    custom = ps.CustomLibrary([lambda x: np.sin(x), lambda x, y: x * y**2], interaction_only=False)
    library = ps.ConcatLibrary([ps.PolynomialLibrary(1), custom])
    peer = ps.SINDy(optimizer=ps.STLSQ(threshold=0.1), feature_library=library).fit(x, t=t, x_dot=x_dot)
    fitted = ff.SINDy(optimizer=ps.STLSQ(threshold=0.1), feature_library=library).fit(x, t, x_dot)
    assert fitted.get_feature_names()[-3:] == ["x0^3", "x0*x1^2", "x1^3"]
    np.testing.assert_allclose(fitted.coefficients(), peer.coefficients(), rtol=1e-7, atol=1e-9)
    with pytest.raises(exceptions.RequestError, match="write the products"):
        ff.SINDy(feature_library=ps.TensoredLibrary([custom, ps.PolynomialLibrary(1)])).fit(x, t)


# -- notebooks


def test_notebooks_show_models_and_tables():
    t, x, _ = oscillation(0.0)
    data = ff.open({"a<b": x[:, 0], "v": x[:, 1]}, t=t, name="run & more")
    model = ff.PWA(2, target="next").fit(x, t).model_
    shown = model._repr_html_()
    assert "2 regions, discrete" in shown
    # A formula that is well formed for each equation, with the words for whoever does not see it.
    root = xml.etree.ElementTree.fromstring(f"<div>{shown}</div>")
    assert [formula.get("alttext") for formula in root.iter("math")] == model.equations()
    assert [item.text for item in root.iter("li")] == ["region 0: ", "region 1: "] * 2
    assert all("".join(formula.itertext()).count("=") == 1 for formula in root.iter("math"))
    assert "run &amp; more" in data._repr_html_()
    table = ff.read(data)._repr_html_()
    assert "<th>a&lt;b</th>" in table and "300 rows" in table and table.count("<tr>") == 11
    compared = ff.compare({"piecewise": model}, ff.open({"x0": x[:, 0], "x1": x[:, 1]}, dt=PERIOD))._repr_html_()
    assert "<td>piecewise</td>" in compared and "95 % intervals" in compared


def test_regions_are_passive_at_their_ports():
    rng = np.random.default_rng(4)
    h, mass, x, v, rows = 0.05, 1.5, 0.5, 0.0, []
    for _ in range(1500):
        f = rng.uniform(-4.0, 4.0)
        rows.append((x + 0.15 * rng.uniform(-1, 1), v + 0.15 * rng.uniform(-1, 1), f))
        for _ in range(20):
            v += h / 20 * (f - (4.0 if x > 0 else 9.0) * x - 0.1 * v) / mass
            x += h / 20 * v
    data = ff.open(dict(zip("xvf", np.array(rows).T, strict=True)), dt=h)
    # Pulled towards the map of all rows no region would be active.
    given = {"states": ["x", "v"], "inputs": ["f"], "target": "next", "shrinkage": "none", "passive": {"f": "v"}}
    model = ff.PWA("kmeans:5", **given).fit(data)
    candidate = model.report_["candidates"][0]
    stability = candidate["stability"]
    (port,) = stability["passivity"]["ports"]
    assert (port["input"], port["state"]) == ("f", "v") and abs(port["shortage"] - 2 * h / mass) < 0.01
    storage, supply = np.array(stability["metric"]).reshape(2, 2), np.array([0.0, h])
    allowed = np.block([[storage, supply[:, None]], [supply[None, :], h * port["shortage"]]])
    for region in range(5):
        latents = json.loads(model.model_.to_json())["model"]["latents"]
        step = np.array([latent["coefficients"][region] for latent in latents])
        assert np.linalg.eigvalsh(allowed - step.T @ storage @ step)[0] > -1e-9
    assert max(stability["passivity"]["norms"]) <= 1.0 < max(stability["passivity"]["free_norms"])
    assert candidate["loss"] < 1.05 * candidate["free_loss"]


def test_sindy_keeps_signs_of_coefficients():
    rng = np.random.default_rng(5)
    x = rng.normal(size=(600, 3))
    x[:, 2] += 0.9 * x[:, 1]
    y = x @ [1.0, -0.2, 0.5] + 0.3 * rng.normal(size=600)
    data = ff.open({"a": x[:, 0], "b": x[:, 1], "c": x[:, 2], "y": y}, dt=0.01)

    def fit(**more):
        estimator = ff.SINDy("ols", library=["a", "b", "c"], inputs=["a", "b", "c"], target="y", **more)
        return estimator.fit(data).report_["regions"][0]["equations"][0], estimator.report_

    free, report = fit()
    assert len(free["terms"]) == 3 and "limits" not in report
    bounded, report = fit(constraints={"pushes": {"coefficients": {"y": ["b"]}, "at_least": 0.0}})
    coefficients = {term["function"]: term["coefficient"] for term in bounded["terms"]}
    # Without b the others are those of their own normal equations.
    assert list(coefficients.values()) == pytest.approx(np.linalg.lstsq(x[:, [0, 2]], y, rcond=None)[0], rel=1e-10)
    assert bounded["rms"] > bounded["free_rms"] == free["rms"]
    (limit,) = report["limits"]
    assert (limit["name"], limit["nearest"], limit["cuts"]) == ("pushes, b of y", 0.0, 1)
    with pytest.raises(ff.exceptions.RequestError, match="stlsq"):
        ff.SINDy("frols", target="y", constraints={"x": {"coefficients": {"y": ["b"]}, "at_least": 0.0}}).fit(data)


def test_block_sparse_keeps_constraints():
    rng = np.random.default_rng(3)
    a, b = rng.normal(size=(2, 400))
    f = a - 0.5 * b + 0.1 * rng.normal(size=400)
    data = ff.open({"a": a, "b": b, "f": f}, dt=0.01)
    latents = {"K": {"functions": ["1"]}, "D": {"functions": ["1"]}}
    tasks = {"force": ("f", "K*a + D*b")}

    def fit(**constraints):
        return ff.BlockSparse(latents, tasks, constraints=constraints, lam=0.0).fit(data).report_

    def values(report):
        return [latent["functions"][0]["coefficient"] for latent in report["latents"]]

    free = fit()
    assert values(free)[1] < -0.4 and "limits" not in free
    damped = fit(damping={"of": "D", "at_least": 0.0})
    # Without damping the spring is that of its own normal equation; the bound is kept by a millionth of the damping.
    assert values(damped) == pytest.approx([(a @ f) / (a @ a), 0.0], abs=1e-6) and values(damped)[1] >= 0.0
    (limit,) = damped["limits"]
    assert (limit["name"], limit["side"], limit["bound"]) == ("damping", "at least", 0.0)
    task = damped["tasks"][0]
    assert task["rms"] > task["free_rms"] == free["tasks"][0]["rms"]
    assert task["held_out_rms"] > task["free_held_out_rms"] == free["tasks"][0]["held_out_rms"]
    assert min(values(fit(both={"matrix": [["K", "0"], ["0", "D"]], "at_least": 0.2}))) >= 0.2
