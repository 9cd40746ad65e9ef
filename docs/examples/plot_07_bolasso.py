"""
What many resamples agree on
============================

The lasso takes neighbours along: columns that resemble a true one. Fitted to 128 resamples, it takes other neighbours each time, and the true ones always.
"""

import matplotlib.pyplot as plt
import numpy as np

import fleetfoot as ff

rng = np.random.default_rng(4)
speed, rate = rng.uniform(0.2, 1.0, 2000), rng.normal(0, 1, 2000)
candidates = {
    "v": speed, "v²": speed**2, "v³": speed**3, "w": rate, "w²": rate**2, "w³": rate**3,
    "v w": speed * rate, "v² w": speed**2 * rate, "v w²": speed * rate**2, "|w|": abs(rate), "v |w|": speed * abs(rate),
}  # fmt: skip
X = np.column_stack(list(candidates.values()))
y = 2.0 * speed**2 - 0.8 * rate + 0.5 * speed * rate**2 + rng.normal(0, 0.3, 2000)
bolasso = ff.Bolasso(n_estimators=128, random_state=0).fit(X / X.std(axis=0), y)

figure, axes = plt.subplots(figsize=(7, 4.2), layout="constrained")
ff.plot.selection_frequency(bolasso, feature_names=list(candidates), ax=axes)
plt.show()
