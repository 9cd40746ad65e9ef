"""Every estimator beside its peer: the same arrays, the same answer, time and memory.

    python side_by_side.py [--rows 1000000] [--only KMeans,Lars] [--set all] [--repeat 3] [--minutes 90] [--limit 300]

Each fit runs in a process of its own, ours and the peer's by turns, who begins changing too. Time is the least of the repetitions, of `fit` (or the call)
alone: by the clock, and of the processor over all threads, which other work on the machine disturbs less. `--set` (or FLEETFOOT_BENCH) chooses the cases: `classes`, one of every
estimator; `shapes`, from small to large, tall and wide; `quick`, those shapes of at most ten million values in the order of C. Memory is the peak of
the process during the fits above what it held before them, with the arrays loaded: 0 means that nothing of the size of the input was made. The
answers are compared in the same run, relative to the largest number of the peer's. A case whose side takes longer than the limit is told as such, and no case begins
after so many minutes: what was left out is listed at the end.

Bias: the peers run with the threads that they choose (BLAS, OpenMP); data are Gaussian and well conditioned; the first fit of ours is not warmed up
either.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

Answer = dict[str, Any]

#: Seconds after which a fit is not repeated.
ENOUGH = 20.0


@dataclass(frozen=True)
class Case:
    """A fit of ours and of a peer on the same data."""

    peer: str
    data: Callable[[int], dict[str, np.ndarray]]
    ours: Callable[[dict[str, np.ndarray]], Answer]
    theirs: Callable[[dict[str, np.ndarray]], Answer]
    # What the answers may differ by, relative to the largest number, and why.
    tolerance: float
    reason: str = "two algorithms for one minimum"


def regression(columns: int, active: int, noise: float) -> Callable[[int], dict[str, np.ndarray]]:
    """Rows of correlated Gaussian columns and a sparse target."""

    def make(rows: int) -> dict[str, np.ndarray]:
        rng = np.random.default_rng(7)
        X = rng.standard_normal((rows, columns))
        X[:, 1:] += 0.5 * X[:, :-1]
        b = np.zeros(columns)
        b[rng.choice(columns, active, replace=False)] = rng.standard_normal(active)
        return {"X": X, "y": X @ b + noise * rng.standard_normal(rows) + 1.0}

    return make


def clusters(rows: int) -> dict[str, np.ndarray]:
    """Fifty overlapping clouds in sixteen dimensions, and where the centroids start."""
    rng = np.random.default_rng(8)
    centres = 2.0 * rng.standard_normal((50, 16))
    X = centres[rng.integers(0, 50, rows)] + rng.standard_normal((rows, 16))
    return {"X": X, "start": X[:50].copy()}


def lorenz(rows: int) -> dict[str, np.ndarray]:
    """Lorenz's system and its derivatives, with noise on these."""
    rng = np.random.default_rng(9)
    x, dt = np.empty((rows, 3)), 0.002
    state = np.array([-8.0, 8.0, 27.0])

    def rate(s: np.ndarray) -> np.ndarray:
        return np.array([10 * (s[1] - s[0]), s[0] * (28 - s[2]) - s[1], s[0] * s[1] - 8 / 3 * s[2]])

    steps = min(rows, 100_000)
    for row in range(steps):
        x[row] = state
        k1 = rate(state)
        k2 = rate(state + dt / 2 * k1)
        k3 = rate(state + dt / 2 * k2)
        state = state + dt / 6 * (k1 + 2 * k2 + 2 * k3 + rate(state + dt * k3))
    # Beyond the simulated rows states are drawn near them: the derivative is known everywhere.
    x[steps:] = x[rng.integers(0, steps, rows - steps)] + 0.1 * rng.standard_normal((rows - steps, 3))
    dx = np.stack([10 * (x[:, 1] - x[:, 0]), x[:, 0] * (28 - x[:, 2]) - x[:, 1], x[:, 0] * x[:, 1] - 8 / 3 * x[:, 2]], 1)
    return {"x": x, "dx": dx + 0.1 * rng.standard_normal(dx.shape), "t": dt * np.arange(rows)}


