"""
A phase portrait of a model
===========================

A model is a function: evaluated on a grid it shows where a machine goes. Van der Pol's oscillator, identified from one run, with the limit cycle that it was made to find.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.integrate import solve_ivp

import fleetfoot as ff

t = np.arange(0, 25, 0.01)
x = solve_ivp(lambda _, x: [x[1], 1.5 * (1 - x[0] ** 2) * x[1] - x[0]], (0, 25), [0.1, 0.2], t_eval=t, rtol=1e-9).y.T
sindy = ff.SINDy(library="poly(3)").fit(x, t, feature_names=["q", "v"])
print("\n".join(sindy.equations(3)))

# %%
q, v = np.meshgrid(np.linspace(-3, 3, 40), np.linspace(-4, 4, 40))
slope = sindy.model_.derivative(np.column_stack([q.ravel(), v.ravel()]))
figure, axes = plt.subplots(figsize=(6, 4.6), layout="constrained")
axes.streamplot(q, v, slope[:, 0].reshape(q.shape), slope[:, 1].reshape(q.shape), color="0.7", linewidth=0.7, density=1.4)
for start in ([2.8, 3.0], [-0.3, 0.1]):
    axes.plot(*sindy.simulate(np.array(start), np.arange(0, 12, 0.02)).T, lw=1.8)
axes.set(xlabel="q", ylabel="v", xlim=(-3, 3), ylim=(-4, 4))
plt.show()
