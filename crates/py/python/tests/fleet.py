"""Small logs of a plant that is known exactly, for the tests of statistics."""

from __future__ import annotations

from pathlib import Path

import numpy as np

#: Two equations that share the latent T: a = T - D, b = 2 T, with T = 3 + x - 0.5 x^2 and D = 0.7 v.
SHARED = """
[latents]
T = { of = ["x"], degree = 2 }
D = { functions = ["v", "v^2"] }
[tasks]
along = { target = "a", right = "T - D" }
normal = { target = "b", right = "2*T" }
[inputs]
x = "x"
v = "v"
[time]
column = "t"
"""

#: One equation, y from x and z.
PLAIN = {"model": {"predict": "y"}, "inputs": {"x": "x", "z": "z"}, "time": {"column": "t"}}


def run(rows: int, phase: float) -> dict[str, np.ndarray]:
    """A recording of the plant."""
    t = np.arange(rows) * 0.01
    x, v = np.sin(3.0 * t + phase), np.cos(1.7 * t + 2.0 * phase)
    thrust = 3.0 + x - 0.5 * x**2
    return {"t": t, "x": x, "v": v, "a": thrust - 0.7 * v, "b": 2.0 * thrust}


def noisy(rows: int, seed: int) -> dict[str, np.ndarray]:
    """Correlated regressors and a target with an error, for solvers."""
    random = np.random.default_rng(seed)
    x = random.normal(1.0, 2.0, rows)
    z = 0.6 * x + random.normal(-3.0, 0.5, rows)
    return {"t": np.arange(rows) * 0.1, "x": x, "z": z, "y": 2.0 + 3.0 * x - z + random.normal(0.0, 0.7, rows)}


def write(path: Path, columns: dict[str, np.ndarray], newline: str = "\n") -> Path:
    """A recording as CSV; numbers read back exactly."""
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    lines = [",".join(columns), *(",".join(map(repr, row)) for row in rows)]
    path.write_text(newline.join(lines) + newline, newline="")
    return path


def fleet(folder: Path, aircraft: int = 2, flights: int = 2) -> list[str]:
    """Logs of some aircraft, each in a folder of its own."""
    files = []
    for number in range(1, aircraft + 1):
        for flight in range(flights):
            rows, phase = 90 + 17 * flight + 5 * number, 10.0 * number + flight
            files.append(str(write(folder / str(number) / f"flight_{flight}.csv", run(rows, phase))))
    return files