def library(rows: int) -> dict[str, np.ndarray]:
    """Monomials up to degree 3 of Lorenz's states, for the optimisers alone."""
    made = lorenz(rows)
    x, y, z = made["x"].T / 10
    columns = [x**i * y**j * z**k for i in range(4) for j in range(4 - i) for k in range(4 - i - j)]
    return {"X": np.stack(columns, 1), "Y": made["dx"] / 10}


def coefficients(model: Any, *names: str) -> Answer:
    return {name: np.asarray(getattr(model, name)) for name in names or ("coef_", "intercept_")}


def sklearn_case(name: str, arguments: dict[str, Any], data: Any, attributes: tuple[str, ...], tolerance: float) -> Case:
    """A class with the same name in scikit-learn."""

    def of(module: str) -> Callable[[dict[str, np.ndarray]], Answer]:
        def run(arrays: dict[str, np.ndarray]) -> Answer:
            import importlib

            return coefficients(getattr(importlib.import_module(module), name)(**arguments).fit(arrays["X"], arrays["y"]), *attributes)

        return run

    return Case(f"scikit-learn `{name}`", data, of("fleetfoot"), of("sklearn.linear_model"), tolerance)


def path_case(name: str, arguments: dict[str, Any], picks: tuple[int, ...], tolerance: float) -> Case:
    def of(module: str) -> Callable[[dict[str, np.ndarray]], Answer]:
        def run(arrays: dict[str, np.ndarray]) -> Answer:
            import importlib

            X, y = arrays["X"], arrays["y"] - arrays["y"].mean()
            found = getattr(importlib.import_module(module), name)(X, y, **arguments)
            return {str(at): np.asarray(found[at]) for at in picks}

        return run

    return Case(f"scikit-learn `{name}`", regression(100, 20, 1.0), of("fleetfoot"), of("sklearn.linear_model"), tolerance)


def optimizer_case(name: str, arguments: dict[str, Any], tolerance: float) -> Case:
    def ours(arrays: dict[str, np.ndarray]) -> Answer:
        import fleetfoot as ff

        return coefficients(getattr(ff, name)(**arguments).fit(arrays["X"], arrays["Y"]), "coef_")

    def theirs(arrays: dict[str, np.ndarray]) -> Answer:
        import pysindy

        return coefficients(getattr(pysindy, name)(**arguments).fit(arrays["X"], arrays["Y"]), "coef_")

    # pysindy's forward regression takes time with the square of the rows.
    most = 20_000 if name == "FROLS" else 10**9
    return Case(f"pysindy `{name}`", lambda rows: library(min(rows, most)), ours, theirs, tolerance)


def kmeans(module: str) -> Callable[[dict[str, np.ndarray]], Answer]:
    def run(arrays: dict[str, np.ndarray]) -> Answer:
        import importlib

        KMeans = importlib.import_module(module).KMeans
        found = KMeans(n_clusters=50, init=arrays["start"], n_init=1, max_iter=25, tol=0.0).fit(arrays["X"])
        return {"cluster_centers_": found.cluster_centers_, "inertia_": found.inertia_}

    return run


def sindy_ours(arrays: dict[str, np.ndarray]) -> Answer:
    import fleetfoot as ff

    model = ff.SINDy(library=["poly(5)"], threshold=0.5).fit([arrays["x"]], t=[arrays["t"]], x_dot=[arrays["dx"]])
    return {"terms": np.sort(np.abs(np.asarray(model.coefficients())[np.asarray(model.coefficients()) != 0]))}


def sindy_theirs(arrays: dict[str, np.ndarray]) -> Answer:
    import pysindy

    model = pysindy.SINDy(optimizer=pysindy.STLSQ(threshold=0.5), feature_library=pysindy.PolynomialLibrary(degree=5))
    model.fit(arrays["x"], t=arrays["t"], x_dot=arrays["dx"])
    return {"terms": np.sort(np.abs(model.coefficients()[model.coefficients() != 0]))}


