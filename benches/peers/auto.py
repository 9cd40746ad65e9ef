"""One row of the table of `fleetfoot auto` for every log: auto.py FLEETFOOT DATA FOLDER [NAME ...]

The last quarter of a log (of its episodes, where there are several) is cut off before anything sees it. `auto` runs on the rest without options but those that
auto_logs.py gives. Its model, models of fleetfoot with options that a person would try, pysindy with its defaults, scikit-learn's least squares on lags (the best of five
orders) and persistence are then simulated from the same rows of the cut-off part, over the horizon that `auto` chose. Errors are over those of persistence, state by
state, and their mean. Prints a line of JSON a log; FOLDER keeps logs, models and results.
"""

import hashlib
import json
import re
import subprocess
import sys
import time
import warnings
from pathlib import Path

import auto_logs
import numpy as np
import pyarrow.parquet
import pysindy
from sklearn.linear_model import LinearRegression

STARTS = 50
NEAR = 20
LAGS = (1, 2, 4, 8, 16)
SECONDS = 60


def write(file, table):
    lines = [",".join(table), *(",".join(map(repr, map(float, row))) for row in zip(*table.values()))]
    file.write_text("\n".join(lines) + "\n")


def cut(episodes):
    """The first three quarters and the last one: of the episodes where there are four and more, else of the rows of each."""
    if len(episodes) >= 4:
        last = len(episodes) - len(episodes) // 4
        return episodes[:last], episodes[last:]
    part = lambda episode, first, last: {name: values[int(first * len(values)) : int(last * len(values))] for name, values in episode.items()}
    return [part(episode, 0, 0.75) for episode in episodes], [part(episode, 0.75, 1) for episode in episodes]


def even(episode, period):
    """Rows at even stamps, for those who count rows; those of a log whose stamps are even stay what they are."""
    t = episode["t"]
    if np.all(np.abs(np.diff(t) - period) < 0.02 * period):
        return episode
    at = np.arange(t[0], t[-1], period)
    return {"t": at, **{name: auto_logs.held_or_between(at, t, values) for name, values in episode.items() if name != "t"}}


