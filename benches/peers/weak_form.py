"""Structures of noisy recordings: `fit sindy` as it is, without smoothed states, on rows, and on windows, beside pysindy on smoothed differences and its weak form.

    pip install dysts==0.96 pysindy==2.1.0 numpy scipy sympy
    python benches/peers/weak_form.py --fleetfoot target/release/fleetfoot [--noise 0,0.01,0.05,0.1,0.2] [--seeds 3] [--json results.json]

Six systems: those of `cargo run --example sindy_study` (Lorenz, Lotka and Volterra, Van der Pol, Rössler, a damped pendulum, Lorenz 1996 with five states), ten
recordings of 1,000 rows from starts that a seed draws; candidates are all monomials to the third degree, and sines and cosines for the pendulum. dysts: eight
polynomial flows (`--dysts` names others), two trajectories of 512 rows as in `dysts_supports.py`. Noise is white and Gaussian, a share of each state's standard
deviation. A system is right when every equation has exactly the true terms.

pysindy: STLSQ at its default threshold 0.1 on `SmoothedFiniteDifference()`, and on `WeakPDELibrary` over the same functions with its default windows and test
functions (a tenth of a recording, p = 4), 80 windows a recording, about as many as fleetfoot has.
"""

import argparse
import json
import pathlib
import subprocess
import sys
import warnings

import dysts_supports as flows
import numpy as np

warnings.filterwarnings("ignore")
DYSTS = "Aizawa,Dadras,GenesioTesi,Halvorsen,Lorenz,RabinovichFabrikant,Rossler,SprottB"
WINDOWS, THRESHOLD = 80, 0.1


def ring(x):
    return (np.roll(x, -1) - np.roll(x, 2)) * np.roll(x, 1) - x + 8.0


def around(i):
    before, ahead, far = (i - 1) % 5, (i + 1) % 5, (i - 2) % 5
    return [tuple(sorted((before, ahead))), tuple(sorted((before, far))), (i,), ()]


# Name: right side, rows' period, where recordings begin, whether there are sines, terms of every equation as lists of states.
SYSTEMS = {
    "Lorenz": (lambda s: [10 * (s[1] - s[0]), s[0] * (28 - s[2]) - s[1], s[0] * s[1] - 8 / 3 * s[2]], 0.005,
               [(-15, 15), (-15, 15), (10, 40)], False, [[(0,), (1,)], [(0,), (1,), (0, 2)], [(0, 1), (2,)]]),
    "Lotka-Volterra": (lambda s: [2 / 3 * s[0] - 4 / 3 * s[0] * s[1], s[0] * s[1] - s[1]], 0.02, [(0.3, 1.8), (0.2, 1.0)], False,
                       [[(0,), (0, 1)], [(0, 1), (1,)]]),
    "Van der Pol": (lambda s: [s[1], -s[0] + 0.5 * s[1] - 0.5 * s[0] ** 2 * s[1]], 0.02, [(-3, 3), (-3, 3)], False,
                    [[(1,)], [(0,), (1,), (0, 0, 1)]]),
    "Rössler": (lambda s: [-s[1] - s[2], s[0] + 0.2 * s[1], 0.2 + s[0] * s[2] - 5.7 * s[2]], 0.02, [(-6, 6), (-6, 6), (0, 1)], False,
                [[(1,), (2,)], [(0,), (1,)], [(), (0, 2), (2,)]]),
    "damped pendulum": (lambda s: [s[1], -4.905 * np.sin(s[0]) - 0.2 * s[1]], 0.02, [(-2.8, 2.8), (-0.5, 0.5)], True,
                        [[(1,)], ["sin 0", (1,)]]),
    "Lorenz 96": (lambda s: ring(np.asarray(s)), 0.01, [(-4, 8)] * 5, False, [around(i) for i in range(5)]),
}


def record(name, seed):
    """Ten recordings of 1,000 rows."""
    from scipy.integrate import solve_ivp

    side, period, begins, _, _ = SYSTEMS[name]
    draw, stamps = np.random.default_rng([seed, len(name)]), period * np.arange(1000)
    starts = [[draw.uniform(low, high) for low, high in begins] for _ in range(10)]
    return [solve_ivp(lambda t, s: side(s), (0, stamps[-1]), s, "DOP853", stamps, rtol=1e-10, atol=1e-12).y.T for s in starts], period


def noisy(runs, level, seed):
    draw, deviation = np.random.default_rng([seed, 7]), np.concatenate(runs).std(axis=0)
    return [run + level * deviation * draw.standard_normal(run.shape) for run in runs]


def term(text, states):
    """A candidate of fleetfoot as sorted states with repetition, or as `sin 0`."""
    for function in ("sin", "cos"):
        if text.startswith(f"{function}(x"):
            return f"{function} {int(text[5:-1])}"
    powers = flows.monomial(text, states)
    return tuple(state for state, power in enumerate(powers) for _ in range(power))


def by_fleetfoot(binary, options):
    def fit(runs, period, library):
        states = runs[0].shape[1]
        functions = [f"poly({library[0]})"] + (["fourier(1)"] if library[1] else [])
        output = flows.report(binary, runs, period, ["--library", ",".join(functions), *options])
        return ([None] * states, None) if output is None else (flows.terms(output, term, states), [output.get("weak"), output.get("smooth_states")])

    return fit


