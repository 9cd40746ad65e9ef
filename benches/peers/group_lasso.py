"""adelie's group lasso on the rows and lambdas that the bench wrote: group_lasso.py FOLDER ROWS GROUP TOL THREADS.

Rows are FOLDER/columns.f64 by columns, the target last; lambdas FOLDER/lambdas.f64, descending; groups of GROUP neighbours, weights the roots of their sizes.
Prints one JSON line: version, seconds (best of two). Coefficients go to FOLDER/coefficients.f64, a row a lambda.
"""

import importlib.metadata
import json
import pathlib
import sys
import time
import warnings

import adelie as ad
import numpy as np

warnings.filterwarnings("ignore")


def main():
    folder, n, size, tolerance, threads = sys.argv[1:]
    folder, n, size, threads = pathlib.Path(folder), int(n), int(size), int(threads)
    columns = np.fromfile(folder / "columns.f64").reshape(-1, n)
    x, y = columns[:-1].T, columns[-1].copy()
    lambdas = np.fromfile(folder / "lambdas.f64")
    groups = np.arange(0, x.shape[1], size)

    def fit():
        return ad.grpnet(
            X=ad.matrix.dense(x, n_threads=threads),
            glm=ad.glm.gaussian(y=y),
            groups=groups,
            lmda_path=lambdas,
            tol=float(tolerance),
            early_exit=False,
            n_threads=threads,
            progress_bar=False,
        )

    seconds = []
    for _ in range(2):
        begin = time.perf_counter()
        state = fit()
        seconds.append(time.perf_counter() - begin)
    solutions = {float(lmda): np.asarray(beta) for lmda, beta in zip(state.lmdas, state.betas.toarray())}
    # Lambdas that it leaves out are those above where its path starts.
    coefficients = np.array([solutions.get(float(lmda), np.zeros(x.shape[1])) for lmda in lambdas])
    coefficients.tofile(folder / "coefficients.f64")
    version = importlib.metadata.version("adelie")
    print(json.dumps({"version": version, "seconds": min(seconds)}))


if __name__ == "__main__":
    main()
