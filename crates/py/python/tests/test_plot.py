"""Pictures: what is drawn is what was given."""

from __future__ import annotations

import subprocess
import sys

import fleetfoot as ff
import numpy as np
import pytest

matplotlib = pytest.importorskip("matplotlib", reason="matplotlib is not installed")
matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


ALPHAS = np.array([1.0, 0.5, 0.1, 0.0])
COEFS = np.array([[0.0, 0.4, 0.8, 0.9], [0.0, 0.0, -0.3, -0.5], [0.0, 0.0, 0.0, 0.0]])


def test_path_of_a_tuple_and_an_estimator():
    ax = ff.plot.path((ALPHAS, [0, 1], COEFS), feature_names=["v", "w", "v*w"], unit="N s/m")
    lines = {line.get_label(): line for line in ax.lines}
    np.testing.assert_array_equal(lines["v"].get_ydata(), COEFS[0])
    assert "v*w" not in lines and ax.get_ylabel() == "coefficient [N s/m]" and ax.xaxis_inverted()
    assert ax.get_xscale() == "log" and (lines["w"].get_xdata() > 0).all()

    class Fitted:
        alphas_, coef_path_ = [ALPHAS, ALPHAS], [COEFS, 2 * COEFS]
        feature_names_in_ = np.array(["a", "b", "c"])

    axes = plt.figure().add_subplot()
    assert ff.plot.path(Fitted(), target=1, ax=axes) is axes
    assert max(line.get_ydata().max() for line in axes.lines if len(line.get_ydata()) == 4) == 1.8
    with pytest.raises(TypeError, match="coef_path_"):
        ff.plot.path(object())
    with pytest.raises(ValueError, match="2 names"):
        ff.plot.path((ALPHAS, COEFS), feature_names=["a", "b"])


def test_selection_frequency_is_sorted():
    ax = ff.plot.selection_frequency([0.2, 1.0, 0.9], feature_names=["a", "b", "c"], threshold=0.9)
    assert [bar.get_width() for bar in ax.patches] == [1.0, 0.9, 0.2]
    assert [label.get_text() for label in ax.get_yticklabels()] == ["b", "c", "a"]
    assert len(ff.plot.selection_frequency(np.linspace(0, 1, 50), most=7).patches) == 7
    with pytest.raises(TypeError, match="selection_frequency_"):
        ff.plot.selection_frequency(object())


def test_horizon_draws_model_and_baselines():
    score = {"rmse": [[0.1, 1.0], [0.2, 2.0]], "mae": [], "mahalanobis": [[0.5, 0.4, 0.6], [0.7, 0.6, None]]}
    report = {"time": [0.1, 0.2], "states": ["q", "v"], "model": score, "baselines": {"null": score}}
    ax = ff.plot.horizon(report, state="v", unit="m/s")
    np.testing.assert_array_equal(ax.lines[0].get_ydata(), [1.0, 2.0])
    assert len(ax.lines) == 2 and ax.get_ylabel() == "RMSE of v [m/s]" and ax.get_xlabel().endswith("[s]")
    assert len(ff.plot.horizon(report, baselines=False).lines) == 1
    with pytest.raises(ValueError, match="speed"):
        ff.plot.horizon(report, state="speed")
    with pytest.raises(TypeError, match="rollout"):
        ff.plot.horizon({"rmse": 1.0})


def test_region_map_shows_the_regions_of_the_rows():
    rng = np.random.default_rng(3)
    runs = []
    for _ in range(3):
        x = np.cumsum(rng.normal(size=(2_000, 2)), axis=0) * 0.05
        runs.append({"a": x[:, 0], "b": x[:, 1]})
    data = ff.open(runs, recipe={"states": {"a": {}, "b": {}}, "time": {"dt": 0.1}, "model": {"partition": "kmeans:4"}})
    model = ff.PWA(4).fit(data).model_
    ax = ff.plot.region_map(model, data, "a", "b", bins=20)
    image = ax.images[0].get_array()
    assert image.shape == (20, 20) and (ax.get_xlabel(), ax.get_ylabel()) == ("a", "b")
    x = np.concatenate([np.column_stack([run["a"], run["b"]]) for run in runs])
    left, right, low, high = ax.images[0].get_extent()
    column = np.floor((x[:, 0] - left) / (right - left) * 20).astype(int)
    row = np.floor((x[:, 1] - low) / (high - low) * 20).astype(int)
    regions = model.region(x)
    for cell in rng.integers(0, len(x), size=40):
        here = regions[(column == column[cell]) & (row == row[cell])]
        shares = np.bincount(here, minlength=4)
        if np.sort(shares)[-1] > np.sort(shares)[-2] + 1:
            assert np.unique(regions)[image[row[cell], column[cell]]] == shares.argmax()
    for value in ("transitions", "score", "rows"):
        shown = ff.plot.region_map(model, data, "a", "b", value=value, bins=10).images[0].get_array()
        assert np.isfinite(shown.compressed() if hasattr(shown, "compressed") else shown).any()
    with pytest.raises(ValueError, match="value="):
        ff.plot.region_map(model, data, "a", "b", value="height")
    with pytest.raises(ValueError, match="c"):
        ff.plot.region_map(model, data, "a", "c")


