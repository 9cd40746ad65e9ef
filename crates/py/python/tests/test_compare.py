"""Models beside each other: the numbers are those of a plain computation with numpy and scipy."""

from __future__ import annotations

import html

import fleetfoot as ff
import numpy as np
import pytest

DT = 0.01
A = np.array([[0.0, 1.0], [-4.0, -0.4]])
B = np.array([[0.0], [1.0]])


def run(seed, rows=400, noise=1e-3):
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.normal(size=rows // 20), 20)[:, None]
    x = np.zeros((rows, 2))
    x[0] = rng.normal(size=2)
    for k in range(rows - 1):
        x[k + 1] = x[k] + DT * (A @ x[k] + B @ u[k])
    return x + noise * rng.normal(size=x.shape), u


def table(seed):
    x, u = run(seed)
    return {("q", "v"): x, "u": u[:, 0]}


RECIPE = {"states": {"q": {}, "v": {}}, "inputs": {"u": "u"}, "time": {"dt": DT}}


@pytest.fixture(scope="module")
def model():
    return ff.PWA().fit(ff.open([table(seed) for seed in range(4)], recipe=RECIPE)).model_


@pytest.fixture(scope="module")
def data():
    return ff.open([table(seed) for seed in range(10, 16)], name=[f"walk {i}" for i in range(6)], recipe=RECIPE)


def by_hand(predict):
    """Root mean square errors by run, from central differences: of rows with neighbours, after one that has them."""
    out = []
    for seed in range(10, 16):
        x, u = run(seed)
        measured = (x[2:] - x[:-2]) / (2 * DT)
        error = measured - predict(x[1:-1], u[1:-1])
        out.append(np.sqrt((error[1:] ** 2).mean(axis=0)))
    return np.array(out)


def truth(x, u):
    return x @ A.T + u @ B.T


def half(x, u):
    return 0.5 * truth(x, u)


def test_errors_match_a_plain_computation(model, data):
    stats = pytest.importorskip("scipy.stats", reason="scipy is not installed")
    comparison = ff.compare({"affine": model, "truth": truth, "half": half}, data)
    assert comparison.models == ("affine", "truth", "half", "null", "persistence")
    assert comparison.targets == ("d(q)/dt", "d(v)/dt") and comparison.groups == tuple(f"walk {i}" for i in range(6))
    assert comparison.rows.tolist() == [397] * 6
    expected = {"truth": by_hand(truth), "half": by_hand(half), "affine": by_hand(lambda x, u: model.derivative(x, u))}
    for name, wanted in expected.items():
        np.testing.assert_allclose(comparison.rmse[name], wanted, rtol=1e-9, err_msg=name)
    for row in comparison.table:
        place = comparison.targets.index(row["target"])
        errors = comparison.rmse[row["model"]][:, place]
        low, high = stats.t.interval(0.95, 5, loc=errors.mean(), scale=stats.sem(errors))
        np.testing.assert_allclose([row["rmse"], row["low"], row["high"]], [errors.mean(), low, high], rtol=1e-6)
        if row["model"] == "affine":
            assert np.isnan(row["difference"])
            continue
        paired = errors - comparison.rmse["affine"][:, place]
        low, high = stats.t.interval(0.95, 5, loc=paired.mean(), scale=stats.sem(paired))
        np.testing.assert_allclose([row["difference_low"], row["difference_high"]], [low, high], rtol=1e-6)
        assert row["better"] == np.mean(paired < 0)
    worse = next(row for row in comparison.table if row["model"] == "half" and row["target"] == "d(v)/dt")
    assert worse["difference_low"] > 0


def test_baselines_are_the_mean_and_the_row_before(model, data):
    comparison = ff.compare({"affine": model}, data)
    measured = []
    for seed in range(10, 16):
        x, _ = run(seed)
        measured.append((x[2:] - x[:-2]) / (2 * DT))
    before = [np.sqrt(((rates[1:] - rates[:-1]) ** 2).mean(axis=0)) for rates in measured]
    np.testing.assert_allclose(comparison.rmse["persistence"], before, rtol=1e-9)
    mean = np.concatenate([rates[1:] for rates in measured]).mean(axis=0)
    null = [np.sqrt(((rates[1:] - mean) ** 2).mean(axis=0)) for rates in measured]
    np.testing.assert_allclose(comparison.rmse["null"], null, rtol=1e-9)


def test_unpredicted_rows_are_left_out_of_all(model, data):
    def shy(x, u):
        out = truth(x, u)
        out[:100] = np.nan
        return out

    comparison = ff.compare({"affine": model, "shy": shy}, data)
    assert comparison.rows.tolist() == [299] * 6
    with pytest.raises(ValueError, match="shy predict none"):
        ff.compare({"affine": model, "shy": lambda x, u: np.full(x.shape, np.nan)}, data)


def test_training_episodes_are_reported(model, data):
    assert not ff.compare({"affine": model}, data).in_sample["affine"]
    episodes = ff.open([table(0), table(10)], name=["run 0", "other"], recipe=RECIPE)
    comparison = ff.compare({"affine": model}, episodes)
    assert comparison.in_sample["affine"] == ["run 0"] and "trained on 1" in str(comparison)


def test_recordings_put_their_episodes_together(model):
    x, u = run(30)
    t = np.arange(400) * DT + np.where(np.arange(400) < 150, 0.0, 50.0)
    torn = ff.open(
        [
            {("q", "v"): x, "u": u[:, 0], "t": t},
            {("q", "v"): run(31)[0], "u": run(31)[1][:, 0], "t": np.arange(400) * DT},
        ],
        name=["torn", "whole"],
    )
    recipe = {**RECIPE, "time": {"column": "t"}}
    assert len(ff.compare({"affine": model}, torn, recipe=recipe).groups) == 3
    assert ff.compare({"affine": model}, torn, recipe=recipe, by="recording").groups == ("torn", "whole")


def test_tables_of_text(model, data):
    comparison = ff.compare({"K_1": model, "half": half}, data)
    assert str(comparison).count("\n") >= 5 and "±" in str(comparison) and "paired by episode" in str(comparison)
    markdown = comparison.to_markdown().splitlines()
    assert len(markdown) == 2 + 4 and all(line.count("|") == 6 for line in markdown)
    latex = comparison.to_latex()
    assert latex.startswith(r"\begin{tabular}{lrrrr}") and r"K\_1" in latex and latex.count(r"\\") == 5
    assert latex.count("&") == 5 * 4


@pytest.mark.parametrize(
    ("models", "options", "says"),
    [
        ({}, {}, "empty"),
        ({"f": truth}, {}, "one fleetfoot model"),
        ({"m": "model"}, {"reference": "n"}, "reference"),
        ({"m": "model"}, {"by": "row"}, "by="),
        ({"null": "model"}, {}, "baseline"),
        ({"m": "model", "f": lambda x, u: x[:, 0]}, {}, "shape"),
    ],
)
def test_mistakes_are_named(model, data, models, options, says):
    models = {name: model if choice == "model" else choice for name, choice in models.items()}
    with pytest.raises(ValueError, match=says):
        ff.compare(models, data, **options)
    with pytest.raises(TypeError, match="int"):
        ff.compare({"m": model, "n": 3}, data)


def test_two_defaults_agree_on_how_targets_are_measured():
    t = np.arange(0, 10, 0.05)
    runs = [np.column_stack([a * np.cos(2 * t), -2 * a * np.sin(2 * t)]) for a in (1.0, 0.7, 0.4, 1.2)]
    data = ff.open([{"x0": run[:, 0], "x1": run[:, 1]} for run in runs[2:]], dt=0.05)
    pwa, sindy = (one.fit(runs[:2], dt=0.05) for one in (ff.PWA(), ff.SINDy(derivative="central6")))
    with pytest.warns(ff.FleetfootWarning, match="sindy was fitted to other differences; its targets are measured as pwa"):
        comparison = ff.compare({"pwa": pwa, "sindy": sindy}, data)
    # Central differences of a sine of frequency w fall short by (w dt)^2 / 6; those of sixth order do not.
    short = 1.0 - np.sin(0.1) / 0.1
    amplitude = np.array([0.4, 1.2])
    assert np.allclose(comparison.rmse["sindy"][:, 0], 2.0 * short * amplitude / np.sqrt(2.0), rtol=0.05)
    assert (comparison.rmse["pwa"] < 1e-6).all() and str(comparison).endswith(comparison.notes[0])
    assert f"<p>{html.escape(comparison.notes[0])}</p>" in comparison._repr_html_()
    # A column that somebody gives is another quantity.
    given = ff.PWA().fit(runs[:2], dt=0.05, x_dot=[np.gradient(run, 0.05, axis=0) for run in runs[:2]])
    table = [
        {"x0": run[:, 0], "x1": run[:, 1], "x0_dot": 2.0 * run[:, 1], "x1_dot": -8.0 * run[:, 0]} for run in runs[2:]
    ]
    with pytest.raises(ValueError, match="measure their targets otherwise"):
        ff.compare({"pwa": pwa, "given": given}, ff.open(table, dt=0.05))
