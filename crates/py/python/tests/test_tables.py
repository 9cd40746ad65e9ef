"""Tables of every library are fitted and predicted as what they are: the coefficients of the arrays, the kind that was given."""

from __future__ import annotations

import subprocess
import sys
import tempfile

import numpy as np
import pytest

import fleetfoot as ff
from fleetfoot.exceptions import DataError

#: The column of words is told, and no signal.
pytestmark = pytest.mark.filterwarnings("ignore:no signal, and left out")

pd = pytest.importorskip("pandas", reason="pandas is not installed")
pl = pytest.importorskip("polars", reason="polars is not installed")
pa = pytest.importorskip("pyarrow", reason="pyarrow is not installed")
xr = pytest.importorskip("xarray", reason="xarray is not installed")

PERIOD = 0.01
T = np.arange(500) * PERIOD
U = np.sin(3 * T)
NAMES = ["q", "v"]


def states():
    """x'' = -4 x + u, by small steps."""
    x = np.empty((len(T), 2))
    x[0] = 1.0, 0.0
    for k in range(len(T) - 1):
        now = x[k]
        for _ in range(20):
            now = now + PERIOD / 20 * np.array([now[1], -4 * now[0] + U[k]])
        x[k + 1] = now
    return x


X = states()


def frame():
    return pd.DataFrame({"q": X[:, 0], "v": X[:, 1], "t": T, "word": "a"})


def dated(t=T):
    return pd.DataFrame(X, columns=NAMES, index=pd.to_datetime(t, unit="s"))


#: Tables that have their clock within, and the type that comes back.
CLOCKED = {
    "pandas, column": lambda: (frame(), pd.DataFrame),
    "pandas, index of dates": lambda: (dated(), pd.DataFrame),
    "pandas, index with a zone": lambda: (dated().tz_localize("Europe/Berlin"), pd.DataFrame),
    "pandas, index of spans": lambda: (frame()[NAMES].set_index(pd.to_timedelta(T, unit="s")), pd.DataFrame),
    "pandas, index of numbers": lambda: (frame()[[*NAMES, "t"]].set_index("t"), pd.DataFrame),
    "polars": lambda: (pl.from_pandas(frame()), pl.DataFrame),
    "polars, lazy": lambda: (pl.from_pandas(frame()).lazy(), pl.LazyFrame),
    "pyarrow": lambda: (pa.table(frame()), pa.Table),
    "pyarrow, batch": lambda: (pa.RecordBatch.from_pandas(frame()), pa.RecordBatch),
    "xarray, data set": lambda: (
        xr.Dataset({"q": ("time", X[:, 0]), "v": ("time", X[:, 1])}, coords={"time": T}),
        xr.Dataset,
    ),
    "xarray, dates": lambda: (
        xr.Dataset({"q": ("when", X[:, 0]), "v": ("when", X[:, 1])}, coords={"when": dated().index.to_numpy()}),
        xr.Dataset,
    ),
    "xarray, array": lambda: (
        xr.DataArray(X, dims=("time", "state"), coords={"time": T, "state": NAMES}),
        xr.DataArray,
    ),
    "own": lambda: (ff.read({"t": T, "q": X[:, 0], "v": X[:, 1]}, NAMES), ff.Table),
}

ESTIMATORS = {
    "SINDy": lambda **more: ff.SINDy(library="poly(1)", **more),
    "PWA": lambda **more: ff.PWA(["average", 2], **more),
    "NARX": lambda **more: ff.NARX(2, degree=1, terms=3, direct=False, **more),
    "BlockSparse": lambda **more: ff.BlockSparse(degree=1, select="bic", **more),
}


def numbers(fit):
    """The coefficients, of every unknown function where they have libraries of their own."""
    if not isinstance(fit, ff.BlockSparse):
        return fit.coefficients()
    return np.concatenate([fit.coefficients(latent=latent["name"]) for latent in fit.report_["latents"]])


def values_of(table, names):
    """The columns of any table side by side."""
    if isinstance(table, pl.LazyFrame):
        table = table.collect()
    if isinstance(table, xr.DataArray):
        return table.to_numpy()
    return np.column_stack([np.asarray(table.column(name) if hasattr(table, "column") else table[name]) for name in names])


