"""Makes the tables of docs/results/ that depend on folds and choices again: `python3 benches/results.py --fleetfoot target/release/fleetfoot --data FOLDER`.

Each table stands between two comments of a page and is replaced by the result of this run; commit and machine stand below it.
A page may show an extract of its table further up, which is changed by hand.
"""

import argparse
import contextlib
import csv
import itertools
import json
import os
import platform
import random
import re
import resource
import statistics
import subprocess
import tempfile
import textwrap
from pathlib import Path

import auto_table
import raw_hexapod

ROOT = Path(__file__).resolve().parent.parent
PAGES = ROOT / "docs" / "results"
#: A table of this page is made here too.
HOWTO = ROOT / "docs" / "howto" / "auto.md"


class Bench:
    """Commands in a folder of their own."""

    def __init__(self, fleetfoot, folder):
        self.fleetfoot, self.folder = str(fleetfoot), folder

    def run(self, *arguments):
        """The JSON that a command prints."""
        words = [self.fleetfoot, *map(str, arguments), "--json"]
        done = subprocess.run(words, cwd=self.folder, capture_output=True, text=True)
        if done.returncode:
            raise SystemExit(f"{' '.join(words)}\n{done.stderr}")
        return json.loads(done.stdout)

    def write(self, name, text):
        (self.folder / name).write_text(text)

    def split(self, file, share):
        """The first rows of a CSV as train.csv, the others as test.csv."""
        head, *rows = file.read_text().splitlines(keepends=True)
        cut = int(len(rows) * share)
        self.write("train.csv", head + "".join(rows[:cut]))
        self.write("test.csv", head + "".join(rows[cut:]))


@contextlib.contextmanager
def bench(fleetfoot):
    with tempfile.TemporaryDirectory() as folder:
        yield Bench(fleetfoot, Path(folder))


def over_null(score):
    return ", ".join(f"{target['mae_over_null']['value']:.3f}" for target in score["targets"])


def over_baseline(score):
    """Mean absolute error of the best baseline over that of the model, per target."""
    ratios = []
    for target in score["targets"]:
        best = min(target["baselines"], key=lambda row: row["mae"] / row["model_mae"])
        ratios.append(f"{best['mae'] / best['model_mae']:.1f} ({best['name']})")
    return f"error of the best baseline over the model's: {', '.join(ratios)}"


def free_run(rollout):
    """The Mahalanobis score at the last step beside the best baseline's, and what left."""
    last = lambda scores: scores["mahalanobis"][-1][0]
    name, best = min(((name, last(scores)) for name, scores in rollout["baselines"].items()), key=lambda pair: pair[1])
    error = last(rollout["model"])
    return f"{rollout['time'][-1]:.3g} s: {error:.3g} against {best:.3g} ({name}); {rollout['diverged']} of {rollout['rollouts']} diverged"


def chosen(fit):
    return fit["candidates"][fit["chosen"]]["partition"]


def quadrotor_in_wind(bench, data):
    recipe = '[columns]\nTx = "R_13*T_sp"\nTy = "R_23*T_sp"\nTz = "R_33*T_sp"\n[states]\n'
    recipe += "".join(f'v_{axis} = {{ derivative = "forward" }}\n' for axis in "xyz")
    bench.write("quad.toml", recipe + '[inputs]\nTx = "Tx"\nTy = "Ty"\nTz = "Tz"\n')
    flights = {name: data / "neural-fly" / f"{name}.csv" for name in ("nowind", "35wind", "70wind", "100wind")}
    for name, file in flights.items():
        bench.split(file, 0.5)
        for part in ("train", "test"):
            (bench.folder / f"{part}.csv").rename(bench.folder / f"{part}-{name}.csv")
    for left_out, label in (((), "first halves of four flights, wind of 0 to 12.1 m/s"), (("100wind",), "the same without the 12.1 m/s flight, scored on it")):
        train = [f"train-{name}.csv" for name in flights if name not in left_out]
        test = [f"test-{name}.csv" for name in (left_out or flights)]
        fit = bench.run("fit", "pwa", "-c", "quad.toml", *train, "--partition", "null,average,kmeans:2,5,10,20")
        score = bench.run("score", "model.json", *test)
        rollout = bench.run("rollout", "model.json", *test, "--horizon", 50, "--starts", 500)
        outside = score["rows_outside_training"] / max(score["rows"], 1)
        yield f"quadrotor (`neural-fly`), {label}", f"velocities, thrust vector; {chosen(fit)}", f"MAE over null {over_null(score)}; {outside:.0%} of the rows outside of the training range", free_run(rollout)


