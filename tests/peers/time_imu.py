"""Speed at which the Python package decodes a log, and at which its chunks decompress.

    python time_imu.py FILE [--messages 100000] [--gigabytes 2]

Prints one JSON object. All in one process and one thread:
`read_and_decode`: messages a second from the file to decoded objects, by mcap-ros2-support;
`decode`: the same from messages in memory;
`decompress_gb_per_s`: uncompressed bytes a second of the file's chunks, which are in memory, without any parsing.

Needs mcap, mcap-ros2-support, zstandard, lz4.
"""

import argparse
import io
import json
import time
from itertools import islice

import lz4.frame
import zstandard
from mcap.reader import NonSeekingReader
from mcap.records import Channel, Chunk, Message, Schema
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory


def read_and_decode(path: str, count: int) -> float:
    """Messages a second, in file order."""
    with open(path, "rb") as stream:
        reader = NonSeekingReader(stream, decoder_factories=[DecoderFactory()])
        begin = time.perf_counter()
        total = 0.0
        done = 0
        for decoded in islice(reader.iter_decoded_messages(log_time_order=False), count):
            total += decoded.decoded_message.angular_velocity.z
            done += 1
        return done / (time.perf_counter() - begin)


def decode(path: str, count: int) -> float:
    """Messages a second, from memory."""
    schemas, channels, messages = {}, {}, []
    with open(path, "rb") as stream:
        for record in StreamReader(stream).records:
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, Message):
                messages.append(record)
                if len(messages) == count:
                    break
    channel = channels[messages[0].channel_id]
    decoder = DecoderFactory().decoder_for(channel.message_encoding, schemas[channel.schema_id])
    begin = time.perf_counter()
    total = sum(decoder(message.data).angular_velocity.z for message in messages)
    seconds = time.perf_counter() - begin
    assert total == total
    return len(messages) / seconds


def decompress(path: str, limit: float):
    """Uncompressed bytes a second, and how many bytes there were, compressed and not."""
    zstd = zstandard.ZstdDecompressor()
    packed = unpacked = 0
    seconds = 0.0
    with open(path, "rb") as stream:
        for record in StreamReader(stream, emit_chunks=True).records:
            if not isinstance(record, Chunk):
                continue
            begin = time.perf_counter()
            if record.compression == "zstd":
                data = zstd.decompress(record.data, max_output_size=record.uncompressed_size)
            elif record.compression == "lz4":
                data = lz4.frame.decompress(record.data)
            else:
                data = io.BytesIO(record.data).getvalue()
            seconds += time.perf_counter() - begin
            packed, unpacked = packed + len(record.data), unpacked + len(data)
            if unpacked >= limit:
                break
    return unpacked / seconds if seconds else None, packed, unpacked


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", metavar="FILE")
    parser.add_argument("--messages", type=int, default=100_000)
    parser.add_argument("--gigabytes", type=float, default=2.0, help="how much to decompress at most")
    arguments = parser.parse_args()
    rate, packed, unpacked = decompress(arguments.file, arguments.gigabytes * 1e9)
    answer = {
        "read_and_decode": read_and_decode(arguments.file, arguments.messages),
        "decode": decode(arguments.file, arguments.messages),
        "decompress_gb_per_s": rate and rate / 1e9,
        "compressed_bytes": packed,
        "uncompressed_bytes": unpacked,
    }
    print(json.dumps(answer))


if __name__ == "__main__":
    main()
