"""The tables `raw_hexapod` and `raw_models` of docs/results/hexapod-raw-logs.md: the simulated hexapod's raw logs, of three computers, jittered and with gross errors, against the truth.

Runs of 120 s, ten unless `results.py --seeds` says otherwise, and models of a fleet of runs. `fleetfoot prepare` has what a real robot would log; the rows of truth are those of the same seed, written as Parquet.
"""

import subprocess

import numpy as np
import pyarrow as arrow
import pyarrow.parquet as parquet

SEEDS, SECONDS, SPEED = range(1, 11), 120, 0.25
# When the controller first switches the lamp.
LAMP = 0.500_381_966
# Offset and skew of the clocks in the default world against the controller's clock, which shows true time: s and s/s.
ROBOT, MOCAP = (0.125, 25e-6), (-0.04, -10e-6)
POSE, IMU, CRANK = "/mocap/pose.pose", "/imu/data", "/joint_states.position"
# The unit gives the mean force of the millisecond before its stamp.
FORCE = f"{IMU}.linear_acceleration"
QUATERNION = [f"{POSE}.orientation.{axis}" for axis in "xyzw"]

# Turn from the attitude before a sample to the one after it, in the trunk's axes: half the turn's tangent is x over w, whatever the signs of the quaternions. A component of the turn over two periods is the mean of that rate; of its
# size the mean is another one, and impacts, which turn the trunk there and back, are not alike forwards and backwards in time.
BEFORE, AFTER = ({axis: f"{by}({POSE}.orientation.{axis}, 1)" for axis in "xyzw"} for by in ("lag", "lead"))
TURN = {
    "x": f"{BEFORE['w']}*{AFTER['x']} - {BEFORE['x']}*{AFTER['w']} - {BEFORE['y']}*{AFTER['z']} + {BEFORE['z']}*{AFTER['y']}",
    "w": " + ".join(f"{BEFORE[axis]}*{AFTER[axis]}" for axis in "xyzw"),
}

COLUMNS = f"""[columns]
turned = "2*({TURN['x']})/({TURN['w']})/(lead(time(), 1) - lag(time(), 1))"
x = "{POSE}.position.x"
y = "{POSE}.position.y"
z = "{POSE}.position.z"
yaw = "yaw({POSE}.orientation)"
pitch = "pitch({POSE}.orientation)"
roll = "roll({POSE}.orientation)"
wx = "{IMU}.angular_velocity.x"
wy = "{IMU}.angular_velocity.y"
wz = "{IMU}.angular_velocity.z"
alpha_l = "{CRANK}[left_crank]"
alpha_r = "{CRANK}[right_crank]"
"""
BY_MOTION, BY_WAVE = '["wx", "turned"]', '["/robot/sync.illuminance", "/mocap/sync.illuminance"]'


# The robot's clock by the lamp that the controller switches, then that of the motion capture by what the robot felt: both beside the controller's.
CLOCKS = f"""[clocks.robot]
topics = ["/imu/*", "/joint_states", "/robot/*", "/motor/*"]
wave = ["/controller/sync.illuminance", "/robot/sync.illuminance"]
even = true
[clocks.mocap]
topics = ["/mocap/*"]
motion = {BY_MOTION}
"""
# That of the motion capture beside the robot's, by a lamp that both see.
SEEN = f"""[clocks.mocap]
topics = ["/mocap/*"]
wave = {BY_WAVE}
[prepare]
dejitter = true
method = "none"
[states]
x = {{}}
"""