@pytest.mark.parametrize("kind", CLOCKED)
@pytest.mark.parametrize("make", ESTIMATORS.values(), ids=ESTIMATORS)
@pytest.mark.filterwarnings("error::fleetfoot.FleetfootWarning")
def test_tables_give_the_coefficients_of_arrays(make, kind):
    wanted = make().fit(X, T, feature_names=NAMES)
    table, back = CLOCKED[kind]()
    # All numbers are states, or those that are named.
    for fit in (make().fit(table), make(states=NAMES).fit(table)):
        np.testing.assert_allclose(numbers(fit), numbers(wanted), rtol=1e-12, atol=1e-13)
        assert fit.score(table) == pytest.approx(wanted.score(X, T), abs=1e-12)
        predicted = fit.predict(table)
        assert isinstance(predicted, back)
        expected = wanted.predict(X)
        np.testing.assert_allclose(values_of(predicted, fit.model_.outputs), expected, rtol=1e-9, atol=1e-9)
    assert list(make().fit(table).feature_names_in_) == NAMES


@pytest.mark.parametrize("make", ESTIMATORS.values(), ids=ESTIMATORS)
def test_columns_of_a_table_beside_a_clock(make):
    df = frame()
    wanted = make().fit(X, T, u=U, feature_names=NAMES, input_names=["u"])
    inputs = pd.DataFrame({"u": U})
    for fit in (
        make().fit(df[NAMES], T, u=inputs),
        make().fit(df[NAMES], df["t"], u=inputs),
        make().fit(df[NAMES], pl.Series(T), u=U, input_names=["u"]),
        make(states=NAMES, inputs=["u"]).fit(df.assign(u=U)),
        make(states=NAMES, inputs=["u"]).fit(df[NAMES].assign(u=U), T),
    ):
        np.testing.assert_array_equal(numbers(fit), numbers(wanted))
    even = make().fit(X, PERIOD, u=U, feature_names=NAMES, input_names=["u"])
    for fit in (make().fit(df[NAMES], PERIOD, u=inputs), make(dt=PERIOD).fit(df[NAMES], u=inputs)):
        np.testing.assert_array_equal(numbers(fit), numbers(even))
    fit = make().fit(df[NAMES], T, u=inputs)
    predicted = fit.predict(df[NAMES][:20], inputs[:20])
    np.testing.assert_array_equal(predicted.to_numpy(), wanted.predict(X[:20], U[:20]))
    assert list(predicted.columns) == list(fit.model_.outputs) and predicted.index.equals(df.index[:20])
    assert fit.score(df[NAMES], T, u=inputs) == wanted.score(X, T, u=U)


def test_lists_of_tables_are_runs():
    df = frame()
    runs = [df[:250], df[250:]]
    wanted = ff.SINDy(library="poly(1)").fit([X[:250], X[250:]], [T[:250], T[250:]], feature_names=NAMES)
    for fit in (
        ff.SINDy(library="poly(1)").fit(runs),
        ff.SINDy(library="poly(1)").fit([one[NAMES] for one in runs], [one["t"] for one in runs]),
        ff.SINDy(library="poly(1)", states=NAMES).fit(runs, "t"),
    ):
        np.testing.assert_array_equal(numbers(fit), numbers(wanted))
        assert fit.report_["episodes"] == 2
        assert [type(one) for one in fit.predict(runs)] == [pd.DataFrame] * 2
    with pytest.raises(DataError, match="run 1 has no column `v`"):
        ff.SINDy().fit([df, df[["q", "t"]]])


