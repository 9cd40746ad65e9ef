"""
The path of the lasso
=====================

From one statistic of the rows comes the whole path over the penalty, knot by knot, each with a certificate that it is the optimum.
"""

import matplotlib.pyplot as plt
import numpy as np

import fleetfoot as ff

rng = np.random.default_rng(0)
names = [f"x{k}" for k in range(12)]
X = rng.normal(size=(400, 12)) @ (np.eye(12) + 0.35 * rng.normal(size=(12, 12)))
y = 3 * X[:, 0] - 2 * X[:, 3] + 1.2 * X[:, 7] + rng.normal(0, 2, 400)
path = ff.LassoLarsCV(cv=10).fit(X, y)

figure, axes = plt.subplots(figsize=(7, 4.2), layout="constrained")
ff.plot.path(path, feature_names=names, ax=axes)
axes.axvline(path.alpha_, color="black", lw=0.8, ls="--")
axes.set_title("dashed: chosen by cross-validation")
plt.show()
