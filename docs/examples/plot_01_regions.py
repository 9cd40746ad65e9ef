"""
Where a running robot changes its dynamics
==========================================

A hexapod runs on a treadmill, simulated with its legs' contacts. Its state space is cut into ten regions, and each gets an affine model: by k-means, which puts regions where rows are dense, and by refinement, which
puts them where one affine map fits. On the plane of the two cranks' phases the regions are stances: which feet are on the ground decides which equations hold.
"""

import os
from pathlib import Path

import matplotlib.pyplot as plt

import fleetfoot as ff

folder = Path(os.environ.get("FLEETFOOT_GALLERY", "gallery-data"))
runs = ff.generate("hexapod", folder / "hexapod", runs=5, seconds=8, speed=(0.2, 0.45), seed=1, force=True)
training, held_out = ff.open(runs.files[:4], recipe=runs.recipe), ff.open(runs.files[4:], recipe=runs.recipe)

figure, axes = plt.subplots(2, 2, figsize=(10, 8.6), layout="constrained")
for partition, (regions, errors) in zip(("kmeans:10", "refined:10"), axes.T, strict=True):
    model = ff.PWA(partition, folds=0).fit(training).model_
    ff.plot.region_map(model, held_out, "alpha_l", "alpha_r", ax=regions)
    regions.set_title(f"{partition}: which region holds")
    ff.plot.region_map(model, held_out, "alpha_l", "alpha_r", value="score", ax=errors)
    # One scale for both: what lies above is as bright.
    errors.images[0].set_clim(0, 4)
    errors.set_title(f"{partition}: where one step errs")
plt.show()
