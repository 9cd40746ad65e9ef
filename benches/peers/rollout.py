"""Rollouts of a piecewise-affine model, vectorised over the trajectories: rollout.py FOLDER STARTS STEPS STATES INPUTS REGIONS DT.

Several ways to apply the region's coefficients are timed, the fastest counts:
- `gather`: the coefficients of every trajectory's region are gathered and multiplied row by row (einsum);
- `batched`: the same with a batched matrix product;
- `all`: one matrix product with the coefficients of all regions, then the right columns are picked;
- `groups`: trajectories sorted by region, one small product a region.

Prints one JSON line: version, seconds (best of five of the best variant), the variant, peak MiB. The trajectories go to FOLDER/numpy.f64,
starts x (steps + 1) x states.
"""

import json
import pathlib
import resource
import sys
import time

import numpy as np

REPEATS = 5


def read(folder, name, *shape):
    return np.fromfile(folder / f"{name}.f64").reshape(shape)


class Rollout:
    def __init__(self, folder, starts, steps, states, inputs, regions, dt):
        self.dt, self.steps, self.states = dt, steps, states
        self.x0 = read(folder, "start", starts, states)
        # Inputs as a simulation would hold them: one block a step.
        self.u = np.ascontiguousarray(read(folder, "inputs", starts, steps, inputs).transpose(1, 0, 2))
        self.centre, self.scale = read(folder, "centre", states), read(folder, "scale", states)
        weights = read(folder, "weights", regions, states)
        self.weights, self.offsets = np.ascontiguousarray(weights.T), read(folder, "offsets", regions)
        # regions x states x (states + inputs + 1), the constant last
        self.theta = read(folder, "theta", regions, states, states + inputs + 1)
        self.theta_all = np.ascontiguousarray(self.theta.reshape(regions * states, -1).T)
        self.theta_t = np.ascontiguousarray(self.theta.transpose(0, 2, 1))
        self.rows = np.arange(starts)

    def slopes(self, variant, psi, region):
        if variant == "gather":
            return np.einsum("nij,nj->ni", self.theta[region], psi)
        if variant == "batched":
            return np.matmul(self.theta[region], psi[:, :, None])[:, :, 0]
        if variant == "all":
            every = (psi @ self.theta_all).reshape(len(psi), -1, self.states)
            return every[self.rows, region]
        order = np.argsort(region, kind="stable")
        borders = np.searchsorted(region[order], np.arange(len(self.theta) + 1))
        sorted_psi = psi[order]
        out = np.empty((len(psi), self.states))
        for i in range(len(self.theta)):
            a, b = borders[i], borders[i + 1]
            if b > a:
                out[order[a:b]] = sorted_psi[a:b] @ self.theta_t[i]
        return out

    def run(self, variant):
        count, inputs = len(self.x0), self.u.shape[2]
        states = self.states
        path = np.empty((self.steps + 1, count, states))
        path[0] = self.x0
        psi = np.ones((count, states + inputs + 1))
        z, scores = np.empty((count, states)), np.empty((count, len(self.offsets)))
        for k in range(self.steps):
            x = path[k]
            np.subtract(x, self.centre, out=z)
            np.divide(z, self.scale, out=z)
            np.matmul(z, self.weights, out=scores)
            scores += self.offsets
            region = scores.argmax(axis=1)
            psi[:, :states] = x
            psi[:, states : states + inputs] = self.u[k]
            slopes = self.slopes(variant, psi, region)
            slopes *= self.dt
            np.add(x, slopes, out=path[k + 1])
        return path


def main():
    folder = pathlib.Path(sys.argv[1])
    starts, steps, states, inputs, regions = (int(argument) for argument in sys.argv[2:7])
    rollout = Rollout(folder, starts, steps, states, inputs, regions, float(sys.argv[7]))
    best = {}
    for variant in ("gather", "batched", "all", "groups"):
        for _ in range(REPEATS):
            begin = time.perf_counter()
            path = rollout.run(variant)
            seconds = time.perf_counter() - begin
            best[variant] = min(best.get(variant, np.inf), seconds)
    variant = min(best, key=best.get)
    path = rollout.run(variant)
    np.ascontiguousarray(path.transpose(1, 0, 2)).tofile(folder / "numpy.f64")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(json.dumps({"version": np.__version__, "seconds": best[variant], "variant": variant, "all": best, "peak": peak}))


main()
