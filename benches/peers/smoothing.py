"""scipy's cubic smoothing spline on the rows that the bench wrote: smoothing.py FOLDER LAMBDA|gcv.

Prints one JSON line: version, seconds by the clock and of the processor (best of three; of cross-validation, which takes long, one run). Values and slopes at the stamps go to FOLDER/found.f64.
"""

import json
import os
import pathlib
import sys
import time

for variable in ["OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"]:
    os.environ[variable] = "1"

import numpy as np
import scipy
from scipy.interpolate import make_smoothing_spline


def main():
    folder, asked = pathlib.Path(sys.argv[1]), sys.argv[2]
    times, values = (np.fromfile(folder / f"{name}.f64") for name in ["times", "values"])
    lam, repeats = (None, 1) if asked == "gcv" else (float(asked), 3)
    best = processor = float("inf")
    for _ in range(repeats):
        start, used = time.perf_counter(), time.process_time()
        spline = make_smoothing_spline(times, values, lam=lam)
        fitted = np.concatenate([spline(times), spline.derivative()(times)])
        best, processor = min(best, time.perf_counter() - start), min(processor, time.process_time() - used)
    fitted.tofile(folder / "found.f64")
    print(json.dumps({"version": scipy.__version__, "seconds": best, "processor": processor}))


main()
