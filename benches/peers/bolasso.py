"""Bootstrap replicates of the lasso on the block matrix that the bench wrote: bolasso.py FOLDER NAME LAMBDA N P TASKS REPLICATES.

NAME is `rows` (LassoLars on every replicate's rows) or `gram` (weighted Grams by numpy, then lars_path_gram). Columns are divided by each replicate's own
scale. Prints one JSON line: version, seconds of all replicates. Coefficients go to FOLDER/coefficients.f64, a row a replicate. numpy uses all cores.
"""

import json
import pathlib
import sys
import time
import warnings

import numpy as np
import sklearn
from sklearn.linear_model import LassoLars, lars_path_gram

warnings.filterwarnings("ignore")


def main():
    folder, name, alpha = pathlib.Path(sys.argv[1]), sys.argv[2], float(sys.argv[3])
    n, p, tasks, replicates = map(int, sys.argv[4:8])
    b = np.fromfile(folder / "b.f64").reshape(p, n * tasks).T
    y = np.fromfile(folder / "y.f64")
    counts = np.fromfile(folder / "counts.f64").reshape(replicates, n)
    coefficients = np.zeros((replicates, p))
    total = 0.0
    for replicate in range(replicates):
        begin = time.perf_counter()
        weights = np.tile(counts[replicate], tasks)
        rows = int(counts[replicate].sum())
        if name == "rows":
            used = np.flatnonzero(weights)
            root = np.sqrt(weights[used])
            x = b[used] * root[:, None]
            scale = np.sqrt((x**2).sum(axis=0) / rows)
            x = np.asfortranarray(x / scale)
            # LassoLars divides by the number of rows that it is given.
            model = LassoLars(alpha=alpha * rows / len(used), fit_intercept=False, copy_X=False, max_iter=10_000, eps=np.finfo(float).eps)
            model.fit(x, y[used] * root)
            solution = model.coef_
        else:
            weighted = b * weights[:, None]
            gram, xy = b.T @ weighted, weighted.T @ y
            scale = np.sqrt(np.diag(gram) / rows)
            gram, xy = gram / scale / scale[:, None], xy / scale
            _, _, path = lars_path_gram(xy, gram, n_samples=rows, alpha_min=alpha, method="lasso", max_iter=10_000)
            solution = path[:, -1]
        total += time.perf_counter() - begin
        coefficients[replicate] = solution / scale
    coefficients.tofile(folder / "coefficients.f64")
    print(json.dumps({"version": sklearn.__version__, "seconds": total}))


if __name__ == "__main__":
    main()
