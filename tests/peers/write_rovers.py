"""Writes one run of a rover in every format of logs, each by an independent writer.

    python write_rovers.py OUTDIR

`rover.bag`, `rover.db3`, `rover.bin`, `rover.log`, `rover.wpilog`, `rover.npz`, `rover.mat`: 300 rows at 50 Hz of v' = 3 u - 2 v in exact steps of the
forward difference. The files are kept in `tests/data/rovers`.

Needs rosbags, pymavlink, robotpy-wpiutil, scipy.
"""

import math
import shutil
import struct
import sys
from pathlib import Path

import numpy
import scipy.io
from pymavlink.DFReader import FORMAT_TO_STRUCT
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore
from wpiutil import DataLogWriter, log

ROWS, STEP = 300, 0.02


def rover():
    """Times in microseconds, speeds and commands."""
    v, rows = 0.0, []
    for k in range(ROWS):
        u = math.sin(0.05 * k) + 0.3 * math.cos(0.37 * k)
        rows.append((20_000 * k + 1_000_000, v, u))
        v += STEP * (3.0 * u - 2.0 * v)
    return rows


def ros(folder: Path):
    for name, kind in ("rover.bag", Stores.ROS1_NOETIC), ("rover", Stores.ROS2_HUMBLE):
        store = get_typestore(kind)
        is_first = kind is Stores.ROS1_NOETIC
        writer = Writer1(folder / name) if is_first else Writer2(folder / name, version=9)
        if is_first:
            writer.set_compression(Writer1.CompressionFormat.BZ2)
        number = store.types["std_msgs/msg/Float64"]
        pack = store.serialize_ros1 if is_first else store.serialize_cdr
        with writer:
            topics = [writer.add_connection(topic, number.__msgtype__, typestore=store) for topic in ("/speed", "/command")]
            for time, *values in rover():
                for topic, value in zip(topics, values, strict=True):
                    writer.write(topic, 1_700_000_000 * 10**9 + time * 1000, pack(number(value), number.__msgtype__))
    (folder / "rover/rover.db3").rename(folder / "rover.db3")
    shutil.rmtree(folder / "rover")


def ardupilot(folder: Path):
    binary, text = bytearray(), []

    def add(number, name, letters, *values):
        binary.extend(bytes([0xA3, 0x95, number]))
        forms = [FORMAT_TO_STRUCT[letter][0] for letter in letters]
        binary.extend(struct.pack("<" + "".join(forms), *(value.encode() if isinstance(value, str) else value for value in values)))
        text.append(", ".join([name, *(value if isinstance(value, str) else repr(value) for value in values)]))

    add(0x80, "FMT", "BBnNZ", 0x80, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")
    add(0x80, "FMT", "BBnNZ", 0x41, 27, "RVR", "Qdd", "TimeUS,V,U")
    for row in rover():
        add(0x41, "RVR", "Qdd", *row)
    (folder / "rover.bin").write_bytes(binary)
    (folder / "rover.log").write_text("\n".join(text) + "\n")


def wpilib(folder: Path):
    path = folder / "rover.wpilog"
    path.unlink(missing_ok=True)
    data = DataLogWriter(str(path), "")
    speed, command = (log.DoubleLogEntry(data, name, "", 1) for name in ("/speed", "/command"))
    for time, v, u in rover():
        speed.append(v, time)
        command.append(u, time)
    data.stop()


def main():
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    ros(folder)
    ardupilot(folder)
    wpilib(folder)
    t, v, u = numpy.array(rover()).T
    numpy.savez_compressed(folder / "rover.npz", t=t / 1e6, v=v, u=u)
    scipy.io.savemat(folder / "rover.mat", {"t": t[:, None] / 1e6, "run": {"v": v[:, None], "u": u[:, None]}}, do_compression=True)


main()
