"""Writes the seeds of the fuzz targets.

    python write_seeds.py FUZZ_FOLDER

makes corpus/cdr and corpus/reader in it: a few messages of every encoding, and small files of every layout. The forms of the inputs are
told in fuzz_targets/body/cdr.rs and fuzz_targets/body/reader.rs.

Needs what write_logs.py needs.
"""

import argparse
import struct
import tempfile
from pathlib import Path

from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer
from mcap_protobuf.decoder import DecoderFactory as Protobuf
from mcap_ros1.decoder import DecoderFactory as Ros1

import cdr
import robot
import write_logs
from columns import Columns
from definitions import idl_text, msg_text
from layouts import LAYOUTS, compress_file, relayout
from read_logs import decoder_for
from robot import START

# Their place in the list of encodings of the target.
KINDS = {("cdr", "ros2msg"): 0, ("cdr", "ros2idl"): 1, ("ros1", "ros1msg"): 2, ("protobuf", "protobuf"): 3, ("json", ""): 4}
MAX_FIELDS = 12


def seed(encoding: str, schema_encoding: str, schema: bytes, type_name: str, paths, message: bytes) -> bytes:
    """An input of the target `cdr`."""
    fields = "\n".join([type_name, *paths]).encode()
    return struct.pack("<BHH", KINDS[encoding, schema_encoding], len(schema), len(fields)) + schema + fields + message