def pwa_ours(arrays: dict[str, np.ndarray]) -> Answer:
    import fleetfoot as ff

    model = ff.PWARegressor(n_regions=10, random_state=0).fit(arrays["X"], arrays["y"])
    return {"mse": np.mean((model.predict(arrays["X"]) - arrays["y"]) ** 2)}


def pwa_theirs(arrays: dict[str, np.ndarray]) -> Answer:
    from sklearn.cluster import KMeans
    from sklearn.linear_model import LinearRegression

    X, y = arrays["X"], arrays["y"]
    Z = (X - X.mean(0)) / X.std(0)
    labels = KMeans(n_clusters=10, n_init=1, random_state=0, max_iter=100).fit_predict(Z)
    prediction = np.empty_like(y)
    for region in range(10):
        rows = labels == region
        prediction[rows] = LinearRegression().fit(X[rows], y[rows]).predict(X[rows])
    return {"mse": np.mean((prediction - y) ** 2)}


def gram_ours(arrays: dict[str, np.ndarray]) -> Answer:
    import fleetfoot as ff

    found = ff.lars_path_gram(arrays["Xy"], arrays["G"], n_samples=int(arrays["n"]), method="lasso")
    return {str(at): np.asarray(found[at]) for at in (0, 2)}


def gram_theirs(arrays: dict[str, np.ndarray]) -> Answer:
    from sklearn.linear_model import lars_path_gram

    found = lars_path_gram(arrays["Xy"].copy(), arrays["G"].copy(), n_samples=int(arrays["n"]), method="lasso")
    return {str(at): np.asarray(found[at]) for at in (0, 2)}


def gram(rows: int) -> dict[str, np.ndarray]:
    made = regression(300, 60, 1.0)(min(rows, 20_000))
    X, y = made["X"], made["y"] - made["y"].mean()
    return {"Xy": X.T @ y, "G": X.T @ X, "n": np.array(len(X))}


def bolasso_ours(arrays: dict[str, np.ndarray], n_estimators: int = 128, alpha: float = 0.02) -> Answer:
    import fleetfoot as ff

    model = ff.Bolasso(n_estimators=n_estimators, alpha=alpha, random_state=0).fit(arrays["X"], arrays["y"])
    return {"support": np.asarray(model.get_support(), dtype=float)}


def bolasso_theirs(arrays: dict[str, np.ndarray], n_estimators: int = 128, alpha: float = 0.02) -> Answer:
    from sklearn.linear_model import LassoLars

    X, y, rng = arrays["X"], arrays["y"], np.random.default_rng(0)
    kept = np.zeros(X.shape[1])
    for _ in range(n_estimators):
        rows = rng.integers(0, len(X), len(X))
        kept += LassoLars(alpha=alpha).fit(X[rows], y[rows]).coef_ != 0
    return {"support": (kept >= 0.9 * n_estimators).astype(float)}


