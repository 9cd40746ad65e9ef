"""Writes paths_sklearn.txt beside itself: what scikit-learn makes of small problems.

Each case: a line `case NAME N P`, N rows of X and the target behind them, then its answers, each a line `answer KIND UNIQUE INTERCEPT PARAMETERS...`
followed by a line `alphas COUNT VALUES...` and COUNT lines of P coefficients; a last line `end`. UNIQUE is 1 where the minimiser is.
Numbers are written so that they read back as the same f64. The first line names the versions.
"""

import pathlib
import warnings

import numpy as np
import sklearn
from sklearn.linear_model import ElasticNet, Lasso, LassoLars, lars_path_gram

warnings.filterwarnings("ignore")


def cases():
    random = np.random.default_rng(9603)
    for k, (n, p) in enumerate([(20, 3), (30, 8), (50, 12), (80, 20), (25, 24)]):
        x = random.normal(0, 1, (n, p)) + [0.0, 0.6, 2.0, 0.3, 0.2][k] * random.normal(0, 1, (n, 1))
        x *= 10 ** random.uniform(-0.5, 0.5, p)
        y = x[:, ::3] @ random.normal(0, 1, len(range(0, p, 3))) + random.normal(0, 1, n) + 2.0
        yield f"random{k}", x, y, True
    x = random.normal(0, 1, (12, 20))
    yield "wide", x, x[:, 0] - 2 * x[:, 3] + 0.1 * random.normal(0, 1, 12), True
    # Strong correlations: columns leave and come back.
    x = random.normal(0, 1, (40, 1)) * np.linspace(1, 2, 9) + 0.3 * random.normal(0, 1, (40, 9))
    yield "returns", x, x @ [1, 0, 0, -2, 0, 1.5, 0, 0, 1] + 0.2 * random.normal(0, 1, 40), True
    # Few distinct values: ties, columns that enter and leave at one knot.
    for k in range(6):
        x = random.integers(-1, 2, (10 + k, 5 + k)).astype(float)
        yield f"integers{k}", x, random.integers(-2, 3, 10 + k).astype(float), False
    x = random.normal(0, 1, (30, 5))
    yield "duplicated", np.column_stack([x, x[:, 1], -x[:, 2]]), x @ [1, 2, -1, 0, 0] + random.normal(0, 1, 30), False


def lars_answers(x, y, unique):
    n = len(x)
    x = x - x.mean(0)
    y = y - y.mean()
    for method in ["lasso", "lar"]:
        if unique and len(x) > x.shape[1]:
            alphas, _, coefs = lars_path_gram(x.T @ y, x.T @ x, n_samples=n, method=method)
            # From the first change of sign on, plain LARS there turns the sign of the correlation too and leaves the equiangular path.
            if np.all(coefs[:, 1:] * coefs[:, :-1] >= 0) or method == "lasso":
                yield f"lars_path_gram_{method}", [], alphas, coefs.T


def answers(x, y, unique):
    yield from ((kind, unique, 1, more, alphas, coefs) for kind, more, alphas, coefs in lars_answers(x, y, unique))
    largest = np.abs((x - x.mean(0)).T @ (y - y.mean())).max() / len(x)
    alphas = largest * np.array([0.7, 0.2, 0.05, 0.01])
    options = {"tol": 1e-15, "max_iter": 2_000_000}
    for positive in [False, True]:
        for intercept in [True, False]:
            models = [Lasso(a, positive=positive, fit_intercept=intercept, **options).fit(x, y) for a in alphas]
            yield "Lasso", unique, intercept, [int(positive)], alphas, [model.coef_ for model in models]
    for ratio in [0.9, 0.3]:
        models = [ElasticNet(a, l1_ratio=ratio, **options).fit(x, y) for a in alphas]
        yield "ElasticNet", True, 1, [ratio], alphas, [model.coef_ for model in models]
    if unique:
        models = [LassoLars(a, eps=1e-300).fit(x, y) for a in alphas]
        yield "LassoLars", unique, 1, [], alphas, [model.coef_ for model in models]


def text(values):
    return " ".join(repr(float(value)) for value in values)


def main():
    lines = [f"scikit-learn {sklearn.__version__}, numpy {np.__version__}"]
    for name, x, y, unique in cases():
        lines.append(f"case {name} {len(x)} {x.shape[1]}")
        lines.extend(text([*row, target]) for row, target in zip(x, y))
        for kind, unique_here, intercept, more, alphas, coefs in answers(x, y, unique):
            lines.append(f"answer {kind} {int(unique_here)} {int(intercept)} {text(more)}".rstrip())
            lines.append(f"alphas {len(alphas)} {text(alphas)}")
            lines.extend(text(row) for row in coefs)
    lines.append("end")
    pathlib.Path(__file__).with_name("paths_sklearn.txt").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
