"""Every door of arrays reads every kind of array alike: order of memory, strides, types of numbers, masks, libraries."""

from __future__ import annotations

import datetime
import decimal
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import fleetfoot as ff
from fleetfoot._frames import frame

STATES, INPUTS = ["q", "v"], ["force", "load"]
ROWS, DT = 300, 0.01
RANDOM = np.random.default_rng(41)
#: Whole numbers, so that integers and single precision hold the same values.
X = RANDOM.integers(-90, 90, (ROWS, 2)).astype(float)
U = RANDOM.integers(-90, 90, (ROWS, 2)).astype(float)
T = np.arange(ROWS) * DT
HALVES = np.round(2.0 * X) / 2.0


def strided(values: np.ndarray) -> np.ndarray:
    wide = np.full(tuple(2 * length for length in values.shape), -999.0)
    view = wide[tuple(slice(None, None, 2) for _ in values.shape)]
    view[...] = values
    return view


def reversed_(values: np.ndarray) -> np.ndarray:
    every = tuple(slice(None, None, -1) for _ in values.shape)
    return np.ascontiguousarray(values[every])[every]


def read_only(values: np.ndarray) -> np.ndarray:
    copy = values.copy()
    copy.flags.writeable = False
    return copy


def unaligned(values: np.ndarray) -> np.ndarray:
    shifted = np.frombuffer(bytearray(values.nbytes + 1), dtype=np.uint8)[1:].view(float).reshape(values.shape)
    shifted[...] = values
    return shifted


def columns_of_a_frame(values: np.ndarray) -> Any:
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    return pandas.DataFrame(values, copy=True).to_numpy() if values.ndim == 2 else np.asfortranarray(values)


#: The same numbers, as an array of each kind.
KINDS: dict[str, Callable[[np.ndarray], Any]] = {
    "Fortran": np.asfortranarray,
    "to_numpy of pandas": columns_of_a_frame,
    "strided": strided,
    "reversed": reversed_,
    "read-only": read_only,
    "unaligned": unaligned,
    "float32": lambda values: values.astype(np.float32),
    "float32, Fortran": lambda values: np.asfortranarray(values.astype(np.float32)),
    "float16": lambda values: values.astype(np.float16),
    "longdouble": lambda values: values.astype(np.longdouble),
    "int64": lambda values: values.astype(np.int64),
    "int8, Fortran": lambda values: np.asfortranarray(values.astype(np.int8)),
    "big-endian": lambda values: values.astype(">f8"),
    "big-endian int": lambda values: np.asfortranarray(values.astype(">i4")),
    "objects": lambda values: values.astype(object),
    "Decimal": lambda values: np.vectorize(decimal.Decimal, otypes=[object])(values),
    "masked, nothing masked": lambda values: np.ma.masked_array(np.asfortranarray(values), mask=False),
    "list": lambda values: values.tolist(),
}


def fitted(**how: Any) -> Any:
    """A nonsymmetric model, so that no permutation of its states gives the same."""
    slopes = X @ [[0.1, -2.0], [1.0, -0.3]] + U @ [[0.5, 0.0], [0.0, 0.25]] + [0.25, -0.5]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return ff.PWA(1, degree=1, **how).fit(
            X, T, x_dot=slopes, u=U, feature_names=STATES, input_names=INPUTS
        )


@pytest.fixture(scope="module")
def model() -> Any:
    return fitted().model_


@pytest.fixture(scope="module")
def autoregression() -> Any:
    y = np.zeros((ROWS, 2))
    for k in range(1, ROWS - 1):
        y[k + 1] = y[k] @ [[0.5, 0.1], [-0.2, 0.6]] - 0.1 * y[k - 1] + 0.01 * U[k]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return ff.PWA(1, target="next", lags=2).fit(y, T, u=U, feature_names=STATES, input_names=INPUTS).model_


