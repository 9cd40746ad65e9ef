"""Writes small log files of every kind with other people's writers.

    python write_logs.py OUTDIR

Every file is the same at each run. Where the Python packages cannot decode a file, FILE.truth.jsonl stands beside it, in the form that
read_logs.py prints. Topics: robot.py; types: definitions.py and protobuf_types.py; layouts and damages: layouts.py.

Needs mcap, mcap-ros1-support, mcap-ros2-support, mcap-protobuf-support, zstandard, lz4.
"""

import argparse
import json
import os
from pathlib import Path

import mcap_protobuf.writer
import mcap_ros1.writer
import mcap_ros2.writer
from mcap_ros1._vendor.genpy import dynamic, rostime

import bags
import cdr
import protobuf_types
import robot
from columns import Columns
from definitions import ROS1, idl_text, msg_text
from layouts import CHUNK_SIZE, LAYOUTS, chunks, compress_file, corrupt, corrupt_frame, messages, relayout, truncate, writer
from read_logs import read
from robot import SECOND, START

MILLISECOND = 1_000_000

# topic, type, messages a second, maker of a value from the message's number, the seconds since the start and the header stamp
TOPICS = [
    ("/imu", "sensor_msgs/msg/Imu", 50, robot.imu),
    ("/odom", "nav_msgs/msg/Odometry", 20, robot.odometry),
    ("/joint_states", "sensor_msgs/msg/JointState", 25, robot.joint_state),
    ("/tf", "tf2_msgs/msg/TFMessage", 20, robot.transforms),
    ("/cmd_vel", "geometry_msgs/msg/Twist", 10, lambda place, seconds, at: robot.command(place, seconds)),
    ("/camera", "sensor_msgs/msg/Image", 1, lambda place, seconds, at: robot.image(place, at)),
    ("/types", "fleet_msgs/msg/Types", 5, lambda place, seconds, at: robot.types(place)),
    ("/arrays", "fleet_msgs/msg/Arrays", 5, lambda place, seconds, at: robot.arrays(place)),
    ("/nothing", "std_msgs/msg/Empty", 2, lambda place, seconds, at: {}),
]
STATES = {"/imu", "/odom", "/cmd_vel"}


def events(duration: float, topics=None, clock=lambda topic, place, at: (at, at + 2 * MILLISECOND)):
    """(topic, type, place, value, log time, publish time) of all messages, in the order of their log times.

    `clock` tells the header stamp and the log time of a measurement, or None to leave it out.
    """
    measured = []
    for order, (topic, kind, rate, make) in enumerate(TOPICS):
        if topics is not None and topic not in topics:
            continue
        for place in range(int(duration * rate)):
            at = START + place * SECOND // rate
            stamps = clock(topic, place, at)
            if stamps is not None:
                value = make(place, place / rate, stamps[0])
                measured.append((stamps[1], order, place, topic, kind, value))
    measured.sort(key=lambda event: event[:3])
    return [(topic, kind, place, value, log, log - MILLISECOND) for log, _, place, topic, kind, value in measured]


def write_ros2(path, messages):
    """With the library's own writer."""
    with open(path, "wb") as stream:
        with mcap_ros2.writer.Writer(stream, chunk_size=CHUNK_SIZE) as out:
            schemas = {}
            for topic, kind, place, value, log, publish in messages:
                if kind not in schemas:
                    schemas[kind] = out.register_msgdef(kind, msg_text(kind))
                out.write_message(topic, schemas[kind], value, log, publish, place)


def ros1_value(classes, kind, value):
    """A value as an object of a generated ROS 1 class."""
    made = classes[kind]()
    for slot, slot_type in zip(made.__slots__, made._slot_types):
        item = value[slot]
        base = slot_type.split("[")[0]
        base = "std_msgs/Header" if base == "Header" else base
        if base in classes:
            item = [ros1_value(classes, base, element) for element in item] if "[" in slot_type else ros1_value(classes, base, item)
        setattr(made, slot, item)
    return made


def ros1_stamped(value: dict, place: int) -> dict:
    """A ROS 2 value with the header of ROS 1."""
    head = value["header"]
    time = rostime.Time(head["stamp"]["sec"], head["stamp"]["nanosec"])
    return value | {"header": {"seq": place, "stamp": time, "frame_id": head["frame_id"]}}


