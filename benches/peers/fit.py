"""K-50 with 10-fold cross-validation by scikit-learn and numpy: fit.py rows.f64 start.f64 losses.f64

Written with care: float64 in C order, one product per region and fold, no copies beyond those that scikit-learn makes itself.
Prints one line of JSON; writes the losses of the folds, then the mean absolute errors over the null model's.
"""
import json
import resource
import sys
import time

import numpy as np
import sklearn
from sklearn.cluster import KMeans

STATES, TARGETS, CLUSTERS, ITERATIONS, FOLDS = 16, 8, 50, 25, 10


def fit(x, y, start):
    mean, scale = x.mean(axis=0), x.std(axis=0)
    z = (x - mean) / scale
    kmeans = KMeans(CLUSTERS, init=start, n_init=1, max_iter=ITERATIONS, algorithm="lloyd").fit(z)
    labels = kmeans.labels_
    order = np.argsort(labels, kind="stable")
    bounds = np.searchsorted(labels[order], np.arange(CLUSTERS + 1))
    theta = np.empty((CLUSTERS, STATES + 1, TARGETS))
    for k in range(CLUSTERS):
        rows = order[bounds[k] : bounds[k + 1]]
        xr, yr = x[rows], y[rows]
        xm, ym = xr.mean(axis=0), yr.mean(axis=0)
        xc = xr - xm
        beta = np.linalg.solve(xc.T @ xc, xc.T @ (yr - ym))
        theta[k, :-1], theta[k, -1] = beta, ym - xm @ beta
    return mean, scale, kmeans, theta


def main():
    rows = np.fromfile(sys.argv[1]).reshape(STATES + TARGETS, -1)
    start = np.fromfile(sys.argv[2]).reshape(CLUSTERS, STATES)
    x, y = np.ascontiguousarray(rows[:STATES].T), np.ascontiguousarray(rows[STATES:].T)
    del rows
    n = len(x)
    begin = time.perf_counter()
    variance = y.var(axis=0)
    losses, absolute, null = [], np.zeros(TARGETS), np.zeros(TARGETS)
    for fold in range(FOLDS):
        a, b = fold * n // FOLDS, (fold + 1) * n // FOLDS
        train = np.r_[0:a, b:n]
        mean, scale, kmeans, theta = fit(x[train], y[train], start)
        labels = kmeans.predict((x[a:b] - mean) / scale)
        error = y[a:b].copy()
        for k in range(CLUSTERS):
            mask = labels == k
            error[mask] -= x[a:b][mask] @ theta[k, :-1] + theta[k, -1]
        losses.append(float(((error**2).mean(axis=0) / variance).mean()))
        absolute += np.abs(error).sum(axis=0)
        null += np.abs(y[a:b] - y[train].mean(axis=0)).sum(axis=0)
    fit(x, y, start)
    seconds = time.perf_counter() - begin
    np.array(losses + list(absolute / null)).tofile(sys.argv[3])
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(json.dumps({"seconds": seconds, "peak_mib": peak, "version": sklearn.__version__}))


main()
