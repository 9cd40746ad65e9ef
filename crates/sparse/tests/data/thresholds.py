"""Writes thresholds.txt beside itself: what pysindy's optimisers make of small problems.

Each case: a line `case NAME N P CONSTANT`, N rows of the P columns (without the constant; CONSTANT 1: a column of ones stands before them) and the target behind
them, then its answers, each a line `answer KIND PARAMETERS...`, a line of coefficients (the constant's first), and for FROLS a line `err` with the error
reduction ratios in order of entry. A last line `end`. Numbers are written so that they read back as the same f64. The first line names the versions.

KIND and PARAMETERS (booleans are 0 or 1):
    stlsq threshold alpha normalize unbias max_iter
    guess threshold alpha COEFFICIENTS...          STLSQ from a first guess
    fixed threshold alpha COLUMNS...               STLSQ, columns never thresholded (the others are `sparse_ind`), unbias off
    sr3 lambda regularizer nu max_iter normalize unbias        regularizer 0, 1, 2
    ssr alpha residual kappa unbias normalize      kappa -1: none
    frols alpha kappa max_iter unbias normalize    kappa -1: none
"""

import pathlib
import warnings

import numpy as np
import pysindy
from pysindy.optimizers import FROLS, SR3, SSR, STLSQ

warnings.filterwarnings("ignore")


def lorenz(count):
    def rate(s):
        x, y, z = s
        return np.array([10 * (y - x), x * (28 - z) - y, x * y - 8 / 3 * z])

    state, states, step = np.array([-8.0, 8.0, 27.0]), [], 0.002
    for k in range(count * 40):
        if k % 40 == 0:
            states.append(state)
        a = rate(state)
        b = rate(state + step / 2 * a)
        c = rate(state + step / 2 * b)
        state = state + step / 6 * (a + 2 * b + 2 * c + rate(state + step * c))
    states = np.array(states)
    return states, np.array([rate(s) for s in states])


def cases():
    random = np.random.default_rng(2106)
    states, rates = lorenz(60)
    x, y, z = states.T
    columns = np.column_stack([x, y, z, x * x, x * y, x * z, y * y, y * z, z * z])
    for k, noise in enumerate([0.0, 0.02, 0.2]):
        target = rates[:, k]
        yield f"lorenz{k}", columns, target + noise * target.std() * random.normal(0, 1, 60), 1
    for k, (n, p) in enumerate([(30, 5), (45, 9), (60, 14)]):
        columns = random.normal(0, 1, (n, p)) * 10 ** random.uniform(-0.7, 0.7, p)
        truth = random.normal(0, 1, p) * (random.uniform(0, 1, p) < 0.5)
        yield f"random{k}", columns, columns @ truth + 0.3 * random.normal(0, 1, n), k % 2
    for k, near in enumerate([1e-2, 1e-4]):
        columns = random.normal(0, 1, (50, 6))
        columns[:, 4] = columns[:, 0] - columns[:, 1] + near * columns[:, 4]
        yield f"collinear{k}", columns, columns[:, 0] + 0.5 * columns[:, 3] + 0.05 * random.normal(0, 1, 50), 0


def stlsq(x, y):
    largest = np.abs(np.linalg.lstsq(x, y, rcond=None)[0]).max()
    for threshold in [0.0, 0.1, 0.03 * largest, 0.3 * largest, 2 * largest]:
        for alpha in [0.05, 0.0, 5.0]:
            for unbias in [True, False]:
                model = STLSQ(threshold=threshold, alpha=alpha, unbias=unbias).fit(x, y)
                yield "stlsq", [threshold, alpha, 0, unbias, 20], model.coef_[0]
    length = np.linalg.norm(y)
    for threshold in [0.01 * length, 0.1 * length]:
        for unbias, most in [(True, 20), (False, 20), (True, 1), (False, 2)]:
            options = {"normalize_columns": True, "unbias": unbias, "max_iter": most}
            model = STLSQ(threshold=threshold, alpha=0.05, **options).fit(x, y)
            yield "stlsq", [threshold, 0.05, 1, unbias, most], model.coef_[0]
    first = STLSQ(threshold=0.1, alpha=0.05, unbias=False, max_iter=1).fit(x, y).coef_
    for guess in [first, np.zeros_like(first), np.ones_like(first)]:
        model = STLSQ(threshold=0.1, alpha=0.05, initial_guess=guess.copy(), unbias=False).fit(x, y)
        yield "guess", [0.1, 0.05, *guess[0]], model.coef_[0]
    for fixed in [[0], [1, 3]]:
        others = [j for j in range(x.shape[1]) if j not in fixed]
        for threshold in [0.1, 0.3 * largest]:
            model = STLSQ(threshold=threshold, alpha=0.05, sparse_ind=others, unbias=False).fit(x, y)
            coefficients = np.zeros(x.shape[1])
            coefficients[others] = model.coef_[0]
            coefficients[fixed] = model.optvar_non_sparse_[0]
            yield "fixed", [threshold, 0.05, *fixed], coefficients


