"""Cross-validated lasso of the peers on the rows that the bench wrote: lasso_cv.py FOLDER NAME ROWS.

NAME is `LassoLarsCV` or `LassoCV` (scikit-learn, ten contiguous folds, all cores) or `adelie` (its single path, no cross-validation). Prints one JSON
line: version, seconds, alpha. Coefficients at alpha go to FOLDER/coefficients.f64; alphas and mean held-out errors of `LassoLarsCV` to
FOLDER/alphas.f64 and FOLDER/errors.f64.
"""

import importlib.metadata
import json
import pathlib
import sys
import time
import warnings

import numpy as np

warnings.filterwarnings("ignore")


def scikit_learn(name, x, y):
    from sklearn.linear_model import LassoCV, LassoLarsCV

    models = {
        "LassoLarsCV": LassoLarsCV(cv=10, n_jobs=2, max_iter=100_000),
        "LassoCV": LassoCV(cv=10, n_jobs=2, precompute=True, max_iter=100_000, tol=1e-8),
    }
    begin = time.perf_counter()
    model = models[name].fit(x, y)
    seconds = time.perf_counter() - begin
    return seconds, model


def adelie(x, y):
    import adelie as ad

    seconds = []
    for _ in range(2):
        begin = time.perf_counter()
        state = ad.grpnet(X=ad.matrix.dense(x, n_threads=2), glm=ad.glm.gaussian(y=y), n_threads=2, progress_bar=False)
        seconds.append(time.perf_counter() - begin)
    return min(seconds), state


def main():
    folder, name, n = pathlib.Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])
    columns = np.fromfile(folder / "columns.f64").reshape(-1, n)
    x, y = columns[:-1].T, columns[-1].copy()
    if name == "adelie":
        seconds, state = adelie(x, y)
        k = len(state.lmdas) // 2
        alpha, coefficients = float(state.lmdas[k]), state.betas[k].toarray().ravel()
        version = importlib.metadata.version("adelie")
    else:
        seconds, model = scikit_learn(name, x, y)
        alpha, coefficients = float(model.alpha_), model.coef_
        version = importlib.metadata.version("scikit-learn")
        if name == "LassoLarsCV":
            np.asarray(model.cv_alphas_).tofile(folder / "alphas.f64")
            np.asarray(model.mse_path_).mean(1).tofile(folder / "errors.f64")
    np.asarray(coefficients, dtype=np.float64).tofile(folder / "coefficients.f64")
    print(json.dumps({"version": version, "seconds": seconds, "alpha": alpha}))


if __name__ == "__main__":
    main()
