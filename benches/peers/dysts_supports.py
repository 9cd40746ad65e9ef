"""Supports of dysts' polynomial systems, found by fleetfoot and by pysindy from the same rows.

    pip install dysts==0.96 pysindy==2.1.0 numpy scipy sympy
    python benches/peers/dysts_supports.py --fleetfoot target/release/fleetfoot [--cache DIR] [--systems Lorenz,Rossler] [--noise 0,0.01] [--json results.json]

Systems: those flows of dysts whose right sides sympy expands into polynomials of the states alone; flows with delays, fractions, sines, absolute values or
the time in their right sides are absent, and the table says how many. The truth is the set of monomials of the expanded right sides.

Rows: two trajectories of 512 rows at 100 rows per dominant period, dysts' own default sampling (`make_trajectory(pts_per_period=100)`), so 5.1 periods each.
The first begins at dysts' initial condition, the second on the same attractor 20 periods later. dysts integrates in Python with Radau; here the same right
sides are compiled and integrated by LSODA to a relative tolerance of 1e-11. Noise, where there is some, is white and Gaussian, of 1 % of each state's standard
deviation over both trajectories, with seeds 0, 1 and 2.

Methods: `fleetfoot fit sindy --states ... --degree D`, nothing else said; pysindy's STLSQ with threshold 0.1 on central differences
(`FiniteDifference()`), on smoothed ones (`SmoothedFiniteDifference()`), and its bagging ensemble of both
(`EnsembleOptimizer(STLSQ(threshold=0.1), bagging=True)`, the median of 20 members, numpy's seed 0). All get the polynomial library of the least degree D
that holds the system. A system is right when every equation has exactly the true terms.
"""

import argparse
import hashlib
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import warnings

# The matrices are small: threads of BLAS would only wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np  # noqa: E402

ROWS, PER_PERIOD, APART = 512, 100, 20.0
THRESHOLD = 0.1
SEEDS = (0, 1, 2)
warnings.filterwarnings("ignore")


def systems():
    """Name, period, right sides as sympy polynomials, of every polynomial flow; and the names of the others."""
    import dysts.flows
    import sympy
    from dysts.systems import get_attractor_list

    polynomial, others = [], []
    for name in get_attractor_list():
        flow = getattr(dysts.flows, name)()
        states, clock = sympy.symbols(f"x0:{flow.dimension}"), sympy.Symbol("t")
        try:
            sides = [sympy.expand(side) for side in np.ravel(flow.rhs(np.array(states, dtype=object), clock))]
            if len(sides) != len(states) or any(clock in side.free_symbols for side in sides):
                raise ValueError("not autonomous")
            polynomial.append((name, float(flow.period), np.ravel(flow.ic).astype(float), [sympy.Poly(side, *states) for side in sides]))
        except Exception:  # whatever sympy cannot expand is no polynomial
            others.append(name)
    return polynomial, others


def truth(sides):
    """The exponents of the terms of every right side; what cancels up to rounding is no term."""
    supports = []
    for side in sides:
        largest = max(abs(float(value)) for value in side.coeffs())
        supports.append({powers for powers, value in side.terms() if abs(float(value)) > 1e-12 * largest})
    return supports


def trajectories(name, period, start, sides, cache):
    """Two trajectories (rows x states) and their sampling period."""
    import sympy
    from scipy.integrate import solve_ivp

    text = repr((ROWS, PER_PERIOD, APART, period, start.tolist(), [str(side.as_expr()) for side in sides]))
    file = cache / f"{name}-{hashlib.sha256(text.encode()).hexdigest()[:12]}.npz"
    step = period / PER_PERIOD
    if not file.exists():
        compiled = sympy.lambdify(sides[0].gens, [side.as_expr() for side in sides], "math", cse=True)
        flow = lambda t, x: compiled(*x)
        runs = []
        for begin in (0.0, APART * period):
            stamps = begin + step * np.arange(ROWS)
            stamps = stamps if begin == 0.0 else np.concatenate([[0.0], stamps])
            solution = solve_ivp(flow, (0.0, stamps[-1]), start, "LSODA", stamps, rtol=1e-11, atol=1e-12)
            if not solution.success or not np.isfinite(solution.y).all():
                raise RuntimeError(f"{name}: {solution.message}")
            runs.append(solution.y.T[-ROWS:])
        cache.mkdir(parents=True, exist_ok=True)
        np.savez(file, *runs)
    with np.load(file) as loaded:
        return [loaded["arr_0"], loaded["arr_1"]], step


def noisy(name, runs, noise, seed):
    deviation = np.concatenate(runs).std(axis=0)
    key = int.from_bytes(hashlib.sha256(name.encode()).digest()[:4], "little")
    draw = np.random.default_rng([seed, key])
    return [run + noise * deviation * draw.standard_normal(run.shape) for run in runs]


def monomial(text, states):
    """`x0^2*x1` as exponents."""
    powers = [0] * states
    for factor in [] if text == "1" else text.split("*"):
        state, _, power = factor.partition("^")
        powers[int(state[1:])] += int(power or 1)
    return tuple(powers)


def report(binary, runs, step, options):
    """The report of `fit sindy` on recordings of x0, x1, ...; nothing where it fails."""
    names = [f"x{i}" for i in range(runs[0].shape[1])]
    with tempfile.TemporaryDirectory() as folder:
        files = []
        for number, run in enumerate(runs):
            files.append(f"{folder}/run{number}.csv")
            rows = np.column_stack([step * np.arange(len(run)), run])
            np.savetxt(files[-1], rows, "%.17g", ",", header=",".join(["t", *names]), comments="")
        command = [binary, "fit", "sindy", *files, "--states", ",".join(names), "--json", "-o", f"{folder}/model.json"]
        done = subprocess.run([*command, *options], capture_output=True, text=True)
    if done.returncode != 0:
        print(done.stderr.strip(), file=sys.stderr)
        return None
    return json.loads(done.stdout)


