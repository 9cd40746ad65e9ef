"""Prints every number of every message of ULog files, as pyulog reads them.

    python read_ulogs.py FILE...

The lines are described in columns.py; each also names its file. Texts (arrays of char) are left out. A last line a file tells what
the file says of itself: {"file": .., "topic": "", "about": {..}}.

Needs pyulog, numpy.
"""

import json
import math
import os
import sys

import numpy as np
from columns import Columns
from pyulog import ULog


def topic_name(name: str, instance: int) -> str:
    return f"/{name}.{instance}" if instance else f"/{name}"


def add_dataset(columns: Columns, dataset):
    """The columns of one instance of a topic. Python's numbers are exact for every type of numpy's."""
    topic = columns.topic(topic_name(dataset.name, dataset.multi_id))
    topic.rows = len(dataset.data["timestamp"])
    topic.log_time = topic.publish_time = [1000 * int(time) for time in dataset.data["timestamp"]]
    for field in dataset.field_data:
        if field.type_str == "char" or "_padding" in field.field_name:
            continue
        values = np.asarray(dataset.data[field.field_name])
        if field.type_str == "bool":
            values = (values != 0).astype(np.int64)
        # A whole number beyond 2^53 is the nearest one that a double holds.
        topic.columns[f"{topic.name}.{field.field_name}"] = [
            float(value) if abs(value) > 2**53 else value for value in values.astype(object)
        ]


def add_logged(columns: Columns, log: ULog):
    """Logged texts: their levels, tags and times."""
    # Grouped by their tags: the order of the file is that of their times.
    tagged = [message for messages in log.logged_messages_tagged.values() for message in messages]
    tagged.sort(key=lambda message: message.timestamp)
    for name, messages in [("/logged_messages", log.logged_messages), ("/logged_messages_tagged", tagged)]:
        for message in messages:
            fields = {"log_level": message.log_level, "timestamp": message.timestamp}
            if hasattr(message, "tag"):
                fields["tag"] = message.tag
            columns.topic(name).add(1000 * message.timestamp, 1000 * message.timestamp, fields)


def finite(values: dict) -> dict:
    """The values, those that are not finite as words, which JSON can hold."""
    return {key: repr(value) if isinstance(value, float) and not math.isfinite(value) else value for key, value in values.items()}


def about(log: ULog) -> dict:
    """Parameters, changes and defaults as numbers, information as it is where it is a text or a number."""
    plain = {key: value for key, value in log.msg_info_dict.items() if isinstance(value, (str, int, float))}
    defaults = [finite(log.get_default_parameters(kind)) for kind in (0, 1)]
    return {
        "info": finite(plain),
        "multiple": {key: [part for part in values if all(isinstance(text, str) for text in part)]
                     for key, values in log.msg_info_multiple_dict.items()},
        "parameters": finite(log.initial_parameters),
        "changed": [[time / 1e6, name, value] for time, name, value in log.changed_parameters],
        "system": defaults[0],
        "setup": defaults[1],
        "texts": sorted(message.message for message in log.logged_messages),
    }


def main():
    for path in sys.argv[1:]:
        log, columns, name = ULog(path), Columns(), os.path.basename(path)
        for dataset in log.data_list:
            add_dataset(columns, dataset)
        add_logged(columns, log)
        for line in columns.lines(file=name):
            sys.stdout.write(line + "\n")
        sys.stdout.write(json.dumps({"file": name, "topic": "", "about": about(log)}) + "\n")


if __name__ == "__main__":
    main()