#: Everything that a model answers at points or of runs, by the arrays that it is given.
DOORS: dict[str, Callable[[Any, Callable[[np.ndarray], Any]], Any]] = {
    "predict": lambda model, kind: model.predict(kind(X), kind(U)),
    "predict, runs": lambda model, kind: model.predict([np.asarray(kind(X))], [kind(U)])[0],
    "step": lambda model, kind: model.step(kind(X), kind(U), 0.01),
    "step at a point": lambda model, kind: model.step(kind(X[3]), kind(U[3]), 0.01),
    "derivative": lambda model, kind: model.derivative(kind(X), kind(U)),
    "region": lambda model, kind: model.region(kind(X), kind(U)),
    "linearize": lambda model, kind: np.concatenate(
        [part.ravel() for part in model.linearize(kind(X[:5]), kind(U[:5]), 0.01)]
    ),
    "simulate": lambda model, kind: model.simulate(kind(X[0]), T[:20], kind(U[:20])),
    "simulate, many": lambda model, kind: model.simulate(kind(X[:4]), T[:3], kind(U[:12].reshape(4, 3, 2))),
    "simulate, straight lines": lambda model, kind: model.simulate(kind(X[0]), T[:20], kind(U[:20]), interpolate=True),
    "score": lambda model, kind: model.score(kind(X), T, kind(X), kind(U))["targets"][0]["rmse"],
}


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
@pytest.mark.parametrize("door", DOORS.values(), ids=DOORS)
def test_model_methods_read_every_array(model: Any, door: Any, kind: Any) -> None:
    expected = np.asarray(door(model, np.ascontiguousarray))
    assert np.isfinite(expected.astype(float)).all()
    np.testing.assert_array_equal(np.asarray(door(model, kind)), expected)


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_history_is_read_from_every_array(autoregression: Any, kind: Any) -> None:
    past = (X[:2], U[:2])
    expected = autoregression.step(X[2], U[2], history=past)
    assert not np.allclose(expected, autoregression.step(X[2], U[2], history=(X[:2].T.copy(), U[:2])))
    stepped = autoregression.step(kind(X[2]), kind(U[2]), history=(kind(past[0]), kind(past[1])))
    np.testing.assert_array_equal(stepped, expected)


#: Fits on arrays, by what they find.
FITS: dict[str, Callable[[Callable[[np.ndarray], Any]], Any]] = {
    "PWA": lambda kind: ff.PWA(1).fit(kind(X), T, x_dot=kind(HALVES), u=kind(U)).coefficients(),
    "SINDy": lambda kind: ff.SINDy(dt=DT).fit(kind(X), y=kind(HALVES), u=kind(U)).coefficients(),
    "NARX": lambda kind: ff.NARX(1, 1, 1, terms="all").fit(kind(X), u=kind(U)).coefficients(),
    "a column": lambda kind: ff.PWA(1, target="effort").fit(kind(X), y=kind(U[:, 0])).coefficients(),
    "Lasso": lambda kind: ff.Lasso(0.1).fit(kind(X), kind(U[:, 0])).coef_,
    "ElasticNet, weights": lambda kind: ff.ElasticNet(0.1).fit(kind(X), kind(U[:, 0]), np.abs(X[:, 1]) + 1.0).coef_,
    "STLSQ": lambda kind: ff.STLSQ(0.001).fit(kind(X), kind(U[:, 0])).coef_,
    "PWARegressor": lambda kind: ff.PWARegressor(2).fit(kind(X), kind(U[:, 0])).coef_,
    "KMeans": lambda kind: ff.KMeans(2, random_state=0).fit(kind(X)).cluster_centers_,
    "lars_path": lambda kind: ff.lars_path(kind(X), kind(U[:, 0]))[2],
    "lasso_path": lambda kind: ff.lasso_path(kind(X), kind(U[:, 0]), alphas=[1.0, 0.1])[1],
    "open": lambda kind: ff.read(ff.open({("q", "v"): kind(X)}, dt=DT), ["q", "v"])["v"],
    "open, one array": lambda kind: ff.read(ff.open(np.asarray(kind(X)), dt=DT), ["x0", "x1"])["x1"],
}


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
@pytest.mark.parametrize("fit", FITS.values(), ids=FITS)
def test_every_fit_reads_every_kind_of_array(fit: Any, kind: Any) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        expected, coefficients = np.asarray(fit(np.ascontiguousarray)), np.asarray(fit(kind))
    # scikit-learn's letter: answers in single precision where X is.
    tolerance = 1e-4 if coefficients.dtype == np.float32 else 1e-9
    np.testing.assert_allclose(coefficients, expected, rtol=tolerance, atol=tolerance)


