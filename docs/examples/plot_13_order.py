"""
How many regions, which lags, which library
===========================================

A switched system of three affine modes. Numbers of regions, lags and degrees of the library are choices of one kind: each buys a smaller error with more numbers. All of them stand on one front, the error of rows
that did not train against the numbers of a model, and the Bayesian information criterion says where more numbers are no longer worth it.
"""

import math

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

found = []
for degree in (1, 2, 3):
    for lags in (0, 1, 2):
        models = ff.PWA(["average", "refined:2..6"], target="next", degree=degree, lags=lags, partition_on=["y", "u"], folds=5)
        models.fit(y[:, None], dt=1.0, u=u[:, None], feature_names=["y"], input_names=["u"])
        # Monomials of y, u and their lags; the separators of the regions have numbers, too.
        terms = math.comb(2 * (lags + 1) + degree, degree)
        for candidate in models.report_["candidates"]:
            regions = candidate["regions"]
            numbers = regions * terms + (0 if regions == 1 else 3 * regions)
            found.append((numbers, candidate["loss"], candidate["bic"], degree, lags, regions))

# %%
# The front: models that no model of fewer numbers beats.
front = [own for own in sorted(found) if own[1] <= min(other[1] for other in found if other[0] <= own[0])]
best = min(found, key=lambda own: own[2])
figure, (errors, criterion) = plt.subplots(1, 2, figsize=(10, 4.2), layout="constrained")
for degree, colour in zip((1, 2, 3), ("C0", "C1", "C2"), strict=True):
    own = np.array([model for model in found if model[3] == degree])
    errors.loglog(own[:, 0], own[:, 1], "o", ms=4, color=colour, alpha=0.7, label=f"degree {degree}")
    criterion.semilogx(own[:, 0], own[:, 2], "o", ms=4, color=colour, alpha=0.7)
errors.loglog([own[0] for own in front], [own[1] for own in front], color="0.4", lw=1, zorder=0, label="front")
errors.set(xlabel="numbers of the model", ylabel="squared error of rows that did not train")
criterion.set(xlabel="numbers of the model", ylabel="BIC")
criterion.plot(best[0], best[2], "o", ms=11, mfc="none", color="k")
criterion.annotate(f"degree {best[3]}, {best[4]} lags, {best[5]} regions", (best[0], best[2]), (10, 12), textcoords="offset points")
errors.legend(frameon=False)
plt.show()
