"""The cases of `side_by_side.py`: data, a fit of ours, the fit of a peer, and by what the answers may differ."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

Answer = dict[str, Any]

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
            path = getattr(importlib.import_module(module), name)(X, y, **arguments)
            return {str(at): np.asarray(path[at]) for at in picks}

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
        clustering = KMeans(n_clusters=50, init=arrays["start"], n_init=1, max_iter=25, tol=0.0).fit(arrays["X"])
        return {"cluster_centers_": clustering.cluster_centers_, "inertia_": clustering.inertia_}

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


def pwa_ours(arrays: dict[str, np.ndarray], n_regions: int = 10) -> Answer:
    import fleetfoot as ff

    model = ff.PWARegressor(n_regions=n_regions, random_state=0).fit(arrays["X"], arrays["y"])
    return {"mse": np.mean((model.predict(arrays["X"]) - arrays["y"]) ** 2)}


def pwa_theirs(arrays: dict[str, np.ndarray], n_regions: int = 10) -> Answer:
    from sklearn.cluster import KMeans
    from sklearn.linear_model import LinearRegression

    X, y = arrays["X"], arrays["y"]
    Z = (X - X.mean(0)) / X.std(0)
    labels = KMeans(n_clusters=n_regions, n_init=1, random_state=0, max_iter=100).fit_predict(Z)
    prediction = np.empty_like(y)
    for region in range(n_regions):
        rows = labels == region
        prediction[rows] = LinearRegression().fit(X[rows], y[rows]).predict(X[rows])
    return {"mse": np.mean((prediction - y) ** 2)}


def gram_ours(arrays: dict[str, np.ndarray]) -> Answer:
    import fleetfoot as ff

    path = ff.lars_path_gram(arrays["Xy"], arrays["G"], n_samples=int(arrays["n"]), method="lasso")
    return {str(at): np.asarray(path[at]) for at in (0, 2)}


def gram_theirs(arrays: dict[str, np.ndarray]) -> Answer:
    from sklearn.linear_model import lars_path_gram

    path = lars_path_gram(arrays["Xy"].copy(), arrays["G"].copy(), n_samples=int(arrays["n"]), method="lasso")
    return {str(at): np.asarray(path[at]) for at in (0, 2)}


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

    cases = {}
    for rows, columns in SHAPES:
        for order in "CF":
            for name in options:
                folds = 3 if columns >= 1_000 or rows * columns >= 100_000_000 else 10
                cases[f"{name} {rows}x{columns} {order}"] = Case(
                    f"scikit-learn `{name}`, {folds} folds",
                    of_shape(rows, columns, order),
                    of("fleetfoot", name, folds),
                    of("sklearn.linear_model", name, folds),
                    1e-2,
                    "their duality gap of 1e-4",
                )
    return cases


def wide_cases() -> dict[str, Case]:
    """One solution, and one bolasso, of thousands of features."""
    fits: dict[str, tuple[dict[str, Any], float]] = {
        "Lasso": ({"alpha": 0.1, "tol": 1e-8}, 1e-5),
        "ElasticNet": ({"alpha": 0.1, "l1_ratio": 0.5, "tol": 1e-8}, 1e-5),
        "LassoLars": ({"alpha": 0.05}, 1e-8),
        "Lars": ({"n_nonzero_coefs": 100}, 1e-8),
    }
    cases = {}
    for rows, columns in [(300, 1_000), (5_000, 2_000), (5_000, 10_000)]:
        for order in "CF":
            data = of_shape(rows, columns, order)
            for name, (arguments, tolerance) in fits.items():
                cases[f"{name} {rows}x{columns} {order}"] = sklearn_case(name, arguments, data, ("coef_", "intercept_"), tolerance)
    cases["STLSQ 5000x2000 C"] = wide_threshold()
    cases["PWARegressor 5000x2000 C"] = Case(
        "scikit-learn `KMeans` and `LinearRegression`",
        of_shape(5_000, 2_000, "C"),
        lambda arrays: pwa_ours(arrays, n_regions=2),
        lambda arrays: pwa_theirs(arrays, n_regions=2),
        float("inf"),
        "other starts of k-means, and 2,500 rows for 2,000 features",
    )
    few = {"n_estimators": 4, "alpha": 0.1}
    cases["Bolasso 5000x2000 C"] = Case(
        "4 times scikit-learn `LassoLars`",
        of_shape(5_000, 2_000, "C"),
        lambda arrays: bolasso_ours(arrays, **few),
        lambda arrays: bolasso_theirs(arrays, **few),
        1.0,
        "other draws",
    )
    return cases


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
