"""From raw channels to clean states, from Python."""

from __future__ import annotations

import inspect

import fleetfoot as ff
import numpy as np
import pytest
from fleetfoot import _core

ROWS, DT = 1500, 0.01
WRONG = np.arange(40, ROWS, 113)


@pytest.fixture
def swing():
    """Stamps, the angle of a pendulum with noise and gross errors, and the truth."""
    t = DT * np.arange(ROWS)
    truth = np.sin(3.0 * t) + 0.3 * np.cos(7.0 * t)
    measured = truth + np.random.default_rng(1).normal(0.0, 2e-3, ROWS)
    measured[WRONG] += 0.7
    return t, measured, truth


def test_a_clean_episode_has_the_derivative_and_fits_unchanged(swing, tmp_path):
    t, measured, truth = swing
    log = ff.open({"t": t, "q": measured}, t="t", recipe={"states": {"q": {"unit": "rad"}}})
    clean = ff.prepare(log, tmp_path / "clean", second_order=True, clip=0.1)
    assert [file.exists() for file in [*clean.files, clean.recipe]] == [True, True]
    assert (clean.rows, clean.written) == (ROWS, ROWS - 20) and 0.0 < clean.smoothed < 1.0
    channel = clean.episodes[0]["pieces"][0]["channels"][0]
    inside = [row for row in WRONG if 10 <= row < ROWS - 10]
    spans = np.array(channel["rejected"]["spans"])
    for row in inside:
        at = t[row]
        assert ((spans[:, 0] <= at + 1e-9) & (at - 1e-9 <= spans[:, 1])).any(), f"the gross error at {at} s is left out"
    rows = ff.read(clean.files[0])
    kept = slice(10, ROWS - 10)
    rate = 3.0 * np.cos(3.0 * t) - 2.1 * np.sin(7.0 * t)
    error = rows["q_dot"] - rate[kept]
    # The spline says how sure it is: 95 % of the errors of a Gaussian process lie within two deviations; rows are correlated.
    within = np.abs(error) < 2.0 * rows["q_dot_deviation"]
    assert within.mean() > 0.85, within.mean()
    assert np.sqrt(np.mean(error**2)) < 0.05 * np.std(rate)
    assert np.sqrt(np.mean((rows["q"] - truth[kept]) ** 2)) < 1.5e-3, "smoother than the noise of 2e-3"
    model = ff.SINDy().fit(clean.open()).model_
    assert "q_dot" in str(model)


def test_scores_include_raw_log_errors(swing, tmp_path):
    t, measured, _ = swing
    file = tmp_path / "swing.csv"
    file.write_text("t,q\n" + "".join(f"{a!r},{b!r}\n" for a, b in zip(t.tolist(), measured.tolist())))
    recipe = {"states": {"q": {}}, "model": {"predict": "next"}}
    clean = ff.prepare(file, tmp_path / "clean", recipe=recipe)
    model = ff.PWA(partition="average").fit(clean.open()).model_
    score, rolled = model.score(clean.files), model.rollout(clean.files, horizon=5, starts=200)
    # The noise is of 2e-3; gross errors were rejected and are no measurements.
    for smooth, raw in [
        (score["targets"][0]["rmse"], score["targets"][0]["raw"]["rmse"]),
        (rolled["model"]["rmse"][0][0], rolled["raw"]["rmse"][0][0]),
    ]:
        assert 0.9 < raw / np.hypot(smooth, 2e-3) < 1.1, (smooth, raw)
    assert score.table[0]["raw rmse"] == score["targets"][0]["raw"]["rmse"]
    assert rolled.table[0]["raw rmse"] == rolled["raw"]["rmse"][-1][0]
    file.unlink()
    with pytest.warns(ff.FleetfootWarning, match="swing.csv and is not there"):
        score = model.score(clean.files)
    assert "raw" not in score["targets"][0] and "raw rmse" not in score.table[0]


def test_files_and_memory_give_the_same_rows(swing, tmp_path):
    t, measured, _ = swing
    file = tmp_path / "swing.csv"
    file.write_text("t,q\n" + "".join(f"{a!r},{b!r}\n" for a, b in zip(t.tolist(), measured.tolist())))
    recipe = {"states": {"q": {}}}
    of_file = ff.prepare(file, tmp_path / "a", recipe=recipe)
    of_memory = ff.prepare(ff.open({"t": t, "q": measured}, t="t"), tmp_path / "b", recipe=recipe)
    one, other = (ff.read(made.files[0]) for made in (of_file, of_memory))
    for name in ("q", "q_dot", "q_deviation", "q_dot_deviation"):
        assert np.array_equal(one[name], other[name], equal_nan=True), name


