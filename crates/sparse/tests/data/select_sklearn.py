"""Writes select_sklearn.txt beside itself: how scikit-learn chooses the penalty of small problems.

Each case: a line `case NAME N P K`, N rows of X and the target behind them, then its answers. K contiguous folds of equal size, held out in turn.

- `cv KIND L1_RATIO CHOSEN COUNT`, COUNT lines of an alpha and the mean squared error of every fold
- `ic KIND NOISE_VARIANCE CHOSEN COUNT`, COUNT lines of an alpha and the criterion

A last line `end`. Numbers are written so that they read back as the same f64. The first line names the versions.
"""

import pathlib
import warnings

import numpy as np
import sklearn
from sklearn.linear_model import ElasticNetCV, LassoCV, LassoLarsCV, LassoLarsIC
from sklearn.model_selection import KFold

warnings.filterwarnings("ignore")


def cases():
    random = np.random.default_rng(33)
    for name, n, p, k, share in [("few", 60, 5, 5, 0.0), ("correlated", 120, 12, 10, 1.0), ("many", 60, 25, 3, 0.3)]:
        x = random.normal(0, 1, (n, p)) + share * random.normal(0, 1, (n, 1))
        x = x * 10 ** random.uniform(-0.5, 0.5, p) + random.normal(0, 2, p)
        truth = np.where(np.arange(p) % 3 == 0, random.normal(0, 1, p), 0.0)
        yield name, x, x @ truth + random.normal(0, 1.5, n) + 3.0, k


def text(values):
    return " ".join(repr(float(value)) for value in values)


def cross_validated(x, y, k):
    folds = KFold(k)
    tight = {"tol": 1e-15, "max_iter": 2_000_000}
    largest = np.abs((x - x.mean(0)).T @ (y - y.mean())).max() / len(x)
    alphas = largest * np.logspace(0, -3, 25)
    lasso = LassoCV(alphas=alphas, cv=folds, **tight).fit(x, y)
    yield "LassoCV", 1.0, lasso.alpha_, lasso.alphas_, lasso.mse_path_
    for ratio in [0.9, 0.5]:
        net = ElasticNetCV(alphas=alphas, l1_ratio=ratio, cv=folds, **tight).fit(x, y)
        yield "ElasticNetCV", ratio, net.alpha_, net.alphas_, net.mse_path_
    path = LassoLarsCV(cv=folds, eps=1e-300, max_n_alphas=100_000, max_iter=100_000).fit(x, y)
    yield "LassoLarsCV", 1.0, path.alpha_, path.cv_alphas_, path.mse_path_


def main():
    lines = [f"scikit-learn {sklearn.__version__}, numpy {np.__version__}"]
    for name, x, y, k in cases():
        lines.append(f"case {name} {len(x)} {x.shape[1]} {k}")
        lines.extend(text([*row, target]) for row, target in zip(x, y))
        for kind, ratio, chosen, alphas, errors in cross_validated(x, y, k):
            lines.append(f"cv {kind} {text([ratio, chosen])} {len(alphas)}")
            lines.extend(text([alpha, *row]) for alpha, row in zip(alphas, errors))
        for criterion in ["aic", "bic"]:
            model = LassoLarsIC(criterion, eps=1e-300, max_iter=100_000).fit(x, y)
            lines.append(f"ic {criterion} {text([model.noise_variance_, model.alpha_])} {len(model.alphas_)}")
            lines.extend(text(pair) for pair in zip(model.alphas_, model.criterion_))
    lines.append("end")
    pathlib.Path(__file__).with_name("select_sklearn.txt").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
