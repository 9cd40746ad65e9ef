"""Files that h5py and pyarrow read: every number is the one that was written."""

from __future__ import annotations

import fleetfoot as ff
import numpy as np
import pytest
from command import run

h5py = pytest.importorskip("h5py", reason="h5py is not installed")
pa = pytest.importorskip("pyarrow", reason="pyarrow is not installed")
from pyarrow import feather  # noqa: E402

ROWS = 400


def arrays():
    """A clock, a vector a row, and a column of whole numbers."""
    rng = np.random.default_rng(5)
    return {
        "t": np.arange(ROWS) * 0.01,
        "gyro": rng.normal(size=(ROWS, 3)),
        "count": rng.integers(0, 1000, size=ROWS),
        "flag": rng.random(ROWS) < 0.5,
    }


def hdf5(path):
    """Groups, structs, a text, a setting and an empty array."""
    columns = arrays()
    with h5py.File(path, "w") as file:
        file["t"] = columns["t"]
        file.create_dataset("imu/gyro", data=columns["gyro"], compression="gzip", chunks=(50, 3))
        file["imu/count"] = columns["count"]
        file["flag"] = columns["flag"]
        pose = np.zeros(ROWS, dtype=[("x", "f8"), ("y", ">f4")])
        pose["x"], pose["y"] = columns["gyro"][:, 0], columns["gyro"][:, 1]
        file["pose"] = pose
        file["robot"] = "name"
        file["mass"] = 1.5
        file["gains"] = np.arange(4.0)
        file["nothing"] = np.zeros((0, 3))
    return path


def matlab(path):
    """A file as `save -v7.3` writes it: MATLAB's head, transposed matrices and marked texts."""
    columns = arrays()
    with h5py.File(path, "w", userblock_size=512) as file:
        file["t"] = columns["t"][None, :]
        file["imu/gyro"] = columns["gyro"].T
        file["imu/count"] = columns["count"][:, None].astype(float).T
        text = file.create_dataset("robot", data=np.zeros((ROWS, 1), dtype=np.uint16))
        text.attrs["MATLAB_class"] = np.bytes_("char")
        file["t"].attrs["MATLAB_class"] = np.bytes_("double")
        file["#refs#/a"] = np.arange(ROWS)[None, :]
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512, b" "))
    return path


def read(source, names):
    table = ff.read(ff.open(source), names)
    return [table[name] for name in names]


def test_hdf5_gives_the_numbers_that_h5py_wrote(tmp_path):
    columns, path = arrays(), hdf5(tmp_path / "run.h5")
    with pytest.warns(UserWarning) as warned:
        data = ff.open(path)
    messages = " ".join(str(one.message) for one in warned)
    assert "other lengths than 400 rows: gains" in messages and "no numbers: robot" in messages
    assert data.names == [str(path)]
    names = ["imu.gyro[0]", "imu.gyro[1]", "imu.gyro[2]", "imu.count", "flag", "pose.x", "pose.y"]
    table = ff.read(data, names)
    np.testing.assert_allclose(table["t"], columns["t"], atol=1e-12)
    for at in range(3):
        np.testing.assert_array_equal(table[f"imu.gyro[{at}]"], columns["gyro"][:, at])
    np.testing.assert_array_equal(table["imu.count"], columns["count"])
    np.testing.assert_array_equal(table["flag"], columns["flag"])
    np.testing.assert_array_equal(table["pose.x"], columns["gyro"][:, 0])
    np.testing.assert_array_equal(table["pose.y"], columns["gyro"][:, 1].astype(np.float32))


def test_matlab_73_is_read_by_h5py(tmp_path):
    columns, path = arrays(), matlab(tmp_path / "run.mat")
    with pytest.warns(UserWarning, match="no numbers: robot"):
        data = ff.open(str(path))
    names = ["imu.gyro[0]", "imu.gyro[1]", "imu.gyro[2]", "imu.count"]
    table = ff.read(data, names)
    np.testing.assert_allclose(table["t"], columns["t"], atol=1e-12)
    for at in range(3):
        np.testing.assert_array_equal(table[f"imu.gyro[{at}]"], columns["gyro"][:, at])
    np.testing.assert_array_equal(table["imu.count"], columns["count"])


