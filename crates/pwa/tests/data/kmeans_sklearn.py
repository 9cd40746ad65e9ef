"""Writes kmeans_sklearn.txt beside itself: what scikit-learn makes of small problems from given starts.

Each case: a line `case NAME N D K ITERATIONS`, N rows, K starting centroids, K final centroids, a line `inertia VALUE iterations COUNT`.
Numbers are written so that they read back as the same f64. The first line names the versions.
"""

import pathlib
import warnings

import numpy as np
import sklearn
from sklearn.cluster import KMeans

warnings.filterwarnings("ignore")


def cases():
    random = np.random.default_rng(20)
    centres = random.uniform(-4, 4, (6, 3))
    blobs = centres[random.integers(0, 6, 240)] + random.normal(0, 0.7, (240, 3))
    yield "blobs", blobs, blobs[:6], 100
    noise = random.normal(0, 1, (200, 5))
    yield "noise", noise, noise[7:19], 4
    line = random.uniform(-2, 2, (150, 1)) ** 3
    yield "line", line, line[:5], 100
    # No row is near the last two starting centroids: scikit-learn moves them to the farthest rows.
    start = np.vstack([blobs[:4], [[50.0, 50.0, 50.0], [-60.0, 50.0, 0.0]]])
    yield "empty", blobs, start, 100


def main():
    out = pathlib.Path(__file__).with_name("kmeans_sklearn.txt")
    lines = [f"scikit-learn {sklearn.__version__}, numpy {np.__version__}"]
    for name, rows, start, iterations in cases():
        model = KMeans(len(start), init=start, n_init=1, max_iter=iterations, tol=0.0, algorithm="lloyd").fit(rows)
        lines.append(f"case {name} {len(rows)} {rows.shape[1]} {len(start)} {iterations}")
        for matrix in (rows, start, model.cluster_centers_):
            lines.extend(" ".join(repr(float(x)) for x in row) for row in matrix)
        lines.append(f"inertia {float(model.inertia_)!r} iterations {model.n_iter_}")
    out.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