RAW = f"""[time]
base = "{IMU}"
[prepare]
method = "none"
[states]
""" + "".join(f"{name} = {{}}\n" for name in ("wx", "wy", "wz", "x", "y", "z", "pitch", "roll")) + "".join(
    f'{name} = {{ kind = "angle" }}\n' for name in ("yaw", "alpha_l", "alpha_r")
)
SPLINE = RAW.replace('method = "none"', 'method = "cubic"\ndejitter = true') + "".join(
    f'[channels.{name}]\nmethod = "quintic"\n' for name in ("x", "y", "z", "alpha_l", "alpha_r")
)
BODY = f"""[prepare]
dejitter = true
[body]
gravity = [0.0, 0.0, -9.81]
[sensor.gyro]
kind = "gyro"
channels = [{', '.join(f'"{IMU}.angular_velocity.{axis}"' for axis in 'xyz')}]
[sensor.accelerometer]
kind = "accelerometer"
average = 0.001
channels = [{', '.join(f'"{FORCE}.{axis}"' for axis in 'xyz')}]
[sensor.mocap]
kind = "pose"
delay = "auto"
channels = [{', '.join(f'"{POSE}.position.{axis}"' for axis in 'xyz')}, {', '.join(f'"{q}"' for q in QUATERNION)}]
""" + "".join(f"""[joint.alpha_{side}]
unit = "rad"
kind = "angle"
sensors = ["encoder_{side}"]
[sensor.encoder_{side}]
kind = "position"
channels = ["{CRANK}[{name}_crank]"]
resolution = 3.835e-4
""" for side, name in (("l", "left"), ("r", "right")))

# Estimates by the readings up to the instant of a row.
FILTER = BODY.replace("[body]", '[body]\nestimate = "filter"').replace('unit = "rad"', 'unit = "rad"\nestimate = "filter"')


def read(file, seconds=False):
    """The columns of a Parquet file, and the seconds of its stamps since the run's beginning."""
    table = parquet.read_table(file)
    stamp = next(name for name, kind in zip(table.schema.names, table.schema.types) if str(kind).startswith("timestamp"))
    columns = {name: table[name].to_numpy() for name in table.schema.names if name != stamp}
    stamps = table[stamp].cast("timestamp[ns]").cast("int64").to_numpy()
    return (stamps - 1_735_689_600_000_000_000) * 1e-9, columns


def rotation(roll, pitch, yaw):
    """Trunk to world, as matrices."""
    (sr, cr), (sp, cp), (sy, cy) = ((np.sin(angle), np.cos(angle)) for angle in (roll, pitch, yaw))
    rows = [[cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr], [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr], [-sp, cp * sr, cp * cr]]
    return np.moveaxis(np.array(rows), 2, 0)


def change(time, values):
    """Central differences: what `fit` makes of states whose derivative nobody gives."""
    return np.gradient(values, time)


STATES = ("x", "y", "z", "yaw", "pitch", "roll", "alpha_l", "alpha_r", "vx", "vy", "vz", "wx", "wy", "wz", "alpha_l_rate", "alpha_r_rate")
ANGLES = ("yaw", "pitch", "roll", "alpha_l", "alpha_r")


def unwrapped(angle):
    """Without its jumps of a turn; what is missing stays so."""
    sound, out = np.isfinite(angle), np.full(len(angle), np.nan)
    out[sound] = np.unwrap(angle[sound])
    return out


def whole(time, columns):
    """Angles without their jumps, and what has no derivative of its own by differences."""
    for name in STATES:
        if name in columns:
            columns[name] = unwrapped(columns[name]) if name in ANGLES else columns[name]
            columns.setdefault(f"{name}_dot", change(time, columns[name]))
    return columns


def in_trunk(columns, velocity, acceleration):
    """Velocity and how it changes in the trunk's axes, of those in the world."""
    to_trunk = rotation(columns["roll"], columns["pitch"], columns["yaw"]).transpose(0, 2, 1)
    velocity, acceleration = (np.einsum("nij,nj->ni", to_trunk, np.stack(list(v), 1)) for v in (velocity, acceleration))
    acceleration -= np.cross(np.stack([columns[f"w{axis}"] for axis in "xyz"], 1), velocity)
    for at, axis in enumerate("xyz"):
        columns[f"v{axis}"], columns[f"v{axis}_dot"] = velocity[:, at], acceleration[:, at]


def from_raw(time, columns):
    velocity = [change(time, columns[axis]) for axis in "xyz"]
    for side in "lr":
        columns[f"alpha_{side}_rate"] = change(time, unwrapped(columns[f"alpha_{side}"]))
    in_trunk(columns, velocity, [change(time, v) for v in velocity])
    return whole(time, columns)