def test_targets_beside_tables():
    df = frame()
    dots = pd.DataFrame({"a": X[:, 1], "b": -4 * X[:, 0] + U})
    wanted = ff.SINDy(library="poly(1)").fit(X, T, dots.to_numpy(), U, NAMES, ["u"])
    fit = ff.SINDy(library="poly(1)").fit(df[NAMES], T, y=dots, u=pd.DataFrame({"u": U}))
    np.testing.assert_array_equal(numbers(fit), numbers(wanted))
    y = 2 * df["q"] - df["v"] + 1
    plain = ff.PWA(target="y").fit(X, y.to_numpy())
    for fit, table in (
        (ff.PWA(target="y").fit(df[NAMES], y), df[NAMES]),
        (ff.PWA(target="y").fit(df[NAMES].assign(y=y)), df[NAMES]),
        (ff.PWA(target="y", inputs=NAMES).fit(df[NAMES], y), df[["v", "q"]]),
    ):
        np.testing.assert_allclose(fit.coefficients(), plain.coefficients(), atol=1e-12)
        np.testing.assert_allclose(np.ravel(fit.predict(table)), y, atol=1e-9)
        assert fit.score(df[NAMES].assign(y=y)) == pytest.approx(1.0)
    assert isinstance(ff.PWA(target="y").fit(df[NAMES], y).predict(df[NAMES]), pd.Series)
    assert isinstance(ff.PWA(target="y").fit(pl.from_pandas(df[NAMES]), y).predict(pl.from_pandas(df)), pl.Series)


def test_variables_over_several_dimensions_are_columns():
    data = xr.Dataset({"leg": (("joint", "time"), X.T)}, coords={"time": T, "joint": ["hip", "knee"]})
    read = ff.read(data, ["leghip", "legknee"])
    np.testing.assert_array_equal(read["legknee"], X[:, 1])
    counted = ff.SINDy(library="poly(1)").fit(xr.DataArray(X, dims=("time", "k"), coords={"time": T}, name="leg"))
    assert list(counted.feature_names_in_) == ["leg0", "leg1"]
    with pytest.raises(ValueError, match="dimensions"):
        ff.open(xr.DataArray(np.zeros((3, 2, 2)), dims=("time", "a", "b")))


WITHOUT_ARROW = """
import sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] == "pyarrow":
            raise ImportError(name + " is blocked")

sys.meta_path.insert(0, Blocked())
import warnings, numpy as np, pandas as pd, fleetfoot as ff
t = np.arange(300) * 0.01
x = np.column_stack([np.cos(2 * t), -2 * np.sin(2 * t)])
wanted = ff.SINDy(library="poly(1)").fit(x, t, feature_names=["q", "v"]).coefficients()
df = pd.DataFrame(x, columns=["q", "v"], index=pd.to_datetime(t, unit="s")).assign(word="a")
for fit in (ff.SINDy(library="poly(1)").fit(df), ff.SINDy(library="poly(1)", states=["q", "v"]).fit(df)):
    assert np.array_equal(fit.coefficients(), wanted)
    assert isinstance(fit.predict(df), pd.DataFrame)
assert ff.read(df, ["q"])["stamp"][1] == df.index[1].to_numpy()
with warnings.catch_warnings(record=True) as told:
    warnings.simplefilter("always")
    ff.open(df)
assert any("left out" in str(one.message) and "`word`" in str(one.message) for one in told)
try:
    ff.open(df.assign(v=["-", *map(str, x[1:, 1])]))
except ff.exceptions.DataError as error:
    assert "column `v`" in str(error)
    print("fitted")
"""


def test_an_index_of_times_is_a_clock_without_pyarrow():
    process = subprocess.run([sys.executable, "-c", WITHOUT_ARROW], capture_output=True, text=True, check=False)
    assert process.returncode == 0 and "fitted" in process.stdout, process.stderr


def test_index_of_times_is_the_clock():
    late = dated(T + (T > 2.0) * 60.0)
    read = ff.read(ff.open(late), NAMES)
    np.testing.assert_array_equal(read["stamp"], late.index.to_numpy())
    assert len(set(read["episode"])) == 2
    # Arguments override it.
    even = ff.read(ff.open(late, dt=0.5), NAMES)
    assert even["t"][1] == 0.5 and len(set(even["episode"])) == 1
    assert ff.read(ff.open(late, recipe={"time": {"dt": 0.5}}), NAMES)["t"][1] == 0.5
    with pytest.raises(ValueError, match="index of times"):
        ff.open([late, late.reset_index(drop=True)])


# -- the package's own tables


def small_table():
    return ff.read({"t": np.arange(5) * 0.5, "x": np.array([1.0, 2.0, 4.0, 8.0, 16.0]), "y": np.arange(5.0)}, ["x", "y"])


