"""The worked example runs, and shows what it says."""

import runpy
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).parents[2] / "examples" / "log_to_model.py"


@pytest.mark.filterwarnings("ignore::fleetfoot.FleetfootWarning")
def test_from_log_to_model(tmp_path, capsys):
    pytest.importorskip("matplotlib", reason="the example draws")
    runpy.run_path(str(EXAMPLE))["main"](tmp_path)
    printed = capsys.readouterr().out
    assert "/odom" in printed and "piecewise" in printed and "±" in printed
    for name in ("model.json", "regions.png", "horizon.png", "c/robot.c", "c/robot.h"):
        assert (tmp_path / name).stat().st_size > 500, name