def tables() -> dict[str, Callable[[np.ndarray, list[str]], Any]]:
    """Tables of every library with these columns, in another order."""
    pandas, polars, pyarrow, xarray = (
        pytest.importorskip(name, reason=f"{name} is not installed")
        for name in ("pandas", "polars", "pyarrow", "xarray")
    )

    def turned(values: np.ndarray, names: list[str]) -> dict[str, np.ndarray]:
        return {name: values[:, at] for at, name in reversed(list(enumerate(names)))}

    return {
        "pandas": lambda values, names: pandas.DataFrame(turned(values, names)),
        "pandas, nullable": lambda values, names: pandas.DataFrame(turned(values, names)).astype("Float64"),
        "pandas, Decimal": lambda values, names: pandas.DataFrame(turned(values, names)).map(decimal.Decimal),
        "polars": lambda values, names: polars.DataFrame(turned(values, names)),
        "polars, Decimal": lambda values, names: polars.DataFrame(turned(values, names)).cast(polars.Decimal(10, 3)),
        "Arrow": lambda values, names: pyarrow.table(turned(values, names)),
        "Arrow, a batch": lambda values, names: pyarrow.record_batch(turned(values, names)),
        "xarray": lambda values, names: xarray.Dataset({k: ("row", v) for k, v in turned(values, names).items()}),
    }


@pytest.mark.parametrize("library", tables())
@pytest.mark.parametrize("door", ["predict", "step", "derivative", "region", "linearize", "simulate"])
def test_tables_give_states_and_inputs_by_their_names(model: Any, door: str, library: str) -> None:
    table = tables()[library]

    if door == "simulate":
        result = model.simulate(table(X[:3], STATES), T[:5], table(U[:5], INPUTS))
        expected = model.simulate(X[:3], T[:5], U[:5])
    else:
        result = getattr(model, door)(table(X, STATES), table(U, INPUTS))
        expected = getattr(model, door)(X, U)
    if door == "predict":
        result = frame(result).matrix(list(model.outputs))
    for left, other in zip(*([one] if isinstance(one, np.ndarray) else one for one in (expected, result)), strict=True):
        np.testing.assert_array_equal(left, other)


def test_a_row_of_pandas_gives_states_by_name(model: Any) -> None:
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    row = pandas.DataFrame(np.hstack([U, X])[:, ::-1], columns=[*STATES[::-1], *INPUTS[::-1]]).iloc[7]
    np.testing.assert_array_equal(model.derivative(row, row), model.derivative(X[7], U[7]))
    with pytest.raises(ff.exceptions.ModelError, match="no column `v`"):
        model.derivative(pandas.DataFrame({"q": X[:, 0], "w": X[:, 1]}), U)