def from_spline(time, columns):
    in_trunk(columns, [columns[f"{axis}_dot"] for axis in "xyz"], [columns[f"{axis}_ddot"] for axis in "xyz"])
    cranks(columns)
    return whole(time, columns)


def cranks(columns):
    """Rates and accelerations of the cranks by the names of the truth."""
    for side in "lr":
        for end in ("", "_deviation"):
            columns[f"alpha_{side}_rate{end}"] = columns[f"alpha_{side}_dot{end}"]
            if f"alpha_{side}_ddot{end}" in columns:
                columns[f"alpha_{side}_rate_dot{end}"] = columns[f"alpha_{side}_ddot{end}"]


def from_body(time, columns):
    velocity, acceleration = ([columns[f"{kind}{axis}"] for axis in "xyz"] for kind in "va")
    deviations = {f"v{axis}_deviation": columns[f"v{axis}_deviation"] for axis in "xyz"}
    for axis in "xyz":
        columns[f"{axis}_dot"] = columns[f"v{axis}"]
    cranks(columns)
    in_trunk(columns, velocity, acceleration)
    # The deviation of a velocity is about the world's axes, of an attitude about the trunk's: near the middle of the belt and upright they are those of the trunk and the angles.
    columns |= deviations | {f"{angle}_deviation": columns[f"attitude_{axis}_deviation"] for angle, axis in (("roll", "x"), ("pitch", "y"), ("yaw", "z"))}
    return whole(time, columns)


# Three numbers each whose stated deviations are held against their errors together.
BLOCKS = {
    "attitude": ("roll", "pitch", "yaw"), "position": ("x", "y", "z"), "velocity": ("vx", "vy", "vz"), "rate": ("wx", "wy", "wz"),
    "bias of the gyroscope": [f"gyro_bias_{axis}" for axis in "xyz"], "bias of the accelerometer": [f"accelerometer_bias_{axis}" for axis in "xyz"],
}
# The 95 % quantile of chi squared of three numbers.
CHI_SQUARED = 7.815


class Truth:
    """The rows of truth of a seed."""

    def __init__(self, file):
        self.time, columns = read(file)
        self.outliers = self.time[(columns["mocap_outlier"] == 1.0) & (columns["mocap_missing"] == 0.0)]
        self.poses = int((columns["mocap_missing"] == 0.0)[np.round(self.time * 1e3).astype(int) % 10 == 0].sum())
        # The derivatives of the rows, as a fit from the truth has them.
        biases = {name: columns[name] for name in columns if "_bias_" in name}
        self.columns = whole(self.time, {name: columns[name] for name in STATES} | biases)
        self.missed = missed(columns, 10)

    def errors(self, time, columns, name):
        """Of the rows but for the first and the last second."""
        inside = (time > 1.0) & (time < SECONDS - 1.0) & np.isfinite(columns[name])
        error = columns[name][inside] - np.interp(time[inside], self.time, self.columns[name])
        return inside, error - 2 * np.pi * np.round(np.median(error) / (2 * np.pi)) if name in ANGLES else error


