"""Imu messages of an MCAP file by mcap-ros2-support: imu_messages.py FILE MESSAGES OUT.

Passes over the first MESSAGES messages of the topic /imu, in the order of the file, in one thread:
- timed, the fastest of three: messages become objects, of which one number is looked at (the least that anybody does with them);
- not timed: the stamps and all 37 numbers of each message go to OUT, as little-endian doubles, 40 a message: header stamp, log time and
  publish time less the first log time, nanoseconds (whole numbers that a double holds), then the numbers in the order of the definition.

Prints one JSON line: version, messages, seconds, first log time. Needs mcap, mcap-ros2-support, numpy.
"""

import importlib.metadata
import json
import sys
import time
from itertools import islice

import numpy as np
from mcap.reader import NonSeekingReader
from mcap_ros2.decoder import DecoderFactory

REPEATS = 3


def messages(stream, count):
    # Front to back: on such files this reader is several times as fast as the one that goes by the index.
    reader = NonSeekingReader(stream, decoder_factories=[DecoderFactory()])
    return islice(reader.iter_decoded_messages(topics=["/imu"], log_time_order=False), count)


def numbers(imu):
    q, w, a = imu.orientation, imu.angular_velocity, imu.linear_acceleration
    return [
        q.x, q.y, q.z, q.w, *imu.orientation_covariance,
        w.x, w.y, w.z, *imu.angular_velocity_covariance,
        a.x, a.y, a.z, *imu.linear_acceleration_covariance,
    ]  # fmt: skip


def main():
    path, count, out = sys.argv[1], int(sys.argv[2]), sys.argv[3]
    seconds = float("inf")
    for _ in range(REPEATS):
        with open(path, "rb") as stream:
            begin = time.perf_counter()
            total, seen = 0.0, 0
            for decoded in messages(stream, count):
                total += decoded.decoded_message.angular_velocity.z
                seen += 1
            seconds = min(seconds, time.perf_counter() - begin)
    rows, first = [], None
    with open(path, "rb") as stream:
        for decoded in messages(stream, count):
            imu, record = decoded.decoded_message, decoded.message
            first = record.log_time if first is None else first
            stamp = imu.header.stamp.sec * 10**9 + imu.header.stamp.nanosec
            rows.append([stamp - first, record.log_time - first, record.publish_time - first, *numbers(imu)])
    np.asarray(rows, "<f8").tofile(out)
    version = importlib.metadata.version("mcap-ros2-support")
    print(json.dumps({"version": version, "messages": seen, "seconds": seconds, "first": first, "total": total}))


main()
