"""
Lift that nobody measured
=========================

Climbs of a simulated jet log motion, mass and air data. Thrust, drag, lift and specific impulse are unknown functions of four equations, each a sum of few candidates out of many. The lift that comes out beside
the one that the simulation used.
"""

import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import fleetfoot as ff

folder = Path(os.environ.get("FLEETFOOT_GALLERY", "gallery-data"))
world = {"turbulence.longitudinal": 0.02, "turbulence.normal": 0.02}
runs = ff.generate("aircraft", folder / "climbs", runs=24, seed=3, world=world, force=True)
fit = ff.BlockSparse(bolasso="episodes:200", threshold=0.9, recipe=runs.recipe).fit(runs.files)
lift = dict(zip(fit.get_feature_names("L"), fit.coefficients(latent="L"), strict=True))
print({name: round(float(value), 2) for name, value in lift.items() if value})

# %%
alpha = np.linspace(0.0, 0.12, 100)
figure, axes = plt.subplots(figsize=(7, 4.2), layout="constrained")
for mach, colour in ((0.4, "tab:blue"), (0.6, "tab:orange"), (0.78, "tab:green")):
    names = {"alpha": alpha, "M": mach, "q": 1.0, "np": np}
    estimate = sum(value * eval(name.replace("^", "**"), names) for name, value in lift.items())
    true = 25 + 559.7 * alpha + 301.8 * alpha * mach**2 + 18.95 * mach**3
    axes.plot(alpha, true * np.ones_like(alpha), color=colour, lw=5, alpha=0.3)
    axes.plot(alpha, estimate * np.ones_like(alpha), color=colour, label=f"Mach {mach}")
axes.set(xlabel="angle of attack [rad]", ylabel="lift over dynamic pressure [m²]", title="thin: found, wide: true (mean of the fleet)")
axes.legend(frameon=False)
plt.show()