def turned(vectors):
    """Rotation matrices of rotation vectors (Rodrigues)."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    cross = np.moveaxis(np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]), 2, 0)
    angle = np.linalg.norm(vectors, axis=1)[:, None, None]
    return np.eye(3) + np.sinc(angle / np.pi) * cross + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * (cross @ cross)


def missed(columns, rows):
    """Turn that the true rates, sampled at 1 kHz and without noise, miss, as a density of white noise about each axis: deviation of the turn missed in so many rows over the root of their time."""
    attitude = rotation(columns["roll"], columns["pitch"], columns["yaw"])
    rates = np.stack([columns[f"w{axis}"] for axis in "xyz"], 1)
    left = turned(0.5e-3 * (rates[1:] + rates[:-1])).transpose(0, 2, 1) @ attitude[:-1].transpose(0, 2, 1) @ attitude[1:]
    angles = 0.5 * np.stack([left[:, 2, 1] - left[:, 1, 2], left[:, 0, 2] - left[:, 2, 0], left[:, 1, 0] - left[:, 0, 1]], 1)
    sums = np.add.reduceat(angles, np.arange(0, len(angles) - rows + 1, rows), axis=0)[:-1]
    return np.sqrt(np.mean(sums**2, axis=0) / (rows * 1e-3))


def generate(bench, folder, *options):
    words = [bench.fleetfoot, "generate", "hexapod", "--seconds", SECONDS, "--runs", 1, "--speed", SPEED, *options, "-o", folder, "--force"]
    subprocess.run(list(map(str, words)), cwd=bench.folder, check=True, capture_output=True)


def prepared(bench, name, recipe, logs):
    bench.write(f"{name}.toml", recipe)
    report = bench.run("prepare", "-c", f"{name}.toml", logs, "-o", name, "--force")
    files = [bench.folder / name / piece["file"] for episode in report["episodes"] for piece in episode["pieces"]]
    parts = [read(file) for file in files]
    signals = {key: np.concatenate([columns[key] for _, columns in parts]) for key in parts[0][1]}
    return report, np.concatenate([time for time, _ in parts]), signals


def ahead(report, clock):
    return next(entry for entry in report["clocks"] if entry["clock"] == clock)


def off(estimate, clock, reference=(0.0, 0.0), start=0.0):
    """Errors of offset (s) and skew (s/s), and whether the truth lies in the stated intervals; `start` is when the channel that was compared with begins."""
    at = estimate["at"] + start
    skew = (1 + clock[1]) / (1 + reference[1]) - 1
    offset = clock[0] - reference[0] + skew * at
    inside = all(low <= truth <= high for truth, (low, high) in ((offset, estimate["offset_interval"]), (skew, estimate["skew_interval"])))
    return estimate["offset"] - offset, estimate["skew"] - skew, inside


def seed_of(bench, seed):
    """Results of the run of a seed."""
    generate(bench, "raw", "--seed", seed)
    generate(bench, "truth", "--seed", seed, "--format", "parquet")
    truth = Truth(bench.folder / "truth" / "hexapod_00.parquet")
    results = {"truth": truth}
    # Stamps as they are contradict an even lamp, which `prepare` refuses.
    jittered, even = COLUMNS + CLOCKS.replace("even = true\n", ""), COLUMNS + CLOCKS
    for name, recipe, make in (("raw", jittered + RAW, from_raw), ("spline", even + SPLINE, from_spline), ("filter", even + FILTER, from_body), ("smoother", even + BODY, from_body)):
        report, time, columns = prepared(bench, f"{name}_out", recipe, "raw")
        results[name] = report, {}, {}
        columns = results["columns"] = make(time, columns)
        for state in STATES:
            for key in (state, f"{state}_dot"):
                if key in columns:
                    inside, error = truth.errors(time, columns, key)
                    results[name][1][key] = np.sqrt(np.mean(error**2))
                    if f"{key}_deviation" in columns:
                        stated = columns[f"{key}_deviation"][inside]
                        finite = np.isfinite(stated)
                        results[name][2][key] = np.sqrt(np.mean(stated[finite] ** 2)), np.mean(np.abs(error[finite]) < 1.96 * stated[finite])
    columns = results.pop("columns")
    scores = {name: [truth.errors(time, columns, key) for key in keys] for name, keys in BLOCKS.items()}
    scores = {name: [error / columns[f"{key}_deviation"][inside] for key, (inside, error) in zip(BLOCKS[name], pairs)] for name, pairs in scores.items()}
    results["blocks"] = {name: np.sum(np.square(scaled), axis=0) for name, scaled in scores.items()}
    generate(bench, "even", "--seed", seed, "--set", "sync.period=1.0")
    bench.write("even.toml", COLUMNS + SEEN)
    results["even"] = bench.run("prepare", "-c", "even.toml", "even", "-o", "even_out", "--force")
    return results


def number(value):
    return "-" if value is None or not np.isfinite(value) else f"{value:.3g}"


def clock_table(runs):
    yield "| seed | robot to controller: us, ppm off (in the bracket) | motion capture to controller by motion: us, ppm off (in the interval) | the same with the delay of the fusion: us | by a wave of 1 s: bracket, ms (truth in it) | gross errors left out, of | good poses lost, of |"
    yield "|---:|---|---|---:|---|---|---|"
    for seed, results in runs.items():
        report, truth = results["smoother"][0], results["truth"]
        by_lamp = off(ahead(report, "robot"), ROBOT, start=LAMP)
        by_motion = off(ahead(report, "mocap"), MOCAP)
        # Poses that are still late after the clock was corrected were stamped by so much more.
        fused = by_motion[0] + report["body"]["delay"]
        even = ahead(results["even"], "mocap")
        bracket = even["offset_interval"]
        says = lambda error: f"{1e6 * error[0]:.1f}, {1e6 * error[1]:.3f} ({'yes' if error[2] else 'no'})"
        spans = [span for log in report["body"]["rejected"] for span in log["positions"]["spans"]]
        rows = sum(log["positions"]["rows"] for log in report["body"]["rejected"])
        known = [any(abs(time - low) < 0.2 for low, _ in spans) for time in truth.outliers]
        left = sum(known)
        yield f"| {seed} | {says(by_lamp)} | {says(by_motion)} | {1e6 * fused:.1f} | {1e3 * (bracket[1] - bracket[0]):.2f} ({'yes' if off(even, MOCAP, ROBOT)[2] else 'no'}) | {left} of {len(known)} | {rows - left} of {truth.poses - len(known)} |"


def pooled(runs, name, key, which=1):
    values = [results[name][which][key] for results in runs.values() if name in results and key in results[name][which]]
    if not values:
        return None
    return np.sqrt(np.mean(np.square(values))) if which == 1 else (np.sqrt(np.mean([stated**2 for stated, _ in values])), np.mean([share for _, share in values]))


def state_table(runs):
    yield "| error of a column | raw | spline | filter | smoother | stated deviation | error within 1.96 of it |"
    yield "|---|---:|---:|---:|---:|---:|---:|"
    for key in [*STATES, *(f"{name}_dot" for name in STATES)]:
        errors = {name: pooled(runs, name, key) for name in ("raw", "spline", "filter", "smoother")}
        best = min((error for error in errors.values() if error is not None), default=None)
        cells = [f"**{number(error)}**" if error is not None and error == best else number(error) for error in errors.values()]
        stated = pooled(runs, "smoother", key, 2) or pooled(runs, "spline", key, 2)
        cells += [number(stated[0]), f"{stated[1]:.0%}"] if stated else ["-", "-"]
        yield f"| {key} | {' | '.join(cells)} |"


def doubtful(runs):
    """Names of the states whose errors exceed 1.96 stated deviations too often."""
    stated = {name: pooled(runs, "smoother", name, 2) or pooled(runs, "spline", name, 2) for name in [*STATES, *(f"{name}_dot" for name in STATES)]}
    failing = [f"{name} ({pair[1]:.0%})" for name, pair in stated.items() if pair and pair[1] < 0.9]
    yield "Errors beyond 1.96 stated deviations in more than a tenth of the rows: " + (", ".join(failing) or "none") + "."


def block_table(runs):
    yield "| state of the smoother | sum of the squares of three errors, in stated deviations: its mean over 3 | rows in which it is below the 95 % of its law |"
    yield "|---|---:|---:|"
    for name in BLOCKS:
        squares = np.concatenate([results["blocks"][name] for results in runs.values()])
        yield f"| {name} | {np.mean(squares) / 3:.2f} | {np.mean(squares < CHI_SQUARED):.1%} |"


PERIOD = 1e-3
# Noise by the world file, of the axes together, and by a report with its deviation: of single readings, then of the integrals between poses. A converter's steps add 2 % to the readings of the rate.
WORLD = {
    "single readings of the rate, rad/s": (1.4e-3, lambda body: axes(body, "reading_noise", 0)),
    "density of the rate, rad/s/sqrt(Hz)": (1.4e-3 * PERIOD**0.5, lambda body: axes(body, "imu_noise", 0)),
    "density of the force, m/s^2/sqrt(Hz)": (0.063 * PERIOD**0.5, lambda body: axes(body, "imu_noise", 1)),
    "walk of the rate's bias, rad/s^2/sqrt(Hz)": (1e-4, lambda body: component(body, "imu_walk", 0)),
    "walk of the force's bias, m/s^3/sqrt(Hz)": (1e-3, lambda body: component(body, "imu_walk", 1)),
    "position, m": (27e-6, lambda body: component(body, "pose_noise", 0)),
    "attitude, rad": (0.0026, lambda body: component(body, "pose_noise", 1)),
    "turn missed by rates where they jump": (None, lambda body: component(body, "imu_missed", 0)),
}


def axes(body, key, which):
    """The root of the mean square over the axes, and the greatest share that an axis deviates by."""
    values, deviations = (np.array(body[f"{key}{end}"][which], dtype=float) for end in ("", "_deviation"))
    return np.sqrt(np.mean(values**2)), np.max(deviations / values)


def component(body, key, which):
    value, deviation = body[key][which], body[f"{key}_deviation"][which]
    return value, np.nan if deviation is None else deviation / value


def noise_table(runs):
    bodies = [results["smoother"][0]["body"] for results in runs.values()]
    yield "| noise | world file | estimate, least to greatest of the seeds | stated deviation, greatest | error, root of the mean square of the seeds | seeds within 1.96 deviations | within 10 % |"
    yield "|---|---:|---:|---:|---:|---:|---|"
    for name, (truth, of) in WORLD.items():
        estimates, stated = np.array([of(body) for body in bodies]).T
        row = f"| {name} | {number(truth)} | {estimates.min():.3g} to {estimates.max():.3g} | {stated.max():.1%} |"
        if truth is None:
            yield f"{row} - | - | - |"
            continue
        off = estimates / truth - 1
        inside, near = (int(np.sum(np.abs(off) < bound)) for bound in (1.96 * stated, 0.1))
        yield f"{row} {np.sqrt(np.mean(off**2)):.1%} | {inside} of {len(bodies)} | {near} of {len(bodies)} |"
    missing = np.sqrt(np.mean([results["truth"].missed ** 2 for results in runs.values()], axis=0))
    yield f"| turn missed by true rates at 1 kHz, without noise: all axes; roll, pitch, yaw | {np.sqrt(np.mean(missing**2)):.3g}; {', '.join(f'{value:.3g}' for value in missing)} | | | | | |"


def tables(runs):
    """Tables of the runs, seed by seed."""
    return "\n\n".join("\n".join(part(runs)) for part in (clock_table, state_table, doubtful, block_table, noise_table))


def table(bench):
    runs = {}
    for seed in SEEDS:
        runs[seed] = seed_of(bench, seed)
        print(f"seed {seed}", flush=True)
    return tables(runs)


# Runs that train and runs that test, of how many seconds, and their seeds.
TRAIN, TEST = (20, 60, 21), (6, 60, 22)
PARTITIONS = {"null": "null", "average": "average", "kmeans:10": "kmeans10", "kmeans:50": "kmeans50"}
TIMES = (1, 11, 40, 100, 200)


def fleet(bench, folder, runs, *options):
    count, seconds, seed = runs
    words = [bench.fleetfoot, "generate", "hexapod", "--runs", count, "--minutes", count * seconds / 60, "--seed", seed, "--speed", "0.1:0.5", *options, "-o", folder]
    subprocess.run(list(map(str, words)), cwd=bench.folder, check=True, capture_output=True)


def as_truth(file, out):
    """Prepared rows under the names of the truth's columns: velocities in the trunk's axes, cranks' rates."""
    rows = parquet.read_table(file)
    columns = {name: rows[name].to_numpy() for name in rows.schema.names if name != "t"}
    to_trunk = rotation(columns["roll"], columns["pitch"], columns["yaw"]).transpose(0, 2, 1)
    velocity = np.einsum("nij,nj->ni", to_trunk, np.stack([columns[f"v{axis}"] for axis in "xyz"], 1))
    columns |= {f"v{axis}": velocity[:, at] for at, axis in enumerate("xyz")} | {f"alpha_{side}_rate": columns[f"alpha_{side}_dot"] for side in "lr"}
    parquet.write_table(arrow.table({"t": rows["t"], **{name: columns[name] for name in (*STATES, "u_v", "u_w")}}), out)