def positioning(bench, data):
    bench.split(data / "emps.csv", 0.8)
    bench.write("emps.toml", '[columns]\nqd = "central(qm)"\n[states]\nqm = { known = "qd", regressor = false }\nqd = {}\n[inputs]\nvir = "vir"\n')
    fit = bench.run("fit", "pwa", "-c", "emps.toml", "train.csv", "--partition", "average,kmeans:2", "--purge", "0.1")
    score = bench.run("score", "model.json", "test.csv")
    rollout = bench.run("rollout", "model.json", "test.csv", "--horizon", 500, "--starts", 100)
    yield "positioning system (`emps`), last fifth", f"position, speed, voltage; {chosen(fit)}", f"MAE over null {over_null(score)}, R2 {score['targets'][0]['r2']:.3f}", free_run(rollout)


def placement(bench, data):
    bench.split(data / "pick-and-place.csv", 50_000 / 60_000)
    fit = bench.run("fit", "pwa", "train.csv", "--states", "y", "--inputs", "u", "--predict", "next", "--lags", 3, "--partition", "average,kmeans:2,5,10,20", "--partition-on", "y,lag(y,1),u", "--purge", "0.05")
    score = bench.run("score", "model.json", "test.csv")
    rollout = bench.run("rollout", "model.json", "test.csv", "--horizon", 1000, "--starts", 100)
    yield "placement head (`pick-and-place`), rows after the 50,000th", f"next value, 3 lags; {chosen(fit)}", over_baseline(score), free_run(rollout)


def quadrotor_on_the_bench(bench, data):
    bench.split(data / "crazyflie-thrust.csv", 0.7)
    fit = bench.run("fit", "pwa", "train.csv", "--inputs", "m1,m2,m3,m4", "--predict", "acc_z_mps2", "--lags", 20, "--partition", "average,kmeans:3", "--purge", "0.5")
    score = bench.run("score", "model.json", "test.csv")
    yield "quadrotor on the bench (`crazyflie-thrust`), last 30 %", f"vertical acceleration of motors and its own past, 20 lags; {chosen(fit)}", over_baseline(score), "-"
    bench.split(data / "crazyflie-roll-pitch.csv", 0.7)
    fit = bench.run("fit", "pwa", "train.csv", "--states", "gyro_x_rads,gyro_y_rads", "--inputs", "m1,m2,m3,m4", "--predict", "next", "--lags", 5, "--partition", "average,kmeans:4", "--purge", "0.5")
    score = bench.run("score", "model.json", "test.csv")
    rollout = bench.run("rollout", "model.json", "test.csv", "--horizon", 20, "--starts", 300)
    yield "the same (`crazyflie-roll-pitch`), last 30 %", f"body rates, next value, 5 lags; {chosen(fit)}", over_baseline(score), free_run(rollout)


def airliner(bench, data):
    bench.split(data / "a320-flight.csv", 0.8)
    fit = bench.run("fit", "pwa", "train.csv", "--states", "altitude,CAS,weight", "--inputs", "pitch,fuelflow", "--partition", "average,kmeans:2,3,6", "--partition-on", "altitude,CAS", "--purge", "60")
    score = bench.run("score", "model.json", "test.csv")
    rollout = bench.run("rollout", "model.json", "test.csv", "--horizon", 60, "--starts", 100)
    outside = score["rows_outside_training"] / max(score["rows"], 1)
    yield "airliner (`a320-flight`), last fifth: a descent never seen in training", f"altitude, speed, weight; {chosen(fit)}", f"MAE over null {over_null(score)}; {outside:.0%} of the rows outside of the training range", free_run(rollout)


