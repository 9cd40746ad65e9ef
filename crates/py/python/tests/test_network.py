"""Networks: one model whatever the door, and the linear model where no network is better."""

from __future__ import annotations

import json

import numpy as np
import pytest
from command import run

import fleetfoot as ff
from fleetfoot.exceptions import ModelError, RequestError


def table(curved, count=1500, seed=5):
    rng = np.random.default_rng(seed)
    x, z = rng.uniform(-3, 3, count), rng.uniform(-1, 2, count)
    y = (np.sin(x) * z if curved else 0.5 * x - z) + 0.01 * rng.normal(size=count)
    return {"x": x, "z": z, "y": y}


def fit(curved, **options):
    return ff.Network(target="y", inputs=["x", "z"], effort="low", **options).fit(ff.open(table(curved), dt=1.0))


def test_network_of_a_surface_matches_numpy():
    fitted = fit(True, hidden=[8, 6])
    report = fitted.report_
    assert [candidate["name"] for candidate in report["candidates"]] == ["linear", "network 8-6"] and report["chosen"] == 1
    assert report["held_out"][0]["rmse"] < 0.3 * report["held_out"][0]["mean"]
    latent = json.loads(fitted.model_.to_json())["model"]["latents"][0]
    network = latent["network"]["hidden"]
    x = np.column_stack([table(True)["x"], table(True)["z"]])
    units = (x[:, network["inputs"]] - network["centre"]) / network["scale"]
    for layer in network["layers"]:
        units = np.tanh(units @ np.array(layer["weights"]).T + layer["biases"])
    design = np.column_stack([np.ones(len(x)), x, units])
    assert fitted.get_feature_names() == ["1", "x", "z", *(f"unit{k}" for k in range(1, 7))]
    np.testing.assert_allclose(fitted.predict(None, x).ravel(), design @ fitted.coefficients().ravel(), atol=1e-12)
    assert "network_" in fitted.model_.equations()[0]


def test_a_plane_gets_the_linear_model():
    fitted = fit(False)
    assert fitted.report_["chosen"] == 0 and fitted.model_.method == "network linear"
    assert any("linear model is written" in note for note in fitted.report_["notes"])


def test_the_command_writes_the_same_model(tmp_path):
    data = table(True, 600)
    np.savetxt(tmp_path / "log.csv", np.column_stack(list(data.values())), delimiter=",", header="x,z,y", comments="", fmt="%.17g")
    words = "fit network log.csv --predict y --inputs x,z --dt 1 --hidden 8 --effort low --seed 4 -o net.json"
    run(*words.split(), folder=tmp_path)
    written = ff.load(tmp_path / "net.json")
    model = ff.Network(8, target="y", inputs=["x", "z"], effort="low", seed=4, dt=1.0)
    same = model.fit(ff.open(str(tmp_path / "log.csv"), dt=1.0)).model_
    latents = [json.loads(model_file.to_json())["model"]["latents"] for model_file in (written, same)]
    assert latents[0] == latents[1]


def test_gru_matches_numpy():
    rng = np.random.default_rng(2)
    u = np.repeat(rng.uniform(-1, 1, 120), 10)
    x = np.zeros(1200)
    for k in range(1199):
        x[k + 1] = 0.9 * x[k] + np.tanh(2 * u[k] * x[k - 1] + u[k])
    fit = ff.Network(6, cell="gru", lags=2, effort="low", folds=2, states=["x"], inputs=["u"], dt=0.1)
    fitted = fit.fit(ff.open({"x": x, "u": u}, dt=0.1))
    assert fitted.report_["chosen"] == 1 and fitted.model_.method == "network gru 6"
    latent = json.loads(fitted.model_.to_json())["model"]["latents"][0]
    cell = latent["network"]["cell"]
    # The library has x, u and their past row by row; the cell reads the oldest row first.
    rows = np.column_stack([x[2:], u[2:], x[1:-1], u[1:-1], x[:-2], u[:-2]])
    state, logistic = np.zeros((len(rows), 6)), lambda z: 1 / (1 + np.exp(-z))
    weights = [np.array(cell[name], float) for name in ("input_weights", "state_weights", "biases")]
    for step in cell["steps"]:
        z = (rows[:, step] - cell["centre"]) / cell["scale"]
        (r, u_gate, n), (hr, hu, hn) = (np.split(part, 3, axis=1) for part in (z @ weights[0].T + weights[2], state @ weights[1].T))
        r, u_gate = logistic(r + hr), logistic(u_gate + hu)
        state = (1 - u_gate) * np.tanh(n + r * (hn + cell["state_biases"])) + u_gate * state
    delta = latent["constants"][0] + rows @ np.ravel(latent["coefficients"]) + state @ np.ravel(latent["network"]["weights"])
    # One-step errors that the engine reports are those of the equations.
    rmse = np.sqrt(np.mean((x[3:] - x[2:-1] - delta[:-1]) ** 2))
    scored = fitted.model_.score(ff.open({"x": x, "u": u}, dt=0.1))
    np.testing.assert_allclose(scored["targets"][0]["rmse"], rmse, rtol=1e-9)


def test_untrainable_networks_are_refused():
    with pytest.raises(RequestError, match="units of every hidden layer"):
        fit(True, hidden=[0])


def test_networks_survive_export_and_import(tmp_path):
    fitted = fit(True, hidden=8)
    (file,) = fitted.model_.export("onnx", tmp_path, prefix="surface")
    recipe = {"inputs": {"x": {}, "z": {}}, "model": {"predict": "y"}}
    again = ff.import_model(file, recipe)
    assert again.method == "imported network 8 tanh" and again.outputs == ("y",)
    parts = [json.loads(model.to_json())["model"]["latents"][0] for model in (fitted.model_, again)]
    for name in ("constants", "coefficients"):
        np.testing.assert_allclose(*(np.array(part[name], float) for part in parts), rtol=1e-12)
    with pytest.raises(RequestError, match="time between rows"):
        ff.import_model(file, {"states": {"x": {}, "z": {}}})
    with pytest.raises(ModelError, match="2 inputs.*recipe has 1"):
        ff.import_model(file, {"inputs": {"x": {}}, "model": {"predict": "y"}})
