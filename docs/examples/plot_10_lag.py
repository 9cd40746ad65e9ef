"""
A lag inside a function
=======================

A motor's force follows its command with a lag of 70 ms. The lag is a number inside a candidate function, and is estimated with its standard error, from logs of different length.
"""

import matplotlib.pyplot as plt
import numpy as np

import fleetfoot as ff

rng = np.random.default_rng(2)


def log(rows, dt=0.005):
    command = np.repeat(rng.uniform(-1, 1, rows // 40 + 1), 40)[:rows]
    force, rate = np.zeros(rows), np.zeros(rows)
    for k in range(rows - 1):
        force[k + 1] = command[k] + (force[k] - command[k]) * np.exp(-dt / 0.07)
        rate[k + 1] = rate[k] + dt * (-2 * rate[k] + 3 * (force[k] + force[k + 1]) / 2)
    slope = -2 * rate + 3 * force + rng.normal(0, 0.1, rows)
    return np.arange(rows) * dt, rate, slope, command


lengths, estimates, errors = [500, 1000, 2000, 4000, 8000, 16000], [], []
for rows in lengths:
    t, rate, slope, command = log(rows)
    sindy = ff.SINDy(library=["identity", "lag1(u, tau)"], parameters={"tau": {"initial": 0.03, "bounds": [0.01, 0.3]}})
    sindy.fit(rate[:, None], t, x_dot=slope[:, None], u=command[:, None], feature_names=["w"], input_names=["u"])
    tau = sindy.report_["parameters"][0]
    estimates.append(tau["value"])
    errors.append(tau["standard_error"])

# %%
figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
axes.errorbar(lengths, 1e3 * np.array(estimates), yerr=2e3 * np.array(errors), fmt="o", capsize=4, label="found, two standard errors")
axes.axhline(70, color="0.6", ls="--", label="true")
axes.set(xscale="log", xlabel="rows of the log", ylabel="lag [ms]")
axes.legend(frameon=False)
plt.show()