def models(bench):
    """Piecewise-affine models of prepared raw logs beside those of the truth of the same runs, both by the recipe of the truth, and both held against the truth of other runs."""
    fleet(bench, "fleet", TRAIN)
    fleet(bench, "truth", TRAIN, "--format", "parquet")
    fleet(bench, "test", TEST, "--format", "parquet")
    commands = "[inputs]\n" + "".join(f'{name} = "/cmd_vel.twist.{field}"\n' for name, field in (("u_v", "linear.x"), ("u_w", "angular.z")))
    # Slow runs turn too little to estimate their clocks by motion: a lamp that both see gives the offset, and the fusion the rest.
    lamp = CLOCKS.replace(f"motion = {BY_MOTION}", 'wave = ["/controller/sync.illuminance", "/mocap/sync.illuminance"]\neven = true')
    bench.write("body.toml", COLUMNS + lamp + BODY + commands)
    report = bench.run("prepare", "-c", "body.toml", "fleet", "-o", "clean")
    (bench.folder / "raw").mkdir()
    for episode in report["episodes"]:
        for piece in episode["pieces"]:
            as_truth(bench.folder / "clean" / piece["file"], bench.folder / "raw" / piece["file"])
    first, second = [], []
    for source in ("truth", "raw"):
        fit = bench.run("fit", "pwa", "-c", "truth/robot.toml", source, "--partition", ",".join(PARTITIONS), "--folds", 10, "--keep-all", "-o", f"{source}.json")
        first.append((source, fit))
        for partition, name in PARTITIONS.items():
            model = f"{source}_{name}.json"
            score = bench.run("score", model, "test")
            rollout = bench.run("rollout", model, "test", "--horizon", max(TIMES), "--starts", 1000, "--controller", "treadmill")
            second.append((source, partition, score, rollout))
    targets = first[0][1]["targets"]
    yield f"| rows held out in turn | {' | '.join(targets)} |"
    yield "|---" * (len(targets) + 1) + "|"
    for source, fit in first:
        for candidate in fit["candidates"]:
            yield f"| {source}: {candidate['partition']} | {' | '.join(number(interval['value']) for interval in candidate['mae_over_null_intervals'])} |"
    yield ""
    yield f"| truth of other runs | {' | '.join(targets)} |"
    yield "|---" * (len(targets) + 1) + "|"
    for source, partition, score, _ in second:
        yield f"| {source}: {partition} | {' | '.join(number(target['mae_over_null']['value']) for target in score['targets'])} |"
    yield ""
    yield f"| free runs beside the truth of other runs | {' | '.join(f'{time} ms' for time in TIMES)} | diverged |"
    yield "|---" * (len(TIMES) + 2) + "|"
    for source, partition, _, rollout in second:
        yield f"| {source}: {partition} | {' | '.join(number(rollout['model']['mahalanobis'][time - 1][0]) for time in TIMES)} | {rollout['diverged']} of {rollout['rollouts']} |"
    yield ""
    rows = {source: fit["rows"] for source, fit in first}
    yield f"{TRAIN[0]} runs of {TRAIN[1]} s at 0.1 to 0.5 m/s: {rows['truth']:,} rows of truth, {rows['raw']:,} prepared; {TEST[0]} other runs, 1,000 starts, the controller closing the loop."


def models_table(bench):
    return "\n".join(models(bench))
