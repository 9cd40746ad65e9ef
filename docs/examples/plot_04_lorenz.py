"""
Lorenz's equations from a noisy trajectory
==========================================

Twenty candidate functions for each of three equations; seven of the sixty are true. They are found from states with noise, and the model's own trajectory keeps to the attractor.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.integrate import solve_ivp

import fleetfoot as ff


def lorenz(_, x):
    return [10 * (x[1] - x[0]), x[0] * (28 - x[2]) - x[1], x[0] * x[1] - 8 / 3 * x[2]]


t = np.arange(0, 40, 0.002)
x = solve_ivp(lorenz, (0, 40), [-8, 8, 27], t_eval=t, rtol=1e-9, atol=1e-9).y.T
noisy = x + np.random.default_rng(1).normal(0, 0.02, x.shape)
sindy = ff.SINDy(library="poly(3)").fit(noisy, t, feature_names=["x", "y", "z"])
print("\n".join(sindy.equations(4)))

# %%
simulated = sindy.simulate(x[0], t)
figure = plt.figure(figsize=(9, 4.2), layout="constrained")
for place, (states, title) in enumerate(((noisy, "measured"), (simulated, "the model")), start=1):
    axes = figure.add_subplot(1, 2, place, projection="3d")
    axes.plot(*states.T, lw=0.4, color=f"C{place - 1}")
    axes.set(title=title, xlabel="x", ylabel="y", zlabel="z")
plt.show()
