"""Models at points and on recordings, held against finite differences, other paths of the engine, and exported code."""

from __future__ import annotations

import copy
import importlib.util
import pickle
import sys
import threading

import numpy as np
import pytest

import fleetfoot as ff
from fleetfoot.exceptions import DataError, ModelError, RequestError, WriteError


def pendulum(count=1500, dt=0.01, seed=0):
    """A driven pendulum with friction: angle, rate, torque."""
    rng = np.random.default_rng(seed)
    knots = np.arange(0, count + 50, 50)
    u = np.interp(np.arange(count), knots, rng.uniform(-2, 2, len(knots)))
    x = np.empty((count, 2))
    x[0] = 0.3, 0.0
    for k in range(count - 1):
        q, v = x[k]
        x[k + 1] = q + dt * v, v + dt * (-9.81 * np.sin(q) - 0.2 * v + u[k])
    return np.arange(count) * dt, x, u


NAMES = {"feature_names": ["q", "v"], "input_names": ["u"]}


@pytest.fixture(scope="module")
def sindy():
    t, x, u = pendulum()
    library = ["poly(1)", "sin(q)", "v*abs(v)"]
    return ff.SINDy(library=library, terms=3, derivative="forward").fit(x, t, u=u, **NAMES).model_


@pytest.fixture(scope="module")
def pwa():
    t, x, u = pendulum()
    return ff.PWA(6, derivative="forward", outside="extrapolate").fit(x, t, u=u, **NAMES).model_


@pytest.fixture(scope="module")
def lagged():
    t, x, u = pendulum()
    return ff.PWA(3, target="next", lags=2).fit(x, t, u=u, **NAMES).model_


def points(model, count=20, seed=1):
    rng = np.random.default_rng(seed)
    widths = len(model.states), len(model.inputs)
    x, u = (rng.uniform(-1, 1, (count, width)) for width in widths)
    past = tuple(rng.uniform(-1, 1, (count, model.lags, width)) for width in widths)
    return x, u, past if model.lags else None


def one(past, at):
    return None if past is None else (past[0][at], past[1][at])


def test_model_properties(sindy, pwa, lagged):
    assert (sindy.states, sindy.inputs, sindy.outputs) == (("q", "v"), ("u",), ("d(q)/dt", "d(v)/dt"))
    assert (sindy.lags, sindy.is_continuous, sindy.dt) == (0, True, pytest.approx(0.01))
    assert (lagged.lags, lagged.is_continuous) == (2, False)
    assert len(pwa.regions) == 6 and pwa.coefficients().shape == (6, 2, 4)
    assert pwa.coefficients(region=2).shape == (2, 4) and sindy.coefficients().ndim == 2
    assert len(pwa.equations()) == 12 and len(pwa.equations(region=1)) == 2
    assert "region 1: d(q)/dt = " in pwa.equations(region=1)[0]
    assert "kmeans:6" in str(pwa) and "Model(" in repr(pwa)
    for wrong in (-1, 6):
        with pytest.raises(ModelError, match="0 to 5"):
            pwa.coefficients(region=wrong)


def test_truth_is_identified(sindy):
    """Euler's recursion, measured by forward differences, is the truth to the last digits."""
    coefficients = dict(zip(sindy.get_feature_names(), sindy.coefficients().T))
    assert coefficients["v"] == pytest.approx([1.0, -0.2], abs=1e-9)
    assert coefficients["sin(q)"] == pytest.approx([0.0, -9.81], abs=1e-8)
    assert coefficients["u"] == pytest.approx([0.0, 1.0], abs=1e-9)


def test_points_one_by_one_and_together(sindy, pwa, lagged):
    for model in (sindy, pwa, lagged):
        x, u, past = points(model)
        for call in (model.step, model.derivative, model.region):
            many = call(x, u, history=past)
            alone = [call(x[at], u[at], history=one(past, at)) for at in range(len(x))]
            assert np.array_equal(many, alone)
        a, b, c = model.linearize(x, u, history=past)
        assert (a.shape, b.shape, c.shape) == ((20, 2, 2), (20, 2, 1), (20, 2))
        assert np.array_equal(model.linearize(x[3], u[3], history=one(past, 3))[0], a[3])


