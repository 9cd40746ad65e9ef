"""Writes a large log of Imu messages, fast.

    python generate_imu.py OUT --messages 10000000 [--compression zstd|lz4|none] [--level 3] [--threads 2]

A message is 324 bytes of CDR (355 with its record) at 1 kHz, in chunks of about 4 MiB with message indexes and a summary. Rates and
accelerations stand on the grid of a 16-bit converter with noise in its low bits, the orientation is that of a noisy filter: so the
file compresses as a recorded one does, and not as constants would. The same arguments give the same bytes.

Needs numpy, mcap, zstandard, lz4.
"""

import argparse
import os
import struct
import time
import zlib
from collections import deque
from concurrent.futures import ThreadPoolExecutor

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Chunk, ChunkIndex, DataEnd, Footer, Header, Schema, Statistics, SummaryOffset
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC

from definitions import msg_text
from robot import START

CHUNK_BYTES = 4 * 1024 * 1024
PERIOD = 1_000_000
RECORD = np.dtype(
    [
        ("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4"), ("log_time", "<u8"), ("publish_time", "<u8"),
        # Encapsulation, header.stamp, header.frame_id and its padding to eight bytes.
        ("kind", "u1", 4), ("sec", "<i4"), ("nanosec", "<u4"), ("frame_length", "<u4"), ("frame", "S12"),
        ("orientation", "<f8", 4), ("orientation_covariance", "<f8", 9),
        ("angular_velocity", "<f8", 3), ("angular_velocity_covariance", "<f8", 9),
        ("linear_acceleration", "<f8", 3), ("linear_acceleration_covariance", "<f8", 9),
    ]
)  # fmt: skip
FRAME = b"imu_link"
# Lowest steps of a converter with 16 bits for +-2000 degrees per second and +-16 g.
RATE_STEP = np.deg2rad(4000.0) / 65536
ACCELERATION_STEP = 32 * 9.80665 / 65536


def records(first: int, count: int) -> bytes:
    """The message records with the numbers first .. first + count."""
    rng = np.random.Generator(np.random.PCG64([7, first]))
    number = first + np.arange(count)
    seconds = number * (PERIOD * 1e-9)
    stamp = START + number * PERIOD
    made = np.zeros(count, RECORD)
    made["opcode"], made["length"], made["channel"], made["sequence"] = 5, RECORD.itemsize - 9, 1, number
    made["log_time"] = stamp + 500_000 + rng.integers(0, 200_000, count)
    made["publish_time"] = stamp + 100_000
    made["kind"], made["frame_length"], made["frame"] = [0, 1, 0, 0], len(FRAME) + 1, FRAME
    made["sec"], made["nanosec"] = stamp // 10**9, stamp % 10**9
    yaw = 3.0 * np.sin(0.7 * seconds) + 1e-4 * rng.standard_normal(count)
    made["orientation"][:, 2], made["orientation"][:, 3] = np.sin(yaw / 2), np.cos(yaw / 2)
    made["orientation"][:, :2] = 1e-3 * rng.standard_normal((count, 2))
    rates = 0.01 * rng.standard_normal((count, 3))
    rates[:, 2] += 2.1 * np.cos(0.7 * seconds)
    made["angular_velocity"] = np.round(rates / RATE_STEP) * RATE_STEP
    acceleration = 0.05 * rng.standard_normal((count, 3)) + [0.0, 0.0, 9.80665]
    acceleration[:, 1] += 0.5 * np.sin(1.3 * seconds)
    made["linear_acceleration"] = np.round(acceleration / ACCELERATION_STEP) * ACCELERATION_STEP
    for name, variance in [("orientation", 1e-6), ("angular_velocity", 1e-4), ("linear_acceleration", 2.5e-3)]:
        made[f"{name}_covariance"][:, [0, 4, 8]] = variance
    return made.tobytes()