def paths(message) -> list[str]:
    """Some fields of a decoded message, spread over all."""
    columns = Columns()
    columns.topic("").add(0, 0, message)
    names = [name.lstrip(".") for name in columns.topics[""].columns]
    return names[:: max(1, len(names) // MAX_FIELDS)]


def ros2_seeds():
    """Every form of CDR with every kind of type."""
    values = {
        "sensor_msgs/msg/JointState": robot.joint_state(1, 0.1, START),
        "tf2_msgs/msg/TFMessage": robot.transforms(0, 0.1, START),
        "fleet_msgs/msg/Types": robot.types(1),
        "fleet_msgs/msg/Arrays": robot.arrays(2),
        "fleet_msgs/msg/Wide": robot.wide(3),
        "std_msgs/msg/Empty": {},
    }
    named = {
        "sensor_msgs/msg/JointState": ["position[left_wheel]", "velocity[arm.lift]"],
        "tf2_msgs/msg/TFMessage": ["transforms[base_link].transform.translation.x", "transforms[laser].transform.rotation.w"],
    }
    for name, value in values.items():
        whole = cdr.complete(name, value)
        listed = paths(whole) + named.get(name, [])
        for kind in (cdr.CDR_LE, cdr.CDR_BE, cdr.CDR2_LE, cdr.D_CDR2_LE):
            short = name.split("/")[-1].lower()
            data = cdr.encode(kind, name, whole)
            yield f"{short}_{kind}", seed("cdr", "ros2msg", msg_text(name).encode(), name, listed, data)
        yield f"{short}_idl", seed("cdr", "ros2idl", idl_text(name).encode(), name, listed, cdr.encode(cdr.CDR_LE, name, whole))
    yield from extensible_seeds()


def extensible_seeds():
    assembly, part = "fleet_msgs/msg/Assembly", "fleet_msgs/msg/Part"
    optional = {(part, "weight"), (assembly, "main")}
    value = {"grade": 3, "main": robot.part(2), "spares": [robot.part(1), robot.part(5) | {"weight": None}], "done": True}
    whole = cdr.complete(assembly, value, optional)
    for kind, extension in [(cdr.CDR2_LE, "final"), (cdr.D_CDR2_LE, "appendable"), (cdr.PL_CDR2_LE, "mutable")]:
        extensibility = {assembly: extension, part: extension}
        schema = idl_text(assembly, extensibility, optional).encode()
        data = cdr.encode(kind, assembly, whole, extensibility, optional)
        yield f"assembly_{extension}", seed("cdr", "ros2idl", schema, assembly, paths(whole), data)


def other_seeds(folder: Path):
    """One message of every channel of the ROS 1, protobuf and JSON logs."""
    for encoding in ("ros1", "protobuf", "json"):
        schemas, channels, last = {}, {}, {}
        with open(folder / f"{encoding}_zstd.mcap", "rb") as stream:
            for record in StreamReader(stream).records:
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel):
                    channels[record.id] = record
                elif isinstance(record, Message) and record.sequence < 8:
                    last[record.channel_id] = record
        for channel_id, message in last.items():
            channel, schema = channels[channel_id], schemas.get(channels[channel_id].schema_id)
            decoded = decoder_for([Ros1(), Protobuf()], channel, schema)(message.data)
            name, kind, text = ("", "", b"") if encoding == "json" else (schema.name, schema.encoding, schema.data)
            label = f"{encoding}{channel.topic.replace('/', '_')}"
            yield label, seed(encoding, kind, text, name, paths(decoded), message.data)


def small(source: Path, target: Path, layout: str, messages: int):
    """The first messages of every channel of a log, in another layout and without checksums, so that a change is not refused for these."""
    seen: dict[int, int] = {}

    def keep(message: Message) -> bool:
        seen[message.channel_id] = seen.get(message.channel_id, 0) + 1
        return seen[message.channel_id] <= messages and len(message.data) < 2000

    options = {"chunk_size": 600, "compression": CompressionType.ZSTD, "enable_crcs": False} | LAYOUTS[layout]
    out = Writer(str(target), **options)
    out.start(profile="", library="")
    relayout(source, out, layout, keep)


def reader_seeds(logs: Path, folder: Path):
    for encoding, count in [("ros2", 3), ("ros1", 3), ("protobuf", 3), ("json", 4)]:
        for layout in LAYOUTS:
            if encoding == "ros2" or layout in ("none", "zstd"):
                small(logs / f"{encoding}_zstd.mcap", folder / f"{encoding}_{layout}.mcap", layout, count)
    for name in ("odd_channels", "idl_mutable"):
        small(logs / f"{name}.mcap", folder / f"{name}.mcap", "none", 2)
    compress_file(folder / "json_none.mcap", folder / "json_whole.mcap.zstd")
    for layout in ("none", "lz4", "unchunked", "unindexed_unchunked"):
        tiny(folder / f"tiny_{layout}.mcap", layout)


def tiny(path: Path, layout: str):
    """Two topics of few numbers, to be joined: most changes to a small file are changes to what matters."""
    pose = b"builtin_interfaces/Time stamp\nfloat64 x\nfloat32[] y"
    with open(path, "wb") as stream:
        out = Writer(stream, **{"chunk_size": 100, "enable_crcs": False} | LAYOUTS[layout])
        out.start(profile="", library="")
        binary = out.register_channel("/a", "cdr", out.register_schema("p/msg/A", "ros2msg", pose))
        text = out.register_channel("/b", "json", 0)
        for place in range(5):
            log = START + place * 20_000_000
            numbers = struct.pack("<iIdIff", log // 10**9, log % 10**9, place / 8, 2, place, -place)
            out.add_message(binary, log, b"\0\1\0\0" + numbers, log, place)
            out.add_message(text, log + 7_000_000, b'{"v":%d.5,"on":%s}' % (place, b"true" if place % 2 else b"false"), log, place)
        out.finish()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="FUZZ_FOLDER")
    corpus = parser.parse_args().folder / "corpus"
    for target in ("cdr", "reader"):
        (corpus / target).mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as logs:
        write_logs.write_all(Path(logs))
        for name, data in [*ros2_seeds(), *other_seeds(Path(logs))]:
            (corpus / "cdr" / name).write_bytes(data)
        reader_seeds(Path(logs), corpus / "reader")


if __name__ == "__main__":
    main()
