"""Paths of scikit-learn on the moments that the bench wrote: lars.py FOLDER NAME N P.

NAME is `lars` (lars_path_gram, lasso) or `enet TOL` (enet_path on lambdas.f64 with the Gram matrix precomputed). Prints one JSON line: version,
seconds (best of three). Coefficients go to FOLDER/coefficients.f64, a row an alpha, and the alphas of `lars` to FOLDER/alphas.f64.
"""

import json
import os
import pathlib
import sys
import time
import warnings

for variable in ["OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"]:
    os.environ[variable] = "1"

import numpy as np
import sklearn
from sklearn.linear_model import enet_path, lars_path_gram

warnings.filterwarnings("ignore")
REPEATS = 3


def main():
    folder, name = pathlib.Path(sys.argv[1]), sys.argv[2]
    n, p = map(int, sys.argv[3:5])
    gram = np.fromfile(folder / "gram.f64").reshape(p, p)
    xy = np.fromfile(folder / "xy.f64")
    if name == "lars":

        def fit():
            alphas, _, coefficients = lars_path_gram(xy, gram, n_samples=n, method="lasso", max_iter=100_000)
            return alphas, coefficients
    else:
        x = np.asfortranarray(np.fromfile(folder / "rows.f64").reshape(n, p))
        y = np.fromfile(folder / "y.f64")
        lambdas = np.fromfile(folder / "lambdas.f64")
        tolerance = float(name.split()[1])

        def fit():
            alphas, coefficients, _ = enet_path(
                x, y, l1_ratio=1.0, alphas=lambdas, precompute=gram, Xy=xy, tol=tolerance, max_iter=100_000, check_input=False
            )
            return alphas, coefficients

    seconds = []
    for _ in range(REPEATS):
        begin = time.perf_counter()
        alphas, coefficients = fit()
        seconds.append(time.perf_counter() - begin)
    np.ascontiguousarray(coefficients.T, dtype=np.float64).tofile(folder / "coefficients.f64")
    np.asarray(alphas, dtype=np.float64).tofile(folder / "alphas.f64")
    print(json.dumps({"version": sklearn.__version__, "seconds": min(seconds)}))


if __name__ == "__main__":
    main()
