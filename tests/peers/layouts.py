"""Copies of a log in other layouts, whole and damaged."""

import io

import zstandard
from mcap.records import Channel, Chunk, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import CompressionType, IndexType, Writer

CHUNK_SIZE = 16 * 1024
LAYOUTS = {
    "zstd": {},
    "lz4": {"compression": CompressionType.LZ4},
    "none": {"compression": CompressionType.NONE},
    "unchunked": {"use_chunking": False},
    "unindexed": {
        "index_types": IndexType.NONE,
        "repeat_channels": False,
        "repeat_schemas": False,
        "use_statistics": False,
        "use_summary_offsets": False,
    },
    "unindexed_unchunked": {
        "use_chunking": False,
        "index_types": IndexType.NONE,
        "repeat_channels": False,
        "repeat_schemas": False,
        "use_statistics": False,
        "use_summary_offsets": False,
    },
}


def writer(path, layout: str = "zstd", profile: str = "ros2") -> Writer:
    """A plain writer; its own name is left out of the file so that versions of the package do not show in it."""
    made = Writer(str(path), **({"chunk_size": CHUNK_SIZE, "compression": CompressionType.ZSTD} | LAYOUTS[layout]))
    made.start(profile=profile, library="fleetfoot tests")
    return made


def relayout(source, target, layout: str, keep=lambda message: True):
    """Copies the schemas, channels and messages of a file; `target` may be a writer that has begun."""
    out = target if isinstance(target, Writer) else writer(target, layout)
    schemas, channels = {0: 0}, {}
    with open(source, "rb") as stream:
        for record in StreamReader(stream).records:
            if isinstance(record, Schema) and record.id not in schemas:
                schemas[record.id] = out.register_schema(record.name, record.encoding, record.data)
            elif isinstance(record, Channel) and record.id not in channels:
                schema = schemas[record.schema_id]
                channels[record.id] = out.register_channel(record.topic, record.message_encoding, schema, record.metadata)
            elif isinstance(record, Message) and keep(record):
                out.add_message(channels[record.channel_id], record.log_time, record.data, record.publish_time, record.sequence)
    out.finish()


def compress_file(source, target):
    """Compresses a whole file, as rosbag2 does in its file mode."""
    with open(source, "rb") as stream, open(target, "wb") as out:
        out.write(zstandard.ZstdCompressor().compress(stream.read()))


def chunks(path) -> list[tuple[int, int, Chunk]]:
    """Begin and end of the compressed data of every chunk, and the chunk."""
    data = open(path, "rb").read()
    spans, place = [], 0
    for record in StreamReader(io.BytesIO(data), emit_chunks=True).records:
        if isinstance(record, Chunk):
            start = data.index(record.data, place)
            place = start + len(record.data)
            spans.append((start, place, record))
    return spans


def messages(chunk: Chunk) -> list[Message]:
    """The messages of a chunk."""
    return [record for record in breakup_chunk(chunk) if isinstance(record, Message)]


def truncate(source, target) -> int:
    """Cuts a file in the middle of its chunk number n // 2, and tells that number: the chunks before it are sound."""
    middle = middle_chunk(source)
    start, end, _ = chunks(source)[middle]
    with open(source, "rb") as stream, open(target, "wb") as out:
        out.write(stream.read()[: (start + end) // 2])
    return middle


def corrupt(source, target) -> int:
    """Inverts sixteen bytes in the middle of chunk number n // 2, and tells that number. Often only its checksum notices."""
    start, end, _ = chunks(source)[middle_chunk(source)]
    return invert(source, target, (start + end) // 2)


def corrupt_frame(source, target) -> int:
    """Inverts the first sixteen bytes of that chunk's compressed data, which then is none any more."""
    return invert(source, target, chunks(source)[middle_chunk(source)][0])


def middle_chunk(source) -> int:
    return len(chunks(source)) // 2


def invert(source, target, start: int) -> int:
    data = bytearray(open(source, "rb").read())
    for place in range(start, start + 16):
        data[place] ^= 0xFF
    with open(target, "wb") as out:
        out.write(data)
    return middle_chunk(source)
