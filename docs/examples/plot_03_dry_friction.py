"""
Dry friction, found by k-means
==============================

A sled is pushed to and fro on a rail with dry and viscous friction. Nobody says so: k-means on the speed finds two regions, and each region's affine map has the friction of one direction.
"""

import matplotlib.pyplot as plt
import numpy as np

import fleetfoot as ff

mass, dry, viscous, dt = 2.0, 3.0, 4.0, 0.002
t = np.arange(0, 30, dt)
force = 14 * np.sin(2 * np.pi * 0.5 * t) + 8 * np.sin(2 * np.pi * 1.3 * t + 1)
speed = np.zeros_like(t)
for k in range(len(t) - 1):
    resistance = dry * np.tanh(speed[k] / 1e-3) + viscous * speed[k]
    speed[k + 1] = speed[k] + dt * (force[k] - resistance) / mass
measured = speed + np.random.default_rng(0).normal(0, 2e-4, len(t))

pwa = ff.PWA(2, partition_on=["v"]).fit(measured[:, None], t, u=force[:, None], feature_names=["v"], input_names=["F"])
pwa.print()

# %%
# What is left of the force when the sled's acceleration is taken away, and what the two maps say of it.

acceleration = np.gradient(measured, t)
figure, axes = plt.subplots(figsize=(7, 4.2), layout="constrained")
axes.plot(measured[::5], (force - mass * acceleration)[::5], ".", ms=2, color="0.7", label="force less mass times acceleration")
v = np.linspace(measured.min(), measured.max(), 400)
points = np.column_stack([v, np.zeros_like(v)])
region = np.asarray(pwa.model_.region(v[:, None], np.zeros((len(v), 1))))
for index in np.unique(region):
    speeds = v[region == index]
    constant, slope, gain = pwa.coefficients(region=int(index))[0]
    axes.plot(speeds, -(constant + slope * speeds) / gain, lw=2.5, label=f"region {index}: mass {1 / gain:.2f} kg")
axes.set(xlabel="speed [m/s]", ylabel="friction [N]")
axes.legend(frameon=False)
plt.show()
