"""Controllers of models."""

from __future__ import annotations

import copy
import datetime
import pickle

import fleetfoot as ff
import numpy as np
import pytest


@pytest.fixture(scope="module")
def mass():
    """A mass: x+ = x + 0.01 v, v+ = v + 0.01 u."""
    t, random = np.arange(0, 20, 0.01), np.random.default_rng(0)
    u = np.repeat(random.normal(size=40), 50)
    v = np.cumsum(np.append(0, u[:-1])) * 0.01
    x = np.cumsum(np.append(0, v[:-1])) * 0.01
    rows = np.column_stack([x, v])
    return ff.PWA(target="next").fit(rows, t, u=u, feature_names=["x", "v"], input_names=["u"]).model_


def test_the_gain_is_that_of_scipy(mass):
    linalg = pytest.importorskip("scipy.linalg", reason="the peer")
    law = mass.lqr({"x": 1.0}, q={"x": 4.0, "v": 0.5}, r={"u": 0.1})
    a, b = np.array([[1, 0.01], [0, 1]]), np.array([[0.0], [0.01]])
    q, r = np.diag([4.0, 0.5]), np.array([[0.1]])
    p = linalg.solve_discrete_are(a, b, q, r)
    gain = np.linalg.solve(r + b.T @ p @ b, b.T @ p @ a)
    # The model is found from data, to some 1e-12.
    np.testing.assert_allclose(law.gains[0], gain, rtol=1e-7)
    assert law.regions[0]["residual"] < 1e-12 and law.setpoint["states"]["x"] == 1.0
    assert law.states == ("x", "v") and law.inputs == ("u",)


def test_a_controller_is_a_file_and_a_value(mass, tmp_path):
    law = mass.lqr({"x": 1.0}, integral={"x": 2.0}, limits={"u": (-1, 1)})
    law.save(tmp_path / "law.json")
    assert (tmp_path / "law.json").read_text() == law.to_json()
    with pytest.raises(ff.exceptions.WriteError):
        law.save(tmp_path / "nowhere" / "law.json")
    (tmp_path / "model.json").write_text(mass.to_json())
    (tmp_path / "bytes.json").write_bytes(b"\xff\xfe")
    for wrong, kind in (
        ("no.json", ff.exceptions.DataError),
        ("bytes.json", ff.exceptions.DataError),
        ("model.json", ff.exceptions.ModelError),
    ):
        with pytest.raises(kind, match=wrong):
            ff.Controller.load(tmp_path / wrong)
    for other in (pickle.loads(pickle.dumps(law)), copy.deepcopy(law), ff.Controller.load(tmp_path / "law.json")):
        assert other.to_json() == law.to_json() and (other.gains == law.gains).all()
    t = np.arange(0, 10, 0.01)
    rows = {"t": t, "x": 0 * t, "v": 0 * t, "u": 0 * t}
    ended = [mass.rollout(rows, 900, starts=1, controller=one) for one in (law, tmp_path / "law.json")]
    assert ended[0]["driven_inputs"] == ["u"] == ended[1]["driven_inputs"]
    # The recording stays at 0, the model goes to 1.
    errors = [one["model"]["rmse"][-1][0] for one in ended]
    assert errors[0] == errors[1] and abs(errors[0] - 1) < 0.02
    files = law.export("c", tmp_path / "src", prefix="law")
    assert [name.rsplit("/", 1)[-1] for name in files] == ["law.h", "law.c", "law_test.c"]