def by_pysindy(weak):
    import pysindy

    def fit(runs, period, library):
        degree, sines = library
        states, stamps = runs[0].shape[1], period * np.arange(len(runs[0]))
        polynomials = pysindy.PolynomialLibrary(degree=degree, include_bias=not weak)
        functions = polynomials if not sines else polynomials + pysindy.FourierLibrary(n_frequencies=1)
        if weak:
            functions = pysindy.WeakPDELibrary(function_library=functions, spatiotemporal_grid=stamps, K=WINDOWS, include_bias=True)
        np.random.seed(0)
        model = pysindy.SINDy(
            optimizer=pysindy.STLSQ(threshold=THRESHOLD),
            feature_library=functions,
            differentiation_method=pysindy.SmoothedFiniteDifference(),
        )
        try:
            model.fit(runs, t=stamps if weak else period)
        except Exception as problem:  # its matrices may be singular where no term is left
            print(f"pysindy: {problem}", file=sys.stderr)
            return [None] * states, None
        names = [candidate(name) for name in model.feature_library.get_feature_names([f"x{i}" for i in range(states)])]
        return [{name for name, value in zip(names, row) if value != 0.0} for row in model.coefficients()], None

    return fit


def candidate(name):
    """A candidate of pysindy as ours: `x0^2 x1`, `sin(1 x0)`."""
    if name == "1":
        return ()
    for function in ("sin", "cos"):
        if name.startswith(f"{function}(1 x"):
            return f"{function} {int(name[7:-1])}"
    states = []
    for factor in name.replace("x0x", "x0 x").split():
        base, _, power = factor.partition("^")
        states += [int(base[1:])] * int(power or 1)
    return tuple(sorted(states))


def cases(arguments):
    """Group, name, runs, period, library, true terms, and seed."""
    for seed in range(arguments.first_seed, arguments.first_seed + arguments.seeds):
        chosen = arguments.systems.split(",") if arguments.systems else SYSTEMS
        for name in chosen if not arguments.without_six else ():
            runs, period = record(name, seed)
            yield "six", name, runs, period, (3, SYSTEMS[name][3]), [set(terms) for terms in SYSTEMS[name][4]], seed
        if arguments.dysts:
            polynomial, _ = flows.systems()
            for name, whole, start, sides in polynomial:
                if name in arguments.dysts.split(","):
                    runs, period = flows.trajectories(name, whole, start, sides, arguments.cache)
                    truth = [{tuple(s for s, p in enumerate(powers) for _ in range(p)) for powers in terms} for terms in flows.truth(sides)]
                    yield "dysts", name, runs, period, (max(side.total_degree() for side in sides), False), truth, seed


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fleetfoot", default="target/release/fleetfoot")
    parser.add_argument("--noise", default="0,0.01,0.05,0.1,0.2")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--dysts", default=DYSTS, help="names, with commas; empty for none")
    parser.add_argument("--cache", type=pathlib.Path, default=pathlib.Path("target/dysts"))
    parser.add_argument("--no-peers", action="store_true")
    parser.add_argument("--only", help="methods whose names have this text")
    parser.add_argument("--systems", help="of the six, with commas; all by default")
    parser.add_argument("--without-six", action="store_true", help="dysts alone")
    parser.add_argument("--windows", default="", help="lengths of windows to fit with beside, rows, with commas")
    parser.add_argument("--json", type=pathlib.Path, help="every case")
    arguments = parser.parse_args()
    methods = {
        "`fit sindy`, nothing else said": by_fleetfoot(arguments.fleetfoot, []),
        "`fit sindy --smooth-states on`": by_fleetfoot(arguments.fleetfoot, ["--smooth-states=on"]),
        "`fit sindy --smooth-states off`": by_fleetfoot(arguments.fleetfoot, ["--smooth-states=off"]),
        "`fit sindy --weak off`": by_fleetfoot(arguments.fleetfoot, ["--weak=off", "--smooth-states=off"]),
        "`fit sindy --weak auto`": by_fleetfoot(arguments.fleetfoot, ["--weak=auto", "--smooth-states=off"]),
    }
    for rows in filter(None, arguments.windows.split(",")):
        methods[f"`fit sindy --weak {rows}`"] = by_fleetfoot(arguments.fleetfoot, [f"--weak={rows}", "--smooth-states=off"])
    if not arguments.no_peers:
        methods |= {
            "pysindy, smoothed differences": by_pysindy(weak=False),
            "pysindy, weak form": by_pysindy(weak=True),
        }
    methods = {name: fit for name, fit in methods.items() if not arguments.only or arguments.only in name}
    levels, record_of, counts = [float(text) for text in arguments.noise.split(",")], [], {}
    for group, name, runs, period, library, truth, seed in cases(arguments):
        for level in levels:
            if level == 0.0 and seed > arguments.first_seed:
                continue
            rows = noisy(runs, level, seed) if level else runs
            for method, fit in methods.items():
                answer, weak = fit(rows, period, library)
                good = [a == t for a, t in zip(answer, truth)]
                entry = counts.setdefault((group, method, level), [0, 0])
                entry[0] += all(good)
                entry[1] += 1
                record_of.append({"group": group, "system": name, "seed": seed, "noise": level, "method": method, "right": good, "weak": weak,
                                  "missing": [sorted(map(str, t - (a or set()))) for a, t in zip(answer, truth)],
                                  "needless": [sorted(map(str, (a or set()) - t)) for a, t in zip(answer, truth)]})
                if arguments.json:
                    arguments.json.write_text(json.dumps(record_of))
    print(subprocess.run([arguments.fleetfoot, "--version"], capture_output=True, text=True).stdout.strip())
    for group in ("six", "dysts"):
        if not any(key[0] == group for key in counts):
            continue
        print(f"\n| {group} | " + " | ".join(f"{100 * level:g} %" for level in levels) + " |\n|---" * 1 + "|---" * len(levels) + "|")
        for method in methods:
            print(f"| {method} | " + " | ".join("{} of {}".format(*counts[group, method, level]) for level in levels) + " |")


if __name__ == "__main__":
    main()