def test_derivative_is_the_sum_of_the_terms(sindy, pwa):
    x, u, _ = points(pwa)
    regions = pwa.region(x, u)
    assert set(regions) <= set(range(6)) and len(set(regions)) > 1
    assert np.array_equal(pwa.region(x), regions), "the regions look at states alone"
    columns = np.column_stack([np.ones(20), x, u])
    expected = np.einsum("bij,bj->bi", pwa.coefficients()[regions], columns)
    np.testing.assert_allclose(pwa.derivative(x, u), expected, rtol=1e-12, atol=1e-12)
    functions = {"1": np.ones(20), "q": x[:, 0], "v": x[:, 1], "u": u[:, 0], "sin(q)": np.sin(x[:, 0])}
    functions["v*abs(v)"] = x[:, 1] * np.abs(x[:, 1])
    columns = np.column_stack([functions[name] for name in sindy.get_feature_names()])
    np.testing.assert_allclose(sindy.derivative(x, u), columns @ sindy.coefficients().T, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("dt", [None, 0.05])
@pytest.mark.parametrize("method", ["rk4", "euler"])
def test_linearize_by_finite_differences(sindy, lagged, dt, method):
    """Central differences of the model itself, away from the borders of regions."""
    for model in (sindy, lagged):
        x, u, past = points(model)

        def value(x, u):
            if dt is None and model.is_continuous:
                return model.derivative(x, u, history=past)
            return model.step(x, u, dt, method=method, history=past)

        h = 1e-6
        a, b, c = model.linearize(x, u, dt, method=method, history=past)
        base = model.region(x, u, history=past)
        for matrix, given, which in ((a, x, 0), (b, u, 1)):
            for j in range(given.shape[1]):
                up, down = given.copy(), given.copy()
                up[:, j] += h
                down[:, j] -= h
                pairs = [(side, u) if which == 0 else (x, side) for side in (up, down)]
                same = np.all([model.region(*pair, history=past) == base for pair in pairs], axis=0)
                slope = (value(*pairs[0]) - value(*pairs[1])) / (2 * h)
                assert same.any()
                np.testing.assert_allclose(matrix[same, :, j], slope[same], rtol=1e-6, atol=1e-7)
        sums = np.einsum("bij,bj->bi", a, x) + np.einsum("bij,bj->bi", b, u) + c
        np.testing.assert_allclose(sums, value(x, u), rtol=1e-12, atol=1e-11)


def test_step_is_the_runge_kutta_method(sindy):
    x, u, _ = points(sindy)
    h, f = 0.02, sindy.derivative
    k1 = f(x, u)
    k2 = f(x + h / 2 * k1, u)
    k3 = f(x + h / 2 * k2, u)
    k4 = f(x + h * k3, u)
    np.testing.assert_allclose(sindy.step(x, u, h), x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4), rtol=1e-13, atol=1e-14)
    np.testing.assert_allclose(sindy.step(x, u, h, method="euler"), x + h * k1, rtol=1e-14, atol=1e-15)
    assert np.array_equal(sindy.step(x, u), sindy.step(x, u, sindy.dt))


