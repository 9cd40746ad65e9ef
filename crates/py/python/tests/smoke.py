"""The wheel with numpy alone: it imports, fits, and says what it lacks. Run before anything else is installed."""

import importlib.util
import sys

import numpy as np

import fleetfoot as ff

for module in ("sklearn", "pandas", "matplotlib", "tqdm"):
    assert importlib.util.find_spec(module) is None, f"{module} is installed: this is to be run in an environment with numpy alone"

rng = np.random.default_rng(0)
X = rng.standard_normal((200, 5))
y = X @ [1.0, 0.0, -2.0, 0.0, 0.5] + 3.0

model = ff.LassoLars(alpha=1e-3).fit(X, y)
assert abs(model.predict(X) - y).max() < 0.02, "the lasso follows the data"

t = np.arange(0.0, 20.0, 0.01)
x = np.stack([np.cos(t), -np.sin(t)], axis=1)
pwa = ff.SINDy().fit([x], t=[t])
assert abs(np.abs(pwa.coefficients()).max() - 1.0) < 1e-2, pwa.equations()

try:
    ff.plot.path(model)
except ImportError as error:
    assert "matplotlib" in str(error)
else:
    sys.exit("a plot without matplotlib")
print(f"fleetfoot {ff.__version__} with numpy {np.__version__} alone: fine")
