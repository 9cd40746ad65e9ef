"""
A machine with hysteresis, simulated by its own model
=====================================================

A damper whose force depends on its past. The model sees the force at its start only; from then on it feeds on its own predictions.
"""

import matplotlib.pyplot as plt
import numpy as np

import fleetfoot as ff

dt = 0.002
t = np.arange(0, 9, dt)
velocity = 0.25 * (np.sin(2 * np.pi * 1.1 * t) + np.sin(2 * np.pi * 2.3 * t + 0.5) * np.cos(0.7 * t))
z, force = 0.0, np.zeros_like(t)
for k in range(len(t)):
    z += dt * (120 * velocity[k] - 60 * abs(velocity[k]) * z - 30 * velocity[k] * abs(z))
    force[k] = 30 * velocity[k] + 40 * z
train = slice(0, 3000)
narx = ff.NARX(lags_out=1, lags_in=2, degree=3, terms=12)
narx.fit(force[train, None], dt=dt, u=np.column_stack([velocity, np.sign(velocity)])[train], feature_names=["f"], input_names=["v", "s"])

held_out = slice(3000, 4500)
inputs = np.column_stack([velocity, np.sign(velocity)])[held_out]
history = (force[2998:3000, None], np.column_stack([velocity, np.sign(velocity)])[2998:3000])
simulated = narx.simulate(force[3000:3001], t[held_out] - t[3000], inputs, history=history)

# %%
figure, axes = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
axes[0].plot(t[held_out], force[held_out], color="0.6", lw=3, label="measured")
axes[0].plot(t[held_out], simulated[:, 0], lw=1.2, label="free run of 1,500 steps")
axes[0].set(xlabel="time [s]", ylabel="force [N]")
axes[0].legend(frameon=False)
axes[1].plot(velocity[held_out], force[held_out], color="0.6", lw=3)
axes[1].plot(velocity[held_out], simulated[:, 0], lw=1)
axes[1].set(xlabel="velocity [m/s]", ylabel="force [N]")
plt.show()