def test_plans_keep_limits_and_bounds(mass, tmp_path):
    linalg = pytest.importorskip("scipy.linalg", reason="the peer")
    weights = {"q": {"x": 4.0, "v": 0.5}, "r": {"u": 0.1}}
    law = mass.mpc({"x": 1.0}, horizon=40, limits={"u": (-1, 1)}, bounds={"v": (-0.2, 0.2)}, **weights)
    a, b = np.array([[1, 0.01], [0, 1]]), np.array([[0.0], [0.01]])
    p = linalg.solve_discrete_are(a, b, np.diag([4.0, 0.5]), np.array([[0.1]]))
    np.testing.assert_allclose(law.law["prediction"]["terminal"], p, rtol=1e-6)
    assert (law.gains == mass.lqr({"x": 1.0}, limits={"u": (-1, 1)}, **weights).gains).all()
    t = np.arange(0, 12, 0.01)
    rows = {"t": t, "x": 0 * t, "v": 0 * t, "u": 0 * t}
    path = mass.rollout(rows, 1100, starts=1, controller=law, keep=True)["trajectories"][0]["x"]
    # A violation that saves the heaviest error, 1 m, is a ten-thousandth of it in sizes.
    assert np.abs(path[:, 1]).max() < 0.201 and abs(path[-1, 0] - 1) < 0.02
    files = law.export("c", tmp_path / "src", prefix="law")
    assert [name.rsplit("/", 1)[-1] for name in files] == ["law.h", "law.c", "law_test.c"]
    with pytest.raises(ff.exceptions.OptionError, match="to='c'"):
        law.export("python", tmp_path / "src")
    with pytest.raises(ff.exceptions.ModelError, match="1 to 200"):
        mass.mpc({"x": 1.0}, horizon=0)
    with pytest.raises(ff.exceptions.ModelError, match="widen the bounds"):
        mass.mpc({"x": 1.0}, bounds={"x": (-1, 0.5)})


def test_wrong_arguments_are_named(mass):
    with pytest.raises(ff.exceptions.ModelError, match="did you mean"):
        mass.lqr({"xx": 1.0})
    assert mass.lqr({"x": 1.0}, drive="u", free="x").to_json() == mass.lqr({"x": 1.0}, drive=["u"], free=["x"]).to_json()
    assert mass.lqr({"x": 1.0}, period=datetime.timedelta(milliseconds=10)).to_json() == mass.lqr({"x": 1.0}, period=0.01).to_json()
    with pytest.raises(ff.exceptions.ModelError, match="positive weight"):
        mass.lqr({"x": 1.0}, r={"u": 0.0})
    with pytest.raises(ff.exceptions.ModelError):
        mass.lqr({"x": 1.0}).export("cobol")


def test_a_rotation_is_three_numbers_of_a_law(tmp_path):
    """A body whose rates are commanded: the quaternion's kinematics are given, and the law turns it about each axis by itself."""
    rng, step, rows = np.random.default_rng(3), 0.02, 600
    rates = np.repeat(rng.normal(size=(rows // 20, 3)), 20, axis=0)
    spin, q = [np.zeros(3)], [np.array([1.0, 0.0, 0.0, 0.0])]
    for k in range(rows - 1):
        spin.append(spin[-1] + step * (rates[k] - spin[-1]))
        size = max(np.linalg.norm(spin[k]), 1e-12)
        w, v = np.cos(step * size / 2), np.sin(step * size / 2) * spin[k] / size
        a, b = q[-1][0], q[-1][1:]
        q.append(np.concatenate([[a * w - b @ v], a * v + w * b + np.cross(b, v)]))
    names = ["q.w", "q.x", "q.y", "q.z", "wx", "wy", "wz"]
    model = ff.SINDy(
        library=["1", "wx", "wy", "wz", "ux", "uy", "uz"],
        states={
            "wx": {}, "wy": {}, "wz": {},
            "attitude": {"kind": "quaternion", "columns": names[:4], "rate": names[4:]},
        },
    ).fit(np.hstack([q, spin]), step, u=rates, feature_names=names, input_names=["ux", "uy", "uz"]).model_
    law = model.lqr({"roll(attitude)": 0.0, "pitch(attitude)": 0.0, "yaw(attitude)": 1.0}, q={"attitude": 4.0})
    assert law.states == ("wx", "wy", "wz", "attitude about x", "attitude about y", "attitude about z")
    assert law.gains.shape == (1, 3, 6) and law.setpoint["at_rest"]
    np.testing.assert_allclose(law.law["rotations"][0]["at"], [np.cos(0.5), 0, 0, np.sin(0.5)], atol=1e-12)
    # About each axis the body is the same: what an input does about another one is what the fit is off.
    turn = law.gains[0][:, 3:]
    np.testing.assert_allclose(turn, np.diag(np.diag(turn)), atol=0.02 * turn.max())
    assert [name.rsplit("/", 1)[-1] for name in law.export("c", tmp_path, prefix="turn")][0] == "turn.h"
