"""pysindy on the recordings of the study: peer.py FOLDER.

FOLDER/request.toml lists the cases. Per case, raw little-endian doubles: `states.f64` (rows x states and inputs, episode after episode),
`derivatives.f64` (rows x states, where they are known), and `probe.f64` (probe rows x states and inputs) with `functions.f64` (probe rows x functions),
by which the columns of the peer's library are put into the study's order. Coefficients go to `coefficients.f64` (thresholds x states x functions). Prints the peer's version.
"""

import os
import pathlib
import sys
import tomllib
import warnings

for variable in ["OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"]:
    os.environ[variable] = "1"

import numpy as np
import pysindy
from pysindy.differentiation import FiniteDifference
from pysindy.feature_library import FourierLibrary, PolynomialLibrary
from pysindy.optimizers import STLSQ

warnings.filterwarnings("ignore")


def library(case):
    """The library of a case in the peer's terms."""
    trigonometric = FourierLibrary(n_frequencies=1)
    if case["degree"] == 0:
        return trigonometric
    polynomial = PolynomialLibrary(degree=case["degree"])
    return polynomial + trigonometric if case["trigonometric"] else polynomial


def order(case, folder):
    """For every function of the study, the column of the peer's library that has its values."""
    probe = np.fromfile(folder / "probe.f64").reshape(-1, case["states"] + case["inputs"])
    ours = np.fromfile(folder / "functions.f64").reshape(len(probe), -1)
    theirs = np.asarray(library(case).fit(probe).transform(probe))
    if theirs.shape != ours.shape:
        raise SystemExit(f"{folder.name}: {theirs.shape[1]} functions beside {ours.shape[1]}")
    apart = np.abs(ours[:, :, None] - theirs[:, None, :]).max(axis=0)
    columns = apart.argmin(axis=1)
    if len(set(columns)) != len(columns) or apart.min(axis=1).max() > 1e-9 * np.abs(ours).max():
        raise SystemExit(f"{folder.name}: the libraries differ")
    return columns


def fit(case, folder):
    """Coefficients of every threshold."""

    def episodes(file, columns):
        values = np.fromfile(folder / file).reshape(-1, columns)
        return np.split(values, np.cumsum(case["episodes"])[:-1])

    q = case["states"]
    columns = episodes("states.f64", q + case["inputs"])
    states = [episode[:, :q] for episode in columns]
    inputs = [episode[:, q:] for episode in columns] if case["inputs"] else None
    derivatives = episodes("derivatives.f64", q) if case["derivatives"] else None
    functions = order(case, folder)
    fits = []
    for threshold in case["thresholds"]:
        model = pysindy.SINDy(
            optimizer=STLSQ(threshold=threshold, alpha=case["ridge"]),
            feature_library=library(case),
            differentiation_method=FiniteDifference(order=2, drop_endpoints=True),
        )
        model.fit(states, t=case["period"], x_dot=derivatives, u=inputs)
        fits.append(model.coefficients()[:, functions])
    return np.array(fits)


def main():
    root = pathlib.Path(sys.argv[1])
    request = tomllib.loads((root / "request.toml").read_text())
    for case in request["cases"]:
        folder = root / case["folder"]
        np.ascontiguousarray(fit(case, folder), dtype="<f8").tofile(folder / "coefficients.f64")
    print(pysindy.__version__)


if __name__ == "__main__":
    main()