def test_simulate_is_step_after_step(sindy, pwa, lagged):
    t, x, u = pendulum(60, seed=4)
    for model in (sindy, pwa, lagged):
        first = model.lags
        history = (x[:first], u[:first, None]) if first else None
        simulated = model.simulate(x[first], t[first:], u[first:], history=history, method="rk4")
        rows = [x[first]]
        for k in range(first, 59):
            before = list(x[:first]) + rows
            past = None if not first else (np.array(before[-first - 1 : -1]), u[k - first : k, None])
            rows.append(model.step(rows[-1], u[k : k + 1], t[k + 1] - t[k], history=past))
        assert np.array_equal(simulated, np.array(rows))
        # Open loop or closed, one point or many, a function or an array.
        same = {"history": history, "method": "rk4"}
        closed = model.simulate(x[first], t[first:], lambda time, state: u[int(round(time / 0.01))], **same)
        np.testing.assert_allclose(closed, simulated, rtol=1e-12, atol=1e-12)
        timed = model.simulate(x[first], t[first:], lambda time: u[int(round(time / 0.01))], **same)
        lines = model.simulate(x[first], t[first:], u[first:], interpolate=True, **same)
        assert np.array_equal(timed, lines) and np.array_equal(lines, simulated) == (not model.is_continuous)
        both = model.simulate(np.stack([x[first], 0.5 * x[first]]), t[first:], u[first:], history=history, method="rk4")
        assert both.shape == (2, 60 - first, 2) and np.array_equal(both[0], simulated)
        inputs = np.stack([u[first:, None], 2 * u[first:, None]])
        pair = model.simulate(np.stack([x[first], x[first]]), t[first:], inputs, history=history, method="rk4")
        assert np.array_equal(pair[0], simulated) and not np.array_equal(pair[1], simulated)


def test_simulate_is_the_rollout_on_a_recording(sindy, pwa, lagged):
    """The same recursion through a recording: another path of the engine."""
    t, x, u = pendulum(200, seed=5)
    data = ff.open({"q": x[:, 0], "v": x[:, 1], "u": u}, dt=0.01)
    for model in (sindy, pwa, lagged):
        rolled = model.rollout(data, 50, starts=[(0, 10)], keep=True)
        (trajectory,) = rolled["trajectories"]
        history = (x[10 - model.lags : 10], u[10 - model.lags : 10, None]) if model.lags else None
        simulated = model.simulate(x[10], np.arange(51) * 0.01, u[10:], history=history, method="rk4")
        np.testing.assert_allclose(trajectory["x"], simulated, rtol=1e-11, atol=1e-12)
        assert trajectory["end"] == "horizon" and trajectory["region"].shape == (50,)
        assert len(rolled["time"]) == 50 and "persistence" in rolled["baselines"]


def test_rollouts_report_distances_and_training_domain():
    t = np.arange(60) * 0.1
    model = ff.PWA(1, target="next", folds=0).fit(np.exp(t), t, feature_names=["x"]).model_
    longer = ff.open({"x": np.exp(np.arange(90) * 0.1)}, dt=0.1)
    asked = {"starts": [(0, 20)], "position": ["x"], "keep": True}
    reports = {how: model.rollout(longer, 50, outside=how, **asked) for how in ("tell", "end", "hold")}
    assert [reports[how]["trajectories"][0]["end"] for how in reports] == ["horizon", "left domain", "horizon"]
    assert [reports[how]["ended_outside"] for how in reports] == [0, 1, 0]
    last = {how: reports[how]["model"]["displacement"][-1][0] for how in reports}
    assert last["tell"] < 1e-6 * last["end"] and last["hold"] > 1
    for report in reports.values():
        # One state: the distance is its absolute error; a whole rollout is summed up from its steps.
        steps = np.array([step[0] for step in report["model"]["displacement"]])
        np.testing.assert_allclose(steps, np.array(report["model"]["mae"])[:, 0], rtol=1e-12, atol=1e-300)
        summary = report["model"]["displacement_summary"]
        np.testing.assert_allclose(summary["average"]["value"], steps.mean(), rtol=1e-12)
        drift = (steps[-1] - steps[0]) / 4.9
        np.testing.assert_allclose(summary["drift_per_second"]["value"], drift, rtol=1e-9, atol=1e-12)
    with pytest.raises(RequestError, match="outside"):
        model.rollout(longer, 5, outside="stay")
    with pytest.raises(ff.exceptions.FleetfootError, match="y"):
        model.rollout(longer, 5, position=["y"])


