"""One SINDy fit by pysindy: sindy.py rows.f64 states step degree threshold coefficients.f64

Rows are raw float64, one column after the other. Central differences, all monomials with the constant, STLSQ with pysindy's defaults but for the
threshold. Reading the file is not timed. Prints one line of JSON; writes the coefficients (states x columns) in the order of scikit-learn's
PolynomialFeatures, which is graded lexicographic.
"""

import json
import resource
import sys
import time

import numpy as np
import pysindy


def main():
    states, step, degree, threshold = int(sys.argv[2]), float(sys.argv[3]), int(sys.argv[4]), float(sys.argv[5])
    x = np.ascontiguousarray(np.fromfile(sys.argv[1]).reshape(states, -1).T)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    model = pysindy.SINDy(
        optimizer=pysindy.STLSQ(threshold=threshold),
        feature_library=pysindy.PolynomialLibrary(degree=degree),
        differentiation_method=pysindy.FiniteDifference(order=2),
    )
    begin = time.perf_counter()
    model.fit(x, t=step)
    seconds = time.perf_counter() - begin
    np.ascontiguousarray(model.coefficients()).astype(float).tofile(sys.argv[6])
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(json.dumps({"version": pysindy.__version__, "seconds": seconds, "peak_mib": peak, "before_mib": before}))


if __name__ == "__main__":
    main()
