"""Lloyd's k-means of a peer on the rows and the start that the bench wrote: kmeans.py FOLDER NAME N D K ITERATIONS.

NAME is sklearn64, sklearn32 or faiss32. Prints one JSON line: version, seconds (best of three), CPU seconds (mean of
the three), iterations, inertia, peak MiB;
for scikit-learn also the seconds of its k-means++ alone.
The final centroids go to FOLDER/NAME.f64, row-major.
"""

import json
import pathlib
import sys
import time

import numpy as np

REPEATS = 3


def sklearn_fit(x, start, iterations):
    import warnings

    import sklearn
    from sklearn.cluster import KMeans

    warnings.filterwarnings("ignore")
    model = KMeans(len(start), init=start, n_init=1, max_iter=iterations, tol=0.0, algorithm="lloyd")
    begin = time.perf_counter()
    model.fit(x)
    return time.perf_counter() - begin, model.cluster_centers_, model.n_iter_, sklearn.__version__


def faiss_fit(x, start, iterations):
    import faiss

    n, d = x.shape
    # faiss samples the rows unless told that all may be used.
    model = faiss.Kmeans(d, len(start), niter=iterations, nredo=1, max_points_per_centroid=n, seed=1)
    begin = time.perf_counter()
    model.train(x, init_centroids=start)
    return time.perf_counter() - begin, model.centroids, iterations, faiss.__version__


def seeding_seconds(x, k):
    from sklearn.cluster import kmeans_plusplus

    begin = time.perf_counter()
    kmeans_plusplus(x, k, random_state=1)
    return time.perf_counter() - begin


def peak_mib():
    """The largest resident set of this process; getrusage would count that of the parent at the fork."""
    for line in pathlib.Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) / 1024
    return float("nan")


def inertia_of(x, centroids):
    """Sum of squared distances to the nearest centroids, by differences, in float64."""
    total = 0.0
    for begin in range(0, len(x), 20_000):
        rows = x[begin : begin + 20_000]
        total += ((rows[:, None, :] - centroids[None]) ** 2).sum(2).min(1).sum()
    return total


def main():
    folder, name = pathlib.Path(sys.argv[1]), sys.argv[2]
    n, d, k, iterations = map(int, sys.argv[3:7])
    kind = np.float64 if name == "sklearn64" else np.float32
    x = np.fromfile(folder / "rows.f64").astype(kind, copy=False).reshape(n, d)
    start = np.fromfile(folder / "start.f64").astype(kind, copy=False).reshape(k, d)
    fit = faiss_fit if name == "faiss32" else sklearn_fit
    busy = time.process_time()
    runs = [fit(x, start, iterations) for _ in range(REPEATS)]
    busy = (time.process_time() - busy) / REPEATS
    peak = peak_mib()
    _, centroids, made, version = runs[-1]
    centroids = np.ascontiguousarray(centroids, dtype=np.float64)
    centroids.tofile(folder / f"{name}.f64")
    rows = np.fromfile(folder / "rows.f64").reshape(n, d)
    print(
        json.dumps(
            {
                "version": version,
                "seconds": min(run[0] for run in runs),
                "cpu": busy,
                "iterations": int(made),
                "inertia": float(inertia_of(rows, centroids)),
                "peak_mib": peak,
                "seeding": seeding_seconds(x, k) if name != "faiss32" else None,
            }
        )
    )


if __name__ == "__main__":
    main()