def test_scores_of_paths_equal_numpy_and_dtaidistance():
    dtw_ndim = pytest.importorskip("dtaidistance.dtw_ndim")
    t = np.arange(400) * 0.05
    runs = []
    for seed in range(3):
        r = np.cumsum(np.random.default_rng(seed).normal(size=(t.size, 2)), axis=0) * 0.1
        p = np.zeros((t.size, 2))
        for k in range(1, t.size):
            p[k] = p[k - 1] + 0.05 * (r[k - 1] + 0.3 * np.sin(3 * p[k - 1][::-1]))
        runs.append(np.column_stack([p, r]))
    tables = runs
    opened = [ff.open(dict(zip(("x", "y", "rx", "ry"), run.T, strict=True)), dt=0.05) for run in runs]
    data = opened[0] + opened[1] + opened[2]
    model = ff.PWA("average", states=["x", "y"], inputs=["rx", "ry"], target="delta").fit(data).model_
    options = {"starts": 9, "position": ["x", "y"], "interval": 5, "band": 7, "keep": True}
    rollouts = model.rollout(data, 60, reference={"d(x)/dt": "rx", "d(y)/dt": "ry"}, **options)
    def scores(a, b):
        distance = np.linalg.norm(a - b, axis=1)
        da, db = np.diff(a, axis=0), np.diff(b, axis=0)
        cosine = (da * db).sum(1) / np.linalg.norm(da, axis=1) / np.linalg.norm(db, axis=1)
        later, now = distance[6:], distance[1:-5]
        warped = dtw_ndim.distance(a.copy(), b.copy(), window=8)
        return distance[1:].mean(), cosine.mean(), ((later - now) / now).mean(), warped

    pairs = {"model": [], "reference": [], "beside": []}
    for one in rollouts["trajectories"]:
        rows = tables[one["episode"]][one["row"] :][:61]
        real, simulated = rows[:, :2], one["x"]
        ideal = real[0] + np.vstack([np.zeros(2), np.cumsum(rows[:60, 2:] * 0.05, axis=0)])
        for name, (a, b) in {"model": (simulated, real), "reference": (ideal, real), "beside": (simulated, ideal)}.items():
            pairs[name].append(scores(a, b))
    reports = {"model": rollouts["model"], "reference": rollouts["baselines"]["reference"], "beside": rollouts["beside_reference"]}
    for name, report in reports.items():
        path = report["path"]
        average = report["displacement_summary"]["average"]["value"]
        values = [path[key]["value"] for key in ("average_alignment", "propagated_error", "warping_distance")]
        np.testing.assert_allclose([average, *values], np.mean(pairs[name], axis=0), rtol=1e-9)
    errors = np.concatenate(
        [tables[one["episode"]][one["row"] + 1 :][:60, :2] - one["x"][1:] for one in rollouts["trajectories"]]
    )
    values = np.concatenate([tables[one["episode"]][one["row"] + 1 :][:60, :2] for one in rollouts["trajectories"]])
    for state in range(2):
        share = 1 - errors[:, state].var() / values[:, state].var()
        np.testing.assert_allclose(rollouts["model"]["explained_variance"][state]["value"], share, rtol=1e-9)
    with pytest.raises(ff.exceptions.FleetfootError, match="rz"):
        model.rollout(data, 60, reference={"x": "rz"})


def test_substeps_converge(sindy):
    t, x, u = pendulum(40, seed=6)
    coarse = np.arange(0, 4.0, 0.4)
    inputs = u[:9]
    fine = sindy.simulate(x[0], coarse, inputs, substeps=200)
    errors = [np.abs(sindy.simulate(x[0], coarse, inputs, substeps=n) - fine).max() for n in (1, 2, 4)]
    assert errors[0] > 8 * errors[1] > 64 * errors[2] > 0, "fourth order"


