"""Prints every number of every message of MCAP files, decoded by the Python packages.

    python read_logs.py [--long] FILE...

The lines are described in columns.py; each also names its file. A topic that cannot be decoded has an `error` in its first line.
A damaged file gives what stands before the damage and a line {"file": .., "damage": ..}.

Needs mcap, mcap-ros1-support, mcap-ros2-support, mcap-protobuf-support, zstandard, lz4.
"""

import argparse
import io
import json
import os
import sys

import zstandard
from columns import Columns
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader
from mcap_protobuf.decoder import DecoderFactory as Protobuf
from mcap_ros1.decoder import DecoderFactory as Ros1
from mcap_ros2.decoder import DecoderFactory as Ros2


class Undecodable(Exception):
    """No package decodes the messages of a channel."""


def open_log(path: str):
    """A file's bytes, decompressed where the whole file is compressed."""
    stream = open(path, "rb")
    if path.endswith((".zstd", ".zst")):
        with stream:
            return io.BytesIO(zstandard.ZstdDecompressor().stream_reader(stream).read())
    return stream


def decoder_for(factories, channel: Channel, schema):
    """A function from bytes to a decoded message."""
    if channel.message_encoding == "json":
        return json.loads
    for factory in factories:
        decoder = factory.decoder_for(channel.message_encoding, schema)
        if decoder is not None:
            return decoder
    encoding = schema.encoding if schema else None
    raise Undecodable(f"message encoding {channel.message_encoding}, schema encoding {encoding}")


def refuse(data: bytes):
    """Stands in where no decoder could be made."""
    raise Undecodable("no decoder")


def read(path: str, long: bool):
    """All columns of a file in file order, and the damage that ended it."""
    columns, schemas, channels, decoders = Columns(long), {}, {}, {}
    factories = [Ros2(), Ros1(), Protobuf()]
    with open_log(path) as stream:
        try:
            for record in StreamReader(stream).records:
                if isinstance(record, Message):
                    channel = channels[record.channel_id]
                    topic = columns.topic(channel.topic)
                    try:
                        if channel.id not in decoders:
                            decoders[channel.id] = refuse
                            decoders[channel.id] = decoder_for(factories, channel, schemas.get(channel.schema_id))
                        message = decoders[channel.id](record.data)
                    except Exception as error:  # whatever a decoder throws is about this message only
                        topic.fail(error)
                        continue
                    topic.add(record.log_time, record.publish_time, message)
                elif isinstance(record, Channel):
                    channels[record.id] = record
                    columns.topic(record.topic)
                elif isinstance(record, Schema):
                    schemas[record.id] = record
        except Exception as error:  # of the container: nothing behind it is readable for this package
            return columns, f"{type(error).__name__}: {error}"
    return columns, None


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--long", action="store_true", help="also arrays of more than 64 numbers")
    parser.add_argument("files", nargs="+", metavar="FILE")
    arguments = parser.parse_args()
    for path in arguments.files:
        columns, damage = read(path, arguments.long)
        name = os.path.basename(path)
        for line in columns.lines(file=name):
            sys.stdout.write(line + "\n")
        if damage:
            sys.stdout.write(json.dumps({"file": name, "damage": damage}) + "\n")


if __name__ == "__main__":
    main()