def recordings(fleetfoot, data):
    rows = ["| recording, held out | model, chosen by cross-validation | one step, held out | free run, held out: Mahalanobis score |", "|---|---|---|---|"]
    for study in (quadrotor_in_wind, positioning, placement, quadrotor_on_the_bench, airliner):
        with bench(fleetfoot) as work:
            rows += [f"| {' | '.join(row)} |" for row in study(work, data)]
    return "\n".join(rows)


def with_interval(interval):
    return f"{interval['value']:.3f} ± {(interval['high'] - interval['low']) / 2:.3f}"


def hexapod(fleetfoot, _data):
    with bench(fleetfoot) as work:
        for folder, options in (("train", ("--minutes", 62, "--runs", 37, "--seed", 1)), ("test", ("--minutes", 15, "--runs", 9, "--seed", 2))):
            words = [work.fleetfoot, "generate", "hexapod", *map(str, options), "--speed", "0.1:0.5", "-o", folder]
            subprocess.run(words, cwd=work.folder, check=True, capture_output=True)
        fit = work.run("fit", "pwa", "-c", "train/robot.toml", "train", "--partition", "null,average,kmeans:10,50,refined:10,50,tree:6", "--folds", "10", "--keep-all")
        rows = [f"| model | {' | '.join(fit['targets'])} |", "|---" * (len(fit["targets"]) + 1) + "|"]
        for candidate in fit["candidates"]:
            rows.append(f"| {candidate['partition']} | {' | '.join(with_interval(interval) for interval in candidate['mae_over_null_intervals'])} |")
        work.run("fit", "pwa", "-c", "train/robot.toml", "train", "--partition", "kmeans:50,refined:50,tree:6", "--stable", "--folds", 0, "--select", "bic", "--keep-all", "-o", "stable.json")
        models = ("model_average", "model_kmeans10", "model_kmeans50", "model_refined10", "model_refined50", "model_tree6", "stable_kmeans50", "stable_refined50", "stable_tree6")
        rows += ["", f"{fit['rows']:,} rows in {fit['episodes']} runs; chosen: {chosen(fit)}. Nine runs of another seed, one step ahead (the mean of the eight) and in free runs, the controller closing the loop, 1,000 starts:", ""]
        times = (1, 2, 11, 40, 60, 100, 200)
        rows += [f"| model | numbers | one step | {' | '.join(f'{time} ms' for time in times)} | diverged |", "|---" * (len(times) + 4) + "|"]
        score = lambda scores: " | ".join(f"{scores['mahalanobis'][time - 1][0]:.3g}" for time in times)
        baselines = {}
        for name in models:
            ahead = statistics.fmean(target["mae_over_null"]["value"] for target in work.run("score", f"{name}.json", "test")["targets"])
            for outside in ("tell", "hold"):
                rollout = work.run("rollout", f"{name}.json", "test", "--horizon", 200, "--starts", 1000, "--controller", "treadmill", "--outside", outside)
                label = name.removeprefix("model_").replace("_", " ") + (", held" if outside == "hold" else "")
                rows.append(f"| {label} | {parameters(work.folder / f'{name}.json'):,} | {ahead:.3f} | {score(rollout['model'])} | {rollout['diverged']} |")
                baselines = rollout["baselines"]
        rows += [f"| {name} | - | - | {score(scores)} | - |" for name, scores in baselines.items()]
    return "\n".join(rows)


def parameters(file):
    """Fitted numbers of a model: constants and coefficients of all regions."""
    latents = json.loads(file.read_text())["model"]["latents"]
    return sum(len(latent["constants"]) + sum(map(len, latent["coefficients"])) for latent in latents)


