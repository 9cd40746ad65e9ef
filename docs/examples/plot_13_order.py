"""
How many regions, which lags, which library
===========================================

A switched system of three affine modes. Numbers of regions, lags and degrees of the library are choices of one kind: each buys a smaller error with more coefficients. One fit tries all of them together, from one scan a partition: the error of
rows that did not train against the coefficients of a model, and the Bayesian information criterion, which says where more of them are no longer worth it.
"""

import matplotlib.pyplot as plt
import numpy as np

import fleetfoot as ff

random, rows = np.random.default_rng(3), 3000
u, y = random.uniform(-4, 4, rows), np.zeros(rows)
for k in range(rows - 1):
    if 4 * y[k] - u[k] + 10 < 0:
        step = -0.4 * y[k] + u[k] + 1.5
    elif 5 * y[k] + u[k] - 6 > 0:
        step = -0.3 * y[k] + 0.5 * u[k] - 1.7
    else:
        step = 0.5 * y[k] - u[k] - 0.5
    y[k + 1] = step + 0.1 * random.standard_normal()

# Orders up to two lags of either and degree 3, each with every partition.
narx = ff.NARX(2, 2, 3, order="auto", terms="all", select="bic", partition=["average", "refined:2..6"], partition_on=["y", "u"])
narx.fit(y[:, None], dt=1.0, u=u[:, None], feature_names=["y"], input_names=["u"])
tried = narx.report_["tried"]

# %%
# The front: models that no model of as few coefficients beats.
front = sorted((model for model in tried if model["front"]), key=lambda model: model["coefficients"])
chosen = next(model for model in tried if model["chosen"])
figure, (errors, criterion) = plt.subplots(1, 2, figsize=(10, 4.2), layout="constrained")
for degree in (1, 2, 3):
    models = [model for model in tried if model["order"]["degree"] == degree]
    for axes, value in ((errors, "loss"), (criterion, "bic")):
        axes.plot([model["coefficients"] for model in models], [model[value] for model in models], "o", ms=4, alpha=0.7, label=f"degree {degree}")
errors.plot([model["coefficients"] for model in front], [model["loss"] for model in front], color="0.4", lw=1, zorder=0, label="front")
errors.set(xscale="log", yscale="log", xlabel="coefficients", ylabel="squared error over variance, rows that did not train")
criterion.set(xscale="log", xlabel="coefficients", ylabel="BIC")
criterion.plot(chosen["coefficients"], chosen["bic"], "o", ms=11, mfc="none", color="k")
lags = "{lags_out} and {lags_in}".format(**chosen["order"])
criterion.annotate(f"{chosen['partition']}, lags {lags}, degree {chosen['order']['degree']}", (chosen["coefficients"], chosen["bic"]), (10, 12), textcoords="offset points")
errors.legend(frameon=False)
plt.show()
