"""Writes many_sklearn.txt beside itself: what scikit-learn makes of hundreds of small, mostly degenerate problems.

Each case: a line `case NAME N P INTERCEPT`, N rows of X and the target behind them, then its answers: a line `answer KIND UNIQUE ALPHA L1_RATIO` and a line of P
coefficients; `path COUNT` with COUNT lines `ALPHA UNIQUE COEFFICIENTS...` for lars_path_gram; a last line `end`.

UNIQUE is 1 where the minimiser is: the columns at their bound are independent (singular values of the unit columns above 0.05 of the largest: clearly so). Answers of the peer that violate the
optimality conditions by more than 1e-12 of the target's and the column's length are left out (its LARS loses its way on many degenerate problems), and counted in the
first line, with the versions.
"""

import pathlib
import warnings

import numpy as np
import sklearn
from sklearn.linear_model import ElasticNet, Lasso, LassoLars, lars_path_gram

warnings.filterwarnings("ignore")
COUNTS = {"kept": 0, "wrong": 0}


def short(x, digits=4):
    """Few digits, so that the file stays small."""
    return np.vectorize(lambda v: float(f"{v:.{digits}g}"))(np.asarray(x, dtype=float))


def degenerate(kind, random):
    n, p = int(random.integers(3, 12)), int(random.integers(2, 9))
    x = short(random.normal(0, 1, (n, p)))
    truth = np.where(random.random(p) < 0.4, random.normal(0, 2, p), 0.0)
    y = short(x @ truth + 0.3 * random.normal(0, 1, n) + 1.0)
    if kind == "duplicated":
        x[:, -1] = x[:, 0]
    elif kind == "negated":
        x[:, -1] = -x[:, 0]
    elif kind == "collinear":
        x[:, -1] = x[:, 0] + (x[:, 1] if p > 2 else 0) * 2
    elif kind == "constant":
        x[:, 0] = 3.25
    elif kind == "zero":
        x[:, -1] = 0.0
    elif kind == "scales":
        x *= 10.0 ** random.integers(-6, 7, p)
        x = short(x)
    elif kind == "huge_target":
        y *= 1e12
    elif kind == "tiny_target":
        y *= 1e-12
    elif kind == "ties":
        x, y = random.integers(-1, 2, (n, p)).astype(float), random.integers(-2, 3, n).astype(float)
    elif kind == "signs":
        x, y = random.choice([-1.0, 1.0], (n, p)), random.choice([-1.0, 1.0, 2.0], n)
    elif kind == "wide":
        p = n + int(random.integers(1, 8))
        x = short(random.normal(0, 1, (n, p)))
        y = short(x[:, 0] - 2 * x[:, 1] + 0.1 * random.normal(0, 1, n))
    elif kind == "exact":
        x = random.integers(-3, 4, (n, p)).astype(float)
        y = x @ np.where(random.random(p) < 0.5, random.integers(-2, 3, p), 0).astype(float)
    elif kind == "one_row":
        x, y = x[:1], y[:1]
    elif kind == "two_rows":
        x, y = x[:2], y[:2]
    elif kind == "constant_target":
        y[:] = 2.5
    elif kind == "offsets":
        x = x + 1000.0
    return x, y


KINDS = """random duplicated negated collinear constant zero scales huge_target tiny_target ties signs wide exact one_row two_rows constant_target
offsets""".split()


def cases():
    for seed in range(20):
        for kind in KINDS:
            random = np.random.default_rng([seed, KINDS.index(kind)])
            x, y = degenerate(kind, random)
            yield f"{kind}{seed}", x, y, bool(seed % 2) or kind == "constant_target"
    # The tests of scikit-learn that grew out of issue 9603 and its like: a column that drops at a tie, singular and ill-conditioned designs.
    yield "jitter", np.array([[0.0, 0, 0, -1, 0], [0, -1, 0, 0, 0]]), np.array([-2.5, -2.5]), False
    yield "singular", np.array([[1.0, 1.0], [1.0, 1.0]]), np.array([1.0, 1.0]), False
    yield "ill_conditioned", np.array([[1e20, 1e20, 0], [-1e-32, 0, 0], [1, 1, 1]]), np.array([10.0, 10.0, 1.0]), False
    random = np.random.default_rng(42)
    x = short(random.normal(0, 1, (10, 14)))
    x[:, 7:] = x[:, :7] + short(1e-5 * random.normal(0, 1, (10, 7)))
    yield "near_copies", x, short(x[:, :3] @ [1.0, -2.0, 0.5]), True


