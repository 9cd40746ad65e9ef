"""Writes ROS 1 bags and rosbag2 databases of every kind by the package rosbags.

    python write_rosbags.py OUTDIR [ROWS]

`ros1_{none,bz2,lz4}.bag`; folders `ros2_{none,file,message,split}` of databases, in the second and third packed by zstd as whole files and message by
message, in the fourth in two files; `wal/wal.db3` with most of its rows in the write-ahead log. 4,000 rows of the faster topic unless ROWS says otherwise.

Needs rosbags, numpy.
"""

import shutil
import sqlite3
import sys
from pathlib import Path

import numpy
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

ROWS = int(sys.argv[2]) if len(sys.argv) > 2 else 4000

STATE = """std_msgs/Header header
float64[] values
float32[3] fixed
int8 small
uint64 large
bool on
string name
geometry_msgs/Vector3[] points
"""


def messages(store, ros1: bool):
    """Topic, type, time and message, 50 Hz and 20 Hz."""
    types = store.types
    random = numpy.random.default_rng(7)
    for k in range(ROWS):
        time = 1_700_000_000_000_000_000 + 20_000_000 * k
        stamp = types["builtin_interfaces/msg/Time"](sec=time // 10**9, nanosec=time % 10**9)
        head = {"seq": k} if ros1 else {}
        header = types["std_msgs/msg/Header"](stamp=stamp, frame_id=f"base{k % 3}", **head)
        vector = lambda: types["geometry_msgs/msg/Vector3"](*random.standard_normal(3).tolist())
        quaternion = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.6, 0.8)
        covariance = numpy.arange(9, dtype=numpy.float64)
        yield "/imu", "sensor_msgs/msg/Imu", time, types["sensor_msgs/msg/Imu"](
            header, quaternion, covariance, vector(), covariance, vector(), covariance
        )
        if k % 5 == 0:
            # Now and then longer than several pages of a database.
            name = f"state {k}" * (3000 if k % 500 == 0 else 1)
            yield "/state", "my_msgs/msg/State", time + 1_000_003, types["my_msgs/msg/State"](
                header,
                random.standard_normal(6),
                random.standard_normal(3).astype(numpy.float32),
                k % 200 - 100,
                2**53 - k,
                k % 2 == 0,
                name,
                [vector() for _ in range(k % 4)],
            )


def store_of(name):
    store = get_typestore(name)
    store.register(get_types_from_msg(STATE, "my_msgs/msg/State"))
    return store


def ros1(folder: Path, name: str, compression):
    store = store_of(Stores.ROS1_NOETIC)
    writer = Writer1(folder / f"ros1_{name}.bag")
    if compression:
        writer.set_compression(compression)
    with writer:
        connections = {}
        for topic, kind, time, message in messages(store, True):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], time, store.serialize_ros1(message, kind))


def ros2(folder: Path, name: str, mode=None, part=lambda k: True):
    store = store_of(Stores.ROS2_HUMBLE)
    writer = Writer2(folder / f"ros2_{name}", version=9)
    if mode:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connections = {}
        for k, (topic, kind, time, message) in enumerate(messages(store, False)):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            if part(k):
                writer.write(connections[topic], time, store.serialize_cdr(message, kind))


def split(folder: Path):
    """A recording in two files, whose list stands in the metadata."""
    ros2(folder, "first", part=lambda k: k < ROWS // 2)
    ros2(folder, "second", part=lambda k: k >= ROWS // 2)
    whole = folder / "ros2_split"
    whole.mkdir()
    for place, name in enumerate(["first", "second"]):
        (folder / f"ros2_{name}/ros2_{name}.db3").rename(whole / f"ros2_split_{place}.db3")
    metadata = (folder / "ros2_first/metadata.yaml").read_text()
    names = "- ros2_split_0.db3\n  - ros2_split_1.db3"
    (whole / "metadata.yaml").write_text(metadata.replace("- ros2_first.db3", names))
    shutil.rmtree(folder / "ros2_first")
    shutil.rmtree(folder / "ros2_second")


def write_ahead(folder: Path):
    """A database whose writer was stopped: its pages stand in the log beside it."""
    source = folder / "ros2_none/ros2_none.db3"
    (folder / "wal").mkdir()
    working = folder / "wal/working.db3"
    shutil.copy(source, working)
    connection = sqlite3.connect(working)
    connection.execute("PRAGMA journal_mode=WAL")
    connection.execute("PRAGMA wal_autocheckpoint=0")
    connection.execute("INSERT INTO messages SELECT id + 100000, topic_id, timestamp + 200000000000, data FROM messages")
    connection.commit()
    # Not committed: these rows are none.
    connection.execute("UPDATE messages SET timestamp = 7")
    shutil.copy(working, folder / "wal/wal.db3")
    shutil.copy(f"{working}-wal", folder / "wal/wal.db3-wal")
    connection.rollback()
    connection.close()
    working.unlink()


def main():
    folder = Path(sys.argv[1])
    ros1(folder, "none", None)
    ros1(folder, "bz2", Writer1.CompressionFormat.BZ2)
    ros1(folder, "lz4", Writer1.CompressionFormat.LZ4)
    ros2(folder, "none")
    ros2(folder, "file", CompressionMode.FILE)
    ros2(folder, "message", CompressionMode.MESSAGE)
    split(folder)
    write_ahead(folder)


if __name__ == "__main__":
    main()
