"""Draws the README's picture from the recording of an electro-mechanical positioning system.

    python docs/pictures/emps.py emps.csv

Left: what k-means on the speed finds, friction that changes its sign. Right: a free run of the model through the last fifth, which did not train.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib
import numpy as np

import fleetfoot as ff

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

HERE = Path(__file__).parent
#: The drive's gain, N/V.
GAIN = 35.15065188
RECIPE = {
    "columns": {"qd": "central(qm)"},
    "states": {"qm": {"known": "qd", "regressor": False}, "qd": {}},
    "inputs": {"vir": "vir"},
}
#: Ink, grey, and the two regions, on a light and on a dark page.
THEMES = {"light": ("#1f2328", "#c5cad1", "#0969da", "#bc4c00"), "dark": ("#e6edf3", "#3d444d", "#58a6ff", "#f0883e")}


def read(path: str) -> dict[str, np.ndarray]:
    t, qm, _, vir = np.loadtxt(path, delimiter=",", skiprows=1, unpack=True)
    return {"t": t, "qm": qm, "vir": vir}


def draw(log: dict[str, np.ndarray], theme: str) -> None:
    ink, grey, *colours = THEMES[theme]
    last = int(0.8 * len(log["t"]))
    parts = [{name: values[rows] for name, values in log.items()} for rows in (slice(0, last), slice(last, None))]
    train, test = (ff.open(part, t="t", recipe=RECIPE) for part in parts)
    model = ff.PWA(2, purge=0.1).fit(train).model_

    plt.rcParams.update({"font.size": 9, "svg.fonttype": "path", "svg.hashsalt": "fleetfoot"})
    for name in ("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color"):
        plt.rcParams[name] = ink
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 2.9), layout="constrained")
    for axes in (left, right):
        axes.patch.set_alpha(0)
        axes.spines[["top", "right"]].set_visible(False)

    speed = np.gradient(log["qm"], log["t"])
    smooth = np.convolve(speed, np.ones(25) / 25, mode="same")
    rate = np.gradient(smooth, log["t"])
    masses = [GAIN / model.coefficients(region=region)[-1][-1] for region in (0, 1)]
    left.plot(smooth[:last:6], (GAIN * log["vir"] - np.mean(masses) * rate)[:last:6], ".", ms=1.2, color=grey, rasterized=True)
    grid = np.linspace(smooth[:last].min(), smooth[:last].max(), 400)
    region = np.asarray(model.region(np.column_stack([np.zeros_like(grid), grid]), np.zeros((len(grid), 1))))
    for index, colour in zip((0, 1), colours, strict=True):
        speeds = grid[region == index]
        constant, *_, slope, gain = model.coefficients(region=index)[-1]
        left.plot(speeds, -GAIN * (constant + slope * speeds) / gain, color=colour, lw=2.2, label=f"region {index}: {masses[index]:.1f} kg")
    left.set(xlabel="speed [m/s]", ylabel="friction [N]", ylim=(-90, 90))
    left.legend(frameon=False, loc="upper left")
    left.set_title("two regions, found by k-means", fontsize=9)

    rows = slice(last + 400, last + 4400)
    t = log["t"][rows] - log["t"][rows.start]
    for start in range(0, 4000, 500):
        span = slice(rows.start + start, rows.start + start + 501)
        simulated = model.simulate([log["qm"][span.start], speed[span.start]], log["t"][span] - log["t"][span.start], log["vir"][span, None])
        right.plot(t[start] + log["t"][span] - log["t"][span.start], simulated[:, 0], color=colours[0], lw=1.6, zorder=3, label="model, runs of 500 ms" if not start else None)
    right.plot(t, log["qm"][rows], color=grey, lw=4, label="measured")
    right.set(xlabel="time [s]", ylabel="position [m]")
    right.legend(frameon=False, loc="upper right")
    right.set_title("the last fifth, which did not train", fontsize=9)
    figure.savefig(HERE / f"emps-{theme}.svg", transparent=True, dpi=150, metadata={"Date": None})
    plt.close(figure)


if __name__ == "__main__":
    for theme in THEMES:
        draw(read(sys.argv[1]), theme)
