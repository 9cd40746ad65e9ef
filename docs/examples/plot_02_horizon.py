"""
How far ahead a model can be trusted
====================================

Three models of the same robot are simulated from hundreds of measured states of a run that did not train, and their errors drawn over the time since the start. More regions are better for
the first steps, and worse later.
"""

import os
from pathlib import Path

import matplotlib.pyplot as plt

import fleetfoot as ff

folder = Path(os.environ.get("FLEETFOOT_GALLERY", "gallery-data"))
runs = ff.generate("hexapod", folder / "hexapod", runs=5, seconds=8, speed=(0.2, 0.45), seed=1, force=True)
training, held_out = ff.open(runs.files[:4], recipe=runs.recipe), ff.open(runs.files[4:], recipe=runs.recipe)

figure, axes = plt.subplots(figsize=(7, 4.2), layout="constrained")
for partition, colour in (("average", "tab:blue"), (10, "tab:orange"), (30, "tab:green")):
    model = ff.PWA(partition, folds=0).fit(training).model_
    rollout = model.rollout(held_out, horizon=120, starts=200)
    score = [step[0] for step in rollout["model"]["mahalanobis"]]
    name = "one region" if partition == "average" else f"{partition} regions"
    axes.plot(rollout["time"], score, color=colour, lw=2, label=name)
for name, baseline in rollout["baselines"].items():
    axes.plot(rollout["time"], [step[0] for step in baseline["mahalanobis"]], ls="--", lw=1.2, label=name)
axes.set(xlabel="time since the start [s]", ylabel="Mahalanobis score [1]", yscale="log")
axes.legend(frameon=False, ncols=2)
plt.show()
