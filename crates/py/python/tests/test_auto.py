"""``ff.auto``: a model of a table, the folder that it writes, and a warning where nothing can be learnt."""

from __future__ import annotations

import json

import numpy as np
import pytest

import fleetfoot as ff


def _table(rows: int = 500) -> dict[str, np.ndarray]:
    t = np.arange(rows) * 0.05
    u = np.sign(np.sin(0.9 * t) + np.sin(2.3 * t))
    v = np.zeros(rows)
    for k in range(rows - 1):
        v[k + 1] = 0.9 * v[k] + 0.2 * u[k]
    return {"t": t, "v": v, "u": u}


def test_a_table_gives_a_model_and_a_folder(tmp_path):
    result = ff.auto(ff.open(_table(), t="t"), effort="low", output=tmp_path / "model", export_c=True)
    assert result.warning is None
    assert len(result.sentences) == 5
    assert "Fitted" in repr(result)
    assert any("`u`" in note for note in result.notes)
    state = result.tested[0]
    assert state["rmse"][0] < 0.01 * state["persistence"]
    assert any(one["name"] == result.chosen for one in result.candidates)
    written = json.loads((tmp_path / "model" / "auto.json").read_text())
    assert written["chosen"] == result.chosen
    assert (tmp_path / "model" / "c" / "model.c").exists()
    again = ff.auto(ff.open(_table(), t="t"), recipe=result.recipe)
    assert again.model == result.model
    with pytest.raises(ff.exceptions.FleetfootError, match="force"):
        ff.auto(ff.open(_table(), t="t"), output=tmp_path / "model")


def test_names_choose_states_and_inputs():
    result = ff.auto(ff.open(_table(), t="t"), states=["v"], inputs=["u"], effort="low", horizon=7)
    assert result.horizon["steps"] == 7


def test_noise_is_reported():
    noise = np.random.default_rng(0).normal(size=(2, 400))
    table = {"t": np.arange(400) * 0.01, "a": noise[0], "b": noise[1]}
    with pytest.warns(UserWarning, match="no model has a held-out error below"):
        result = ff.auto(ff.open(table, t="t"), effort="low")
    assert result.warning.startswith("no model has a held-out error below")
    assert str(result).startswith("WARNING")
