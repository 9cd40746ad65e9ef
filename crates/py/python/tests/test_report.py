"""The page: its file, what it says first, and what is refused."""

from __future__ import annotations

import fleetfoot as ff
import numpy as np
import pytest

DT = 0.01


def run(amplitude):
    t = np.arange(0, 5, DT)
    rng = np.random.default_rng(int(100 * amplitude))
    x = amplitude * np.column_stack([np.cos(2 * t), -2 * np.sin(2 * t)])
    x += 1e-3 * rng.normal(size=x.shape)
    return {"q": x[:, 0], "<v>": x[:, 1]}


@pytest.fixture(scope="module")
def fitted():
    return ff.PWA().fit(ff.open([run(1.0), run(0.7)], recipe={"states": {"q": {}, "<v>": {}}, "time": {"dt": DT}}))


def test_a_page_of_a_model_on_data(fitted, tmp_path):
    page, figures = tmp_path / "page.html", tmp_path / "figures"
    report = ff.report(fitted, ff.open([run(0.5)], dt=DT), page, title="a & b", horizon=20, starts=10, svg=figures)
    text = page.read_text(encoding="utf-8")
    assert text.startswith("<!DOCTYPE html>") and "<script" not in text and "<v>" not in text
    assert "<title>a &amp; b</title>" in text and "&lt;v&gt;" in text
    assert {finding["light"] for finding in report["findings"]} <= {"good", "doubtful", "bad", "fact"}
    assert report["episodes"] == 1 and report["in_sample_episodes"] == []
    assert (figures / "score-by-horizon.svg").read_text(encoding="utf-8").startswith("<svg")


def test_models_by_name_and_without_data(fitted, tmp_path):
    page = tmp_path / "page.html"
    report = ff.report({"one": fitted.model_, "other": fitted}, path=page)
    assert report["title"] == "one and other" and report["episodes"] == 0
    assert "No log was given" in page.read_text(encoding="utf-8")


def test_objects_without_model_are_refused(tmp_path):
    with pytest.raises(TypeError, match="no model"):
        ff.report(3, path=tmp_path / "page.html")
    with pytest.raises(ValueError, match="at least one"):
        ff.report({}, path=tmp_path / "page.html")
    assert not list(tmp_path.iterdir())