def horizons(rollout, steps):
    """Mahalanobis scores at some steps, the whole rollout's mean with its interval, and how many diverged."""
    scores = rollout["model"]["mahalanobis"]
    return [f"{scores[step - 1][0]:.3g}" for step in steps] + [with_interval(rollout["model"]["summary"]["average"]), f"{rollout['diverged']} of {rollout['rollouts']}"]


def compared(bench, label, fit, test, partitions, steps, rollout=()):
    """Every partition as it is, bounded (`--stable`), and held at the border of what regions saw."""
    rows = []
    for kind, options in (("free", ()), ("stable", ("--stable",))):
        report = bench.run("fit", "pwa", *fit, "--partition", ",".join(partitions), "--keep-all", "-o", f"{kind}.json", *options)
        for partition, candidate in zip(partitions, report["candidates"]):
            model = f"{kind}_{partition.replace(':', '')}.json"
            moved = candidate.get("stability", {}).get("moved")
            for outside in ("tell", "hold"):
                simulated = bench.run("rollout", model, *test, "--horizon", max(steps), "--starts", 1000, "--outside", outside, *rollout)
                name = f"{partition}, {kind}" + (f", {moved} moved" if moved is not None else "") + (", held" if outside == "hold" else "")
                loss = candidate["loss"]
                rows.append([name, "-" if loss is None else f"{loss:.4g}", *horizons(simulated, steps)])
    header = [label, "held-out loss", *(f"{step} steps" for step in steps), "mean of all steps", "diverged"]
    return [f"| {' | '.join(header)} |", "|---" * len(header) + "|", *(f"| {' | '.join(row)} |" for row in rows), ""]


def stability(fleetfoot, data):
    rows = []
    with bench(fleetfoot) as work:
        for folder, options in (("train", ("--minutes", 10, "--runs", 10, "--seed", 1)), ("test", ("--minutes", 3, "--runs", 3, "--seed", 2))):
            words = [work.fleetfoot, "generate", "hexapod", *map(str, options), "--speed", "0.1:0.5", "--format", "parquet", "-o", folder]
            subprocess.run(words, cwd=work.folder, check=True, capture_output=True)
        fit = ("-c", "train/robot.toml", "train", "--folds", 5)
        rows += compared(work, "hexapod, ten minutes", fit, ("test",), ("average", "kmeans:10", "kmeans:50"), (1, 2, 11, 40, 100, 200), ("--controller", "treadmill"))
    with bench(fleetfoot) as work:
        for _ in quadrotor_in_wind(work, data):
            break
        fit = ("-c", "quad.toml", *(f"train-{name}.csv" for name in ("nowind", "35wind", "70wind", "100wind")))
        test = [f"test-{name}.csv" for name in ("nowind", "35wind", "70wind", "100wind")]
        rows += compared(work, "quadrotor (`neural-fly`)", fit, test, ("average", "kmeans:5", "kmeans:20"), (1, 5, 20, 50))
    with bench(fleetfoot) as work:
        work.split(data / "pick-and-place.csv", 50_000 / 60_000)
        fit = ("train.csv", "--states", "y", "--inputs", "u", "--predict", "next", "--lags", 3, "--partition-on", "y,lag(y,1),u", "--purge", "0.05")
        rows += compared(work, "placement head (`pick-and-place`)", fit, ("test.csv",), ("average", "kmeans:5", "kmeans:20"), (1, 10, 100, 500))
    with bench(fleetfoot) as work:
        file = data / "mcap" / "nav2_turtlebot.mcap"
        work.write("robot.toml", '[columns]\nv = "/odom.twist.twist.linear.x"\nw = "/odom.twist.twist.angular.z"\n[states]\nv = {}\nw = {}\n[time]\nbase = "/odom"\nstamp = "header"\n')
        fit = ("-c", "robot.toml", file, "--predict", "next", "--lags", 5, "--where", "time() < 40")
        rows += compared(work, "wheeled robot (`nav2_turtlebot`)", fit, (file, "--where", "time() > 41"), ("average", "kmeans:3", "kmeans:8"), (1, 5, 20, 50))
    return "\n".join(rows).rstrip()


