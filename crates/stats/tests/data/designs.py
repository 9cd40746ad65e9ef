"""Writes designs.txt: least-squares problems of condition 1e2 to 1e12 with their solutions in 60-digit arithmetic.

    python3 designs.py > designs.txt        (needs numpy and mpmath)

Every number of X and Y is an IEEE double, printed so that it reads back exactly; the solution is that of the rounded problem.
The kinds: "spectrum" has geometrically spaced singular values, columns scaled by powers of two between 2^-40 and 2^40, and an offset
that the intercept takes; "powers" has the monomials of a positive variable, the shape of a polynomial library.
Beside the coefficients stand the terms of the error bound of Householder QR (Higham 2002, theorem 20.1), for the centred design A with
columns of unit length, x = coefficients in its units, r = residual: the condition of A, and per target |r| / (|A| |x|).
"""

import mpmath
import numpy as np

mpmath.mp.dps = 60
ROWS, TARGETS = 80, 2
RESIDUALS = (1e-9, 1e-2)


def spectrum(rng, condition, columns=6):
    u, _ = np.linalg.qr(rng.standard_normal((ROWS, columns)))
    v, _ = np.linalg.qr(rng.standard_normal((columns, columns)))
    x = (u * np.geomspace(1.0, 1.0 / condition, columns)) @ v.T
    x = x * np.sqrt(ROWS) + 0.5 * rng.standard_normal(columns)
    return x * 2.0 ** np.linspace(-40, 40, columns).round()


def powers(rng, columns):
    t = rng.uniform(0.2, 1.6, ROWS)
    return np.stack([t**k for k in range(1, columns + 1)], axis=1)


def exact(x, y):
    """Solution and terms of the bound, in 60 digits."""
    n, p = x.shape
    a = mpmath.matrix(x.tolist())
    b = mpmath.matrix(y.tolist())
    for m in (a, b):
        for j in range(m.cols):
            mean = mpmath.fsum(m[:, j]) / n
            for i in range(n):
                m[i, j] -= mean
    lengths = [mpmath.norm(a[:, j]) for j in range(p)]
    for j in range(p):
        for i in range(n):
            a[i, j] /= lengths[j]
    singular = mpmath.svd_r(a, compute_uv=False)
    # 60 digits leave 60 - 2 * 13 of the normal equations.
    solution = mpmath.lu_solve(a.T * a, a.T * b[:, 0]), mpmath.lu_solve(a.T * a, a.T * b[:, 1])
    ratios = [
        mpmath.norm(b[:, t] - a * solution[t]) / (singular[0] * mpmath.norm(solution[t])) for t in range(TARGETS)
    ]
    coefficients = [[solution[t][j] / lengths[j] for t in range(TARGETS)] for j in range(p)]
    return singular[0] / singular[p - 1], ratios, coefficients


def show(values):
    return " ".join(repr(float(value)) for value in values)


def main():
    rng = np.random.default_rng(20240607)
    print(f"# written by designs.py; mpmath {mpmath.__version__}, {mpmath.mp.dps} digits; numpy {np.__version__}")
    designs = [(f"spectrum-1e{e}", spectrum(rng, 10.0**e)) for e in (2, 4, 6, 8, 10, 12)]
    designs += [(f"powers-{k}", powers(rng, k)) for k in (3, 5, 8)]
    for name, x in designs:
        centred = x - x.mean(axis=0)
        signal = (centred / np.linalg.norm(centred, axis=0)) @ rng.standard_normal((x.shape[1], TARGETS))
        y = signal + np.array(RESIDUALS) * rng.standard_normal((ROWS, TARGETS)) + 0.3
        condition, ratios, coefficients = exact(x, y)
        print(f"design {name} {ROWS} {x.shape[1]} {TARGETS}")
        print("condition", show([condition]))
        print("ratios", show(ratios))
        for row in coefficients:
            print("beta", show(row))
        for row in np.hstack([x, y]):
            print("row", show(row))


main()
