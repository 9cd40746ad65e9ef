"""The numbers and texts of decoded messages, one column a field.

A JSON line a topic holds its stamps, one a field its values:

    {"topic": "/odom", "messages": 3, "undecoded": 0, "log_time": [..], "publish_time": [..]}
    {"topic": "/odom", "name": "/odom.twist.twist.linear.x", "values": [0.5, null, "nan"]}
    {"topic": "/odom", "name": "/odom.child_frame_id", "texts": ["base_link", "base_link", null]}

Values stand in file order, null where a message does not have the field. Numbers are exact: Python writes the shortest decimal that reads
back to the same bits, and integers are written whole. Truth values are 0 and 1; what is not finite is "nan", "inf" or "-inf".
Elements of arrays are named by their place. Arrays of more than 64 numbers are left out unless they are asked for.
"""

import json
import math

LONG_ARRAY = 64


class Topic:
    """The columns of one topic."""

    def __init__(self, name: str, long: bool):
        self.name = name
        self.long = long
        self.rows = 0
        self.undecoded = 0
        self.error = None
        self.log_time: list[int] = []
        self.publish_time: list[int] = []
        self.columns: dict[str, list] = {}

    def add(self, log_time: int, publish_time: int, message):
        """Adds a decoded message: a dict, an object with slots or a protobuf message."""
        self.log_time.append(log_time)
        self.publish_time.append(publish_time)
        self.walk(message, self.name)
        self.rows += 1

    def fail(self, error: Exception):
        """Counts a message that cannot be decoded."""
        self.undecoded += 1
        self.error = self.error or f"{type(error).__name__}: {error}"

    def put(self, name: str, value):
        column = self.columns.setdefault(name, [])
        column.extend([None] * (self.rows - len(column)))
        column.append(value)

    def walk(self, value, name: str):
        kind = type(value)
        if kind is float or kind is int or kind is str:
            self.put(name, value)
        elif kind is bool:
            self.put(name, int(value))
        elif value is None:
            # Absent here; whether it is a number, a text or a struct is known from the messages that have it.
            return
        elif isinstance(value, dict):
            for key, item in value.items():
                self.walk(item, f"{name}.{key}")
        elif isinstance(value, (list, tuple, bytes)):
            if len(value) <= LONG_ARRAY or self.long or not isinstance(value[0], (int, float)):
                for place, item in enumerate(value):
                    self.walk(item, f"{name}[{place}]")
        elif hasattr(value, "DESCRIPTOR"):
            self.walk_protobuf(value, name)
        elif hasattr(value, "nsecs"):
            # ROS 1 times and durations are no messages: their schema does not name these.
            self.put(f"{name}.secs", value.secs)
            self.put(f"{name}.nsecs", value.nsecs)
        else:
            for slot in value.__slots__:
                self.walk(getattr(value, slot), f"{name}.{slot}")

    def walk_protobuf(self, message, name: str):
        for field in message.DESCRIPTOR.fields:
            value = getattr(message, field.name)
            path = f"{name}.{field.name}"
            if field.is_repeated and field.message_type and field.message_type.GetOptions().map_entry:
                for place, key in enumerate(sorted(value)):
                    entry = f"{path}[{key if isinstance(key, str) else place}]"
                    self.walk(key, f"{entry}.key")
                    self.walk(value[key], f"{entry}.value")
            elif field.is_repeated:
                self.walk(list(value), path)
            elif not field.has_presence or message.HasField(field.name):
                self.walk(value, path)

    def lines(self, **more):
        """The JSON lines of this topic."""
        head = {"topic": self.name, "messages": self.rows, "undecoded": self.undecoded}
        if self.error:
            head["error"] = self.error
        yield json.dumps(more | head | {"log_time": self.log_time, "publish_time": self.publish_time})
        for name, column in self.columns.items():
            column = column + [None] * (self.rows - len(column))
            kind = "texts" if any(isinstance(value, str) for value in column) else "values"
            if kind == "values":
                column = [repr(value) if isinstance(value, float) and not math.isfinite(value) else value for value in column]
            elif not all(value is None or isinstance(value, str) for value in column):
                raise ValueError(f"{name} is a text here and a number there")
            yield json.dumps(more | {"topic": self.name, "name": name, kind: column})


class Columns:
    """The columns of all topics of a file."""

    def __init__(self, long: bool = False):
        self.long = long
        self.topics: dict[str, Topic] = {}

    def topic(self, name: str) -> Topic:
        if name not in self.topics:
            self.topics[name] = Topic(name, self.long)
        return self.topics[name]

    def lines(self, **more):
        for topic in self.topics.values():
            yield from topic.lines(**more)

    def write(self, path):
        """Writes the truth about a file beside it."""
        with open(f"{path}.truth.jsonl", "w") as out:
            out.writelines(line + "\n" for line in self.lines())
