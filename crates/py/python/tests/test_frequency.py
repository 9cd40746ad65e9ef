"""Frequency responses beside scipy's averaged spectra, and of a model beside its closed form."""

from __future__ import annotations

import numpy as np
import pytest

import fleetfoot as ff
from fleetfoot.exceptions import RequestError


def second_order(rows: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    u = random.normal(size=rows)
    y = np.zeros(rows)
    for k in range(2, rows):
        y[k] = 1.6 * y[k - 1] - 0.8 * y[k - 2] + 0.2 * u[k - 1]
    return u, y + 0.1 * random.normal(size=rows)


def test_averaged_spectra_equal_scipys():
    signal = pytest.importorskip("scipy.signal")
    u, y = second_order(6000, 1)
    report = ff.frequency(ff.open({"u": u, "y": y}, dt=0.01), "u", "y", segment=2.56)
    options = {"fs": 100.0, "window": "hann", "nperseg": 256, "noverlap": 128, "detrend": "constant"}
    f, cross = signal.csd(u, y, **options)
    power, output = (signal.welch(values, **options)[1] for values in (u, y))
    coherence = signal.coherence(u, y, **options)[1]
    measured = report["measured"]
    inner = slice(1, -1)  # The last line has no mirror image.
    np.testing.assert_allclose(measured["frequency"], f[1:], rtol=1e-12)
    response = np.array(measured["real"]) + 1j * np.array(measured["imaginary"])
    np.testing.assert_allclose(response, (cross / power)[1:], rtol=1e-9)
    np.testing.assert_allclose(measured["coherence"], coherence[1:], rtol=1e-9)
    np.testing.assert_allclose(measured["input_power"][:-1], power[inner], rtol=1e-9)
    np.testing.assert_allclose(measured["output_power"][:-1], output[inner], rtol=1e-9)


def test_circles_hold_the_truth_in_95_percent():
    z = np.exp(-2j * np.pi * np.arange(1, 33) / 64)
    truth = 0.2 * z / (1 - 1.6 * z + 0.8 * z**2)
    inside = []
    for seed in range(30):
        u, y = second_order(64 * 60, seed)
        # The leakage of a resonance over a short window is a bias; here it lasts 20 samples.
        measured = ff.frequency(ff.open({"u": u, "y": y}, dt=0.01), "u", "y", segment=0.64)["measured"]
        response = np.array(measured["real"]) + 1j * np.array(measured["imaginary"])
        inside.append(np.abs(response - truth)[8:31] < np.array(measured["radius"])[8:31])
    share = np.mean(inside)
    assert 0.92 < share < 0.98, share


def test_periodic_excitation_and_a_model():
    n, periods = 200, 12
    random = np.random.default_rng(3)
    t = np.arange(n * periods)
    u = sum(np.cos(2 * np.pi * k * t / n + random.uniform(0, 6.28)) for k in (1, 3, 7, 9, 11, 15))
    v = np.zeros(t.size)
    for k in range(1, t.size):
        v[k] = 0.9 * v[k - 1] + 0.1 * u[k - 1]
    noise = 0.01 * random.normal(size=t.size)
    data = ff.open({"u": u, "v": v + noise}, dt=0.02)
    model = ff.PWA("average", states=["v"], inputs=["u"], target="next").fit(ff.open({"u": u, "v": v}, dt=0.02)).model_
    report = ff.frequency(data, "u", "v", model=model, period=n * 0.02)
    measured, simulated = report["measured"], report["model"]
    excited = np.array(measured["excited"])
    assert [k + 1 for k in np.flatnonzero(excited)] == [1, 3, 7, 9, 11, 15]
    z = np.exp(-2j * np.pi * np.array([1, 3, 7, 9, 11, 15]) / n)
    truth = 0.1 * z / (1 - 0.9 * z)
    lines = {name: np.array(one["real"]) + 1j * np.array(one["imaginary"]) for name, one in report.items() if name in ("measured", "model")}
    np.testing.assert_allclose(lines["model"][excited], truth, rtol=1e-3)
    assert np.abs(lines["measured"][excited] - truth).max() < 0.005
    assert report["inside"] > 0.6
    assert measured["distortion"]["noise"] < 0.01 and simulated["distortion"]["odd"] < 1e-3
    # By numpy: the mean over the periods behind the first, its transform at the excited lines.
    mean = [signal.reshape(periods, n)[1:].mean(0) for signal in (u, v + noise)]
    spectrum = [np.fft.rfft(signal)[1:][excited[: n // 2]] for signal in mean]
    np.testing.assert_allclose(lines["measured"][excited], spectrum[1] / spectrum[0], rtol=1e-9)


def test_refusals():
    data = ff.open({"u": np.zeros(100), "y": np.ones(100)}, dt=0.01)
    with pytest.raises(RequestError, match="whole number"):
        ff.frequency(data, "u", "y", period=0.123)
    with pytest.raises(ff.exceptions.FleetfootError, match="volts"):
        ff.frequency(data, "volts", "y")
    with pytest.raises(TypeError, match="no model"):
        ff.frequency(data, "u", "y", model=3)
