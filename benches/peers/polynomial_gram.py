"""The Gram matrix of all monomials of degree 0..D by numpy: the product alone on ready-made matrices, and with their evaluation.

Arguments: raw float64 columns (column-major), number of columns, degree, file for the Gram matrix. Prints one JSON value.
"""

import itertools
import json
import os
import resource
import sys
import time

import numpy as np

REPETITIONS = 9


def exponents(columns, degree):
    """Graded lexicographic order: 1, x, y, x^2, x*y, y^2, ..."""
    for total in range(degree + 1):
        for picks in itertools.combinations_with_replacement(range(columns), total):
            yield tuple(picks.count(k) for k in range(columns))


def evaluate(base, powers, out):
    """Each monomial is its parent times one column, written in place."""
    index = {power: i for i, power in enumerate(powers)}
    out[:, 0] = 1.0
    for i, power in enumerate(powers[1:], 1):
        last = max(k for k, e in enumerate(power) if e)
        parent = index[power[:last] + (power[last] - 1,) + power[last + 1 :]]
        np.multiply(out[:, parent], base[last], out=out[:, i])


def best(work):
    fastest, result = float("inf"), None
    for _ in range(REPETITIONS):
        start = time.perf_counter()
        result = work()
        fastest = min(fastest, time.perf_counter() - start)
    return fastest, result


def main():
    columns, degree = int(sys.argv[2]), int(sys.argv[3])
    base = np.fromfile(sys.argv[1]).reshape(columns, -1)
    powers = list(exponents(columns, degree))
    X = np.empty((base.shape[1], len(powers)), order="F")
    evaluate(base, powers, X)
    fortran, gram = best(lambda: X.T @ X)

    def both():
        evaluate(base, powers, X)
        return X.T @ X

    whole, _ = best(both)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    C = np.ascontiguousarray(X)
    del X
    c_order, _ = best(lambda: C.T @ C)
    gram.tofile(sys.argv[4])
    print(
        json.dumps(
            {
                "numpy": np.__version__,
                "threads": int(os.environ.get("OPENBLAS_NUM_THREADS", os.cpu_count())),
                "functions": len(powers),
                "fortran": fortran,
                "c": c_order,
                "whole": whole,
                "peak": peak,
            }
        )
    )


if __name__ == "__main__":
    main()