WIDE = regression(100, 20, 1.0)
CASES: dict[str, Case] = {
    "KMeans": Case("scikit-learn `KMeans`", clusters, kmeans("fleetfoot"), kmeans("sklearn.cluster"), 1e-6),
    "Lars": sklearn_case("Lars", {"n_nonzero_coefs": 20}, WIDE, ("coef_", "intercept_"), 1e-8),
    "LassoLars": sklearn_case("LassoLars", {"alpha": 0.01}, WIDE, ("coef_", "intercept_"), 1e-8),
    "LassoLarsCV": sklearn_case("LassoLarsCV", {"cv": 10}, WIDE, ("coef_", "alpha_"), 1e-6),
    "LassoLarsIC": sklearn_case("LassoLarsIC", {"criterion": "bic"}, WIDE, ("coef_", "alpha_"), 1e-6),
    "Lasso": sklearn_case("Lasso", {"alpha": 0.01, "tol": 1e-10}, WIDE, ("coef_", "intercept_"), 1e-6),
    "LassoCV": sklearn_case("LassoCV", {"cv": 10, "tol": 1e-8}, WIDE, ("coef_", "alpha_"), 1e-4),
    "ElasticNet": sklearn_case("ElasticNet", {"alpha": 0.01, "l1_ratio": 0.5, "tol": 1e-10}, WIDE, ("coef_",), 1e-6),
    "lars_path": path_case("lars_path", {"method": "lasso"}, (0, 2), 1e-8),
    "lars_path_gram": Case("scikit-learn `lars_path_gram`", gram, gram_ours, gram_theirs, 1e-8),
    "lasso_path": path_case("lasso_path", {"n_alphas": 100, "tol": 1e-10}, (0, 1), 1e-6),
    "Bolasso": Case(
        "128 times scikit-learn `LassoLars`", lambda rows: regression(45, 9, 1.0)(min(rows, 100_000)), bolasso_ours, bolasso_theirs, 0.0, "other draws, the same support"
    ),
    "STLSQ": optimizer_case("STLSQ", {"threshold": 0.3, "alpha": 0.05}, 1e-8),
    "SR3": optimizer_case("SR3", {"reg_weight_lam": 0.05, "max_iter": 100}, 1e-6),
    "FROLS": optimizer_case("FROLS", {"max_iter": 5}, 1e-8),
    "SINDy": Case("pysindy `SINDy`", lorenz, sindy_ours, sindy_theirs, 1e-5),
    "PWARegressor": Case(
        "scikit-learn `KMeans` and `LinearRegression`", lambda rows: clusters_with_target(rows), pwa_ours, pwa_theirs, 0.05, "other starts of k-means"
    ),
}


