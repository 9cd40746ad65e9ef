"""Writes a log of WPILib by its own writer, robotpy-wpiutil.

    python write_wpilog.py OUTDIR [ROWS]

`robot.wpilog`: entries of every type of number and text, arrays, structs that contain structs, arrays of structs. 2,000 rows unless ROWS says otherwise.

Needs robotpy-wpiutil.
"""

import dataclasses
import math
import sys
from pathlib import Path

from wpiutil import DataLogWriter, log, wpistruct

ROWS = int(sys.argv[2]) if len(sys.argv) > 2 else 2000


@wpistruct.make_wpistruct(name="Translation2d")
@dataclasses.dataclass
class Translation:
    x: wpistruct.double
    y: wpistruct.double


@wpistruct.make_wpistruct(name="Rotation2d")
@dataclasses.dataclass
class Rotation:
    radians: wpistruct.double
    turns: wpistruct.int32


@wpistruct.make_wpistruct(name="Pose2d")
@dataclasses.dataclass
class Pose:
    translation: Translation
    rotation: Rotation


@wpistruct.make_wpistruct(name="Module")
@dataclasses.dataclass
class Module:
    speed: float
    encoder: wpistruct.int64
    faults: wpistruct.uint16
    drive: bool
    angle: wpistruct.int8


def main():
    path = Path(sys.argv[1]) / "robot.wpilog"
    path.unlink(missing_ok=True)
    data = DataLogWriter(str(path), "written by robotpy-wpiutil")
    entries = {
        "/drive/speed": log.DoubleLogEntry(data, "/drive/speed", '{"source": "test"}', 1),
        "/drive/current": log.FloatLogEntry(data, "/drive/current", 1),
        "NT:/SmartDashboard/count": log.IntegerLogEntry(data, "NT:/SmartDashboard/count", 1),
        "DS:enabled": log.BooleanLogEntry(data, "DS:enabled", 1),
        "mode": log.StringLogEntry(data, "mode", 1),
        "/wheels": log.DoubleArrayLogEntry(data, "/wheels", 1),
        "/wheels/temperature": log.FloatArrayLogEntry(data, "/wheels/temperature", 1),
        "/ticks": log.IntegerArrayLogEntry(data, "/ticks", 1),
        "/limits": log.BooleanArrayLogEntry(data, "/limits", 1),
        "/names": log.StringArrayLogEntry(data, "/names", 1),
        "/camera": log.RawLogEntry(data, "/camera", 1),
    }
    # StructLogEntry of this version says that its log is closed: the same records one by one.
    for kind in (Translation, Rotation, Pose, Module):
        data.addSchema(f"struct:{wpistruct.getTypeName(kind)}", "structschema", wpistruct.getSchema(kind).encode(), 1)
    pose, modules_entry = data.start("NT:/pose", "struct:Pose2d", "", 1), data.start("/modules", "struct:Module[]", "", 1)
    for k in range(ROWS):
        time = 5_000_000 + 20_000 * k
        entries["/drive/speed"].append(math.sin(0.1 * k), time)
        entries["/drive/current"].append(0.5 * k, time + 1)
        entries["NT:/SmartDashboard/count"].append(2**53 - k, time + 2)
        if k % 10 == 0:
            entries["DS:enabled"].append(k % 20 == 0, time + 3)
            entries["mode"].append("teleop" if k % 20 else "auto, 1", time + 4)
            entries["/names"].append(["left", f"right {k}"], time + 5)
            entries["/camera"].append(bytes(range(k % 200)), time + 6)
        entries["/wheels"].append([math.cos(0.1 * k + place) for place in range(3 + k % 2)], time + 7)
        entries["/wheels/temperature"].append([20.5, 21.5 + k], time + 8)
        entries["/ticks"].append([k, -(2**40) - k], time + 9)
        entries["/limits"].append([True, k % 3 == 0], time + 10)
        data.appendRaw(pose, wpistruct.pack(Pose(Translation(0.02 * k, -0.01 * k), Rotation(0.001 * k, -k))), time + 11)
        modules = [Module(1.5 * k + place, k * 2**33, k % 65536, k % 2 == 0, k % 100 - 50) for place in range(4)]
        data.appendRaw(modules_entry, wpistruct.packArray(modules), time + 12)
    data.stop()


if __name__ == "__main__":
    main()