def test_matplotlib_is_imported_when_a_picture_is_drawn():
    code = (
        "import sys, fleetfoot as ff\n"
        "assert 'matplotlib' not in sys.modules\n"
        "sys.modules['matplotlib.pyplot'] = None\n"
        "sys.modules['matplotlib'] = None\n"
        "try: ff.plot.selection_frequency([1.0])\n"
        "except ImportError as error: print(error)\n"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert run.returncode == 0 and "pip install matplotlib" in run.stdout, run.stderr


def _swings(count=3):
    t = np.arange(0, 5, 0.01)
    rng = np.random.default_rng(1)
    clean = [np.column_stack([a * np.cos(2 * t), -2 * a * np.sin(2 * t)]) for a in np.linspace(1.0, 0.4, count)]
    return t, [x + 1e-3 * rng.normal(size=x.shape) for x in clean]


def test_coefficients_are_drawn_with_intervals():
    t, runs = _swings()
    fitted = ff.SINDy().fit(runs[0], t, feature_names=["q", "v"])
    ax = fitted.plot(target="d(v)/dt")
    terms = fitted.report_["regions"][0]["equations"][1]["terms"]
    assert [label.get_text() for label in ax.get_yticklabels()] == [term["function"] for term in terms]
    points, _, (bars,) = ax.containers[0]
    np.testing.assert_allclose(np.asarray(points.get_xdata(), dtype=float), [term["coefficient"] for term in terms])
    low, high = bars.get_segments()[0][:, 0]
    assert high - low == pytest.approx(2 * 1.96 * terms[0]["standard_error"])
    # A model alone does not know how well its coefficients are known.
    assert fitted.model_.plot(target=1).get_xlabel() == "coefficient"
    axes = plt.figure().add_subplot()
    assert fitted.model_.plot(ax=axes) is axes and axes.get_title() == "d(q)/dt"
    with pytest.raises(ValueError, match="speed"):
        fitted.plot(target="speed")
    with pytest.raises(ValueError, match="region=3"):
        fitted.plot(region=3)


def test_predictions_are_drawn_beside_measurements():
    t, runs = _swings()
    model = ff.PWA(1).fit(runs[:2], t, feature_names=["q", "v"]).model_
    data = ff.open([{"q": run[:, 0], "v": run[:, 1]} for run in runs], dt=0.01)
    ax = model.plot(data, target="d(v)/dt", episode=2)
    predicted = model.predict(data)
    rows = predicted["episode"] == 2
    np.testing.assert_array_equal(ax.lines[0].get_ydata(), predicted["measured"][rows, 1])
    np.testing.assert_array_equal(ax.lines[1].get_ydata(), predicted["predicted"][rows, 1])
    assert ax.lines[0].get_xdata()[-1] == pytest.approx(4.99) and ax.get_ylabel().startswith("d(v)/dt")
    with pytest.raises(ValueError, match="episode=7"):
        model.plot(data, episode=7)


def test_data_draw_their_channels_and_gaps():
    t = np.concatenate([np.arange(0, 1, 0.01), np.arange(3, 4, 0.01)])
    data = ff.open({"t": t, "q": np.sin(t), "v": np.cos(t)}, t="t")
    drawn = data.plot()
    assert [one.get_ylabel() for one in drawn] == ["q", "v"] and drawn[-1].get_xlabel().endswith("[s]")
    first, second = drawn[0].lines
    np.testing.assert_allclose(np.concatenate([first.get_xdata(), second.get_xdata()]), t, atol=1e-9)
    np.testing.assert_array_equal(second.get_ydata(), np.sin(t[100:]))
    (gap,) = drawn[0].patches
    assert gap.get_x() == pytest.approx(0.99) and gap.get_x() + gap.get_width() == pytest.approx(3.0)
    (one,) = data.plot(["q*v"])
    np.testing.assert_allclose(one.lines[0].get_ydata(), (np.sin(t) * np.cos(t))[:100])
    axes = plt.figure().subplots(3)
    with pytest.raises(ValueError, match="3 axes for 2 channels"):
        data.plot(ax=axes)


def test_a_comparison_draws_errors_with_intervals():
    t, runs = _swings(6)
    model = ff.PWA(1).fit(runs[:2], t, feature_names=["q", "v"]).model_
    data = ff.open([{"q": run[:, 0], "v": run[:, 1]} for run in runs[2:]], dt=0.01)
    comparison = ff.compare({"affine": model, "decay": lambda x, u: -x}, data)
    ax = comparison.plot()
    assert [label.get_text() for label in ax.get_yticklabels()] == ["d(q)/dt", "d(v)/dt"]
    cell = {(row["model"], row["target"]): row for row in comparison.table}
    values = ax.containers[0][0].get_xdata()
    assert values[1] == pytest.approx(cell["affine", "d(v)/dt"]["rmse"] / cell["null", "d(v)/dt"]["rmse"])
    ax = comparison.plot("d(v)/dt")
    labels = [container.get_label() for container in ax.containers]
    assert labels == ["affine", "decay", "null", "persistence"] and ax.get_xlabel().startswith("RMSE")
    assert ax.containers[0][0].get_xdata()[0] == pytest.approx(cell["affine", "d(v)/dt"]["rmse"])
    with pytest.raises(ValueError, match="speed"):
        comparison.plot("speed")
