"""Radial functions: the weights of least squares, and one model whatever the door."""

from __future__ import annotations

import json

import numpy as np
import pytest
from command import run

import fleetfoot as ff
from fleetfoot.exceptions import RequestError, TooFewRowsError


def surface(count=1500, seed=5):
    rng = np.random.default_rng(seed)
    x = np.column_stack([rng.uniform(-3, 3, count), rng.uniform(-1, 2, count)])
    return x, np.sin(x[:, 0]) * x[:, 1] + 0.01 * rng.normal(size=count)


def table(x, y):
    return {"x": x[:, 0], "z": x[:, 1], "y": y}


def features(model, x):
    """The features of a model's only latent by numpy: constant, columns, radial functions of its file."""
    latent = json.loads(model.to_json())["model"]["latents"][0]
    radial = latent["radial"]
    columns = x[:, radial["inputs"]]
    apart = (columns[:, None] - np.array(radial["centres"])) / np.array(radial["scale"])
    phi = np.exp(-(apart**2).sum(axis=2) / (2 * radial["width"] ** 2))
    return np.column_stack([np.ones(len(x)), x, phi])


@pytest.fixture(scope="module")
def fitted():
    x, y = surface()
    data = ff.open(table(x, y), dt=1.0)
    return x, y, data, ff.PWA("average", target="y", inputs=["x", "z"], radial=20).fit(data)


def test_weights_match_least_squares(fitted):
    x, y, _, fit = fitted
    design = features(fit.model_, x)
    known = np.linalg.lstsq(design, y, rcond=None)[0]
    coefficients = fit.coefficients().ravel()
    assert fit.get_feature_names() == ["1", "x", "z", *(f"radial{k}" for k in range(1, 21))]
    np.testing.assert_allclose(coefficients, known, rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(fit.predict(None, x).ravel(), design @ coefficients, atol=1e-12)
    plane = np.linalg.lstsq(design[:, :3], y, rcond=None)[0]
    r2 = [1 - np.mean((y - design[:, : len(coefficients)] @ coefficients) ** 2) / y.var() for coefficients in (plane, known)]
    assert r2[0] < 0.4 and r2[1] > 0.97
    assert fit.score(fitted[2]) == pytest.approx(r2[1], abs=1e-9)


def test_centres_are_centroids_and_the_width_is_their_distance(fitted):
    x, _, _, fit = fitted
    radial = json.loads(fit.model_.to_json())["model"]["latents"][0]["radial"]
    np.testing.assert_allclose(radial["scale"], x.std(axis=0), rtol=1e-9)
    centres = np.array(radial["centres"]) / x.std(axis=0)
    apart = np.linalg.norm(centres[:, None] - centres, axis=2) + np.diag(np.full(20, np.inf))
    assert radial["width"] == pytest.approx(apart.min(axis=1).mean(), rel=1e-9)
    # Lloyd's fixed point, up to its tolerance: a centre is the mean of the rows that are nearest to it.
    rows = x / x.std(axis=0)
    nearest = np.linalg.norm(rows[:, None] - centres, axis=2).argmin(axis=1)
    means = np.array([rows[nearest == k].mean(axis=0) for k in range(20)])
    assert np.abs(means - centres).max() < 0.05


def test_a_model_reads_back_and_prints(fitted, tmp_path):
    x, _, _, fit = fitted
    fit.save(tmp_path / "model.json")
    again = ff.load(tmp_path / "model.json")
    assert again == fit.model_ and again.complexity == 23
    np.testing.assert_array_equal(again.predict(None, x), fit.predict(None, x))
    assert "*radial20" in again.equations()[0]
    assert "radial1 to radial20" in again.describe()


def test_sindy_drops_terms():
    x, y = surface()
    data = ff.open(table(x, y), dt=1.0)
    fit = ff.SINDy(target="y", inputs=["x", "z"], radial=30).fit(data)
    assert fit.get_feature_names() == ["1", "x", "z", *(f"radial{k}" for k in range(1, 31))]
    coefficients = fit.coefficients().ravel()
    assert coefficients.shape == (33,) and np.count_nonzero(coefficients) > 5
    assert fit.score(data) > 0.97


def test_the_command_line_and_python_agree(tmp_path):
    x, y = surface(800)
    np.savetxt(tmp_path / "run.csv", np.column_stack([x, y]), delimiter=",", header="x,z,y", comments="", fmt="%.17g")
    for method, estimator in (
        ("pwa", ff.PWA(2, target="y", inputs=["x", "z"], radial=8)),
        ("sindy", ff.SINDy(target="y", inputs=["x", "z"], radial=8)),
    ):
        arguments = ["fit", method, "run.csv", "--predict", "y", "--inputs", "x,z", "--dt", "1", "--radial", "8"]
        arguments += ["-p", "kmeans:2"] if method == "pwa" else []
        run(*arguments, "-o", "model.json", folder=tmp_path)
        other = ff.load(tmp_path / "model.json")
        estimator.fit(ff.open(table(x, y), dt=1.0))
        np.testing.assert_array_equal(other.coefficients(), estimator.model_.coefficients())
        np.testing.assert_array_equal(other.predict(None, x), estimator.predict(None, x))


def test_impossible_requests_are_refused():
    x, y = surface(50)
    data = ff.open(table(x, y), dt=1.0)
    for kind in (ff.PWA, ff.SINDy):
        with pytest.raises((RequestError, ValueError), match="radial"):
            kind(target="y", inputs=["x", "z"], radial=0).fit(data)
        with pytest.raises(TooFewRowsError, match="50 complete rows are too few"):
            kind(target="y", inputs=["x", "z"], radial=60).fit(data)