def autoregressions(fleetfoot, data):
    """The pick-and-place head: regions of an autoregression chosen on the first 50,000 rows alone, simulated through the others."""
    rows = ["| regions | chosen | numbers | FIT % of the rows that trained | FIT % of the last rows |", "|---|---|---:|---:|---:|"]
    recipe = ("--time", "t", "--outputs", "y", "--inputs", "u", "--decimate", 10, "--test-share", 0.16668, "--lags-out", 4, "--lags-in", 3, "--degree", 1, "--terms", "all", "--order", "auto", "--partition-on", "y,y - lag(y, 1),u")
    for partition in ("kmeans:2..20", "refined:2..20"):
        with bench(fleetfoot) as work:
            fit = work.run("fit", "narx", data / "pick-and-place.csv", *recipe, "--partition", partition)
            order = fit["order"]
            runs = [f"{fit[part]['free_run'][0]['fit']:.2f}" for part in ("train", "test")]
            rows.append(f"| {partition} | {fit['partition']}, ny {order['lags_out']}, nu {order['lags_in']} | {parameters(work.folder / 'model.json')} | {runs[0]} | {runs[1]} |")
    return "\n".join(rows)


def raw(fleetfoot, _data):
    with bench(fleetfoot) as work:
        return raw_hexapod.table(work)


def raw_models(fleetfoot, _data):
    with bench(fleetfoot) as work:
        return raw_hexapod.models_table(work)


def flights(fleetfoot, _data):
    """Climbs that a model of other climbs follows (Fig. 4 and 6 of the block-sparse bolasso paper)."""
    disturbed = ("--set", "turbulence.longitudinal=0.02", "--set", "turbulence.normal=0.02", "--format", "parquet")
    with bench(fleetfoot) as work:
        for folder, runs, seed in (("train", 24, 3), ("test", 50, 4)):
            words = [work.fleetfoot, "generate", "aircraft", "--runs", str(runs), "--seed", str(seed), *disturbed, "-o", folder]
            subprocess.run(words, cwd=work.folder, check=True, capture_output=True)
        work.run("fit", "sparse", "-c", "train/robot.toml", "train", "--bolasso", "episodes:200", "--threshold", "0.9", "-o", "model.json")
        begun = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
        report = work.run("resimulate", "model.json", "test")
        seconds = (resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - begun) / len(report["episodes"])
    programs = sorted(episode["programs"] for episode in report["episodes"])
    rows = ["| rms deviation from the flight | followed: mean of the flights | 90 % | worst | open loop: mean | 90 % | worst | may be off |", "|---|---|---|---|---|---|---|---|"]
    for column in report["columns"]:
        cells = []
        for kind in ("followed", "open_loop"):
            spread = column[kind]
            if spread is None:
                cells += ["-"] * 3
                continue
            values = [episode[kind][column["name"]] for episode in report["episodes"]]
            ended = sum(value is None for value in values)
            mean = f"{ended} diverged" if ended else f"{sum(values) / len(values):.3g}"
            cells += [mean, *("diverged" if spread[name] is None else f"{spread[name]:.3g}" for name in ("ninth", "worst"))]
        unit = f", {column['unit']}" if column["unit"] else ""
        rows.append(f"| {column['name']}{unit} | {' | '.join(cells)} | {column['deviation']:.2g} |")
    violation, count = report["violation"], len(report["episodes"])
    rows += ["", f"{count} flights, {report['rows']:,} rows; {report['minima']} at a minimum, by {programs[0]} to {programs[-1]} convex programs (median {programs[count // 2]}). "
             f"The dynamics are violated by {violation['dynamics']:.1e} of a state's spread at most, bounds by {violation['bounds']:.1e}; stationarity {report['stationarity']:.1e}. "
             f"{seconds:.2f} s of a processor a flight, reading and the noise included."]
    return "\n".join(rows)


SHORT_PERIOD = {"za": -1.4, "zd": -0.12, "ma": -6.5, "mq": -2.1, "md": -9.0}