def terms(output, term, states):
    """The terms of every equation in the one region of a report."""
    return [{term(equation_term["function"], states) for equation_term in equation["terms"]} for equation in output["regions"][0]["equations"]]


def by_fleetfoot(binary, options):
    def fit(runs, step, degree):
        states = runs[0].shape[1]
        output = report(binary, runs, step, ["--degree", str(degree), *options])
        return [None] * states if output is None else terms(output, monomial, states)

    return fit


def by_pysindy(smoothed, ensemble, cache):
    import pysindy

    def fit(runs, step, degree):
        """Supports of pysindy, which is asked once for the same rows."""
        request = f"{pysindy.__version__} {np.__version__} {smoothed} {ensemble} {step!r} {degree} {THRESHOLD}".encode()
        key = hashlib.sha256(request + b"".join(np.ascontiguousarray(run).tobytes() for run in runs)).hexdigest()[:24]
        file = cache / f"pysindy-{key}.json"
        if not file.exists():
            file.write_text(json.dumps([sorted(terms) for terms in answer(runs, step, degree)]))
        return [{tuple(powers) for powers in terms} for terms in json.loads(file.read_text())]

    def answer(runs, step, degree):
        np.random.seed(0)
        optimizer = pysindy.STLSQ(threshold=THRESHOLD)
        if ensemble:
            optimizer = pysindy.EnsembleOptimizer(optimizer, bagging=True)
        model = pysindy.SINDy(
            optimizer=optimizer,
            feature_library=pysindy.PolynomialLibrary(degree=degree),
            differentiation_method=pysindy.SmoothedFiniteDifference() if smoothed else pysindy.FiniteDifference(),
        )
        model.fit(runs, t=step)
        powers = [tuple(int(p) for p in row) for row in model.feature_library.powers_]
        return [{power for power, value in zip(powers, row) if value != 0.0} for row in model.coefficients()]

    return fit


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fleetfoot", default="target/release/fleetfoot")
    parser.add_argument("--option", action="append", default=[], help="a word for fit sindy; the table is made without")
    parser.add_argument("--cache", type=pathlib.Path, default=pathlib.Path("target/dysts"))
    parser.add_argument("--systems", help="names, with commas; all by default")
    parser.add_argument("--noise", default="0,0.01")
    parser.add_argument("--no-peers", action="store_true")
    parser.add_argument("--json", type=pathlib.Path, help="what every method found, for every system")
    arguments = parser.parse_args()
    polynomial, others = systems()
    names = arguments.systems and set(arguments.systems.split(","))
    chosen = [system for system in polynomial if not names or system[0] in names]
    methods = {"fleetfoot, no options": by_fleetfoot(arguments.fleetfoot, arguments.option)}
    if not arguments.no_peers:
        methods |= {
            "pysindy STLSQ, finite differences": by_pysindy(False, False, arguments.cache),
            "pysindy STLSQ, smoothed differences": by_pysindy(True, False, arguments.cache),
            "pysindy ensemble, finite differences": by_pysindy(False, True, arguments.cache),
            "pysindy ensemble, smoothed differences": by_pysindy(True, True, arguments.cache),
        }
    record, counts = [], {}
    for name, period, start, sides in chosen:
        supports, degree = truth(sides), max(side.total_degree() for side in sides)
        runs, step = trajectories(name, period, start, sides, arguments.cache)
        for level in (float(text) for text in arguments.noise.split(",")):
            for seed in SEEDS if level else SEEDS[:1]:
                rows = noisy(name, runs, level, seed) if level else runs
                for method, fit in methods.items():
                    answers = fit(rows, step, degree)
                    good = [answer == support for answer, support in zip(answers, supports)]
                    entry = counts.setdefault((method, level), [0, 0, 0, 0])
                    entry[0] += all(good)
                    entry[1] += 1
                    entry[2] += sum(good)
                    entry[3] += len(good)
                    record.append({
                        "system": name, "noise": level, "seed": seed, "degree": degree, "method": method, "right": good,
                        "missing": [sorted(s - (a or set())) for s, a in zip(supports, answers)],
                        "needless": [sorted((a or set()) - s) for s, a in zip(supports, answers)],
                    })
        if sys.stderr.isatty():
            print(f"\r{name:24}", end="", file=sys.stderr)
    if arguments.json:
        arguments.json.write_text(json.dumps(record))
    from importlib.metadata import version

    peers = ", ".join(f"{package} {version(package)}" for package in ("dysts", "pysindy", "numpy", "scipy", "sympy"))
    release = subprocess.run([arguments.fleetfoot, "--version"], capture_output=True, text=True).stdout.strip()
    print(f"{release}, {peers}")
    print(f"{len(chosen)} polynomial systems of {len(polynomial) + len(others)} flows; absent, because they are no autonomous polynomials: {', '.join(others)}")
    print(f"two trajectories of {ROWS} rows at {PER_PERIOD} rows per period; noise of a share of each state's deviation, {len(SEEDS)} seeds\n")
    print("| method | noise | systems right | equations right |\n|---|---|---|---|")
    for (method, level), (right, of, equations, of_equations) in sorted(counts.items(), key=lambda entry: entry[0][1]):
        print(f"| {method} | {100 * level:g} % | {right} of {of} | {equations} of {of_equations} |")
    

if __name__ == "__main__":
    main()
