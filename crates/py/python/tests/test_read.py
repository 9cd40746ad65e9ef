"""Robots' logs as tables, against an independent reader."""

from __future__ import annotations

import fleetfoot as ff
import numpy as np
import pytest
from recordings import DATA, recording

STAMPS = ("log_time", "publish_time", "header_stamp")
LOGS = sorted((DATA / "mcap").glob("*.mcap"))


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    made = ff.generate("diffdrive", tmp_path_factory.mktemp("logs"), seconds=3.0, seed=5)
    return made.files[0]


def peer(path, topic):
    """The messages of a topic by mcap-ros2-support."""
    reader = pytest.importorskip("mcap_ros2.reader", reason="mcap-ros2-support is not installed")
    return list(reader.read_ros2_messages(str(path), topics=[topic], log_time_order=False))


def field(message, path):
    """A field of a decoded message by its path; NaN or None where it has none."""
    for step in path.replace("]", "").replace("[", ".#").split("."):
        try:
            message = message[int(step[1:])] if step.startswith("#") else getattr(message, step)
        except (IndexError, AttributeError):
            return np.nan
    return message


def agree(path, topic):
    table, messages = ff.read_mcap(path, topic), peer(path, topic)
    assert len(table) == len(messages)
    np.testing.assert_array_equal(table["log_time"].astype(np.int64), [one.log_time_ns for one in messages])
    np.testing.assert_array_equal(table["publish_time"].astype(np.int64), [one.publish_time_ns for one in messages])
    compared = 0
    for name in table.columns:
        # Elements that are told apart by a name have no place in the message's type, and the peer leaves out the
        # member that empty types are padded with.
        named = "[" in name and not name.split("[")[1][0].isdigit()
        if named or name in STAMPS or name.endswith("structure_needs_at_least_one_member"):
            continue
        values = [field(one.ros_msg, name) for one in messages]
        if table[name].dtype == object:
            assert table[name].tolist() == [None if value != value else str(value) for value in values], name
        else:
            np.testing.assert_array_equal(table[name], np.array(values, dtype=np.float64), err_msg=f"{topic}.{name}")
        compared += 1
    if "header_stamp" in table and hasattr(messages[0].ros_msg, "header"):
        stamps = [one.ros_msg.header.stamp for one in messages]
        header_stamps = table["header_stamp"].astype(np.int64)
        np.testing.assert_array_equal(header_stamps, [stamp.sec * 10**9 + stamp.nanosec for stamp in stamps])
    return compared


def test_generated_log_equals_peer(log):
    pytest.importorskip("mcap_ros2", reason="mcap-ros2-support is not installed")
    topics = [topic for topic in ff.info(log)["topics"] if topic["messages"] and topic["message_encoding"] == "cdr"]
    assert len(topics) >= 3
    compared = {topic["name"]: agree(log, topic["name"]) for topic in topics}
    assert sum(compared.values()) > 50, compared


def test_logs_of_other_writers_exist():
    assert list(recording("mcap").glob("*.mcap"))


@pytest.mark.skipif(not LOGS, reason="there are no recordings; set FLEETFOOT_DATA")
@pytest.mark.parametrize("path", LOGS, ids=lambda path: path.stem)
def test_logs_of_other_writers_equal_peer(path):
    pytest.importorskip("mcap_ros2", reason="mcap-ros2-support is not installed")
    ours = [topic for topic in ff.info(path)["topics"] if topic["messages"] and topic["message_encoding"] == "cdr"]
    readable = [topic["name"] for topic in ours if not topic["problem"] and topic["schema_encoding"] == "ros2msg"]
    compared = 0
    for name in readable[:12]:
        try:
            peer(path, name)
        except Exception as problem:  # noqa: BLE001 - what the peer cannot read is no yardstick
            if "not" not in str(problem) and not str(problem):
                raise
            continue
        compared += agree(path, name)
    if not compared:
        pytest.skip("the peer reads no topic of this log")


