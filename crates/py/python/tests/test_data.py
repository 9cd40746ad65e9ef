"""Files, Arrow tables and arrays, opened as one thing: the same rows are the same numbers whatever holds them."""

from __future__ import annotations

import datetime
import gc
import os
import pickle
import subprocess
import sys
from decimal import Decimal

import fleetfoot as ff
import numpy as np
import pytest

pa = pytest.importorskip("pyarrow", reason="pyarrow is not installed")
pl = pytest.importorskip("polars", reason="polars is not installed")
import pyarrow.parquet as pq  # noqa: E402

ROWS = 5_000


def columns(rows=ROWS):
    """Two episodes, with missing values and texts."""
    rng = np.random.default_rng(7)
    t = np.arange(rows) * 0.01
    t[rows // 2 :] += 60.0
    x = rng.normal(size=rows)
    x[17] = np.nan
    return {
        "t": t,
        "x": x,
        "single": rng.normal(size=rows).astype(np.float32),
        "count": rng.integers(-(2**40), 2**40, size=rows),
        "small": rng.integers(0, 255, size=rows).astype(np.uint8),
        "flag": rng.random(rows) < 0.5,
        "terrain": np.array(["sand", "grass", "mud"])[rng.integers(0, 3, size=rows)],
    }


NAMES = list(columns(20))


def bits(table):
    """All columns as bits, texts as they are; NaN are one."""
    out = {}
    for name in table.columns:
        values = table[name]
        if values.dtype.kind == "f":
            values = np.where(np.isnan(values), np.nan, values).view(np.int64)
        out[name] = values
    return out


def same(table, wanted):
    table, wanted = bits(table), bits(wanted)
    assert list(table) == list(wanted)
    for name in wanted:
        if name == "episode":
            # Episodes are called as their file or table; which rows are together must agree.
            borders = [np.flatnonzero(one[1:] != one[:-1]) for one in (table[name], wanted[name])]
            np.testing.assert_array_equal(*borders)
        else:
            np.testing.assert_array_equal(table[name], wanted[name], err_msg=name)


@pytest.fixture(scope="module")
def wanted(tmp_path_factory):
    path = tmp_path_factory.mktemp("data") / "run.parquet"
    pq.write_table(pa.table(columns()), path, row_group_size=1_000)
    table = ff.read(str(path), NAMES)
    assert len(set(table["episode"])) == 2 and len(table) == ROWS
    return table


def chunked(table, size):
    return pa.Table.from_batches(table.to_batches(max_chunksize=size))


def through_duckdb():
    duckdb = pytest.importorskip("duckdb", reason="duckdb is not installed")
    arrow_table = pa.table(columns())  # noqa: F841 - duckdb finds it by its name
    return duckdb.sql("select * from arrow_table")


def through_pandas():
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    return pandas.DataFrame(columns())


SOURCES = {
    "pyarrow": lambda: pa.table(columns()),
    "pyarrow in chunks": lambda: chunked(pa.table(columns()), 777),
    "pyarrow batch": lambda: pa.table(columns()).combine_chunks().to_batches()[0],
    "pyarrow reader": lambda: chunked(pa.table(columns()), 777).to_reader(),
    "polars": lambda: pl.DataFrame(columns()),
    "polars in chunks": lambda: pl.concat(
        [pl.DataFrame(columns())[:1234], pl.DataFrame(columns())[1234:]], rechunk=False
    ),
    "polars categories": lambda: pl.DataFrame(columns()).with_columns(pl.col("terrain").cast(pl.Categorical)),
    "polars nulls": lambda: pl.DataFrame(columns()).with_columns(pl.col("x").fill_nan(None)),
    "pandas": through_pandas,
    "duckdb": through_duckdb,
    "iterator of batches": lambda: iter(chunked(pa.table(columns()), 777).to_batches()),
    "generator of polars": lambda: (pl.DataFrame(columns())[at : at + 900] for at in range(0, ROWS, 900)),
}


@pytest.mark.parametrize("kind", SOURCES)
def test_tables_give_the_bits_of_the_file(kind, wanted):
    same(ff.read(ff.open(SOURCES[kind](), name="run"), NAMES), wanted)


def numbers():
    return {name: values for name, values in columns().items() if name != "terrain"}


def strided(values):
    wide = np.zeros((len(values), 3), dtype=values.dtype)
    wide[:, 1] = values
    return wide[:, 1]


def backwards(values):
    return values[::-1].copy()[::-1]


@pytest.mark.parametrize("layout", [np.asarray, strided, backwards], ids=["contiguous", "strided", "backwards"])
def test_arrays_give_the_bits_of_the_file(layout, wanted):
    read = ff.read({name: layout(values) for name, values in numbers().items()}, NAMES[:-1])
    for name in read.columns[1:]:
        np.testing.assert_array_equal(read[name], wanted[name], err_msg=name)


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_matrices_of_any_order(order, kind):
    x = np.asarray(np.random.default_rng(1).normal(size=(300, 4)), dtype=kind, order=order)
    read = ff.read(ff.open(x, dt=0.01))
    for place in range(4):
        np.testing.assert_array_equal(read[f"x{place}"], x[:, place].astype(np.float64))
    np.testing.assert_array_equal(read["stamp"].astype(np.int64), np.arange(300) * 10_000_000)


def test_where_selects_rows():
    t = np.arange(300) * 0.01
    mode = np.where(np.arange(300) % 100 < 60, "walk", "stand")
    log = {"t": t, "x": np.cos(3 * t), "armed": (t > 1).astype(np.int8), "mode": mode.tolist()}
    table = pa.table(log)
    rows = ff.read(ff.open(table, t="t", where="armed > 0 and t < 2.5"), columns=["x", "t"])
    np.testing.assert_array_equal(rows["t"], t[(t > 1) & (t < 2.5)])
    walking = ff.open(table, t="t", where="mode == 'walk'")
    assert len(ff.read(walking, columns=["x"])["x"]) == 180
    assert len(ff.read(pickle.loads(pickle.dumps(walking)), columns=["x"])["x"]) == 180
    assert len(ff.read(ff.open(walking, where="all"), columns=["x"])["x"]) == 300
    with pytest.raises(ff.exceptions.FleetfootError, match="none of the 300 rows satisfies"):
        ff.read(ff.open(table, t="t", where="t > 9"), columns=["x"])


def test_models_of_tables_and_files_are_the_same_bits(tmp_path):
    data = {name: values for name, values in columns().items() if name in ("t", "single", "count", "small")}
    path = tmp_path / "run.parquet"
    pq.write_table(pa.table(data), path)
    recipe = {"states": {"single": {}}, "inputs": {"small": "small"}, "time": {"column": "t"}}
    fits = {
        "file": ff.open(path, recipe=recipe),
        "polars": ff.open(pl.DataFrame(data), recipe=recipe),
        "pyarrow": ff.open(chunked(pa.table(data), 501), recipe=recipe),
        "numpy": ff.open(data, recipe=recipe),
    }
    coefficients_of = {name: ff.PWA().fit(data).model_.coefficients() for name, data in fits.items()}
    for name, coefficients in coefficients_of.items():
        np.testing.assert_array_equal(coefficients, coefficients_of["file"], err_msg=name)


def test_times_of_every_type():
    start = np.datetime64("2026-01-02T03:04:05.000000001", "ns")
    stamps = start + np.arange(50) * np.timedelta64(20, "ms")
    x = np.arange(50.0)
    wanted = stamps.astype(np.int64)
    nanoseconds = pa.table({"when": pa.array(stamps), "x": x})
    np.testing.assert_array_equal(ff.read(nanoseconds, ["x"], t="when")["stamp"].astype(np.int64), wanted)
    np.testing.assert_array_equal(ff.read({"when": stamps, "x": x}, ["x"], t="when")["stamp"].astype(np.int64), wanted)
    np.testing.assert_array_equal(ff.read({"x": x}, ["x"], t=stamps)["stamp"].astype(np.int64), wanted)
    for unit, table in [(unit, table) for unit in ("ms", "us") for table in (pa.table, dict)]:
        coarse = stamps.astype(f"datetime64[{unit}]")
        when = pa.array(coarse) if table is pa.table else coarse
        read = ff.read(table({"when": when, "x": x}), ["x", "when"], t="when")
        np.testing.assert_array_equal(read["stamp"], coarse)
        # As a value a time is its seconds.
        np.testing.assert_allclose(read["when"], coarse.astype(np.int64) * {"ms": 1e-3, "us": 1e-6}[unit], rtol=1e-15)
    zoned = pa.table({"when": pa.array(stamps).cast(pa.timestamp("ns", "Europe/Berlin")), "x": x})
    np.testing.assert_array_equal(ff.read(zoned, ["x"], t="when")["stamp"].astype(np.int64), wanted)
    spans = pa.table({"when": pa.array(np.arange(50) * np.timedelta64(20, "ms")), "x": x})
    np.testing.assert_array_equal(ff.read(spans, ["x"], t="when")["stamp"].astype(np.int64), np.arange(50) * 20_000_000)
    days = pa.table({"when": pa.array([datetime.date(1970, 1, day) for day in (1, 2, 3)]), "x": x[:3]})
    np.testing.assert_array_equal(
        ff.read(days, ["x"], t="when")["stamp"].astype(np.int64), np.arange(3) * 86_400 * 10**9
    )


def test_decimals_halves_and_structs(tmp_path):
    values = [Decimal("1.25"), None, Decimal("-3.75")]
    pose = [{"x": 1.0, "y": {"z": 2}}, None, {"x": 3.0, "y": {"z": None}}]
    table = pa.table(
        {
            "t": [0.0, 0.1, 0.2],
            "price": pa.array(values, pa.decimal128(12, 2)),
            "half": pa.array(np.array([0.5, 1.5, -2.0], np.float16)),
            "pose": pa.array(pose, pa.struct([("x", pa.float64()), ("y", pa.struct([("z", pa.int64())]))])),
        }
    )
    read = ff.read(table, ["price", "half", "pose.x", "pose.y.z"])
    np.testing.assert_array_equal(read["price"], [1.25, np.nan, -3.75])
    np.testing.assert_array_equal(read["half"], [0.5, 1.5, -2.0])
    np.testing.assert_array_equal(read["pose.x"], [1.0, np.nan, 3.0])
    np.testing.assert_array_equal(read["pose.y.z"], [2.0, np.nan, np.nan])
    pq.write_table(table, tmp_path / "a.parquet")
    same(read, ff.read(tmp_path / "a.parquet", ["price", "half", "pose.x", "pose.y.z"]))


def test_units_come_along():
    field = pa.field("v", pa.float64(), metadata={"unit": "m/s"})
    table = pa.table(
        [pa.array([0.0, 1.0]), pa.array([1.0, 2.0])], schema=pa.schema([pa.field("t", pa.float64()), field])
    )
    assert ff.read(table, ["v"]).units["v"] == "m/s"


def test_unreadable_columns_are_refused_on_request():
    table = pa.table({"t": [0.0, 0.1], "x": [1.0, 2.0], "many": [[1, 2], [3]]})
    assert ff.read(table, ["x"])["x"].tolist() == [1.0, 2.0]
    with pytest.raises(ff.exceptions.DataError, match="many"):
        ff.read(table, ["many"])
    with pytest.raises(ff.exceptions.RequestError, match="y"):
        ff.read(table, ["y"])
    texts = pa.table({"t": np.arange(70_000.0), "word": [f"w{i}" for i in range(70_000)], "x": np.zeros(70_000)})
    assert len(ff.read(texts, ["x"])) == 70_000
    with pytest.raises(ff.exceptions.DataError, match="word"):
        ff.read(texts, ["word"])
    with pytest.raises(ff.exceptions.DataError, match="word"):
        ff.read(texts, ["x"], t="word")


@pytest.mark.parametrize(
    ("call", "error", "says"),
    [
        (lambda: ff.open(3), TypeError, "int"),
        (lambda: ff.open([]), ValueError, "empty"),
        (lambda: ff.open({}), ValueError, "no columns"),
        (lambda: ff.open({"a": np.zeros(3), "b": np.zeros(4)}), ff.exceptions.DataError, "`b` has 4 rows"),
        (lambda: ff.open({"a": np.zeros((3, 2, 2))}), ff.exceptions.DataError, "dimensions"),
        (lambda: ff.open({"a": np.array(["x", "y"])}), ff.exceptions.DataError, "cannot be read as numbers"),
        (lambda: ff.open(np.zeros((3, 2)), t=[0.0, 1.0, 2.0], dt=0.1), ValueError, "t and dt"),
        (lambda: ff.open([np.zeros(3), np.zeros(3)], t=[np.arange(3.0)]), ValueError, "1 arrays for 2 runs"),
        (lambda: ff.open("no such *.mcap"), ff.exceptions.DataError, "nothing matches"),
        (lambda: ff.open({"a": np.zeros(3)}, dt=-1.0), ff.exceptions.OptionError, "positive"),
        (lambda: ff.open({"a": np.zeros(3)}, recipe={"stats": {}}), ff.exceptions.RequestError, "stats"),
        (lambda: ff.open({"a": np.zeros(3)}, recipe="nowhere.toml"), ff.exceptions.RequestError, "nowhere.toml"),
        (lambda: ff.open({"a": np.zeros(3)}, recipe=7), TypeError, "recipe"),
        (lambda: ff.open(iter([1, 2])), TypeError, "batch 0"),
        (
            lambda: ff.open(iter([pa.table({"a": [1.0]}), pa.table({"a": [1]})])),
            ff.exceptions.DataError,
            "batch 1",
        ),
        (lambda: ff.read({"t": np.arange(3.0)}, "t"), TypeError, "list"),
        (lambda: ff.read({"t": np.arange(3.0)}, progress=3), TypeError, "progress"),
    ],
)
def test_mistakes_are_named(call, error, says):
    with pytest.raises(error, match=says):
        call()


def test_recipes_in_every_form(tmp_path):
    recipe = {"states": {"x": {"derivative": "auto"}}, "model": {"degree": np.int64(2)}}
    text = '[states.x]\nderivative = "auto"\n\n[model]\ndegree = 2\n'
    path = tmp_path / "robot.toml"
    path.write_text(text)
    data = {"t": np.arange(3.0), "x": np.zeros(3)}
    recipes = [ff.open(data, recipe=one).recipe for one in (recipe, text, path, str(path))]
    assert recipes == [text] * 4
    assert "dt = 0.5" in ff.open(data, recipe=text, dt=0.5).recipe
    assert ff.open(data).recipe == ""
    both = ff.open(data, name="a", recipe=text) + ff.open(data, name="b")
    assert (both.names, both.recipe, len(both)) == (["a", "b"], text, 2)


def test_files_of_runs_are_topics(tmp_path):
    t = np.arange(400) * 0.01
    for run in range(2):
        folder = tmp_path / "runs" / f"run_{run}"
        folder.mkdir(parents=True)
        x = np.sin(t + run)
        pq.write_table(pa.table({"t": t, "x": x, "rate": np.cos(t + run)}), folder / "odom.parquet")
        pl.DataFrame({"t": t[::7], "u": x[::7]}).write_csv(folder / "cmd.csv")
    recipe = {
        "files": {"odom": "odom.parquet", "cmd": "cmd*.csv"},
        "columns": {"x": "odom.x", "rate": "odom.rate"},
        "states": {"x": {"derivative": "rate"}},
        "inputs": {"u": "cmd.u"},
    }
    runs = tmp_path / "runs"
    table = ff.read(ff.open(runs, recipe=recipe), ["x", "u"])
    assert len(table["x"]) == 800
    np.testing.assert_allclose(table["u"][:390], np.repeat(np.sin(t[::7]), 7)[:390])
    model = ff.PWA(partition="average").fit(ff.open(runs, recipe=recipe)).model_
    report = model.score(runs / "run_1")
    assert report["in_sample_episodes"] == ["run_1"]
    with pytest.raises(ff.exceptions.DataError, match=r"no file for `cmd = .*\[files\]"):
        (runs / "run_1" / "cmd.csv").unlink()
        model.score(runs)


def test_two_parts_of_a_quaternion_are_joined_as_four(tmp_path):
    t = np.arange(400) * 0.01
    sign = np.where(np.arange(400) % 2, -1.0, 1.0)
    none = np.zeros(400)
    camera = {"t": t, "px": t, "py": t, "pz": t}
    turned = {"qx": none, "qy": none, "qz": sign * np.sin(t / 2), "qw": sign * np.cos(t / 2)}
    pq.write_table(pa.table(camera | turned), tmp_path / "mocap.parquet")
    pq.write_table(pa.table({"t": t[::2] + 0.005, "v": t[::2]}), tmp_path / "odom.parquet")
    recipe = {
        "files": {"odom": "odom.*", "mocap": "mocap.*"},
        "time": {"base": "odom"},
        "join": {"mocap.*": "slerp"},
    }
    table = ff.read(ff.open(tmp_path, recipe=recipe), ["mocap.qz", "mocap.qw", "mocap.px"])
    np.testing.assert_allclose(2 * np.arctan2(table["mocap.qz"], table["mocap.qw"]), t[::2] + 0.005, atol=1e-12)
    np.testing.assert_allclose(table["mocap.px"], t[::2] + 0.005, atol=1e-12)


def test_lists_of_runs_with_their_clocks():
    runs = [np.random.default_rng(i).normal(size=(20 + i, 2)) for i in range(3)]
    stamps = [np.arange(20 + i) * 0.1 for i in range(3)]
    read = ff.read(ff.open(runs, t=stamps))
    assert list(dict.fromkeys(read["episode"])) == ["run 0", "run 1", "run 2"]
    np.testing.assert_array_equal(read["x1"], np.concatenate([run[:, 1] for run in runs]))


ZERO_COPY = """
import os, sys, numpy as np, fleetfoot as ff

def resident():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGESIZE")

rows = 2_000_000
data = {f"c{i}": np.arange(rows) * (i + 1.0) for i in range(10)}
data["t"] = np.arange(rows) * 0.01
if sys.argv[1] == "polars":
    import polars
    table = polars.DataFrame(data)
elif sys.argv[1] == "pyarrow":
    import pyarrow
    table = pyarrow.table(data)
elif sys.argv[1] == "fortran":
    table = np.asfortranarray(np.column_stack(list(data.values())))
else:
    table = data
ff.read({"t": np.arange(10.0)})
before = resident()
opened = ff.open(table, dt=0.01)
grown = ff.read(opened, ["x0" if sys.argv[1] == "fortran" else "c0"])
print((resident() - before) / (8 * 11 * rows))
"""


@pytest.mark.parametrize("kind", ["polars", "pyarrow", "numpy", "fortran"])
@pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="resident memory is told by /proc alone")
def test_tables_are_not_copied(kind):
    """Memory grows by the column of eleven that is read back, its stamps, seconds, episodes, and blocks in flight."""
    run = subprocess.run([sys.executable, "-c", ZERO_COPY, kind], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert float(run.stdout) < 0.6, f"memory grew by {run.stdout.strip()} tables"


def test_data_keep_their_arrays_alive():
    opened = ff.open(pl.DataFrame({"t": np.arange(1000.0), "x": np.arange(1000.0) * 2}))
    arrays = ff.open({"t": np.arange(1000.0), "x": np.arange(1000.0) * 2})
    gc.collect()
    junk = [np.full(1000, np.nan) for _ in range(50)]
    np.testing.assert_array_equal(ff.read(opened, ["x"])["x"], np.arange(1000.0) * 2)
    np.testing.assert_array_equal(ff.read(arrays, ["x"])["x"], np.arange(1000.0) * 2)
    assert len(junk) == 50


def test_progress_is_reported_and_stops():
    reports = []
    ff.read({"t": np.arange(300_000.0), "x": np.zeros(300_000)}, ["x"], progress=lambda *all: reports.append(all))
    assert all(isinstance(stage, str) and done >= 0 and total >= 0 for stage, done, total in reports)
    pytest.importorskip("tqdm", reason="tqdm is not installed")
    assert len(ff.read({"t": np.arange(10.0)}, progress=True)) == 10