def starts(episodes, horizon, before):
    """Starts spread evenly over the cut-off rows: an episode and a row each."""
    possible = [(at, row) for at, episode in enumerate(episodes) for row in range(before, len(episode["t"]) - horizon - 1)]
    return [possible[(2 * k + 1) * len(possible) // (2 * STARTS)] for k in range(STARTS)] if len(possible) > STARTS else possible


def difference(predicted, measured, is_angle):
    """Angles differ by half a turn at most."""
    error = predicted - measured
    return np.where(is_angle, np.arctan2(np.sin(error), np.cos(error)), error)


def by_fleetfoot(fleetfoot, model, folder, states, angles, steps, before, every):
    """Errors of a model by state, of the trajectories that begin at the row behind the `before` others of every piece, and how many there are. Pieces with few rows
    before are tried first: every row that a piece has more is one more simulation."""
    for pieces, past in (("near", NEAR), ("far", before)) if every == 1 and before > NEAR else (("far", before),):
        out = folder / "rollouts.parquet"
        words = [fleetfoot, "rollout", model, folder / pieces, "--horizon", max(1, steps // every), "--starts", 10_000_000, "-o", out, "-q"]
        done = subprocess.run(list(map(str, words)), capture_output=True, text=True, timeout=SECONDS)
        if done.returncode == 0:
            break
    else:
        raise RuntimeError(done.stderr.strip()[:300])
    names = ["trajectory", "episode", "row", "step", *states, *(f"{state} measured" for state in states)]
    table = pyarrow.parquet.read_table(out, columns=names)
    row, step, trajectory = (table[name].to_numpy() for name in ("row", "step", "trajectory"))
    first = np.flatnonzero(step == 0)
    episode, begun = table["episode"].take(first).to_pylist(), {}
    for name, at in zip(episode, first):
        if begun.get(name, (-1, None))[0] < row[at] <= past // every:
            begun[name] = (row[at], trajectory[at])
    kept = np.isin(trajectory, [chosen for _, chosen in begun.values()]) & (step > 0)
    values = lambda name: table[name].to_numpy()[kept]
    error = lambda state: difference(values(state), values(f"{state} measured"), state in angles)
    return [float(np.sqrt(np.nanmean(error(state) ** 2))) for state in states], len(begun)


def windows(episodes, begun, names, first, last):
    """Values of some columns from `first` rows before the starts to `last` rows behind them: starts x rows x columns."""
    return np.array([[[episodes[at][name][row + k] for name in names] for k in range(first, last + 1)] for at, row in begun])


def rmse(predicted, measured, angles):
    with np.errstate(all="ignore"):
        error = np.sqrt(np.mean(difference(predicted, measured, np.array(angles)) ** 2, axis=(0, 1)))
    return [float(value) if np.isfinite(value) else float("inf") for value in error]


def by_pysindy(train, test, begun, states, angles, inputs, period, horizon):
    columns = lambda episode, names: np.column_stack([episode[name] for name in names])
    model = pysindy.SINDy()
    controls = {"u": [columns(episode, inputs) for episode in train]} if inputs else {}
    model.fit([columns(episode, states) for episode in train], t=period, **controls)
    x, u = windows(test, begun, states, 0, 0)[:, 0], windows(test, begun, inputs, 0, horizon) if inputs else None
    slope = (lambda x, k: np.asarray(model.predict(x, u=u[:, k]))) if inputs else (lambda x, k: np.asarray(model.predict(x)))
    simulated = []
    for k in range(horizon):
        a = slope(x, k)
        b = slope(x + period / 2 * a, k)
        c = slope(x + period / 2 * b, k)
        x = np.clip(x + period / 6 * (a + 2 * b + 2 * c + slope(x + period * c, k)), -1e9, 1e9)
        simulated.append(x)
    return rmse(np.stack(simulated, 1), windows(test, begun, states, 1, horizon), [state in angles for state in states])


def by_lags(train, test, begun, states, angles, inputs, lags, horizon):
    past = lambda episode, names, row: np.concatenate([episode[name][row - lags + 1 : row + 1] for name in names]) if names else np.empty(0)
    X, Y = [], []
    for episode in train:
        for row in range(lags - 1, len(episode["t"]) - 1, max(1, len(episode["t"]) // 20_000)):
            X.append(np.concatenate([past(episode, states, row), past(episode, inputs, row)]))
            Y.append([episode[name][row + 1] for name in states])
    model = LinearRegression().fit(np.array(X), np.array(Y))
    x = np.swapaxes(windows(test, begun, states, 1 - lags, 0), 1, 2)
    u = np.swapaxes(windows(test, begun, inputs, 1 - lags, horizon), 1, 2) if inputs else np.empty((len(begun), 0, 0))
    simulated = []
    for k in range(horizon):
        row = np.concatenate([x.reshape(len(begun), -1), u[:, :, k : k + lags].reshape(len(begun), -1)], 1)
        ahead = np.clip(model.predict(row), -1e9, 1e9)
        simulated.append(ahead)
        x = np.concatenate([x[:, :, 1:], ahead[:, :, None]], 2)
    return rmse(np.stack(simulated, 1), windows(test, begun, states, 1, horizon), [state in angles for state in states])


def hands(rate, horizon):
    """Fits that a person would try: words of `fit`, and the rows of which one is seen."""
    usual = [
        (["narx"], 1),
        (["pwa", "--predict", "delta", "--partition", "average", "--lags", 5], 1),
        (["pwa", "--predict", "delta", "--partition", "refined:2..5", "--lags", 2], 1),
    ]
    if horizon >= 100:
        usual.append((["pwa", "--predict", "delta", "--partition", "refined:2..5", "--lags", 2, "--rate", rate / 10], 10))
    return usual


def tried(fleetfoot, folder, recipe, words):
    """A fit by hand."""
    model = folder / "hand.json"
    model.unlink(missing_ok=True)
    done = subprocess.run(list(map(str, [fleetfoot, "fit", words[0], "-c", recipe, folder / "train", *words[1:], "-o", model, "-q"])), capture_output=True, text=True, timeout=SECONDS)
    if done.returncode:
        raise RuntimeError(done.stderr.strip()[:300])
    return model


def study(fleetfoot, data, folder, name):
    make, options = auto_logs.all_logs(fleetfoot, data, folder)[name]
    work = folder / slug(name)
    (work / "train").mkdir(parents=True, exist_ok=True)
    train, test = cut(make())
    for at, episode in enumerate(train):
        write(work / "train" / f"e{at:02}.csv", episode)
    begin = time.perf_counter()
    done = subprocess.run(list(map(str, [fleetfoot, "auto", work / "train", *options, "-o", work / "model", "--force", "--json", "-q"])), capture_output=True, text=True)
    seconds = time.perf_counter() - begin
    if done.returncode:
        return {"name": name, "failed": done.stderr.strip()[-300:]}
    report = json.loads(done.stdout)
    (work / "auto.txt").write_text(done.stdout)
    states = [tested["state"] for tested in report["tested"]]
    recipe = (work / "model" / "recipe.toml").read_text()
    inputs = [quoted or bare for quoted, bare in re.findall(r"^\[inputs\.(?:\"([^\"]+)\"|(\w+))\]", recipe, re.M)]
    rate = re.search(r"^rate = ([\d.e+-]+)", recipe, re.M)
    period = 1 / float(rate[1]) if rate else float(np.median(np.concatenate([np.diff(episode["t"]) for episode in train])))
    every = int(re.search(r"every (\d+) rows", report["chosen"])[1]) if "every" in report["chosen"] else 1
    horizon = report["horizon"]["steps"]
    before = max(20, min(20 * every, 200))
    before += -before % max(every, 10)
    # A model of rows as they come counts rows; so do all others then.
    as_they_come = report["chosen"].startswith("rows as they come")
    placed = (lambda episode: episode) if as_they_come else (lambda episode: even(episode, period))
    rows = [placed(episode) for episode in test]
    horizon = max(1, min(horizon, max(len(run["t"]) for run in rows) - before - 3))
    begun = starts(rows, horizon, before)
    for pieces, past in (("near", NEAR), ("far", before)):
        (work / pieces).mkdir(exist_ok=True)
        for k, (at, row) in enumerate(begun):
            write(work / pieces / f"p{k:03}.csv", {name: values[row - past : row + horizon + 2] for name, values in rows[at].items()})
    measured = windows(rows, begun, states, 1, horizon)
    columns = json.loads((work / "model" / "model.json").read_text())["model"]["columns"]
    angles = [column["name"] for column in columns if column["angle"]]
    still = rmse(windows(rows, begun, states, 0, 0), measured, [state in angles for state in states])
    moving = [k for k, value in enumerate(still) if value > 0]
    ratio = lambda errors: float(np.mean([errors[k] / still[k] for k in moving]))
    result = {"name": name, "options": list(options), "states": states, "inputs": inputs, "horizon": horizon, "seconds": seconds, "chosen": report["chosen"], "warning": report["warning"], "persistence": still}
    errors, count = by_fleetfoot(fleetfoot, work / "model" / "model.json", work, states, angles, horizon, before, every)
    result |= {"auto": ratio(errors), "starts": count, "of": len(begun)}
    result["printed"] = [[state["state"], *state["rmse"], error] for state, error in zip(report["tested"], errors)]
    result["said"] = float(np.mean([state["rmse"][0] / state["persistence"] for state in report["tested"]]))
    key = json.dumps([states, angles, inputs, horizon, before, period, as_they_come])
    kept = work / "rivals.json"
    if kept.exists() and (known := json.loads(kept.read_text()))["key"] == key:
        return result | known
    rivals, even_train = {"key": key}, [placed(episode) for episode in train]
    try:
        rivals["pysindy"] = ratio(by_pysindy(even_train, rows, begun, states, angles, inputs, period, horizon))
    except Exception as problem:
        rivals["pysindy"] = str(problem)[:80]
    lagged = [ratio(by_lags(even_train, rows, begun, states, angles, inputs, lags, horizon)) for lags in LAGS]
    rivals["arx"] = min(lagged)
    plain = work / "hand.toml"
    state = lambda name: f'[states."{name}"]\n' + ('kind = "angle"\n' if name in angles else "")
    plain.write_text("".join(map(state, states)) + "".join(f'[inputs."{name}"]\n' for name in inputs) + (f"[time]\nrate = {rate[1]}\n" if rate and not as_they_come else ""))
    best = []
    linear = ["pwa", "--predict", "delta", "--partition", "average"]
    for words, seen in [(linear, 1), *hands(1 / period, horizon)]:
        try:
            file = tried(fleetfoot, work, plain, list(words))
            error = ratio(by_fleetfoot(fleetfoot, file, work, states, angles, horizon, before, seen)[0])
        except (RuntimeError, subprocess.TimeoutExpired) as problem:
            best.append([float("inf"), " ".join(map(str, words)), str(problem)[:200]])
            continue
        best.append([error, " ".join(map(str, words)), ""])
    rivals["linear"] = best[0][0]
    rivals["hands"] = sorted(best, key=lambda entry: entry[0])
    kept.write_text(json.dumps(rivals))
    return result | rivals


def kept(fleetfoot, data, folder, name):
    """The row of a log; that of the same binary and the same scripts is not made twice, so that a run that was ended goes on."""
    digest = hashlib.sha256(b"".join(Path(file).read_bytes() for file in (fleetfoot, __file__, auto_logs.__file__))).hexdigest()
    file = folder / f"{slug(name)}.json"
    if file.exists() and (row := json.loads(file.read_text()))["by"] == digest:
        return row
    row = study(fleetfoot, data, folder, name) | {"by": digest}
    file.write_text(json.dumps(row))
    return row


def slug(name):
    return re.sub(r"[^a-z0-9]+", "-", name)


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    fleetfoot, data, folder = Path(sys.argv[1]).resolve(), Path(sys.argv[2]), Path(sys.argv[3]).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    for name in sys.argv[4:] or auto_logs.all_logs(fleetfoot, data, folder):
        print(json.dumps(kept(fleetfoot, data, folder, name)), flush=True)
