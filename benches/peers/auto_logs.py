"""Logs for the table of `fleetfoot auto`: real recordings, simulated robots, gymnasium's classic control, and the same with bad stamps, noise and delays.

A log is a list of episodes; an episode is a table of columns, the stamps `t` first.
"""

import csv
import shutil
import subprocess

import gymnasium
import numpy as np
import pyarrow.parquet


def read(file, time=None, most=None, every=1):
    """A CSV of numbers, its columns by name; stamps in seconds as `t` (those of a column, or so many seconds a row)."""
    with open(file) as lines:
        rows = list(csv.reader(lines))
    rows = [rows[0], *rows[1::every]][: None if most is None else most + 1]
    table = {}
    for name, values in zip(rows[0], zip(*rows[1:])):
        try:
            table[name] = np.array([float(value) if value else np.nan for value in values])
        except ValueError:
            continue
    if isinstance(time, float):
        table = {"t": time * np.arange(len(rows) - 1), **table}
    elif time is not None:
        table = {"t": table.pop(time), **table}
    return [table]


def simulated(fleetfoot, folder, robot, *options, columns=None, every=1):
    """Runs of a simulated robot, rows of truth as they are recorded."""
    shutil.rmtree(folder / robot, ignore_errors=True)
    words = [fleetfoot, "generate", robot, "--format", "parquet", "-o", folder / robot, *options]
    subprocess.run(list(map(str, words)), check=True, capture_output=True)
    episodes = []
    for file in sorted((folder / robot).glob("*.parquet")):
        table = pyarrow.parquet.read_table(file)
        names = [name for name in table.column_names if columns is None or name in columns]
        signals = {name: table[name].to_numpy(zero_copy_only=False)[::every] for name in names}
        stamps = next(name for name in table.column_names if name in ("t", "time", "stamp", "seconds"))
        t = table[stamps].to_numpy(zero_copy_only=False)[::every].astype("int64" if "ns" in str(table[stamps].type) else float)
        t = (t - t[0]) * 1e-9 if t.dtype.kind == "i" else t - t[0]
        signals.pop(stamps, None)
        episodes.append({"t": t.astype(float), **{k: v.astype(float) for k, v in signals.items() if v.dtype.kind in "fiu"}})
    return episodes


def played(name, states, step, seed, episodes, rows, hold=10):
    """Episodes of an environment of gymnasium under random actions that are held; its own state is logged."""
    environment, random, recorded = gymnasium.make(name).unwrapped, np.random.default_rng(seed), []
    box = environment.action_space
    for episode in range(episodes):
        environment.reset(seed=seed + episode)
        lines = []
        for row in range(rows):
            if row % hold == 0:
                action = box.sample() if hasattr(box, "n") else random.uniform(box.low, box.high).astype(np.float32)
                if hasattr(box, "n"):
                    action = int(random.integers(box.n))
            before = np.array(environment.state, float)
            _, _, ended, _, _ = environment.step(action)
            lines.append([row * step, *before, float(np.ravel(action)[0])])
            if ended:
                break
        if len(lines) > 40:
            recorded.append(dict(zip(("t", *states, "action"), np.array(lines).T)))
    return recorded


def cart(seed, rows, step=0.02, delay=0):
    """A cart on a spring with dry friction, pulled by a force that is held; the force acts `delay` rows late."""
    random, x, v, u = np.random.default_rng(seed), 0.3, 0.0, 0.0
    lines, forces = [], [0.0] * (delay + 1)
    for row in range(rows):
        if row % 15 == 0:
            u = 2 * random.normal()
        forces.append(u)
        lines.append([row * step, x, v, u])
        for _ in range(4):
            a = 2 * forces[-1 - delay] - 1.5 * v - 3 * np.sin(x) - 0.5 * np.tanh(20 * v)
            x, v = x + step / 4 * v, v + step / 4 * a
    return [dict(zip(("t", "x", "v", "u"), np.array(lines).T))]


def noisy(episodes, share, columns, seed=7):
    """White noise on some columns: a share of their standard deviation."""
    random = np.random.default_rng(seed)
    spread = {name: np.std(np.concatenate([episode[name] for episode in episodes])) for name in columns}
    return [{name: values + share * spread[name] * random.normal(size=len(values)) if name in columns else values for name, values in episode.items()} for episode in episodes]


def jittered(episodes, share=0.3, seed=8):
    """Rows measured at stamps that scatter about even ones by a share of the period."""
    random, measured = np.random.default_rng(seed), []
    for episode in episodes:
        t = episode["t"]
        at = np.clip(t + share * (t[1] - t[0]) * random.uniform(-1, 1, len(t)), t[0], t[-1])
        measured.append({"t": at, **{name: held_or_between(at, t, values) for name, values in episode.items() if name != "t"}})
    return measured


def held_or_between(at, t, values):
    """Values between rows: those that are held stay, others go along lines."""
    if np.mean(np.diff(values) == 0) > 0.5:
        return values[np.clip(np.searchsorted(t, at, "right") - 1, 0, len(t) - 1)]
    return np.interp(at, t, values)


