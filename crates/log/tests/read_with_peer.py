"""Prints every message of an MCAP file as the Python package mcap-ros2-support decodes it, one JSON object a line.

A field is [path, kind, text]; real numbers are their 64 bits in hexadecimal, so that nothing is rounded on the way.
"""

import json
import struct
import sys

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory


def fields(value, path, out):
    if isinstance(value, bool):
        out.append([path, "bool", str(value).lower()])
    elif isinstance(value, int):
        out.append([path, "int", str(value)])
    elif isinstance(value, float):
        out.append([path, "float", struct.pack(">d", value).hex()])
    elif isinstance(value, str):
        out.append([path, "text", value])
    elif isinstance(value, (list, tuple)):
        for index, element in enumerate(value):
            fields(element, f"{path}[{index}]", out)
    else:
        for name in value.__slots__:
            fields(getattr(value, name), f"{path}.{name}" if path else name, out)


def main(path):
    with open(path, "rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for schema, channel, message, decoded in reader.iter_decoded_messages(log_time_order=False):
            leaves = []
            fields(decoded, "", leaves)
            print(
                json.dumps(
                    {
                        "topic": channel.topic,
                        "type": schema.name,
                        "log_time": message.log_time,
                        "publish_time": message.publish_time,
                        "sequence": message.sequence,
                        "fields": leaves,
                    }
                )
            )


main(sys.argv[1])
