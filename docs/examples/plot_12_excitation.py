"""
Which drive teaches most?
=========================

The same wheeled robot, driven for the same time by different commands. The log-determinant of what its log could tell an affine model says before any fit how good the coefficients will be.
"""

import os
from pathlib import Path

import matplotlib.pyplot as plt

import fleetfoot as ff

folder = Path(os.environ.get("FLEETFOOT_GALLERY", "gallery-data"))
kinds = ["multisine", "prbs", "random-walk", "random-steps", "ornstein-uhlenbeck", "pink"]
information = {}
for kind in kinds:
    made = ff.generate("diffdrive", folder / f"drive_{kind}", seconds=20, excitation=kind, seed=1, force=True)
    information[kind] = made.excitation["log_determinant"]

names = sorted(information, key=information.get)
figure, axes = plt.subplots(figsize=(7, 3.6), layout="constrained")
axes.barh([name.replace("-", " ") for name in names], [information[name] - min(information.values()) for name in names])
axes.set_xlabel("log-determinant of the regressors, a row, above that of the least")
plt.show()