def short_period(seed, rows, sensors, gusts):
    """Rows of 20 ms of an aircraft's short period under a 3-2-1-1 every eight seconds, noise on what is measured and on the states from row to row, as a log."""
    truth, period, noise = SHORT_PERIOD, 0.02, random.Random(seed)
    state, lines = [0.0, 0.0], ["t,alpha,q,d"]
    for row in range(rows):
        time = row * period
        d = next((value for end, value in ((0.5, 0.0), (2.0, 0.05), (3.0, -0.05), (3.5, 0.05), (4.0, -0.05)) if time % 8 < end), 0.0)
        measured = [value + deviation * noise.gauss(0, 1) for value, deviation in zip(state, sensors)]
        lines.append(f"{time:.2f},{measured[0]!r},{measured[1]!r},{d}")
        slope = lambda x: (truth["za"] * x[0] + x[1] + truth["zd"] * d, truth["ma"] * x[0] + truth["mq"] * x[1] + truth["md"] * d)
        moved = lambda slope, step: [x + step * rate for x, rate in zip(state, slope)]
        one = slope(state)
        two = slope(moved(one, period / 2))
        three = slope(moved(two, period / 2))
        four = slope(moved(three, period))
        state = [x + period / 6 * (a + 2 * b + 2 * c + e) for x, a, b, c, e in zip(state, one, two, three, four)]
        state = [x + deviation * noise.gauss(0, 1) for x, deviation in zip(state, gusts)]
    return "\n".join(lines) + "\n"


SEEDS = 200


def noise_of_both_kinds(fleetfoot, _data):
    """Parameters of given equations by three methods, under noise of the sensors, of the dynamics, and of both."""
    recipe = '[states]\nalpha = { known = "za*alpha + q + zd*d" }\nq = { known = "ma*alpha + mq*q + md*d" }\n[inputs]\nd = "d"\n[time]\ncolumn = "t"\n[parameters]\n'
    recipe += "".join(f"{name} = {{ initial = {truth * (1.3, 0.7)[at % 2]:.4g} }}\n" for at, (name, truth) in enumerate(SHORT_PERIOD.items()))
    sensors, gusts, still = (0.004, 0.008), (0.001, 0.002), (0.0, 0.0)
    rows = ["| noise | method | bias | root mean square | 95 % intervals hold | gains, median | median time |", "|---|---|---:|---:|---:|---|---:|"]
    for label, noise in (
        ("sensors", (400, sensors, still)),
        ("dynamics", (400, (1e-6, 1e-6), gusts)),
        ("both", (400, sensors, gusts)),
        ("both, 1,600 rows", (1600, sensors, gusts)),
    ):
        with bench(fleetfoot) as work:
            work.write("aircraft.toml", recipe)
            for seed in range(SEEDS):
                work.write(f"{seed}.csv", short_period(seed, *noise))
            for method in ("equation-error", "output-error", "filter-error"):
                errors, held, gains, seconds = {name: [] for name in SHORT_PERIOD}, 0, [], []
                for seed in range(SEEDS):
                    begun = resource.getrusage(resource.RUSAGE_CHILDREN)
                    report = work.run("fit", "parameters", "-c", "aircraft.toml", f"{seed}.csv", "--method", method, "--folds", 0)
                    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
                    seconds.append(ended.ru_utime - begun.ru_utime + ended.ru_stime - begun.ru_stime)
                    gains.append([gain["value"] for gain in report.get("gains", [])])
                    for parameter in report["parameters"]:
                        truth, (low, high) = SHORT_PERIOD[parameter["name"]], parameter["interval"]
                        errors[parameter["name"]].append(parameter["value"] / truth - 1)
                        held += low <= truth <= high
                bias = statistics.fmean(statistics.fmean(relative) ** 2 for relative in errors.values()) ** 0.5
                spread = statistics.fmean(error**2 for relative in errors.values() for error in relative) ** 0.5
                medians = ", ".join(f"{statistics.median(values):.2f}" for values in zip(*gains)) or "-"
                rows.append(f"| {label} | {method.replace('-', ' ')} | {bias:.1%} | {spread:.1%} | {held / SEEDS / len(SHORT_PERIOD):.1%} | {medians} | {1e3 * statistics.median(seconds):.0f} ms |")
    return "\n".join([*rows, "", f"{SEEDS} seeds each."])


