"""Parameters of given equations."""

import numpy as np
import pytest

import fleetfoot as ff

KNOWN = {"x": "v", "v": "mu*(1 - x^2)*v - k*x"}
NAMES = {"feature_names": ["x", "v"]}


def oscillator(seed, rows=300, dt=0.05):
    """Van der Pol with mu = 1.2, k = 1, and noise of 0.02 on both states."""
    path, state = [], np.array([1.0, 0.0])

    def slope(z):
        return np.array([z[1], 1.2 * (1 - z[0] ** 2) * z[1] - z[0]])

    for _ in range(rows):
        path.append(state)
        one = slope(state)
        two = slope(state + 0.5 * dt * one)
        three = slope(state + 0.5 * dt * two)
        state = state + dt / 6 * (one + 2 * two + 2 * three + slope(state + dt * three))
    noisy = np.array(path) + 0.02 * np.random.default_rng(seed).normal(size=(rows, 2))
    return noisy, dt * np.arange(rows)


def test_intervals_hold_parameters_of_the_model():
    runs = [oscillator(seed) for seed in range(5)]
    fitted = ff.Parameters({"mu": 1.0, "k": {"initial": 0.8, "bounds": [0.1, 5.0]}}, known=KNOWN)
    fitted.fit([x for x, _ in runs], [t for _, t in runs], **NAMES)
    values = {one["name"]: one for one in fitted.report_["parameters"]}
    for name, truth in (("mu", 1.2), ("k", 1.0)):
        low, high = values[name]["interval"]
        assert low < values[name]["value"] < high and abs(values[name]["value"] - truth) < high - low < 0.1
    assert fitted.report_["converged"] and fitted.report_["segments"] == 5
    assert fitted.report_["held_out"]["over_persistence"] < 0.2


def test_arguments_reach_the_recipe():
    given = ff.Parameters({"k": 1.0}, method="equation-error", segment=20, compare=["x"], folds=0, search=300)._method_recipe()
    assert given == {
        "estimate": {"method": "equation-error", "segment": 20, "compare": "`x`", "folds": 0, "search": 300},
        "parameters": {"k": {"initial": 1.0}},
    }
    assert ff.Parameters()._method_recipe() == {}


def test_equation_error_is_pulled_by_noise_and_fixed_stays():
    x, t = oscillator(1)
    fitted = ff.Parameters({"mu": 1.0, "k": {"initial": 1.0, "fixed": True}}, known=KNOWN, method="equation-error", folds=0)
    fitted.fit(x, t, **NAMES)
    mu, k = fitted.report_["parameters"]
    assert k["value"] == 1.0 and k["fixed"] and abs(mu["value"] - 1.2) < 0.3


def test_filter_error_reports_gains():
    x, t = oscillator(1)
    fitted = ff.Parameters({"mu": 1.0, "k": 1.0}, known=KNOWN, method="filter-error", folds=0).fit(x, t, **NAMES)
    assert fitted.report_["method"] == "filter-error" and fitted.report_["converged"]
    for one, truth in zip(fitted.report_["parameters"], (1.2, 1.0)):
        low, high = one["interval"]
        assert low < high and abs(one["value"] - truth) < high - low < 0.2
    # The dynamics are exact: measurements are hardly believed.
    assert [gain["name"] for gain in fitted.report_["gains"]] == ["x", "v"]
    assert all(0.0 <= gain["value"] < 0.2 for gain in fitted.report_["gains"])
    assert np.allclose(np.sqrt(np.diag(fitted.report_["innovations"])), 0.02, rtol=0.2)


def test_state_without_equation_is_reported():
    x, t = oscillator(1)
    with pytest.raises(ff.exceptions.RequestError, match="known"):
        ff.Parameters({"mu": 1.0}, known={"x": "v"}).fit(x, t, **NAMES)


def test_matrices_stay_positive_definite():
    rng = np.random.default_rng(3)
    t = np.arange(0.0, 20.0, 0.05)
    force = np.column_stack([np.sign(np.sin(1.3 * t)), np.sign(np.cos(0.7 * t))])
    matrix = np.array([[1.0, 0.48], [0.48, 0.24]])
    v = np.vstack([np.zeros(2), np.cumsum(0.05 * force @ matrix, axis=0)[:-1]]) + 0.4 * rng.normal(size=(len(t), 2))
    data = ff.open({"v": v[:, 0], "w": v[:, 1], "f": force[:, 0], "g": force[:, 1]}, dt=0.05)
    known = {"v": "A*f + B*g", "w": "B*f + C*g"}
    start = {"A": 1.0, "B": 0.0, "C": 1.0}
    kept = {"mobility": {"matrix": [["A"], ["B", "C"]], "at_least": 0.03}}

    def fit(**more):
        report = ff.Parameters(start, known=known, states=["v", "w"], inputs=["f", "g"], folds=0, **more).fit(data).report_
        a, b, c = (one["value"] for one in report["parameters"])
        return np.linalg.eigvalsh([[a, b], [b, c]])[0], report

    free, plain = fit()
    bound, report = fit(constraints=kept)
    assert free < 0.03 <= bound < 0.03 + 1e-6
    (limit,) = report["limits"]
    assert limit["free_nearest"] == pytest.approx(free - 0.03, abs=1e-9) and limit["cuts"] == 1
    noise = [(one["deviation"], one["free_deviation"]) for one in report["noise"]]
    assert [one[1] for one in noise] == pytest.approx([one["deviation"] for one in plain["noise"]], rel=1e-9)
    assert np.prod([bounded / other for bounded, other in noise]) > 1.0