def of_shape(rows: int, columns: int, order: str) -> Callable[[int], dict[str, np.ndarray]]:
    """Rows of one shape, in one order of memory."""

    def make(_: int) -> dict[str, np.ndarray]:
        made = regression(columns, max(2, columns // 20), 1.0)(rows)
        return {"X": np.asarray(made["X"], order="F" if order == "F" else "C"), "y": made["y"]}

    return make


#: Rows and columns from small to large, tall and wide; the largest hold 2.4 GB.
SHAPES = [
    (50, 5),
    (1_000, 20),
    (20_000, 50),
    (100_000, 30),
    (300, 1_000),
    (5_000, 2_000),
    (100_000, 300),
    (5_000, 10_000),
    (1_000_000, 100),
    (1_000_000, 300),
]


def shape_cases() -> dict[str, Case]:
    """The cross-validated estimators from small to large, tall and wide, in both orders of memory.

    The peers keep their tolerance of 1e-4, which is what users of them wait for; ours are exact. What is compared is the least mean error over the folds.
    """
    options: dict[str, dict[str, Any]] = {
        "LassoCV": {"alphas": 30},
        "ElasticNetCV": {"alphas": 30, "l1_ratio": 0.5},
        "LassoLarsCV": {},
    }

    def of(module: str, name: str, folds: int) -> Callable[[dict[str, np.ndarray]], Answer]:
        def run(arrays: dict[str, np.ndarray]) -> Answer:
            import importlib

            model = getattr(importlib.import_module(module), name)(cv=folds, **options[name])
            errors = model.fit(arrays["X"], arrays["y"]).mse_path_.mean(axis=1)
            return {"error": errors.min()}

        return run

    found = {}
    for rows, columns in SHAPES:
        for order in "CF":
            for name in options:
                folds = 3 if columns >= 1_000 or rows * columns >= 100_000_000 else 10
                found[f"{name} {rows}x{columns} {order}"] = Case(
                    f"scikit-learn `{name}`, {folds} folds",
                    of_shape(rows, columns, order),
                    of("fleetfoot", name, folds),
                    of("sklearn.linear_model", name, folds),
                    1e-2,
                    "their duality gap of 1e-4",
                )
    return found


def wide_cases() -> dict[str, Case]:
    """One solution, and one bolasso, of thousands of features."""
    fits: dict[str, tuple[dict[str, Any], float]] = {
        "Lasso": ({"alpha": 0.1, "tol": 1e-8}, 1e-5),
        "ElasticNet": ({"alpha": 0.1, "l1_ratio": 0.5, "tol": 1e-8}, 1e-5),
        "LassoLars": ({"alpha": 0.05}, 1e-8),
        "Lars": ({"n_nonzero_coefs": 100}, 1e-8),
    }
    found = {}
    for rows, columns in [(300, 1_000), (5_000, 2_000), (5_000, 10_000)]:
        for order in "CF":
            data = of_shape(rows, columns, order)
            for name, (arguments, tolerance) in fits.items():
                found[f"{name} {rows}x{columns} {order}"] = sklearn_case(name, arguments, data, ("coef_", "intercept_"), tolerance)
    found["STLSQ 5000x2000 C"] = wide_threshold()
    few = {"n_estimators": 4, "alpha": 0.1}
    found["Bolasso 5000x2000 C"] = Case(
        "4 times scikit-learn `LassoLars`",
        of_shape(5_000, 2_000, "C"),
        lambda arrays: bolasso_ours(arrays, **few),
        lambda arrays: bolasso_theirs(arrays, **few),
        1.0,
        "other draws",
    )
    return found


def wide_threshold() -> Case:
    """Thresholding of thousands of candidates."""

    def data(_: int) -> dict[str, np.ndarray]:
        made = of_shape(5_000, 2_000, "C")(0)
        return {"X": made["X"], "Y": made["y"][:, None]}

    case = optimizer_case("STLSQ", {"threshold": 0.1, "alpha": 0.05}, 1e-6)
    return Case(case.peer, data, case.ours, case.theirs, case.tolerance)


CASES.update(shape_cases())
CASES.update(wide_cases())


def clusters_with_target(rows: int) -> dict[str, np.ndarray]:
    X = clusters(rows)["X"]
    return {"X": X, "y": np.abs(X[:, :4]).sum(1) + 0.1 * np.random.default_rng(10).standard_normal(rows)}


def peak() -> int:
    """Peak resident bytes since the last reset."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmHWM"):
            return 1024 * int(line.split()[1])
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def resident() -> int:
    return os.sysconf("SC_PAGESIZE") * int(Path("/proc/self/statm").read_text().split()[1])


def run_alone(name: str, who: str, folder: Path, repeat: int) -> None:
    """The child: fits, and writes time, memory and answer."""
    warnings.simplefilter("ignore")
    case = CASES[name]
    arrays = dict(np.load(folder / f"{name}.npz"))
    run = case.ours if who == "ours" else case.theirs
    small = {key: (value[: max(400, len(value) // 1000)] if value.ndim and key not in ("start", "G", "Xy") else value) for key, value in arrays.items()}
    run(small)  # imports and threads are no part of the fit
    Path("/proc/self/clear_refs").write_text("5")
    before, times, processor = resident(), [], []
    for _ in range(repeat):
        start, used = time.perf_counter(), time.process_time()
        answer = run(arrays)
        times.append(time.perf_counter() - start)
        processor.append(time.process_time() - used)
        if sum(times) > ENOUGH:
            break
    np.savez(folder / f"{name}.{who}.npz", **answer)
    print(json.dumps({"seconds": min(times), "processor": min(processor), "bytes": max(0, peak() - before)}))


def difference(ours: Answer, theirs: Answer) -> float:
    worst = 0.0
    for key in theirs:
        a, b = np.asarray(ours[key], dtype=float), np.asarray(theirs[key], dtype=float)
        if a.shape != b.shape:
            return float("inf")
        scale = np.abs(b).max(initial=0.0)
        worst = max(worst, float(np.abs(a - b).max(initial=0.0) / (scale if scale > 0 else 1.0)))
    return worst


def compared(name: str, arguments: argparse.Namespace) -> tuple[str, float | None]:
    """Both sides of a case: a line of the table, and the difference of the answers where both have one."""
    case = CASES[name]
    found: dict[str, Any] = {}
    off = None
    with tempfile.TemporaryDirectory() as folder:
        arrays = case.data(arguments.rows)
        np.savez(Path(folder) / f"{name}.npz", **arrays)
        size = " + ".join("x".join(map(str, value.shape)) for value in arrays.values() if value.ndim)
        del arrays
        # Short fits are repeated in one process, long ones are not; twice, so that both begin once.
        for turn in (("ours", "theirs"), ("theirs", "ours")):
            for who in turn:
                known = found.get(who)
                timed_out = known is None and turn[0] == "theirs"
                if timed_out or (known is not None and known["seconds"] > ENOUGH):
                    continue
                new = alone(name, who, folder, arguments)
                if new is not None:
                    found[who] = new if known is None else {key: min(value, known[key]) for key, value in new.items()}
        if len(found) == 2:
            off = difference(*(dict(np.load(Path(folder) / f"{name}.{who}.npz")) for who in ("ours", "theirs")))
    cells = []
    for clock in ("seconds", "processor"):
        cells += [f"{found[who][clock]:.3f}" if who in found else f"> {arguments.limit:g}" for who in ("ours", "theirs")]
        cells.append(f"{found['theirs'][clock] / max(found['ours'][clock], 1e-9):.2f}" if len(found) == 2 else "-")
    cells += [f"{found[who]['bytes'] / 2**20:.0f}" if who in found else "-" for who in ("ours", "theirs")]
    cells.append("-" if off is None else f"{off:.1e}")
    return f"| `{name}` | {case.peer} | {size} | {' | '.join(cells)} |", off


def alone(name: str, who: str, folder: str, arguments: argparse.Namespace) -> dict[str, float] | None:
    """One side of a case in a process of its own; `None` where it takes longer than the limit."""
    command = [sys.executable, __file__, "--child", name, who, folder, "--repeat", str(arguments.repeat)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=arguments.limit)
    except subprocess.TimeoutExpired:
        return None
    if done.returncode != 0:
        raise SystemExit(done.stderr)
    result: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return result


def chosen(which: str) -> list[str]:
    """The cases of a set."""
    shaped = {*shape_cases(), *wide_cases()}
    if which == "classes":
        return [name for name in CASES if name not in shaped]
    if which == "shapes":
        return [name for name in CASES if name in shaped]
    if which == "quick":
        size = {f"{rows}x{columns}": rows * columns for rows, columns in SHAPES}
        small = {shape for shape, values in size.items() if values <= 10_000_000}
        return [name for name in CASES if name in shaped and name.endswith(" C") and name.split()[1] in small]
    return list(CASES)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=1_000_000)
    parser.add_argument("--only", default="")
    sets = ["all", "classes", "shapes", "quick"]
    parser.add_argument("--set", choices=sets, default=os.environ.get("FLEETFOOT_BENCH", "all"), help="which cases, where none are named")
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--minutes", type=float, default=90.0, help="after which no case begins")
    parser.add_argument("--limit", type=float, default=300.0, help="seconds that one side of a case may take, imports and all")
    parser.add_argument("--child", nargs=3, metavar=("NAME", "WHO", "FOLDER"), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.child:
        run_alone(arguments.child[0], arguments.child[1], Path(arguments.child[2]), arguments.repeat)
        return 0
    wanted = [name for name in arguments.only.split(",") if name] or chosen(arguments.set)
    print(
        "| estimator | peer | input | ours, s | peer, s | ratio | ours, processor s | peer, processor s | ratio | ours, MiB | peer, MiB | difference |"
    )
    print("|---|---|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|")
    wrong: list[str] = []
    begun = time.monotonic()
    for place, name in enumerate(wanted):
        if time.monotonic() - begun > 60.0 * arguments.minutes:
            print(f"LEFT OUT after {arguments.minutes:g} minutes: {', '.join(wanted[place:])}", file=sys.stderr)
            break
        line, off = compared(name, arguments)
        print(line, flush=True)
        if off is not None and not off <= CASES[name].tolerance:
            wrong.append(f"{name}: {off:.1e}, more than {CASES[name].tolerance:.1e} ({CASES[name].reason})")
    for line in wrong:
        print(f"DIFFERS {line}", file=sys.stderr)
    print(f"{(time.monotonic() - begun) / 60.0:.0f} minutes", file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