TABLES = {"auto": auto_table.auto, "noise_of_both_kinds": noise_of_both_kinds, "recordings": recordings, "hexapod": hexapod, "stability": stability, "autoregressions": autoregressions, "raw_hexapod": raw, "raw_models": raw_models, "flights": flights}


def machine():
    with open("/proc/cpuinfo") as info:
        model = re.search(r"model name\s*: (.*)", info.read())
    return f"{model.group(1) if model else platform.processor()}, {os.cpu_count()} processors"


def commit():
    return subprocess.run(["git", "describe", "--always", "--dirty=+"], cwd=ROOT, capture_output=True, text=True).stdout.strip()


def folded(text):
    """Lines of prose at most 118 characters long; lines of tables stay."""
    lines = text.split("\n")
    return "\n".join(line if line.startswith(("|", "- [")) else textwrap.fill(line, 118) for line in lines)


#: Results of which a page shows a choice: all their tables are files beside it.
CHOSEN = ("stability", "raw_hexapod", "raw_models")
#: Longest table of a page, in rows.
LONGEST = 40


def filed(name, text, page):
    """The text with a link to a file of comma-separated values in place of each table that is not for reading."""
    parts, count = [], 0
    for is_table, lines in itertools.groupby(text.split("\n"), lambda line: line.startswith("|")):
        lines = list(lines)
        rows = [[cell.strip().strip("*") for cell in line.strip("|").split("|")] for line in lines]
        if not is_table or (name not in CHOSEN and len(rows) - 2 <= LONGEST):
            parts += lines
            continue
        count += 1
        file = PAGES / "tables" / f"{name}-{count}.csv"
        file.parent.mkdir(exist_ok=True)
        with open(file, "w", newline="") as out:
            csv.writer(out, lineterminator="\n").writerows([rows[0], *rows[2:]])
        if len(parts) > 1 and parts[-2].startswith("- ["):
            parts.pop()
        parts.append(f"- [Table of {len(rows) - 2} rows]({os.path.relpath(file, page.parent)}): {rows[0][0]}")
    return "\n".join(parts)


def fill(name, text):
    """Replaces the text between a table's two comments, on the page that has them."""
    begin, end = f"<!-- begin {name} -->", f"<!-- end {name} -->"
    pages = [page for page in [*sorted(PAGES.glob("*.md")), HOWTO] if begin in page.read_text()]
    if len(pages) != 1 or end not in pages[0].read_text():
        raise SystemExit(f"{PAGES} has no place for {name}")
    before, rest = pages[0].read_text().split(begin, 1)
    after = rest.split(end, 1)[1]
    text = folded(filed(name, text, pages[0]))
    pages[0].write_text(f"{before}{begin}\n\n{text}\n\nMade by `benches/results.py` at {commit()} on {machine()}.\n\n{end}{after}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fleetfoot", type=Path, required=True, help="the released command")
    parser.add_argument("--data", type=Path, default=os.environ.get("FLEETFOOT_DATA"), help="the folder of the recordings [FLEETFOOT_DATA]")
    parser.add_argument("tables", nargs="*", default=sorted(TABLES), help=f"those wanted, of {', '.join(sorted(TABLES))} [all]")
    parser.add_argument("--seeds", type=int, default=len(raw_hexapod.SEEDS), help="how many runs raw_hexapod has [%(default)s]")
    arguments = parser.parse_args()
    raw_hexapod.SEEDS = range(1, arguments.seeds + 1)
    for name in arguments.tables:
        fill(name, TABLES[name](arguments.fleetfoot.resolve(), arguments.data))
        print(name)