def test_masked_values_are_missing_everywhere(model: Any) -> None:
    hidden = X.copy()
    hidden[5] = -999.0
    masked = np.ma.masked_equal(hidden, -999.0)
    whole = np.ma.masked_equal(hidden.astype(int), -999)
    assert np.isnan(model.predict(masked, U)[5]).all() and np.isnan(model.derivative(whole, U)[5]).all()
    assert np.isfinite(model.predict(masked, U)[6]).all()
    missing = np.where(hidden == -999.0, np.nan, hidden)
    for values in (masked, whole, np.ma.masked_array(np.asfortranarray(hidden), mask=hidden == -999.0)):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            fitted = ff.PWA(1).fit(values, T, x_dot=HALVES)
            expected = ff.PWA(1).fit(missing, T, x_dot=HALVES)
            column = ff.PWA(1, target="y").fit(U, y=np.ma.masked_array(X[:, 0], mask=hidden[:, 0] == -999.0))
            without = ff.PWA(1, target="y").fit(U, y=missing[:, 0])
        np.testing.assert_array_equal(fitted.coefficients(), expected.coefficients())
        np.testing.assert_array_equal(column.coefficients(), without.coefficients())
        rows = ff.read(ff.open({("q", "v"): values}, dt=DT), ["q", "v"])
        np.testing.assert_array_equal(np.column_stack([rows["q"], rows["v"]]), missing)
        with pytest.raises(ValueError, match="NaN"):
            ff.Lasso().fit(values, U[:, 0])
        with pytest.raises(ValueError, match="NaN"):
            ff.KMeans(2).fit(values)
    with pytest.raises(ValueError, match="NaN"):
        ff.Lasso().fit(X, U[:, 0], np.ma.masked_equal(hidden[:, 0] ** 2, 999.0**2))


def test_text_and_complex_numbers_are_refused_with_the_value(model: Any) -> None:
    text = X.astype(object)
    text[4, 1] = "-"
    for door in (lambda x: model.predict(x, U), lambda x: model.step(x, U), lambda x: ff.PWA(1).fit(x, T)):
        with pytest.raises(ff.exceptions.DataError, match=r"text \('-' in row 5.*pandas"):
            door(text)
        with pytest.raises(ff.exceptions.DataError, match="complex"):
            door(X + 1j)
        with pytest.raises(ff.exceptions.DataError, match="text"):
            door(X.astype(str))


def test_durations_are_seconds_at_every_door(model: Any) -> None:
    expected = model.simulate(X[0], T[:20], U)
    for unit in ("ns", "us", "ms"):
        durations = (np.arange(20) * np.timedelta64(10, "ms")).astype(f"timedelta64[{unit}]")
        np.testing.assert_allclose(model.simulate(X[0], durations, U), expected, rtol=1e-12)
        stamps = np.datetime64("2026-11-27T08:00:00") + durations
        np.testing.assert_allclose(model.simulate(X[0], stamps, U), expected, rtol=1e-12)
    tens = [datetime.timedelta(milliseconds=10 * k) for k in range(20)]
    np.testing.assert_allclose(model.simulate(X[0], tens, U), expected, rtol=1e-12)
    for period in (np.timedelta64(10, "ms"), datetime.timedelta(milliseconds=10)):
        np.testing.assert_array_equal(model.step(X, U, period), model.step(X, U, 0.01))
        fitted = ff.PWA(1).fit(X, dt=period, u=U)
        np.testing.assert_array_equal(fitted.coefficients(), ff.PWA(1).fit(X, dt=0.01, u=U).coefficients())
        assert fitted.model_.dt == pytest.approx(0.01)


def test_runs_of_tables_and_tables_beside_arrays_are_predicted(model: Any) -> None:
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    both = pandas.DataFrame(np.hstack([X, U]), columns=[*STATES, *INPUTS])
    states = both[STATES]
    expected = model.predict(X, U)
    for predicted in (*model.predict([both, both]), model.predict(states, U), model.predict([states], [U])[0]):
        np.testing.assert_array_equal(predicted[list(model.outputs)].to_numpy(), expected)
    with pytest.raises(ff.exceptions.ModelError, match="no column `v`"):
        model.predict(both[["q", *INPUTS]], U)
    with pytest.raises(ff.exceptions.ModelError, match="list of as many for u"):
        model.predict([both, both], [U])
