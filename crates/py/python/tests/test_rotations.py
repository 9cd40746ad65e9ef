"""Rotations among the states, and gleaned rows: from arrays, by the keywords of the recipe."""

from __future__ import annotations

import numpy as np
import pytest

import fleetfoot as ff
from fleetfoot.exceptions import FleetfootError

DT = 0.01
INERTIA = np.array([1.0, 2.0, 3.0])
NAMES = ["q.w", "q.x", "q.y", "q.z", "wx", "wy", "wz"]
ATTITUDE = {"kind": "quaternion", "columns": NAMES[:4], "rate": NAMES[4:]}


def slope(s):
    """Euler's equations of a free body, and the kinematics of its attitude."""
    w, v, rate = s[0], s[1:4], s[4:]
    turn = np.concatenate([[-v @ rate], w * rate + np.cross(v, rate)])
    return np.concatenate([0.5 * turn, np.cross(INERTIA * rate, rate) / INERTIA])


def body(rows=800):
    s, rows_of_states = np.array([0.8, 0.36, -0.48, 0.0, 1.4, -1.1, 1.2]), np.empty((rows, 7))
    for k in range(rows):
        rows_of_states[k] = s
        for _ in range(4):
            h = DT / 4
            a = slope(s)
            b = slope(s + h / 2 * a)
            c = slope(s + h / 2 * b)
            d = slope(s + h * c)
            s = s + h / 6 * (a + 2 * b + 2 * c + d)
    return np.arange(rows) * DT, rows_of_states


def test_rigid_body_is_identified_and_simulated():
    t, x = body()
    flipped = x.copy()
    flipped[:, :4] *= np.where(np.random.default_rng(3).random(len(x)) < 0.5, -1, 1)[:, None]
    states = {"wx": {}, "wy": {}, "wz": {}, "attitude": ATTITUDE}
    coefficients = []
    for rows in (x, flipped):
        sindy = ff.SINDy(states=states, library=["poly(2)"]).fit(rows, t, feature_names=NAMES)
        equations = sindy.report_["regions"][0]["equations"]
        assert [len(equation["terms"]) for equation in equations] == [1, 1, 1]
        coefficients.append([equation["terms"][0]["coefficient"] for equation in equations])
    np.testing.assert_allclose(coefficients[0], [-1, 1, -1 / 3], atol=1e-8)
    np.testing.assert_allclose(coefficients[0], coefficients[1], atol=1e-12)
    model = sindy.model_
    # Steps of 10 ms by the model's own integrator, from the first row.
    simulated = model.simulate(x[0, [NAMES.index(name) for name in model.states]], t)
    states_of_log = simulated[:, [model.states.index(name) for name in NAMES]]
    np.testing.assert_allclose(np.linalg.norm(states_of_log[:, :4], axis=1), 1, atol=1e-14)
    np.testing.assert_allclose(states_of_log, x, atol=1e-5)


def test_invalid_rotations_are_refused():
    t, x = body(100)
    x[50, :4] = 0
    with pytest.raises(FleetfootError, match="row 51 .*attitude"):
        ff.SINDy(states={"wx": {}, "attitude": ATTITUDE}).fit(x, t, feature_names=NAMES)


@pytest.mark.parametrize("lags", ["6:3", {"last": 6, "every": 3}])
def test_gleaned_rows_are_their_lags(lags):
    rng = np.random.default_rng(1)
    u = rng.normal(size=500)
    y = np.zeros(500)
    for k in range(6, 499):
        y[k + 1] = 0.5 * y[k] - 0.2 * y[k - 3] + 0.3 * u[k - 6]
    model = ff.PWA("average", target="next", lags=lags).fit(
        y[:, None], np.arange(500), u=u[:, None], feature_names=["y"], input_names=["u"]
    )
    assert model.model_.lags == 6
    following = model.model_.step(y[[-1]], u[[-1]], history=(y[-7:-1, None], u[-7:-1, None]))
    np.testing.assert_allclose(following, [0.5 * y[-1] - 0.2 * y[-4] + 0.3 * u[-7]], atol=1e-9)
    with pytest.raises(FleetfootError, match="50:5"):
        ff.PWA("average", lags="3:6").fit(y[:, None], np.arange(500), feature_names=["y"])