def test_predictions_agree_with_points(sindy, lagged):
    t, x, u = pendulum(120, seed=7)
    data = ff.open({"q": x[:, 0], "v": x[:, 1], "u": u}, dt=0.01)
    for model in (sindy, lagged):
        rows = model.predict(data)
        assert rows["targets"] == list(model.outputs) and rows["episodes"] == ["run"]
        direct = model.predict(x, u)
        assert np.array_equal(direct, rows["predicted"], equal_nan=True)
        assert np.isnan(direct[: model.lags]).all() and np.isfinite(direct[model.lags :]).all()
        used = rows["complete"]
        np.testing.assert_array_equal(rows["residual"][used], (rows["measured"] - rows["predicted"])[used])
        report = model.score(data)
        assert report["rows"] == used.sum()
        residual = rows["residual"][used]
        for target, error in zip(report["targets"], residual.T):
            assert target["rmse"] == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-9)
        assert model.score(x, dt=0.01, u=u)["targets"] == report["targets"]


def test_exported_python_computes_the_same(sindy, pwa, tmp_path):
    for name, model in (("sindy", sindy), ("pwa", pwa)):
        (file,) = model.export("python", tmp_path, prefix=name)
        spec = importlib.util.spec_from_file_location(name, file)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        assert module.STATES == model.states and module.INPUTS == model.inputs
        x, u, _ = points(model)
        for at in range(20):
            exported = getattr(module, name.capitalize())(x[at])
            assert exported.step(list(u[at]), 0.03) > module.NOT_FINITE
            np.testing.assert_allclose(exported.x, model.step(x[at], u[at], 0.03), rtol=1e-12, atol=1e-12)
    for to, suffixes in {"c": {".c", ".h"}, "rust": {".rs"}, "latex": {".tex"}, "npz": {".npz"}}.items():
        files = pwa.export(to, tmp_path / to)
        assert suffixes <= {file[file.rindex(".") :] for file in files}
    with np.load(tmp_path / "npz" / "model.npz") as arrays:
        assert len(arrays.files) > 0
    with pytest.raises(ModelError, match="to=.fortran."):
        pwa.export("fortran", tmp_path)
    with pytest.raises(ModelError, match="prefix|identifier"):
        pwa.export("c", tmp_path, prefix="1 model")


def test_files_pickles_and_copies(pwa, tmp_path):
    pwa.save(tmp_path / "model.json")
    twins = [ff.load(tmp_path / "model.json"), pickle.loads(pickle.dumps(pwa)), copy.copy(pwa), copy.deepcopy(pwa)]
    x, u, _ = points(pwa)
    for twin in twins:
        assert twin == pwa and hash(twin) == hash(pwa) and twin.to_json() == pwa.to_json()
        assert np.array_equal(twin.step(x, u), pwa.step(x, u))
    text = (tmp_path / "model.json").read_text()
    (tmp_path / "model.json").write_text(text.replace('"step": 0.01', '"step": 0.02'))
    with pytest.raises(ModelError, match="damaged or edited"):
        ff.load(tmp_path / "model.json")
    with pytest.raises(ModelError, match="nowhere"):
        ff.load(tmp_path / "nowhere.json")
    with pytest.raises(WriteError):
        pwa.save(tmp_path / "no" / "such" / "folder" / "model.json")


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda m: m.step([1.0, 2.0]), "u is missing"),
        (lambda m: m.step([1.0, 2.0, 3.0], [0.0]), r"x has the shape \[3\].*q, v"),
        (lambda m: m.step([1.0, 2.0], [[0.0, 1.0]]), "u has the shape"),
        (lambda m: m.step(np.zeros((3, 2)), np.zeros((2, 1))), "x has 3 points and u has 2"),
        (lambda m: m.step([1.0, 2.0], [0.0], -1.0), "dt=-1"),
        (lambda m: m.step([1.0, 2.0], [0.0], method="rk5"), "rk5"),
        (lambda m: m.simulate([1.0, 2.0], [0.0, 0.1]), "u is missing"),
        (lambda m: m.simulate([1.0, 2.0], [0.0, 0.1, 0.1], [[0.0]] * 3), "rising"),
        (lambda m: m.simulate([1.0, 2.0], [0.0, 0.1, 0.2], [[0.0]]), r"the 1 input \(u\) in 3 rows, one for each time \(that of the last"),
        (lambda m: m.simulate([1.0, 2.0], [0.0, 0.1], [[0.0]], substeps=0), "substeps=0"),
        (lambda m: m.predict(np.zeros((3, 2)), np.zeros((2, 1))), "x has 3 rows and u has 2"),
        (lambda m: m.coefficients(latent="z"), "'z'"),
    ],
)
def test_bad_points_are_refused_by_name(sindy, call, words):
    with pytest.raises(ModelError, match=words):
        call(sindy)