def test_tables_share_their_memory(log):
    pa = pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    pl = pytest.importorskip("polars", reason="polars is not installed")
    table = ff.read_mcap(log, "/odom")
    name = "twist.twist.linear.x"
    values = table[name]
    address = values.__array_interface__["data"][0]
    assert not values.flags.writeable
    assert table.to_pyarrow()[name].chunk(0).buffers()[1].address == address
    assert pa.table(table).schema.names == table.columns
    np.testing.assert_array_equal(table.to_polars()[name].to_numpy(), values)
    assert pl.DataFrame(table).height == len(table)
    np.testing.assert_array_equal(table.to_pandas()[name].to_numpy(), values)
    assert table.to_pandas()["frame" if "frame" in table else "header.frame_id"].dtype == "category"
    part = table[5:9]
    assert len(part) == 4 and part[name].__array_interface__["data"][0] == address + 5 * 8
    assert part.to_pyarrow().num_rows == 4
    del table
    assert np.isfinite(values).all()


def test_fields_and_topics_are_chosen(log):
    table = ff.read_mcap(log, "/odom", fields=["twist.twist.linear.x"])
    assert table.columns == ["log_time", "publish_time", "header_stamp", "twist.twist.linear.x"]
    both = ff.read_mcap(log, ["/odom", "/cmd_vel"])
    assert list(both) == ["/odom", "/cmd_vel"] and all(len(topic_table) > 0 for topic_table in both.values())
    assert ff.read_mcap(log, "/odom", fields=[]).columns[:2] == ["log_time", "publish_time"]
    with pytest.raises(ff.exceptions.DataError, match="/odo"):
        ff.read_mcap(log, "/odo")
    with pytest.raises(ff.exceptions.DataError, match="twist.linear"):
        ff.read_mcap(log, "/odom", fields=["twist.linear"])
    with pytest.raises(ff.exceptions.DataError, match="name one"):
        ff.read_mcap(log)
    with pytest.raises(ValueError, match="columns"):
        ff.read_mcap(log, "/odom", rate=10.0)
    with pytest.raises(ValueError, match="one of them"):
        ff.read_mcap(log, "/odom", columns=["/odom.twist.twist.linear.x"])
    with pytest.raises(KeyError, match="nothing"):
        table["nothing"]
    assert table[::2]["log_time"].tolist() == table["log_time"][::2].tolist()


def test_joined_rows(log):
    names = ["/odom.twist.twist.linear.x", "/cmd_vel.twist.linear.x", "2 * /odom.twist.twist.linear.x"]
    rows = ff.read_mcap(log, columns=names[:2])
    odometry = ff.read_mcap(log, "/odom", fields=["twist.twist.linear.x"])
    stamps, expected = rows["stamp"].astype(np.int64), odometry["log_time"].astype(np.int64)
    # Rows are those of the first column's topic, as far as the other has begun.
    kept = np.isin(expected, stamps)
    if kept.sum() != len(stamps):
        expected = odometry["header_stamp"].astype(np.int64)
        kept = np.isin(expected, stamps)
    assert kept.sum() == len(stamps) > 0.8 * len(expected)
    np.testing.assert_array_equal(rows[names[0]], odometry["twist.twist.linear.x"][kept])
    tens = ff.read_mcap(log, columns=names[:1], rate=10.0)
    np.testing.assert_array_equal(np.diff(tens["stamp"].astype(np.int64)), 10**8)
    with_recipe = ff.read_mcap(log, columns=["v", "v + v"], recipe={"columns": {"v": names[0]}})
    np.testing.assert_array_equal(with_recipe["v + v"], 2 * with_recipe["v"])
    assert with_recipe["t"][0] == 0.0


def test_info_reports_ranges(log, tmp_path):
    info = ff.info(log, values=True)
    assert info["format"].lower().startswith("mcap")
    column = next(one for one in info["columns"] if one["name"] == "/odom.twist.twist.linear.x")
    values = ff.read_mcap(log, "/odom", fields=["twist.twist.linear.x"])["twist.twist.linear.x"]
    assert column["statistics"]["count"] == len(values)
    assert column["statistics"]["min"] == values.min() and column["statistics"]["max"] == values.max()
    csv = tmp_path / "a.csv"
    csv.write_text("t,speed [m/s]\n0,1\n0.1,3\n0.2,2\n")
    csv_info = ff.info(csv, values=True)
    assert csv_info["rows"] == 3 and csv_info["clock"]["column"] == "t"
    assert csv_info["columns"][1]["unit"] == "m/s" and csv_info["columns"][1]["statistics"]["max"] == 3.0
    with pytest.raises(ff.exceptions.DataError, match="nowhere"):
        ff.info(tmp_path / "nowhere.csv")