def ros1_types(place: int, at: int) -> dict:
    some = place % 4
    low = place % 2 == 0
    return {
        "truth": low, "octet": -128 if low else 127, "letter": 200, "single": 0.5 * place, "double": -1e-300,
        "i8": -128, "u8": 255, "i16": -32768, "u16": 65535, "i32": -(2**31), "u32": 2**32 - 1, "i64": -(2**63), "u64": 2**64 - 1,
        "text": "x" * place, "moment": rostime.Time(at // SECOND, at % SECOND), "span": rostime.Duration(-place, 5),
        "moments": [rostime.Time(k, place) for k in range(some)], "part": robot.part(place),
        "parts": [robot.part(k) for k in range(some)], "pair": [robot.part(1), robot.part(place)],
        "texts": ["a", "", "bc"][:some], "truths": [True, low, False], "singles": [0.25 * k for k in range(some)],
        "blob": bytes(range(some)), "i64s": [2**53 + 1, -place], "path": [robot.xyz(k, place, 0.0) for k in range(some)],
    }  # fmt: skip


def write_ros1(path):
    """Imu, joint states and all types of ROS 1 with the library's own writer."""
    classes = {}
    for kind in ("sensor_msgs/Imu", "sensor_msgs/JointState", "fleet_msgs/Types"):
        classes |= dynamic.generate_dynamic(kind, msg_text(kind, ROS1))
    with open(path, "wb") as stream:
        with mcap_ros1.writer.Writer(stream, chunk_size=CHUNK_SIZE) as out:
            for topic, _, place, value, log, publish in events(3.0, {"/imu", "/joint_states", "/types"}):
                kind = {"/imu": "sensor_msgs/Imu", "/joint_states": "sensor_msgs/JointState", "/types": "fleet_msgs/Types"}[topic]
                value = ros1_types(place, log) if topic == "/types" else ros1_stamped(value, place)
                out.write_message(topic, ros1_value(classes, kind, value), log, publish, place)


def write_protobuf(path):
    kind = protobuf_types.robot_class()
    with open(path, "wb") as stream:
        with mcap_protobuf.writer.Writer(stream, chunk_size=CHUNK_SIZE) as out:
            for place in range(200):
                at = START + place * SECOND // 50
                message = kind()
                protobuf_types.fill(message, place, place / 50, at)
                out.write_message("/robot", message, at + 2 * MILLISECOND, at + MILLISECOND, place)


def json_value(place: int, seconds: float, at: int) -> dict:
    x, y, yaw, speed, rate = robot.state(seconds)
    value = {
        "header": {"stamp": robot.stamp(at), "frame_id": "map"},
        "pose": {"x": x, "y": y, "heading": {"yaw": yaw}},
        "speeds": [speed, rate, place],
        "moving": place % 3 != 0,
        "load": None if place % 4 == 0 else 0.1 * place,
        "serial": 2**53 + 1 + place,
        "large": 2**64 - 1,
        "tiny": 5e-324,
        "count": -place,
        "wheels": [{"id": k, "slip": 0.01 * k} for k in range(place % 3)],
        "label": 'say "hi" ä€𝄞 \u0001',
        "empty": [],
        "none": {},
    }
    if place % 5 == 0:
        value["now_and_then"] = 1e3
    return value


def write_json(path):
    """With the plain writer: a topic with a JSON schema and one without."""
    out = writer(path, profile="")
    schema = out.register_schema("robot", "jsonschema", json.dumps({"type": "object"}).encode())
    state = out.register_channel("/state", "json", schema)
    bare = out.register_channel("/bare", "json", 0)
    for place in range(150):
        at = START + place * SECOND // 50
        value = json_value(place, place / 50, at)
        out.add_message(state, at + 2 * MILLISECOND, json.dumps(value).encode(), at, place)
        text = json.dumps({"n": place, "x": 1.0 / (place + 1)}, indent=1)
        out.add_message(bare, at + 3 * MILLISECOND, text.encode(), at, place)
    out.finish()


def write_cdr(path, kind: int, messages, idl=None):
    """With the encoder of cdr.py, and the truth beside it.

    `idl` makes schemas of another language: (texts by type, extensibility, optional).
    """
    texts, extensibility, optional = idl or ({}, None, ())
    out, columns, channels = writer(path), Columns(), {}
    for topic, name, place, value, log, publish in messages:
        if topic not in channels:
            encoding = "ros2idl" if name in texts else "ros2msg"
            schema = out.register_schema(name, encoding, texts.get(name, msg_text(name)).encode())
            channels[topic] = out.register_channel(topic, "cdr", schema, {"offered_qos_profiles": ""})
        whole = cdr.complete(name, value, optional)
        out.add_message(channels[topic], log, cdr.encode(kind, name, whole, extensibility, optional), publish, place)
        columns.topic(topic).add(log, publish, whole)
    out.finish()
    columns.write(path)


def wide_events():
    return [("/wide", "fleet_msgs/msg/Wide", k, robot.wide(k), START + k * SECOND // 10, START + k * SECOND // 10) for k in range(20)]


def write_encodings(folder: Path):
    """All forms of CDR, and IDL schemas."""
    some = {"/imu", "/joint_states", "/tf", "/types", "/arrays", "/nothing"}
    messages = events(2.0, some) + wide_events()
    for label, kind in [
        ("cdr_le", cdr.CDR_LE),
        ("cdr_be", cdr.CDR_BE),
        ("cdr2_le", cdr.CDR2_LE),
        ("cdr2_be", cdr.CDR2_BE),
        ("delimited_cdr2_le", cdr.D_CDR2_LE),
        ("delimited_cdr2_be", cdr.D_CDR2_BE),
    ]:
        write_cdr(folder / f"{label}.mcap", kind, messages)
    kinds = {name for _, name, *_ in messages}
    write_cdr(folder / "idl.mcap", cdr.CDR_LE, messages, ({name: idl_text(name) for name in kinds}, None, ()))
    # Without the separator before the first file, as some writers have it.
    plain = {name: idl_text(name, leading_separator=False) for name in kinds}
    write_cdr(folder / "idl_bare.mcap", cdr.CDR_BE, messages, (plain, None, ()))
    write_extensible(folder)


def write_extensible(folder: Path):
    """IDL types that say how they may evolve, with optional fields."""
    assembly, part = "fleet_msgs/msg/Assembly", "fleet_msgs/msg/Part"
    optional = {(part, "weight"), (assembly, "main")}
    for label, kind, extensibility in [
        ("idl_final", cdr.CDR2_LE, {assembly: "final", part: "final"}),
        ("idl_appendable", cdr.D_CDR2_LE, {assembly: "appendable", part: "final"}),
        ("idl_mutable", cdr.PL_CDR2_LE, {assembly: "mutable", part: "appendable"}),
        ("idl_mutable_parts", cdr.D_CDR2_BE, {assembly: "appendable", part: "mutable"}),
    ]:
        messages = []
        for place in range(30):
            spares = [robot.part(place + k) | ({"weight": None} if (place + k) % 2 else {}) for k in range(place % 4)]
            value = {"grade": place, "main": None if place % 3 == 0 else robot.part(place), "spares": spares, "done": place % 2 == 1}
            messages.append(("/assembly", assembly, place, value, START + place * SECOND // 10, START))
        text = idl_text(assembly, extensibility, optional)
        write_cdr(folder / f"{label}.mcap", kind, messages, ({assembly: text}, extensibility, optional))


def write_clocks(folder: Path):
    """Logs whose stamps are troublesome."""

    def two_clocks(topic, place, at):
        return at - START + 10 * SECOND, at + 2 * MILLISECOND

    def zero_stamps(topic, place, at):
        return (0 if topic == "/odom" else at), at + 2 * MILLISECOND

    def some_zero_stamps(topic, place, at):
        return (0 if topic == "/odom" and place % 10 == 3 else at), at + 2 * MILLISECOND

    def jitter(topic, place, at):
        return at, at + int(15 * MILLISECOND * (1.0 + robot.noise(11, place)))

    def gap(topic, place, at):
        late = at - START >= 2 * SECOND
        return (at + 2 * SECOND, at + 2 * SECOND + 2 * MILLISECOND) if late else (at, at + 2 * MILLISECOND)

    def apart(topic, place, at):
        shift = 100 * SECOND if topic == "/odom" else 0
        return at + shift, at + shift + MILLISECOND

    for clock in (two_clocks, zero_stamps, some_zero_stamps, jitter, gap, apart):
        write_ros2(folder / f"{clock.__name__}.mcap", events(4.0, STATES, clock))
    # The same with the file out of the order of its log stamps, too.
    messages = events(4.0, STATES)
    shuffled = sorted(range(len(messages)), key=lambda k: messages[k][4] + 15 * MILLISECOND * robot.noise(12, k))
    write_ros2(folder / "out_of_order.mcap", [messages[k] for k in shuffled])


def write_odd_channels(path):
    """A sound topic beside an empty one, ones without a schema, and ones in encodings and schemas that nobody knows."""
    out = writer(path)
    imu = "sensor_msgs/msg/Imu"
    sound = out.register_schema(imu, "ros2msg", msg_text(imu).encode())
    channels = [
        out.register_channel("/imu", "cdr", sound),
        out.register_channel("/no_schema", "cdr", 0),
        out.register_channel("/unknown_encoding", "cbor", 0),
        out.register_channel("/unknown_schema", "cdr", out.register_schema(imu, "omgidl3", b"?")),
        out.register_channel("/broken_schema", "cdr", out.register_schema(imu, "ros2msg", b"std_msgs/Header header\nfloat64[ x\n")),
        out.register_channel("/missing_type", "cdr", out.register_schema(imu, "ros2msg", b"nowhere_msgs/Lost lost\n")),
    ]
    out.register_channel("/empty", "cdr", sound)
    short = out.register_channel("/short_messages", "cdr", sound)
    for topic, name, place, value, log, publish in events(1.0, {"/imu"}):
        data = cdr.encode(cdr.CDR_LE, name, cdr.complete(name, value))
        for channel in channels:
            out.add_message(channel, log, data, publish, place)
        # One of two ends before its fields do.
        out.add_message(short, log, data if place % 2 else data[:100], publish, place)
    out.finish()


def write_damaged(folder: Path):
    """Copies of sound files with damage, and what is left of them."""
    for damage, label, source in [
        (truncate, "truncated", "ros2_zstd"),
        (truncate, "truncated_lz4", "ros2_lz4"),
        (truncate, "truncated_unindexed", "ros2_unindexed"),
        (corrupt, "corrupt_zstd", "ros2_zstd"),
        (corrupt, "corrupt_lz4", "ros2_lz4"),
        (corrupt_frame, "corrupt_frame_zstd", "ros2_zstd"),
        (corrupt_frame, "corrupt_frame_lz4", "ros2_lz4"),
        (corrupt_frame, "corrupt_frame_unindexed", "ros2_unindexed"),
        (corrupt, "corrupt_crc", "ros2_none"),
        (corrupt, "corrupt_unindexed", "ros2_unindexed"),
    ]:
        whole, damaged = folder / f"{source}.mcap", folder / f"{label}.mcap"
        middle = damage(whole, damaged)
        every = [[key(message) for message in messages(chunk)] for _, _, chunk in chunks(whole)]
        lost = {entry for place, chunk in enumerate(every) for entry in chunk if place == middle or (damage is truncate and place > middle)}
        left = folder / "left.tmp"
        relayout(whole, left, "none", keep=lambda message: key(message) not in lost)
        read(str(left), False)[0].write(damaged)
        os.remove(left)


def key(message):
    """Fields that distinguish a message from all others of a file."""
    return message.channel_id, message.sequence, message.log_time


def write_all(folder: Path):
    folder.mkdir(parents=True, exist_ok=True)
    write_ros2(folder / "ros2_zstd.mcap", events(4.0))
    write_ros1(folder / "ros1_zstd.mcap")
    write_protobuf(folder / "protobuf_zstd.mcap")
    write_json(folder / "json_zstd.mcap")
    for encoding in ("ros2", "ros1", "protobuf", "json"):
        for layout in LAYOUTS:
            if layout != "zstd":
                relayout(folder / f"{encoding}_zstd.mcap", folder / f"{encoding}_{layout}.mcap", layout)
        compress_file(folder / f"{encoding}_unchunked.mcap", folder / f"{encoding}_whole.mcap.zstd")
    write_encodings(folder)
    write_clocks(folder)
    write_odd_channels(folder / "odd_channels.mcap")
    write_damaged(folder)
    messages = events(6.0, {"/imu", "/odom"})
    bags.write(folder / "split_bag", messages, write_ros2)
    bags.write(folder / "compressed_bag", messages, write_ros2, compressed=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("outdir", type=Path, metavar="OUTDIR")
    write_all(parser.parse_args().outdir)


if __name__ == "__main__":
    main()