def test_one_state_under_many_inputs(sindy):
    both = sindy.step([1.0, 2.0], [0.0, 1.0])
    assert both.shape == (2, 2)
    np.testing.assert_array_equal(both, [sindy.step([1.0, 2.0], [0.0]), sindy.step([1.0, 2.0], [1.0])])


def test_bad_calls_are_refused(sindy, lagged):
    with pytest.raises(ModelError, match=r"history is missing.*2 rows back"):
        lagged.step([1.0, 2.0], [0.0])
    with pytest.raises(ModelError, match=r"history: x has the shape \[1, 2\]"):
        lagged.step([1.0, 2.0], [0.0], history=(np.zeros((1, 2)), np.zeros((1, 1))))
    with pytest.raises(DataError, match="x cannot be read as numbers"):
        sindy.step(["a", "b"], [0.0])
    with pytest.raises((DataError, RequestError), match="`u`"):
        sindy.score({"q": np.zeros(9), "v": np.zeros(9)}, dt=0.1)
    with pytest.raises(ModelError, match="steps"):
        sindy.rollout(ff.open({"q": np.zeros(9), "v": np.zeros(9), "u": np.zeros(9)}, dt=0.01), 100)


def test_divergence_is_reported():
    t = np.arange(200) * 0.01
    fit = ff.SINDy(library=["x0^2"], terms=1).fit(1 / (3 - t), t)
    with pytest.warns(ff.FleetfootWarning, match="no finite number"):
        simulated = fit.simulate([1.0], np.arange(0, 400.0))
    bad = np.isnan(simulated[:, 0])
    assert bad.any() and not bad[0] and (np.diff(bad.astype(int)) >= 0).all()


def test_two_threads_fit_at_once():
    t, x, u = pendulum(800)
    alone = ff.PWA(4).fit(x, t, u=u, **NAMES).coefficients()
    results = [None, None]

    def work(at):
        results[at] = ff.PWA(4).fit(x, t, u=u, **NAMES).coefficients()

    threads = [threading.Thread(target=work, args=(at,)) for at in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(np.array_equal(one, alone) for one in results)


def test_inputs_are_read_not_kept(sindy):
    x, u = np.array([1.0, 2.0]), np.array([0.5])
    before = sys.getrefcount(x)
    sindy.step(x, u)
    assert sys.getrefcount(x) == before


def test_alias_is_simulated_like_its_text():
    """Columns that follow from states and inputs are computed from the simulated ones, and are no inputs."""
    t, x, u = pendulum()
    data = {"t": t, "angle": x[:, 0], "rate": x[:, 1], "torque": u}
    recipe = {
        "columns": {"q": "angle", "v": "rate", "drag": "rate*abs(rate)", "pull": "sin(angle) - 0.1*torque"},
        "states": {"q": {"known": "v"}, "v": {"derivative": "forward"}},
        "inputs": {"u": "torque"},
    }
    opened = ff.open(data, recipe=recipe)
    libraries = ["v", "drag", "pull", "u"], ["v", "v*abs(v)", "sin(q) - 0.1*u", "u"]
    aliased, inlined = (ff.SINDy(library=library, terms=3).fit(opened).model_ for library in libraries)
    assert aliased.inputs == inlined.inputs == ("u",)
    simulated = [model.simulate(x[0], t[:400], u[:400]) for model in (aliased, inlined)]
    assert simulated[0].tobytes() == simulated[1].tobytes()
    for model in (aliased, inlined):
        report = model.rollout(opened, 50, starts=20)
        assert report["replayed"] == ["u"]
    scores = [model.rollout(opened, 50, starts=20)["model"] for model in (aliased, inlined)]
    assert scores[0] == scores[1]
