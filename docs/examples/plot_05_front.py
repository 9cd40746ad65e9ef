"""
How many terms?
===============

For every number of terms the best model, and its error on rows that did not train. A pendulum in air needs three terms; what comes after them buys nothing, and the smallest model within one standard
error of the best is taken.
"""

import matplotlib.pyplot as plt
import numpy as np

import fleetfoot as ff

dt, rng = 0.01, np.random.default_rng(3)
t = np.arange(0, 60, dt)
u = 4 * np.sin(1.7 * t) + 3 * np.cos(0.61 * t * np.sqrt(t + 1))
q, v = np.zeros_like(t), np.zeros_like(t)
for k in range(len(t) - 1):
    q[k + 1], v[k + 1] = q[k], v[k]
    for _ in range(20):
        v[k + 1] += dt / 20 * (-9.81 * np.sin(q[k + 1]) - 0.3 * v[k + 1] * abs(v[k + 1]) + u[k])
        q[k + 1] += dt / 20 * v[k + 1]
states = np.column_stack([q, v]) + rng.normal(0, 1e-4, (len(t), 2))
sindy = ff.SINDy(library=["poly(2)", "sin(q)", "v*abs(v)"], front=True)
sindy.fit(states, t, u=u[:, None], feature_names=["q", "v"], input_names=["u"])
print("\n".join(sindy.equations(4)))

# %%
terms = sorted(sindy.front_)
test = states[4000:], t[4000:], u[4000:, None]
error = []
for count in terms:
    report = sindy.front_[count].score(test[0], test[1], u=test[2])
    error.append(report["targets"][-1]["rmse"])
figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
axes.semilogy(terms, error, "o-")
axes.set(xlabel="terms that an equation has at most", ylabel="error of d(v)/dt, one step [rad/s²]")
axes.axvline(3, color="0.6", ls="--", lw=1)
axes.text(3.1, max(error) * 0.6, "gravity, drive, drag")
plt.show()
