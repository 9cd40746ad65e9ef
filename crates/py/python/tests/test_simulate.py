"""Simulations: inputs between their times, what acts at once, stiff equations, and Ctrl-C between two times."""

from __future__ import annotations

import signal
import threading
import time
import warnings
from typing import Any

import numpy as np
import pytest

import fleetfoot as ff
from fleetfoot.exceptions import ModelError

DT = 0.02


def linear(states: np.ndarray, inputs: np.ndarray | None = None) -> Any:
    """A model whose derivatives are these matrices times states and inputs."""
    random = np.random.default_rng(0)
    x = random.normal(size=(400, len(states)))
    u = None if inputs is None else random.normal(size=(400, inputs.shape[1]))
    x_dot = x @ states.T + (0.0 if u is None or inputs is None else u @ inputs.T)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return ff.PWA(1).fit(x, np.arange(400) * DT, x_dot=x_dot, u=u).model_


@pytest.fixture(scope="module")
def lag() -> Any:
    t = np.arange(400) * DT
    u, x = np.cos(3.0 * t), np.sin(t)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return ff.PWA(1).fit(x, t, x_dot=u - 2.0 * x, u=u, feature_names=["x"], input_names=["u"]).model_


def exact(t: np.ndarray) -> np.ndarray:
    """x' = cos(3 t) - 2 x from 0."""
    return (2.0 * np.cos(3.0 * t) + 3.0 * np.sin(3.0 * t) - 2.0 * np.exp(-2.0 * t)) / 13.0


def test_interpolated_inputs_are_not_held(lag: Any) -> None:
    t = np.arange(0.0, 4.0, DT)
    u = np.cos(3.0 * t)
    error = {
        "held": lag.simulate([0.0], t, u),
        "lines": lag.simulate([0.0], t, u, interpolate=True),
        "lines, rk4": lag.simulate([0.0], t, u, interpolate=True, method="rk4", substeps=2),
        "function": lag.simulate([0.0], t, lambda time: np.cos(3.0 * time)),
        "function, coarse times": lag.simulate([0.0], t[::10], lambda time: np.cos(3.0 * time)),
    }
    error = {name: np.abs(x[:, 0] - exact(t if len(x) == len(t) else t[::10])).max() for name, x in error.items()}
    assert error.pop("held") > 3e-3
    # Lines leave h^2/8 of the second derivative: 4.5e-4 of the input, of which x sees a part.
    assert max(error.values()) < 2e-4, error
    # A tenth of the time between rows: a hundredth of the error.
    fine = np.arange(0.0, 4.0, 0.1 * DT)
    simulated = lag.simulate([0.0], fine, np.cos(3.0 * fine), interpolate=True)[:, 0]
    assert np.abs(simulated - exact(fine)).max() < 2e-6
    with pytest.raises(ModelError, match="u has the shape"):
        lag.simulate([0.0], t, u[:-1], interpolate=True)
    # A closed loop is a sampled controller's: its inputs are held.
    closed = lag.simulate([0.0], t, lambda time, x: np.cos(3.0 * time))
    np.testing.assert_allclose(closed, lag.simulate([0.0], t, u), rtol=1e-9, atol=1e-12)


@pytest.fixture(scope="module")
def direct() -> Any:
    random = np.random.default_rng(5)
    u, y = random.normal(size=600), np.zeros(600)
    for k in range(599):
        y[k + 1] = 0.7 * y[k] + 0.5 * u[k + 1]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return ff.NARX().fit(y, u=u), y, u