@pytest.mark.parametrize(
    "key",
    [2, -1, slice(1, 3), slice(None, None, 2), slice(None, None, -1), [0, 3], [True, False, True, False, True], np.array([4, 0]), []],
    ids=str,
)
def test_rows_of_a_table(key):
    table = small_table()
    rows = np.atleast_1d(np.arange(5)[key])
    selected = table[key]
    assert isinstance(selected, ff.Table) and len(selected) == len(rows) and selected.columns == table.columns
    for name in table.columns:
        np.testing.assert_array_equal(selected[name], table[name][rows])
    assert selected.units == table.units


def test_columns_of_a_table():
    table = small_table()
    assert table[["y", "x"]].columns == ["y", "x"] and len(table[["y", "x"]]) == 5
    both = table[table["x"] > 3, ["x"]]
    assert both.columns == ["x"] and both["x"].tolist() == [4.0, 8.0, 16.0]
    with pytest.raises(KeyError, match="no column `z`"):
        table[["x", "z"]]
    with pytest.raises(IndexError, match="9 is out of bounds"):
        table[9]
    assert pl.DataFrame(table[[3, 1]])["x"].to_list() == [8.0, 2.0]


def test_texts_are_taken_along():
    table = ff.read(pa.table({"t": [0.0, 0.1, 0.2], "word": ["b", None, "a"]}), ["word"])
    assert table[[2, 1]]["word"].tolist() == ["a", None]
    assert table[[2, 0]].to_pandas()["word"].tolist() == ["a", "b"]


USER = """
import fleetfoot as ff

one: ff.Table = ff.read_mcap("run.mcap")
topic: ff.Table = ff.read_mcap("run.mcap", "/odom", fields=["x"])
several: dict[str, ff.Table] = ff.read_mcap("run.mcap", ["/odom", "/imu"])
joined: ff.Table = ff.read_mcap("run.mcap", columns=["/odom.x"])
part: ff.Table = topic[topic["x"] > 0, ["x"]]
rows: ff.Table = topic[[1, 2]]
fit = ff.SINDy(threshold=0.1, dt=0.01).fit([[0.0, 1.0]], y=[[0.0, 1.0]])
score: float = fit.score([[0.0, 1.0]])
reveal_type(fit)
"""


def test_editors_know_return_types(tmp_path):
    pytest.importorskip("mypy", reason="mypy is not installed")
    (tmp_path / "user.py").write_text(USER)
    process = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "user.py"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert "fleetfoot._sindy.SINDy" in process.stdout, process.stdout
    assert process.returncode == 0, process.stdout


def worded(kind):
    """A log whose state `q` was written as words, and a mode beside it."""
    q = pd.Series([f"{value:,.2f}".replace(",", "_").replace(".", ",").replace("_", ".") for value in 1e3 * X[:, 0]])
    table = pd.DataFrame({"t": T, "q": q, "v": X[:, 1], "mode": np.where(T < 2, "auto", "manual")})
    return table.astype({"q": "category", "mode": "category"}) if kind == "category" else table


@pytest.mark.parametrize("kind", ["pandas", "category", "polars", "pyarrow", "parquet", "dictionaries"])
def test_text_is_no_number(kind, tmp_path):
    table = worded(kind)
    match kind:
        case "polars":
            table = pl.from_pandas(table)
        case "pyarrow":
            table = pa.Table.from_pandas(table)
        case "parquet" | "dictionaries":
            written, path = worded("category" if kind == "dictionaries" else kind), tmp_path / "log.parquet"
            written.to_parquet(path)
            table = path
    def fit(recipe, partition="average"):
        return ff.PWA(partition=partition).fit(ff.open(table, recipe=recipe)).model_

    with pytest.raises(DataError, match=r"the state `q` holds text \(\"1\.000,00\" in row 1\).*as in 1000\.00"):
        fit("[states]\nq = {}\n[inputs]\nv = {}\n")
    mode = r"`mode` holds text \(\"auto\" in row 1\).*labels:mode"
    with pytest.raises(DataError, match="the input " + mode):
        fit("[states]\nv = {}\n[inputs]\nmode = {}\n")
    with pytest.raises(DataError, match="the column " + mode):
        fit('[inputs]\nv = {}\n[model]\npredict = "mode"\n')
    assert len(fit("[states]\nv = {}\n", "labels:mode").regions) == 2