def table():
    columns = arrays()
    return pa.table(
        {
            "t": columns["t"],
            "x": columns["gyro"][:, 0],
            "count": columns["count"],
            "flag": columns["flag"],
            "place": pa.array([["a", "b"][row % 2] for row in range(ROWS)]).dictionary_encode(),
        }
    )


def stream(path, table):
    with pa.ipc.new_stream(path, table.schema) as writer:
        writer.write_table(table, max_chunksize=77)


def file(path, table):
    with pa.ipc.new_file(path, table.schema) as writer:
        writer.write_table(table, max_chunksize=77)


WRITERS = {
    "feather, lz4": lambda path, table: feather.write_feather(table, path),
    "feather, zstd": lambda path, table: feather.write_feather(table, path, compression="zstd", chunksize=100),
    "feather, plain": lambda path, table: feather.write_feather(table, path, compression="uncompressed"),
    "file": file,
    "stream": stream,
}


@pytest.mark.parametrize("kind", WRITERS)
def test_arrow_files_and_streams_equal_tables(kind, tmp_path):
    path = str(tmp_path / ("run.feather" if kind.startswith("feather") else "run.arrow"))
    wanted = table()
    WRITERS[kind](path, wanted)
    x, count, flag, place = read(path, ["x", "count", "flag", "place"])
    np.testing.assert_array_equal(x, wanted["x"].to_numpy())
    np.testing.assert_array_equal(count, wanted["count"].to_numpy())
    np.testing.assert_array_equal(flag, wanted["flag"].to_numpy(zero_copy_only=False))
    assert list(place) == wanted["place"].to_pylist()


def test_damaged_files_are_refused_and_never_more(tmp_path):
    sources = {"run.h5": hdf5, "run.mat": matlab}
    rng = np.random.default_rng(2)
    for name in (*sources, "run.feather", "run.arrow"):
        path = tmp_path / name
        if name in sources:
            sources[name](path)
        else:
            (stream if name == "run.arrow" else WRITERS["feather, plain"])(str(path), table())
        whole = path.read_bytes()
        refused = 0
        for at in range(60):
            damaged = bytearray(whole[: len(whole) * (at + 1) // 61] if at % 2 else whole)
            for place in rng.integers(0, len(damaged), size=3 if at % 2 == 0 else 0):
                damaged[place] ^= 0xFF
            path.write_bytes(damaged)
            try:
                ff.read(ff.open(path), ["t"])
            except ff.exceptions.FleetfootError as problem:
                assert str(path) in str(problem) or "t" in str(problem)
                refused += 1
        assert refused >= 20, name


def test_several_files_are_one_data_set_and_fit(tmp_path):
    t = np.arange(600) * 0.01
    paths = [tmp_path / "a.h5", tmp_path / "b.feather", tmp_path / "c.csv"]
    x = [np.exp(-0.7 * t) * start for start in (1.0, -2.0, 0.5)]
    with h5py.File(paths[0], "w") as out:
        out["t"], out["x"] = t, x[0]
    feather.write_feather(pa.table({"t": t, "x": x[1]}), paths[1])
    np.savetxt(paths[2], np.column_stack([t, x[2]]), delimiter=",", header="t,x", comments="")
    data = ff.open(paths)
    assert len(data) == 3
    model = ff.SINDy(states=["x"]).fit(data)
    assert "-0.7" in str(model.equations())


def test_the_command_names_this_way(tmp_path):
    for path, package in ((hdf5(tmp_path / "run.h5"), "h5py"), (matlab(tmp_path / "run.mat"), "h5py")):
        message = run("info", str(path), code=1).stderr
        assert f'ff.open("{path.name}")' in message and package in message, message