def test_a_direct_system_is_fitted_predicted_and_simulated(direct: Any) -> None:
    fit, y, u = direct
    assert "lead(u0, 1)" in fit.equations()[0], fit.equations()
    predicted = fit.predict(y, u)
    known_rows = np.isfinite(np.ravel(predicted))
    assert known_rows.sum() >= 590 and not known_rows[-1]
    np.testing.assert_allclose(np.ravel(predicted)[:-1][known_rows[:-1]], y[1:][known_rows[:-1]], atol=1e-8)
    lags = fit.model_.lags
    history = (y[:lags, None], u[:lags, None])
    run = fit.simulate(y[lags : lags + 1], 100, u[lags : lags + 100], history=history)[:, 0]
    np.testing.assert_allclose(run, y[lags : lags + 100], atol=1e-8)
    with pytest.raises(ModelError, match="u has the shape"):
        fit.simulate(y[lags : lags + 1], 100, u[lags : lags + 99], history=history)
    with pytest.raises(ModelError, match="1 row ahead"):
        fit.model_.step(y[5:6], u[5:6], history=history)


def test_a_stiff_model_takes_no_longer_than_another() -> None:
    model = linear(np.array([[-1e6]]), np.array([[1e6]]))
    begun = time.monotonic()
    # It follows the input, but for a millionth of a second.
    simulated = model.simulate([[1.0], [3.0]], np.arange(0.0, 10.5, 0.5), lambda time: np.cos(time))
    np.testing.assert_allclose(simulated[:, 1:, 0], np.tile(np.cos(np.arange(0.5, 10.5, 0.5)), (2, 1)), atol=1e-5)
    # Explicit steps took half a minute on a quiet machine.
    assert time.monotonic() - begun < 15.0


@pytest.mark.skipif(not hasattr(signal, "pthread_kill"), reason="no signals of threads here")
def test_ctrl_c_ends_a_simulation_between_two_times() -> None:
    model = linear(np.array([[0.0, 1.0], [-1e6, 0.0]]))
    begun = time.monotonic()
    main = threading.main_thread().ident
    timer = threading.Timer(0.5, lambda: signal.pthread_kill(main, signal.SIGINT))
    # A shell starts background jobs with SIGINT ignored, and Python then leaves it ignored.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        timer.start()
        with pytest.raises(KeyboardInterrupt):
            model.simulate([1.0, 0.0], [0.0, 1e7])
        assert time.monotonic() - begun < 20.0
    finally:
        timer.join()
        signal.signal(signal.SIGINT, before)


def test_inputs_in_straight_lines_are_one_row_a_time(lag: Any) -> None:
    t = np.arange(5) * DT
    for rows in (4, 6):
        with pytest.raises(ModelError, match=rf"u has the shape \[{rows}\]; give the 1 input \(u\) in 5 rows, one for each time$"):
            lag.simulate([0.0], t, np.ones(rows), interpolate=True)
    # Rows behind the last step of held inputs say nothing.
    np.testing.assert_array_equal(lag.simulate([0.0], t, np.ones(6)), lag.simulate([0.0], t, np.ones(4)))
    with pytest.raises(ModelError, match=r"interpolate=True with u\(t, x\)"):
        lag.simulate([0.0], t, lambda time, x: -x, interpolate=True)


def test_direct_model_refuses_loops_and_gaps() -> None:
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    u = np.random.default_rng(1).normal(size=200)
    x = np.zeros(200)
    for row in range(1, 200):
        x[row] = 0.5 * x[row - 1] + u[row]
    even = np.arange(200) * DT
    model = ff.NARX(1, 0, 1, terms=2, direct=True).fit(x, even, u=u, feature_names=["x"], input_names=["u"]).model_
    with pytest.raises(ModelError, match=r"u\(t, x\): the model reads the inputs of the next row"):
        model.simulate([0.0], 5, lambda time, x: -x)
    with pytest.raises(ModelError, match="1 row ahead"):
        model.step([0.0], [1.0])
    table = pandas.DataFrame({"t": even + 60.0 * (np.arange(200) >= 100), "x": x, "u": u})
    predicted = model.predict(table).to_numpy()[:, 0]
    assert np.isnan(predicted[99]) and np.isfinite(predicted[[98, 100]]).all()
