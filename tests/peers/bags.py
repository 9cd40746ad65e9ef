"""A rosbag2 folder: one recording in three files."""

from pathlib import Path

from layouts import compress_file

FILES = 3


def write(folder: Path, events, write_file, compressed=False):
    """Splits messages in mid-run into files, with the metadata.yaml of `ros2 bag record`."""
    folder.mkdir(exist_ok=True)
    names, parts = [], []
    for k in range(FILES):
        # Not in the order of the alphabet: the order of the metadata counts.
        name = f"{folder.name}_{['b', 'a', 'c'][k]}.mcap"
        part = events[len(events) * k // FILES : len(events) * (k + 1) // FILES]
        write_file(folder / name, part)
        if compressed:
            compress_file(folder / name, folder / f"{name}.zstd")
            (folder / name).unlink()
            name += ".zstd"
        names.append(name)
        parts.append(part)
    (folder / "metadata.yaml").write_text(metadata(names, parts, compressed))


def span(part) -> tuple[int, int]:
    """First log stamp and duration."""
    stamps = [log for *_, log, _ in part]
    return min(stamps), max(stamps) - min(stamps)


def metadata(names, parts, compressed) -> str:
    events = [event for part in parts for event in part]
    start, duration = span(events)
    lines = [
        "rosbag2_bagfile_information:",
        "  version: 9",
        "  storage_identifier: mcap",
        "  duration:",
        f"    nanoseconds: {duration}",
        "  starting_time:",
        f"    nanoseconds_since_epoch: {start}",
        f"  message_count: {len(events)}",
        "  topics_with_message_count:",
    ]
    for topic, kind in dict.fromkeys((event[0], event[1]) for event in events):
        lines += [
            "    - topic_metadata:",
            f"        name: {topic}",
            f"        type: {kind}",
            "        serialization_format: cdr",
            "        offered_qos_profiles: []",
            "        type_description_hash: \"\"",
            f"      message_count: {sum(event[0] == topic for event in events)}",
        ]
    lines += [f"  compression_format: \"{'zstd' if compressed else ''}\"", f"  compression_mode: \"{'FILE' if compressed else ''}\""]
    lines += ["  relative_file_paths:"] + [f"    - {name}" for name in names] + ["  files:"]
    for name, part in zip(names, parts):
        start, duration = span(part)
        lines += [
            f"    - path: {name}",
            "      starting_time:",
            f"        nanoseconds_since_epoch: {start}",
            "      duration:",
            f"        nanoseconds: {duration}",
            f"      message_count: {len(part)}",
        ]
    return "\n".join(lines + ["  custom_data: ~", "  ros_distro: jazzy", ""])
