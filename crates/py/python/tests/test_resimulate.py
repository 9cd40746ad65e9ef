"""Recordings that a model follows."""

from __future__ import annotations

import fleetfoot as ff
import numpy as np
import pytest
from fleetfoot.exceptions import RequestError


def rows(k: float = 2.0, noise: float = 0.01) -> dict[str, np.ndarray]:
    """A spring that is pulled at, with noise; its stiffness is k."""
    t = np.arange(0.0, 8.0, 0.05)
    u = np.sin(0.9 * t)
    q, v = np.zeros_like(t), np.zeros_like(t)
    state = np.array([1.0, 0.0])
    for i, force in enumerate(u):
        q[i], v[i] = state
        for _ in range(50):
            state = state + 0.001 * np.array([state[1], -k * state[0] + force])
    random = np.random.default_rng(1)
    return {"t": t, "q": q + noise * random.normal(size=t.size), "v": v + noise * random.normal(size=t.size), "u": u}


@pytest.fixture(scope="module")
def model() -> ff.Model:
    known = {"q": "v", "v": "-k*q + u"}
    return ff.Parameters({"k": 1.9}, known=known, states=["q", "v"], inputs=["u"], folds=0).fit(rows()).model_


def test_resimulation_obeys_equations_and_bounds(model: ff.Model) -> None:
    report = model.resimulate(rows(k=2.1), bounds={"u": (-0.7, None)}, keep=True)
    assert report["violation"]["dynamics"] < 1e-6
    assert report["violation"]["bounds"] == 0.0
    assert report["minima"] == 1
    [path] = report["trajectories"]
    assert path["x"].shape == path["x_open_loop"].shape == (160, 2)
    assert path["u"].min() >= -0.7
    # Hermite and Simpson's rule, written out.
    k, x, u, h = model_stiffness(model), path["x"], path["u"][:, 0], 0.05

    def slope(x: np.ndarray, u: np.ndarray) -> np.ndarray:
        return np.column_stack([x[:, 1], -k * x[:, 0] + u])

    f = slope(x, u)
    middle = (x[:-1] + x[1:]) / 2 + h / 8 * (f[:-1] - f[1:])
    defect = x[1:] - x[:-1] - h / 6 * (f[:-1] + 4 * slope(middle, (u[:-1] + u[1:]) / 2) + f[1:])
    assert np.abs(defect).max() < 1e-8
    columns = {column["name"]: column for column in report["columns"]}
    assert columns["q"]["followed"]["worst"] < columns["q"]["open_loop"]["worst"]
    assert np.sqrt(np.mean((path["x"][:, 0] - path["x_measured"][:, 0]) ** 2)) == pytest.approx(
        columns["q"]["followed"]["median"]
    )


def model_stiffness(model: ff.Model) -> float:
    """-df/dq."""
    return float(-model.linearize([0.0, 0.0], [0.0])[0][1, 0])


def test_arguments_override_the_recipe(model: ff.Model) -> None:
    recipe = {"resimulate": {"deviations": "q=0.1,v=0.1,u=0.5", "every": 4}}
    report = model.resimulate(rows(), recipe=recipe, every=2)
    assert report["rows"] == 80
    assert [column["deviation"] for column in report["columns"]] == [0.1, 0.1, 0.5]
    again = model.resimulate(rows(), deviations={"q": 0.1, "v": 0.1, "u": 0.5}, every=2, free=["u"])
    assert again == report


@pytest.mark.parametrize(
    ("arguments", "entries"),
    [
        ({"every": 2}, {"every": 2}),
        ({"free": ["u"]}, {"free": "u"}),
        ({"deviations": {"q": 0.1, "v": 0.2}}, {"deviations": "q=0.1,v=0.2"}),
        ({"bounds": {"u": (None, 0.8)}}, {"bounds": "u=..0.8"}),
        ({"widen": 0.5}, {"widen": 0.5}),
        ({"iterations": 1}, {"iterations": 1}),
    ],
)
def test_arguments_are_the_entries_of_a_recipe(model: ff.Model, arguments: dict, entries: dict) -> None:
    report = model.resimulate(rows(k=2.1), **arguments)
    assert model.resimulate(rows(k=2.1), recipe={"resimulate": entries}) == report
    # All inputs may move already: there is one.
    assert (model.resimulate(rows(k=2.1)) == report) == ("free" in arguments)


@pytest.mark.parametrize(
    ("slip", "message"),
    [
        ({"bounds": {"u": (1.0, 0.0)}}, "`u`"),
        ({"bounds": {"w": (0.0, 1.0)}}, "`w`"),
        ({"free": ["w"]}, "`w`"),
        ({"every": 0}, "every"),
        ({"iterations": 0}, "iterations"),
        ({"widen": -1.0}, "widen"),
        ({"deviations": {"w": 1.0}}, "`w`"),
        ({"deviations": {"u": -1.0}}, "`u`"),
    ],
)
def test_errors_name_wrong_arguments(model: ff.Model, slip: dict, message: str) -> None:
    with pytest.raises(RequestError, match=message.replace("`", "[`']")) as caught:
        model.resimulate(rows(), **slip)
    assert "--" not in str(caught.value)