def test_times_of_the_day_pass_midnight():
    tenths = [(863_900 + i) % 864_000 for i in range(200)]
    clock = pa.array([tenth * 100_000 for tenth in tenths], pa.time64("us"))
    table = ff.read(pa.table({"time": clock, "x": [float(i % 7) for i in range(200)]}))
    seconds = table.to_pyarrow()["t"].to_pylist()
    assert seconds == pytest.approx([i / 10 for i in range(200)])


def test_other_libraries_take_the_columns_by_name():
    table = ff.read(pa.table({"t": T, "q": X[:, 0], "mode": ["a", "b"] * (len(T) // 2)}), ["q", "mode"])
    for frame in (pd.DataFrame(table), table.to_pandas()):
        assert list(frame.columns) == table.columns
        np.testing.assert_array_equal(frame["q"].to_numpy(), X[:, 0])
        np.testing.assert_array_equal(frame["stamp"].to_numpy(), table["stamp"])
        assert list(frame["mode"]) == ["a", "b"] * (len(T) // 2)
    assert pl.DataFrame(table).columns == table.columns
    np.testing.assert_array_equal(pl.DataFrame(table)["q"].to_numpy(), X[:, 0])
    first = next(iter(table))
    assert first["q"] == X[0, 0] and first["stamp"] == table["stamp"][0]


def test_numbers_of_a_table_go_through_dlpack():
    table = ff.read({"t": T, "q": X[:, 0], "v": X[:, 1]}, NAMES)
    np.testing.assert_array_equal(np.from_dlpack(table[NAMES]), X)
    np.testing.assert_array_equal(np.from_dlpack(table["q"]), X[:, 0])
    assert table.__dlpack_device__() == np.empty(1).__dlpack_device__()
    with pytest.raises(TypeError, match=r"`episode`, `stamp` holds no numbers: take table\[\['t', 'q', 'v'\]\]"):
        np.from_dlpack(table)


# -- lazy tables


def held_back(rows=None):
    """A lazy table that cannot be collected."""
    table = pl.from_pandas(frame() if rows is None else rows).lazy()

    def refuse(*given, **named):
        raise AssertionError("collected")

    table.collect = refuse
    return table


@pytest.mark.parametrize("make", ESTIMATORS.values(), ids=ESTIMATORS)
def test_lazy_tables_stream(make, monkeypatch, tmp_path):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    eager = make().fit(pl.from_pandas(frame()))
    for fit in (make(), make(states=NAMES)):
        fitted = fit.fit(held_back())
        assert fitted.model_.states == tuple(NAMES)
        np.testing.assert_array_equal(numbers(fitted), numbers(eager))
        assert fitted.score(held_back()) == eager.score(pl.from_pandas(frame()))
        assert fitted.model_.to_json() == fit.fit(held_back()).model_.to_json()
    assert list(make().fit(held_back()).feature_names_in_) == NAMES
    # The files are gone with what read them.
    assert not list(tmp_path.iterdir())


def test_lazy_tables_take_clock_or_period():
    for second in ("t", 0.01, None):
        wanted = ff.PWA(1).fit(pl.from_pandas(frame()), second)
        fitted = ff.PWA(1).fit(held_back(), second)
        assert fitted.model_.states == wanted.model_.states
        np.testing.assert_array_equal(fitted.coefficients(), wanted.coefficients())
    with pytest.raises(DataError, match="t='clock'"):
        ff.PWA(1).fit(held_back(), "clock")
    with pytest.raises(ValueError, match="lazy tables have their own stamps"):
        ff.open(held_back(), t=T)
    with pytest.raises(DataError, match="lazy table cannot be computed.*nowhere"):
        ff.open(pl.scan_parquet("nowhere.parquet"))
    runs = ff.open([held_back(), held_back(frame().assign(q=2.0 * X[:, 0]))], name=["a", "b"])
    assert [name.rpartition("/")[2] for name in runs.names] == ["a.parquet", "b.parquet"]
    assert len(ff.read(runs, NAMES)) == 2 * len(T)