def burst(episodes, size=4):
    """Rows whose stamps are those of arrival: `size` of them come together, a tenth of a period apart."""
    bursts = []
    for episode in episodes:
        t, rows = episode["t"], np.arange(len(episode["t"]))
        period, last = t[1] - t[0], np.minimum((rows // size + 1) * size - 1, len(t) - 1)
        bursts.append({**episode, "t": t[last] + 0.1 * period * (rows % size)})
    return bursts


def dropped(episodes, share=0.05, seed=9):
    """Rows without some of them."""
    random = np.random.default_rng(seed)
    kept = [np.concatenate([[True], random.uniform(size=len(episode["t"]) - 1) > share]) for episode in episodes]
    return [{name: values[keep] for name, values in episode.items()} for episode, keep in zip(episodes, kept)]


def turtlebot(file):
    """Pose and speeds of the odometry messages of a bag."""
    from mcap_ros2.reader import read_ros2_messages

    rows = []
    for message in read_ros2_messages(str(file), topics=["/odom"]):
        odometry = message.ros_msg
        stamp = odometry.header.stamp.sec + 1e-9 * odometry.header.stamp.nanosec
        p, q, twist = odometry.pose.pose.position, odometry.pose.pose.orientation, odometry.twist.twist
        yaw = np.arctan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y**2 + q.z**2))
        rows.append([stamp, p.x, p.y, yaw, twist.linear.x, twist.angular.z])
    return [dict(zip(("t", "x", "y", "yaw", "v", "w"), np.array(rows).T))]


def all_logs(fleetfoot, data, folder):
    """The logs by name: a function that makes one, and the words that name its columns where no rule could know them."""
    fly = data / "neural-fly"
    pendulum = lambda: played("Pendulum-v1", ("theta", "omega"), 0.05, 1, 12, 200)
    diffdrive = lambda: simulated(fleetfoot, folder, "diffdrive", "--seconds", 60, "--runs", 4, columns=("t", "x", "y", "yaw", "v", "w", "v_command", "w_command"))
    return {
        "positioning (real)": (lambda: read(data / "emps.csv", "t"), ()),
        "positioning, pulses (real)": (lambda: read(data / "emps-pulses.csv", "t"), ()),
        "pick and place (real)": (lambda: read(data / "pick-and-place.csv", "t"), ()),
        "damper (simulated)": (lambda: read(data / "bouc-wen.csv", 0.001), ("--states", "x,v,f", "--inputs", "E")),
        "quadrotor in a room (real)": (lambda: read(fly / "nowind.csv", "t"), ()),
        "quadrotor in wind (real)": (lambda: read(fly / "70wind.csv", "t"), ("--states", "v_x,v_y,v_z", "--inputs", "R_13,R_23,R_33,T_sp")),
        "airliner (real)": (lambda: read(data / "a320-flight.csv", 1.0), ("--time", "t", "--time-unit", "s")),
        "quadrotor on a stand (real)": (lambda: read(data / "crazyflie-thrust.csv", "t_s"), ()),
        "turtlebot (real)": (lambda: turtlebot(data / "mcap" / "nav2_turtlebot.mcap"), ()),
        "hybrid drive (simulated)": (lambda: [{k: v for k, v in read(data / "hybrid-diff-drive.csv", "t")[0].items() if k in ("t", "x", "phi", "xd", "phid", "u1", "u2")}], ()),
        "wheeled robot (simulated)": (diffdrive, ()),
        "quadrotor (simulated)": (lambda: simulated(fleetfoot, folder, "quadrotor", "--seconds", 60, columns=("t", "vx", "vy", "vz", "yaw", "pitch", "roll", "wx", "wy", "wz", "u_1", "u_2", "u_3", "u_4"), every=5), ()),
        "hexapod (simulated)": (lambda: simulated(fleetfoot, folder, "hexapod", "--seconds", 40, columns=("t", "vx", "vy", "wz", "alpha_l", "alpha_r", "alpha_l_rate", "alpha_r_rate", "u_v", "u_w"), every=4), ()),
        "stage (simulated)": (lambda: simulated(fleetfoot, folder, "stage", "--seconds", 40, columns=("t", "q", "qd", "u")), ()),
        "pendulum (gymnasium)": (pendulum, ()),
        "mountain car (gymnasium)": (lambda: played("MountainCarContinuous-v0", ("position", "velocity"), 0.1, 3, 12, 300), ()),
        "acrobot (gymnasium)": (lambda: played("Acrobot-v1", ("theta1", "theta2", "omega1", "omega2"), 0.2, 4, 12, 200, 4), ("--inputs", "action", "--states", "theta1,theta2,omega1,omega2")),
        "cart, force late by 7 rows": (lambda: cart(5, 4000, delay=7), ()),
        "cart, noise of 5 %": (lambda: noisy(cart(6, 4000), 0.05, ("x", "v")), ()),
        "pendulum, stamps that jitter": (lambda: jittered(pendulum()), ()),
        "wheeled robot, stamps in bursts": (lambda: burst(diffdrive()), ()),
        "cart, 5 % of the rows dropped": (lambda: dropped(cart(7, 4000)), ()),
    }