def chunk(first: int, count: int, compression: str, level: int):
    """A chunk, its message index record and its offsets' place."""
    data = records(first, count)
    view = np.frombuffer(data, RECORD)
    index = np.zeros(count, np.dtype([("log_time", "<u8"), ("offset", "<u8")]))
    index["log_time"], index["offset"] = view["log_time"], np.arange(count) * RECORD.itemsize
    packed = {
        "zstd": lambda: zstandard.ZstdCompressor(level=level).compress(data),
        "lz4": lambda: lz4.frame.compress(data),
        "none": lambda: data,
    }[compression]()
    made = Chunk(
        compression="" if compression == "none" else compression,
        data=packed,
        message_start_time=int(index["log_time"].min()),
        message_end_time=int(index["log_time"].max()),
        uncompressed_crc=zlib.crc32(data),
        uncompressed_size=len(data),
    )
    message_index = struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + index.nbytes, 1, index.nbytes) + index.tobytes()
    return made, message_index


class Log:
    """The file in the making."""

    def __init__(self, out):
        self.out = out
        self.indexes: list[ChunkIndex] = []
        schema = Schema(id=1, data=msg_text("sensor_msgs/msg/Imu").encode(), encoding="ros2msg", name="sensor_msgs/msg/Imu")
        channel = Channel(id=1, topic="/imu", message_encoding="cdr", schema_id=1, metadata={})
        self.heads = [(Opcode.SCHEMA, schema), (Opcode.CHANNEL, channel)]
        out.write(MCAP0_MAGIC)
        self.put(Header("ros2", "fleetfoot tests"), schema, channel)

    def put(self, *made) -> int:
        builder = RecordBuilder()
        for record in made:
            record.write(builder)
        return self.out.write(builder.end())

    def add(self, made: Chunk, message_index: bytes):
        start = self.out.tell()
        length = self.put(made)
        self.out.write(message_index)
        self.indexes.append(
            ChunkIndex(
                chunk_length=length,
                chunk_start_offset=start,
                compression=made.compression,
                compressed_size=len(made.data),
                message_end_time=made.message_end_time,
                message_index_length=len(message_index),
                message_index_offsets={1: start + length},
                message_start_time=made.message_start_time,
                uncompressed_size=made.uncompressed_size,
            )
        )

    def finish(self, messages: int):
        self.put(DataEnd(0))
        statistics = Statistics(
            attachment_count=0, channel_count=1, channel_message_counts={1: messages}, chunk_count=len(self.indexes),
            message_count=messages, message_end_time=max((index.message_end_time for index in self.indexes), default=0),
            message_start_time=min((index.message_start_time for index in self.indexes), default=0), metadata_count=0, schema_count=1,
        )  # fmt: skip
        summary, offsets = self.out.tell(), []
        for opcode, group in [(code, [head]) for code, head in self.heads] + [
            (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, self.indexes),
        ]:
            start = self.out.tell()
            offsets.append(SummaryOffset(group_opcode=opcode, group_start=start, group_length=self.put(*group)))
        offset_start = self.out.tell()
        self.put(*offsets, Footer(summary_start=summary, summary_offset_start=offset_start, summary_crc=0))
        self.out.write(MCAP0_MAGIC)


def generate(path: str, messages: int, compression: str, level: int, threads: int):
    each = CHUNK_BYTES // RECORD.itemsize
    jobs = ((first, min(each, messages - first)) for first in range(0, messages, each))
    waiting: deque = deque()
    with open(path, "wb") as out, ThreadPoolExecutor(threads) as pool:
        log = Log(out)
        for first, count in jobs:
            waiting.append(pool.submit(chunk, first, count, compression, level))
            if len(waiting) > 2 * threads:
                log.add(*waiting.popleft().result())
        while waiting:
            log.add(*waiting.popleft().result())
        log.finish(messages)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", metavar="OUT")
    parser.add_argument("--messages", type=int, required=True)
    parser.add_argument("--compression", choices=["zstd", "lz4", "none"], default="zstd")
    parser.add_argument("--level", type=int, default=3, help="of zstd")
    parser.add_argument("--threads", type=int, default=2)
    arguments = parser.parse_args()
    begin = time.perf_counter()
    generate(arguments.out, arguments.messages, arguments.compression, arguments.level, arguments.threads)
    seconds = time.perf_counter() - begin
    raw, size = arguments.messages * RECORD.itemsize, os.path.getsize(arguments.out)
    print(f"{arguments.messages} messages, {raw / 1e9:.3f} GB in {size / 1e9:.3f} GB, {seconds:.1f} s, {raw / seconds / 1e9:.3f} GB/s")


if __name__ == "__main__":
    main()
