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
