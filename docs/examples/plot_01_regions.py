"""
Where a running robot changes its dynamics
==========================================

A hexapod runs on a treadmill, simulated with its legs' contacts. k-means cuts its state space into ten regions, and each gets an affine model. On the plane of the two cranks' phases
the regions are stances: which feet are on the ground decides which equations hold.
"""

import os
from pathlib import Path

import matplotlib.pyplot as plt

import fleetfoot as ff

folder = Path(os.environ.get("FLEETFOOT_GALLERY", "gallery-data"))
runs = ff.generate("hexapod", folder / "hexapod", runs=5, seconds=8, speed=(0.2, 0.45), seed=1, force=True)
training, held_out = ff.open(runs.files[:4], recipe=runs.recipe), ff.open(runs.files[4:], recipe=runs.recipe)
model = ff.PWA(10, folds=0).fit(training).model_

figure, axes = plt.subplots(1, 2, figsize=(10, 4.4), layout="constrained")
ff.plot.region_map(model, held_out, "alpha_l", "alpha_r", ax=axes[0])
axes[0].set_title("which region holds")
ff.plot.region_map(model, held_out, "alpha_l", "alpha_r", value="score", ax=axes[1])
axes[1].set_title("where one step errs")
plt.show()