def judged(x, y, alpha, ratio, coefficients):
    """The largest violation, as a correlation, and whether the minimiser is unique, for centred or plain x and y."""
    n, length, size = len(y), np.linalg.norm(x, axis=0), np.linalg.norm(y)
    used = length > 1e-13 * np.abs(x).max(initial=0)
    scale = np.where(used, length * (size if size > 0 else 1.0), 1.0)
    gradient = x.T @ (y - x @ coefficients) - n * alpha * (1 - ratio) * coefficients
    limit = n * alpha * ratio
    violation = np.where(coefficients != 0, np.abs(gradient - limit * np.sign(coefficients)), np.maximum(np.abs(gradient) - limit, 0))
    bound = used & ((np.abs(gradient) >= limit - 1e-7 * scale) | (coefficients != 0))
    columns = (x / np.where(used, length, 1.0))[:, bound]
    singular = np.linalg.svd(columns, compute_uv=False) if bound.any() else np.array([1.0])
    independent = bound.sum() <= len(y) and singular.min() > 0.05 * singular.max()
    return np.where(used, violation / scale, 0).max(initial=0), bool(independent or ratio < 1)


def kept(x, y, alpha, ratio, coefficients):
    violation, unique = judged(x, y, alpha, ratio, coefficients)
    good = np.isfinite(coefficients).all() and violation < 1e-12
    COUNTS["kept" if good else "wrong"] += 1
    return (int(unique),) if good else None


def answers(x, y, intercept, lines):
    n = len(y)
    centred, target = (x - x.mean(0), y - y.mean()) if intercept else (x, y)
    largest = np.abs(centred.T @ target).max() / n
    if largest <= 1e-12 * np.abs(x).max() * np.abs(y).max():
        largest = 1.0
    fits = []
    for share in [0.5, 0.03]:
        alpha = share * largest
        fits.append(("LassoLars", alpha, 1.0, LassoLars(alpha, fit_intercept=intercept)))
        fits.append(("Lasso", alpha, 1.0, Lasso(alpha, fit_intercept=intercept, tol=1e-16, max_iter=100_000)))
        fits.append(("ElasticNet", alpha, 0.5, ElasticNet(alpha, l1_ratio=0.5, fit_intercept=intercept, tol=1e-16, max_iter=100_000)))
    for kind, alpha, ratio, model in fits:
        coefficients = model.fit(x, y).coef_
        flag = kept(centred, target, alpha, ratio, coefficients)
        if flag:
            lines.append(f"answer {kind} {flag[0]} {float(alpha)!r} {ratio}")
            lines.append(text(coefficients))
    try:
        alphas, _, path = lars_path_gram(centred.T @ target, centred.T @ centred, n_samples=n, method="lasso")
    except Exception:
        return
    good = [(alpha, kept(centred, target, alpha, 1.0, b), b) for alpha, b in zip(alphas, path.T) if alpha > 1e-6 * largest]
    good = [(alpha, flag[0], b) for alpha, flag, b in good if flag]
    lines.append(f"path {len(good)}")
    lines.extend(f"{float(alpha)!r} {unique} {text(b)}" for alpha, unique, b in good)


def text(values):
    return " ".join(repr(float(value)) if value != 0 else "0" for value in values)


def main():
    lines, count = [], 0
    for name, x, y, intercept in cases():
        lines.append(f"case {name} {len(x)} {x.shape[1]} {int(intercept)}")
        lines.extend(text([*row, target]) for row, target in zip(x, y))
        answers(x, y, intercept, lines)
        count += 1
    lines.append("end")
    versions = f"scikit-learn {sklearn.__version__}, numpy {np.__version__}"
    head = f"{versions}; {count} problems, {COUNTS['kept']} answers, {COUNTS['wrong']} left out because they are not minimisers"
    pathlib.Path(__file__).with_name("many_sklearn.txt").write_text("\n".join([head, *lines]) + "\n")


if __name__ == "__main__":
    main()
