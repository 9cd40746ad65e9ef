"""Prints every number of every message of ROS 1 bags and rosbag2 databases, decoded by the package rosbags.

    python read_rosbags.py FILE...

A FILE is a `.bag`, a `.db3` or a folder of rosbag2. The lines are described in columns.py; each also names its file.

Needs rosbags, numpy.
"""

import os
import shutil
import sqlite3
import sys
import tempfile
from dataclasses import fields, is_dataclass
from pathlib import Path

import numpy
from columns import Columns
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore


def plain(value, ros1: bool):
    """Values as columns.py takes them: a message as a dict."""
    if isinstance(value, numpy.ndarray):
        return value.tolist()
    if is_dataclass(value):
        names = [field.name for field in fields(value) if not field.name.startswith("__") and not field.name.isupper() and field.name != "structure_needs_at_least_one_member"]
        if ros1 and names == ["sec", "nanosec"]:
            return {"secs": value.sec, "nsecs": value.nanosec}
        return {name: plain(getattr(value, name), ros1) for name in names}
    if isinstance(value, (list, tuple)):
        return [plain(item, ros1) for item in value]
    return value


def database(path: Path):
    """The messages of a database without metadata, in the order of their row ids, and the types that it describes."""
    with tempfile.TemporaryDirectory() as folder:
        # SQLite writes into the log beside a database, even where it only reads.
        copy = shutil.copy(path, folder)
        if os.path.exists(f"{path}-wal"):
            shutil.copy(f"{path}-wal", folder)
        connection = sqlite3.connect(copy)
        query = "SELECT name, type, timestamp, data FROM messages JOIN topics ON topics.id = topic_id ORDER BY messages.id"
        rows = list(connection.execute(query))
        types = {}
        if list(connection.execute("SELECT 1 FROM sqlite_master WHERE name = 'message_definitions'")):
            for kind, text in connection.execute("SELECT topic_type, encoded_message_definition FROM message_definitions"):
                if text:
                    types.update(get_types_from_msg(text, kind))
        connection.close()
    return rows, types


def read(path: Path) -> Columns:
    columns = Columns()
    if path.suffix == ".db3":
        store = get_typestore(Stores.ROS2_HUMBLE)
        rows, types = database(path)
        store.register({kind: definition for kind, definition in types.items() if kind not in store.types})
        for name, kind, time, data in rows:
            topic = columns.topic(name)
            try:
                topic.add(time, time, plain(store.deserialize_cdr(data, kind), False))
            except KeyError as error:
                topic.fail(error)
        return columns
    ros1 = path.suffix == ".bag"
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        for connection in reader.connections:
            columns.topic(connection.topic)
        for connection, time, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            columns.topic(connection.topic).add(time, time, plain(message, ros1))
    return columns


def main():
    for path in map(Path, sys.argv[1:]):
        for line in read(path).lines(file=os.path.basename(path)):
            sys.stdout.write(line + "\n")


if __name__ == "__main__":
    main()