def test_channels_and_arguments_override_the_recipe(swing, tmp_path):
    t, measured, _ = swing
    recipe = {"states": {"q": {}}, "prepare": {"method": "none", "reject": 3.0}}
    log = {"t": t, "q": measured}

    def method(**more):
        folder = tmp_path / str(len(list(tmp_path.iterdir())))
        made = ff.prepare(ff.open(log, t="t"), folder, recipe=recipe, **more)
        return made.episodes[0]["pieces"][0]["channels"][0]

    assert method()["method"] == "none"
    assert method(method="quintic", lam="gcv")["method"] == "quintic"
    channel = method(channels={"q": {"method": "cubic", "lam": 1e-7}})
    assert (channel["method"], channel["lambda"]) == ("cubic", 1e-7)
    assert method(method="savitzky-golay", window=9, degree=2)["method"] == "savitzky-golay"
    trend = method(method="trend-filter", degree=3, lam="gcv", reject=4.0)
    assert trend["method"] == "trend-filter" and trend["rejected"]["rows"] >= len(WRONG)
    assert method(method="not-a-knot")["noise"] is None and method(method="pchip")["method"] == "pchip"


def test_mean_is_shifted_by_half_window(swing, tmp_path):
    t, _, _ = swing
    truth = lambda times: np.sin(3.0 * times)  # noqa: E731
    measured = truth(t - 0.03) + np.random.default_rng(2).normal(0.0, 1e-3, ROWS)
    log = ff.open({"t": t, "q": measured}, t="t", recipe={"states": {"q": {}}})
    clean = ff.prepare(log, tmp_path / "clean", average=0.04, delay=0.01, clip=0.2)
    rows = ff.read(clean.files[0])
    assert np.sqrt(np.mean((rows["q"] - truth(t[20:-20])) ** 2)) < 1e-3


def test_every_setting_is_an_argument():
    entries = dict(_core.settings())["prepare"]
    arguments = inspect.signature(ff.prepare).parameters
    assert [entry for entry in entries if {"lambda": "lam"}.get(entry, entry) not in arguments] == []


def test_mistakes_are_named(swing, tmp_path):
    t, measured, _ = swing
    log = ff.open({"t": t, "q": measured}, t="t", recipe={"states": {"q": {}}})
    with pytest.raises(ff.exceptions.RequestError, match=r"channels.*velocity"):
        ff.prepare(log, tmp_path / "a", channels={"velocity": {"reject": 3.0}})
    with pytest.raises(ff.exceptions.RequestError, match="method"):
        ff.prepare(log, tmp_path / "a", method="wavelet")
    with pytest.raises(ff.exceptions.RequestError, match=r"long enough.*`q`"):
        ff.prepare(
            ff.open({"t": t, "q": np.full(ROWS, np.nan)}, t="t", recipe=log.recipe), tmp_path / "a"
        )
    assert not (tmp_path / "a").exists() or not list((tmp_path / "a").glob("*.parquet"))
    ff.prepare(log, tmp_path / "a")
    ff.prepare(log, tmp_path / "a", force=True)
    with pytest.raises(ff.exceptions.FleetfootError):
        ff.prepare(log, tmp_path / "a")


def test_the_clock_of_another_computer_is_an_argument(swing, tmp_path):
    flight = ff.generate("quadrotor", tmp_path / "raw", runs=1, seconds=6, seed=3)
    recipe = {
        "columns": {"x": "/mocap/pose.pose.position.x"},
        "states": {"x": {}},
    }
    late = {"mocap": {"topics": ["/mocap/*"], "offset": 0.25}}
    plain = ff.prepare(flight.files, tmp_path / "plain", recipe=recipe)
    moved = ff.prepare(flight.files, tmp_path / "moved", recipe=recipe, clocks=late)
    assert plain.clocks == [] and moved.clocks[0]["offset"] == 0.25 and moved.clocks[0]["by"] == "given"
    with pytest.raises(ff.exceptions.RequestError, match=r"clocks.mocap.*motion"):
        ff.prepare(flight.files, tmp_path / "none", recipe=recipe, clocks={"mocap": {"topics": ["/mocap/*"]}})
    t, measured, _ = swing
    with pytest.raises(ff.exceptions.RequestError, match="one clock"):
        ff.prepare(ff.open({"t": t, "q": measured}, t="t"), tmp_path / "none", recipe={"states": {"q": {}}}, clocks=late)
