"""Recordings filtered by a model."""

from __future__ import annotations

from pathlib import Path

import fleetfoot as ff
import numpy as np
import pytest
from fleetfoot.exceptions import RequestError


def rows(seed: int, count: int = 4000) -> dict[str, np.ndarray]:
    """A state that jumps where it crosses 0, and one that it drives, with process noise; the first is measured."""
    random = np.random.default_rng(seed)
    u = np.sin(0.02 * np.arange(count))
    x = np.zeros((count, 2))
    for k in range(count - 1):
        side = 1.0 if x[k, 0] > 0 else -1.0
        x[k + 1] = [0.9 * x[k, 0] + 0.05 * side + 0.05 * x[k, 1], 0.8 * x[k, 1] + 0.3 * u[k] - 0.1 * side]
        x[k + 1] += 0.05 * random.normal(size=2)
    noisy = x[:, 0] + 0.2 * random.normal(size=count)
    return {"t": 0.01 * np.arange(count), "x": x[:, 0], "v": x[:, 1], "u": u, "seen": noisy}


@pytest.fixture(scope="module")
def model() -> ff.Model:
    columns = rows(1)
    states, u = np.column_stack([columns["x"], columns["v"]]), columns["u"]
    fit = ff.PWA(partition="refined:2", target="next").fit(
        states, columns["t"], u=u, feature_names=["x", "v"], input_names=["u"]
    )
    return fit.model_


def test_estimates_are_accurate_and_consistent(model: ff.Model) -> None:
    asked = {"measured": {"x": 0.2}, "sensors": {"x": "seen"}, "truth": {"x": "x", "v": "v"}}
    report = model.filter(rows(2), keep=True, **asked)
    errors = {score["state"]: score for score in report["truth"]}
    assert errors["x"]["rmse"] < 0.6 * errors["x"]["measured_rmse"]
    # The model is one that was fitted, of 4,000 rows: not the truth itself.
    assert 0.85 < report["nees"]["mean"] < 1.15
    assert 0.93 < report["nees"]["share"] < 0.97
    assert report["sensors"][0]["deviation_from"] == "given"
    [episode] = report["estimates"]
    assert episode["x"].shape == episode["deviation"].shape == (4000, 2)
    assert np.allclose(episode["probability"].sum(axis=1), 1.0)
    rms = np.sqrt(np.mean((episode["x"][:, 1] - rows(2)["v"]) ** 2))
    assert rms == pytest.approx(errors["v"]["rmse"])


def test_nothing_looks_ahead_and_missing_rows_are_predicted(model: ff.Model) -> None:
    whole = rows(3, 400)
    whole["seen"][100:150] = np.nan
    part = {name: values[:200] for name, values in whole.items()}
    asked = {"measured": ["x"], "sensors": {"x": "seen"}, "keep": True}
    with pytest.warns(ff.FleetfootWarning, match="innovations"):
        first, second = (model.filter(columns, **asked)["estimates"][0] for columns in (whole, part))
    assert np.array_equal(first["x"][:200], second["x"])
    assert np.isnan(first["innovation"][100:150]).all() and np.isfinite(first["x"]).all()
    assert first["deviation"][149, 0] > first["deviation"][99, 0]


def test_code_and_refusals(model: ff.Model, tmp_path: Path) -> None:
    files = model.export_filter(tmp_path, measured={"x": 0.2}, prefix="robot")
    assert sorted(Path(file).name for file in files) == ["robot_filter.c", "robot_filter.h"]
    assert "robot_filter_step" in (tmp_path / "robot_filter.h").read_text()
    with pytest.raises(RequestError, match="deviation"):
        model.export_filter(tmp_path, measured={"x": None})  # type: ignore[dict-item]
    with pytest.raises(RequestError, match="no state `w`"):
        model.filter(rows(2), truth={"w": "x"})
