"""From a robot's logs to a model, its picture and its code.

    python log_to_model.py [FOLDER]

A differential-drive robot drives for four minutes and logs MCAP (simulated: give your own logs and recipe in its place). What is in a log is looked at, two models
are fitted to five runs and compared on three others; the piecewise one is drawn, simulated, linearised and written in C.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import matplotlib
import numpy as np

import fleetfoot as ff

matplotlib.use("Agg")

# Which fields are what. The rows are the odometry's messages; the voltages hold from one message to the next.
RECIPE = {
    "columns": {"v": "/odom.twist.twist.linear.x", "w": "/odom.twist.twist.angular.z"},
    "states": {"v": {"unit": "m/s"}, "w": {"unit": "rad/s"}},
    "inputs": {"left": "/motor/voltage.data[0]", "right": "/motor/voltage.data[1]"},
}


def main(folder: Path) -> None:
    runs = ff.generate("diffdrive", folder / "runs", runs=8, seconds=30, seed=1, force=True)
    training, held_out = runs.files[:5], runs.files[5:]

    # What is in a log, and one of its topics as a table (Arrow: pandas, polars, duckdb and pyarrow take it as it is).
    for topic in ff.info(held_out[0])["topics"]:
        print(f"{topic['name']:16} {topic['messages']:6} messages of {topic['type']}")
    odometry = ff.read_mcap(held_out[0], "/odom")
    print(f"{len(odometry)} rows of {len(odometry.columns)} columns; {np.abs(odometry['twist.twist.linear.x']).max():.2f} m/s at most")

    # Two models: one affine map for all, and one for each of some regions of the state space.
    data = ff.open(training, recipe=RECIPE)
    one = ff.PWA(target="next").fit(data)
    several = ff.PWA(partition=[5, 10, 20], target="next").fit(data)
    print(f"{len(several.model_.regions)} regions were chosen")

    # Both on rows that trained neither, beside what costs nothing.
    comparison = ff.compare({"affine": one, "piecewise": several}, ff.open(held_out, recipe=RECIPE))
    print(comparison)

    model = several.model_
    ff.plot.region_map(model, held_out, "v", "w").figure.savefig(folder / "regions.png", dpi=120)
    rollout = model.rollout(held_out, horizon=50, starts=200)
    ff.plot.horizon(rollout, state="w", unit="rad/s").figure.savefig(folder / "horizon.png", dpi=120)

    # What a controller needs: a step, a linear model at a point, code.
    x, u = np.array([0.3, 0.0]), np.array([6.0, 6.0])
    A, B, c = model.linearize(x, u)
    print(f"at {x} under {u}: A = {np.round(A, 3).tolist()}, B = {np.round(B, 4).tolist()}; next {np.round(model.step(x, u), 4)}")
    model.save(folder / "model.json")
    model.export("c", folder / "c", prefix="robot")
    print("wrote", ", ".join(sorted(path.name for path in [*folder.glob("*.*"), *(folder / "c").iterdir()])))


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]))
    else:
        with tempfile.TemporaryDirectory() as temporary:
            main(Path(temporary))