def sr3(x, y):
    for kind, name in enumerate(["L0", "L1", "L2"]):
        for weight, nu in [(0.005, 1.0), (0.1, 0.1), (0.02, 10.0)]:
            for most in [30, 1]:
                options = {"reg_weight_lam": weight, "regularizer": name, "relax_coeff_nu": nu, "max_iter": most}
                model = SR3(**options).fit(x, y)
                yield "sr3", [weight, kind, nu, most, 0, 0], model.coef_[0]
        model = SR3(reg_weight_lam=0.05, regularizer=name, max_iter=200, normalize_columns=True, unbias=True).fit(x, y)
        yield "sr3", [0.05, kind, 1.0, 200, 1, 1], model.coef_[0]


def ssr(x, y):
    for criteria in ["coefficient_value", "model_residual"]:
        for alpha in [0.05, 0.0]:
            for kappa in [None, 1e-3, 1.0]:
                for unbias, normalize in [(True, False), (False, False), (True, True)]:
                    options = {"alpha": alpha, "kappa": kappa, "unbias": unbias, "normalize_columns": normalize}
                    model = SSR(criteria=criteria, **options).fit(x, y)
                    errors = model.err_history_
                    # The peer's first entry of the history is overwritten by the last model: a choice of the full model is not comparable.
                    ratios = np.array(errors[1:]) / errors[:-1]
                    best = np.argmin(errors) if kappa is not None else len(ratios) - 1 - np.argmax(ratios[::-1])
                    if best > 0:
                        more = [alpha, criteria == "model_residual", -1 if kappa is None else kappa, unbias, normalize]
                        yield "ssr", more, model.coef_[0]


def frols(x, y):
    for alpha, kappa, most, unbias, normalize in [
        (0.05, None, 10, True, False),
        (0.05, None, 10, False, False),
        (0.0, None, 3, True, False),
        (0.5, None, 4, False, True),
        (0.05, 1e-3, 10, True, False),
        (0.05, 1e-6, 6, True, True),
    ]:
        options = {"alpha": alpha, "kappa": kappa, "max_iter": most, "unbias": unbias, "normalize_columns": normalize}
        model = FROLS(**options).fit(x, y)
        if model.ERR_global[: most + 1].min() < 1e-20 and not unbias:
            continue  # Rounding decides which model is chosen, and the ridge shows it.
        yield "frols", [alpha, -1 if kappa is None else kappa, most, unbias, normalize], model.coef_[0], model.ERR_global[:, 0]


def text(values):
    return " ".join(repr(float(value)) for value in values)


def main():
    lines = [f"pysindy {pysindy.__version__}, numpy {np.__version__}"]
    for name, x, y, constant in cases():
        n, p = x.shape
        lines.append(f"case {name} {n} {p} {constant}")
        lines += [text([*row, value]) for row, value in zip(x, y)]
        full = np.column_stack([np.ones(n), x]) if constant else x
        for method in [stlsq, sr3, ssr, frols]:
            for kind, more, coefficients, *err in method(full, y):
                lines.append(f"answer {kind} {text(more)}")
                lines.append(text(coefficients))
                lines += [f"err {text(values)}" for values in err]
    lines.append("end")
    pathlib.Path(__file__).with_suffix(".txt").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
