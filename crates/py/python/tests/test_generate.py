"""Logs of simulated robots."""

from __future__ import annotations

import fleetfoot as ff
import numpy as np
import pytest


def test_runs_and_recipe(tmp_path):
    made = ff.generate("diffdrive", tmp_path / "a", runs=2, seconds=2.0, seed=3)
    assert [file.exists() for file in [*made.files, made.recipe]] == [True] * 3
    assert [run["end"] for run in made.runs] == ["complete"] * 2
    assert all(abs(run["seconds"] - 2.0) < 0.1 for run in made.runs)
    data = made.open()
    assert data.names == [str(file) for file in made.files] and "[states" in data.recipe
    rows = ff.read(data)
    assert len(set(rows["episode"])) == 2 and np.isfinite(rows[rows.columns[-1]]).any()
    again = ff.generate("diffdrive", tmp_path / "b", runs=2, seconds=2.0, seed=3)
    assert [a.read_bytes() == b.read_bytes() for a, b in zip(made.files, again.files)] == [True, True]
    other = ff.generate("diffdrive", tmp_path / "c", runs=1, minutes=2.0 / 60, seed=4)
    assert other.files[0].read_bytes() != made.files[0].read_bytes()


def test_worlds_are_changed_by_text_file_and_mapping(tmp_path):
    tomllib = pytest.importorskip("tomllib", reason="Python 3.10 reads no TOML")
    settings = tomllib.loads(ff.world("diffdrive"))
    key, value = next((key, value) for key, value in leaves(settings) if isinstance(value, float) and value > 0)
    path = key.split(".")
    nested = {path[-1]: value * 1.25}
    for step in reversed(path[:-1]):
        nested = {step: nested}
    line = f"{key} = {value * 1.25!r}\n"
    (tmp_path / "world.toml").write_text(line)
    worlds = [
        ff.world("diffdrive", one) for one in (nested, {key: np.float64(value * 1.25)}, line, tmp_path / "world.toml")
    ]
    assert all(dict(leaves(tomllib.loads(world)))[key] == value * 1.25 for world in worlds)


def leaves(table, prefix=""):
    for key, value in table.items():
        if isinstance(value, dict):
            yield from leaves(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def test_mistakes_are_named(tmp_path):
    with pytest.raises(ff.exceptions.RequestError, match="turtle"):
        ff.generate("turtle", tmp_path)
    with pytest.raises(ff.exceptions.RequestError, match="nothing"):
        ff.generate("diffdrive", tmp_path, world={"nothing": {"here": 1.0}})
    with pytest.raises(ff.exceptions.RequestError, match="csv"):
        ff.generate("diffdrive", tmp_path, format="csv")
    with pytest.raises(ValueError, match="minutes"):
        ff.generate("diffdrive", tmp_path, minutes=1.0, seconds=1.0)
    with pytest.raises(ValueError, match="runs"):
        ff.generate("diffdrive", tmp_path, runs=0)
    ff.generate("diffdrive", tmp_path / "twice", seconds=0.5)
    with pytest.raises(ff.exceptions.FleetfootError, match="force"):
        ff.generate("diffdrive", tmp_path / "twice", seconds=0.5)
    ff.generate("diffdrive", tmp_path / "twice", seconds=0.5, force=True)
