"""Reports of models are dictionaries that print as tables."""

from __future__ import annotations

import json
import pickle

import numpy as np
import pytest

import fleetfoot as ff

T = np.arange(0, 10, 0.01)


@pytest.fixture(scope="module")
def model():
    x = np.column_stack([np.cos(2 * T), -2 * np.sin(2 * T)])
    return ff.PWA().fit(x, T, feature_names=["q", "v"]).model_


@pytest.fixture(scope="module")
def rows():
    return {"t": T, "q": np.cos(2 * T + 1.0), "v": -2 * np.sin(2 * T + 1.0)}


@pytest.mark.parametrize("kind", ["score", "rollout", "filter"])
def test_a_report_is_a_dict_with_a_table(model, rows, kind):
    calls = {
        "score": lambda: model.score(rows),
        "rollout": lambda: model.rollout(rows, 20, starts=10),
        "filter": lambda: model.filter(rows, measured={"q": 0.05}),
    }
    report = calls[kind]()
    assert isinstance(report, dict) and json.loads(json.dumps(report)) == dict(report)
    assert pickle.loads(pickle.dumps(report)) == report
    names = {"score": ["d(q)/dt", "d(v)/dt"], "rollout": ["q", "v"], "filter": ["q"]}[kind]
    assert [next(iter(row.values())) for row in report.table] == names
    lines = repr(report).splitlines()
    assert len(lines) == len(names) + 2 and lines[0].split()[0] in ("target", "state") and "{" not in lines[1]
    assert f"<td>{names[0]}</td>" in report._repr_html_()
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    assert pandas.DataFrame(report.table).shape[0] == len(names)
    # A report without one of its parts is still shown.
    parts = type(report)(report)
    for name in list(report):
        parts.pop(name)
        assert repr(parts)
        assert parts._repr_html_() is None or parts
    if kind == "rollout":
        assert report.table[1]["rmse"] == report["model"]["rmse"][-1][1] and "10 rollouts of 20 steps" in lines[-1]
    if kind == "score":
        assert report.table[0]["mae"] == report["targets"][0]["mae"]["value"]
