"""What a fit needs beside its input, whatever the input is: the peak above what the process held with the arrays loaded.

    python memory.py [--rows 1000000] [--columns 50]

Rows lie in the order of C or of Fortran, as doubles, floats or integers, as every second value of an array, or sparse (one value in twenty). Each fit has a
process of its own, warmed up on a few rows.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy import sparse
from side_by_side import peak, resident

import fleetfoot as ff

INPUTS = ["C", "Fortran", "float32", "strided", "int64", "sparse"]

#: Estimators, and whether they take sparse rows.
FITS: dict[str, tuple[Callable[[], Any], bool]] = {
    "Lasso": (lambda: ff.Lasso(alpha=0.1), True),
    "LassoCV": (lambda: ff.LassoCV(cv=5, alphas=30), True),
    "LassoLarsCV": (lambda: ff.LassoLarsCV(cv=5), True),
    "STLSQ": (lambda: ff.STLSQ(threshold=0.1), False),
    "KMeans": (lambda: ff.KMeans(n_clusters=10, n_init=1, random_state=0), True),
    "PWARegressor": (lambda: ff.PWARegressor(n_regions=4), False),
}


def made(kind: str, rows: int, columns: int) -> Any:
    """Rows of one kind."""
    generator = np.random.default_rng(0)
    if kind == "sparse":
        return sparse.random(rows, columns, density=0.05, format="csr", random_state=generator)
    if kind == "int64":
        return generator.integers(-100, 100, (rows, columns))
    if kind == "strided":
        return generator.standard_normal((rows, 2 * columns))[:, ::2]
    values = generator.standard_normal((rows, columns))
    return {"C": values, "Fortran": np.asfortranarray(values), "float32": values.astype(np.float32)}[kind]


def run(name: str, kind: str, rows: int, columns: int) -> None:
    """The child: one fit."""
    X = made(kind, rows, columns)
    y = np.asarray(X[:, [0]].toarray() if kind == "sparse" else X[:, :1], dtype=float)[:, 0]
    y = y + np.random.default_rng(1).standard_normal(rows)
    estimator = FITS[name][0]
    warnings.simplefilter("ignore")
    estimator().fit(X[:2000], y[:2000])
    Path("/proc/self/clear_refs").write_text("5")
    before = resident()
    estimator().fit(X, y)
    print(max(0, peak() - before) / 2**20)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=1_000_000)
    parser.add_argument("--columns", type=int, default=50)
    parser.add_argument("--child", nargs=2, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.child:
        run(*arguments.child, arguments.rows, arguments.columns)
        return 0
    print(f"MiB beside {arguments.rows}x{arguments.columns} of input:\n")
    print(f"| estimator | {' | '.join(INPUTS)} |")
    print(f"|---|{'---:|' * len(INPUTS)}")
    size = ["--rows", str(arguments.rows), "--columns", str(arguments.columns)]
    for name, (_, takes_sparse) in FITS.items():
        cells = []
        for kind in INPUTS:
            if kind == "sparse" and not takes_sparse:
                cells.append("-")
                continue
            done = subprocess.run([sys.executable, __file__, "--child", name, kind, *size], capture_output=True, text=True)
            if done.returncode != 0:
                raise SystemExit(done.stderr)
            cells.append(f"{float(done.stdout):.0f}")
        print(f"| `{name}` | {' | '.join(cells)} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
