"""Prints every number of every entry of WPILib's logs, decoded by robotpy-wpiutil.

    python read_wpilog.py FILE...

The lines are described in columns.py; each also names its file. Structs are decoded by the classes of write_wpilog.py.

Needs robotpy-wpiutil.
"""

import os
import sys
from dataclasses import asdict

from columns import Columns
from wpiutil import wpistruct
from wpiutil.log import DataLogReader
from write_wpilog import Module, Pose

READ = {
    "boolean": "getBoolean",
    "int64": "getInteger",
    "float": "getFloat",
    "double": "getDouble",
    "string": "getString",
    "boolean[]": "getBooleanArray",
    "int64[]": "getIntegerArray",
    "float[]": "getFloatArray",
    "double[]": "getDoubleArray",
    "string[]": "getStringArray",
}


def value(record, kind: str):
    if kind in READ:
        return {"value": getattr(record, READ[kind])()}
    if kind == "struct:Pose2d":
        return asdict(wpistruct.unpack(Pose, record.getRaw()))
    if kind == "struct:Module[]":
        return {"value": [asdict(entry) for entry in wpistruct.unpackArray(Module, record.getRaw())]}
    return None


def read(path: str) -> Columns:
    columns, entries = Columns(), {}
    for record in DataLogReader(path):
        if record.isStart():
            start = record.getStartData()
            entries[start.entry] = (start.name, start.type)
        elif not record.isControl():
            name, kind = entries[record.getEntry()]
            if kind == "structschema":
                continue
            decoded = value(record, kind)
            topic, time = columns.topic("/" + name.lstrip("/")), record.getTimestamp() * 1000
            if decoded is None:
                topic.fail(TypeError(kind))
            else:
                topic.add(time, time, decoded)
    return columns


def main():
    for path in sys.argv[1:]:
        for line in read(path).lines(file=os.path.basename(path)):
            sys.stdout.write(line + "\n")


if __name__ == "__main__":
    main()
