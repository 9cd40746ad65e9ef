"""Imu messages of a large ROS 1 bag and of a large rosbag2 database, beside rosbags: rosbags_imu.py FOLDER FLEETFOOT [GIGABYTES [TIMES]].

Makes `imu.bag` and `imu.db3` in FOLDER by rosbags, 1 GB each unless said otherwise: `/imu` at 200 Hz, and `/points` of 16 kB after every twentieth
message, which nobody wants. Then, TIMES (3) times in turn and timed as whole processes:
- `fleetfoot scan` of the angular velocities and accelerations, without its cache;
- rosbags: the messages of `/imu` become objects, and these six numbers of each go into an array.

The answers are compared: rows, least and largest values of `fleetfoot info --values`. Prints one JSON line a file: the fastest seconds of both (wall and
processor), their ratio, and the peak of fleetfoot's memory. The files are removed.

Needs rosbags, numpy.
"""

import importlib.metadata
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

FIELDS = [f"{part}.{axis}" for part in ("angular_velocity", "linear_acceleration") for axis in "xyz"]
START = 1_700_000_000_000_000_000
#: Bytes of twenty Imu messages and one of points.
ROUND = 20 * 340 + 16_000


def write(path: Path, rounds: int):
    is_first = path.suffix == ".bag"
    store = get_typestore(Stores.ROS1_NOETIC if is_first else Stores.ROS2_HUMBLE)
    types = store.types
    imu, points = "sensor_msgs/msg/Imu", "std_msgs/msg/ByteMultiArray"
    pack = store.serialize_ros1 if is_first else store.serialize_cdr
    random = np.random.default_rng(1)
    blob = types[points](types["std_msgs/msg/MultiArrayLayout"]([], 0), random.integers(0, 100, 16_000).astype(np.int8))
    blob = pack(blob, points)
    covariance = np.arange(9.0)
    quaternion = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.6, 0.8)
    vector, stamp, header = types["geometry_msgs/msg/Vector3"], types["builtin_interfaces/msg/Time"], types["std_msgs/msg/Header"]
    writer = Writer1(path) if is_first else Writer2(path.with_suffix(""), version=9)
    with writer:
        topics = [writer.add_connection(*topic, typestore=store) for topic in (("/imu", imu), ("/points", points))]
        for turn in range(rounds):
            for sample, numbers in enumerate(random.standard_normal((20, 6)).tolist()):
                at = START + 5_000_000 * (20 * turn + sample)
                head = header(seq=0, stamp=stamp(at // 10**9, at % 10**9), frame_id="imu") if is_first else header(
                    stamp=stamp(at // 10**9, at % 10**9), frame_id="imu"
                )
                message = types[imu](head, quaternion, covariance, vector(*numbers[:3]), covariance, vector(*numbers[3:]), covariance)
                writer.write(topics[0], at, pack(message, imu))
            writer.write(topics[1], at + 1_000, blob)
    if not is_first:
        (path.with_suffix("") / path.name).rename(path)
        (path.with_suffix("") / "metadata.yaml").unlink()
        path.with_suffix("").rmdir()


def peer(path: Path):
    """The wanted numbers, of one process."""
    rows = []
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        connections = [candidate for candidate in reader.connections if candidate.topic == "/imu"]
        for connection, _, raw in reader.messages(connections=connections):
            message = reader.deserialize(raw, connection.msgtype)
            w, a = message.angular_velocity, message.linear_acceleration
            rows.append((w.x, w.y, w.z, a.x, a.y, a.z))
    return np.array(rows)


def timed(command):
    """Wall and processor seconds of a process, and its peak memory in MiB."""
    begin = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    message = process.stderr.read().decode()
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(message)
    return time.perf_counter() - begin, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def compare(path: Path, fleetfoot: str, times: int):
    recipe = path.with_suffix(".toml")
    names = [field.replace(".", "_") for field in FIELDS]
    columns = "\n".join(f'{name} = "/imu.{field}"' for name, field in zip(names, FIELDS, strict=True))
    states, inputs = ("\n".join(f"{name} = {{}}" for name in part) for part in (names[:3], names[3:]))
    recipe.write_text(f"[columns]\n{columns}\n[states]\n{states}\n[inputs]\n{inputs}\n")
    out = path.with_suffix(".stats")
    scan = [fleetfoot, "scan", "-c", str(recipe), str(path), "--predict", "delta", "--no-cache", "-o", str(out)]
    ours, other = [], []
    for _ in range(times):
        out.unlink(missing_ok=True)
        ours.append(timed(scan))
        other.append(timed([sys.executable, __file__, "--peer", str(path)]))
    rows = peer(path)
    info = json.loads(subprocess.run([fleetfoot, "info", "--values", "--json", str(path)], capture_output=True, check=True).stdout)[0]
    by_name = {column["name"]: column for column in info["columns"]}
    for place, field in enumerate(FIELDS):
        column = by_name[f"/imu.{field}"]["statistics"]
        for key, value in (("min", rows[:, place].min()), ("max", rows[:, place].max())):
            assert column[key] == value, (field, key, column, value)
    least = lambda all, key: min(run[key] for run in all)
    print(
        json.dumps(
            {
                "file": path.name,
                "bytes": path.stat().st_size,
                "messages": len(rows),
                "rosbags": importlib.metadata.version("rosbags"),
                "seconds": [round(least(ours, 0), 3), round(least(other, 0), 3)],
                "processor": [round(least(ours, 1), 3), round(least(other, 1), 3)],
                "ratio": round(least(other, 0) / least(ours, 0), 1),
                "ratio_processor": round(least(other, 1) / least(ours, 1), 1),
                "peak_mib": [round(max(run[2] for run in all)) for all in (ours, other)],
            }
        ),
        flush=True,
    )
    for made in (recipe, out):
        made.unlink(missing_ok=True)


def main():
    if sys.argv[1] == "--peer":
        print(len(peer(Path(sys.argv[2]))))
        return
    folder, fleetfoot = Path(sys.argv[1]), sys.argv[2]
    rounds = int(float(sys.argv[3] if len(sys.argv) > 3 else 1) * 1e9 / ROUND)
    for name in ("imu.bag", "imu.db3"):
        path = folder / name
        try:
            write(path, rounds)
            compare(path, fleetfoot, int(sys.argv[4]) if len(sys.argv) > 4 else 3)
        finally:
            path.unlink(missing_ok=True)


main()
