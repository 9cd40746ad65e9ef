"""The meaning of a call is never guessed against the caller: columns that are no numbers, stamps as targets, words like words."""

from __future__ import annotations

import datetime
import decimal
import warnings
from typing import Any

import numpy as np
import pytest

import fleetfoot as ff
from fleetfoot._arrays import since_first
from fleetfoot.exceptions import DataError, ModelError, RequestError

ROWS = 60
T = np.arange(ROWS) * 0.1
X = np.column_stack([np.sin(T), np.cos(1.7 * T)])


def fitted(x: Any, *given: Any, how: dict[str, Any] | None = None, **named: Any) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return ff.SINDy(library="poly(1)", **(how or {})).fit(x, *given, **named)


def columns() -> dict[str, np.ndarray]:
    return {"t": T, "q": X[:, 0], "v": X[:, 1]}


def tables() -> dict[str, Any]:
    pandas, polars, pyarrow = (
        pytest.importorskip(name, reason=f"{name} is not installed") for name in ("pandas", "polars", "pyarrow")
    )
    return {"pandas": pandas.DataFrame, "polars": lambda held: polars.DataFrame(held, strict=False), "Arrow": pyarrow.table}


@pytest.mark.parametrize("library", tables())
@pytest.mark.parametrize("place", [0, 7])
def test_text_column_among_states_is_reported(library: str, place: int) -> None:
    words = [str(value) for value in X[:, 1]]
    words[place] = "-"
    with pytest.raises(DataError, match="column `v` cannot be read as numbers: it holds text"):
        fitted(tables()[library]({**columns(), "v": words}))
    for damaged in ("1.000,00", "+3 m", " .5"):
        with pytest.raises(DataError, match="column `mode`.*leave the column out"):
            fitted(tables()[library]({**columns(), "mode": [damaged, "b"] * (ROWS // 2)}))
    # Words can be labels; that they are no signal is said.
    with pytest.warns(ff.FleetfootWarning, match="left out: column `mode`"):
        model = ff.SINDy(library="poly(1)").fit(tables()[library]({**columns(), "mode": ["a", None] * (ROWS // 2)}))
    assert model.model_.states == ("q", "v")


def test_an_object_column_with_one_dash_does_not_vanish() -> None:
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    mixed = X[:, 1].astype(object)
    mixed[7] = "-"
    with pytest.raises(DataError, match=r"column `v` .*'-' in row 8"):
        fitted(pandas.DataFrame({**columns(), "v": pandas.Series(mixed, dtype=object)}))
    with pytest.raises(DataError, match="column `v`.*complex"):
        fitted(pandas.DataFrame({**columns(), "v": X[:, 1] + 0j}))
    with pytest.warns(ff.FleetfootWarning, match="left out: column `day`"):
        ff.SINDy(library="poly(1)").fit(pandas.DataFrame({**columns(), "day": pandas.date_range("2026-01-01", periods=ROWS)}))
    # The same where they are inputs or targets.
    with pytest.raises(DataError, match="column `w`.*text"):
        fitted(X, T, u=pandas.DataFrame({"u": X[:, 0] ** 2, "w": ["1", "-"] * (ROWS // 2)}))


def test_columns_that_are_numbers_of_another_kind_are_states() -> None:
    pandas, pyarrow = (pytest.importorskip(name, reason=f"{name} is not installed") for name in ("pandas", "pyarrow"))
    polars = pytest.importorskip("polars", reason="polars is not installed")
    rounded = {**columns(), "v": np.round(X[:, 1], 3)}
    expected = fitted(pandas.DataFrame(rounded))
    assert expected.model_.states == ("q", "v")
    decimals = [decimal.Decimal(str(value)) for value in rounded["v"]]
    for table in (
        pandas.DataFrame({**rounded, "v": decimals}),
        pandas.DataFrame({**rounded, "v": rounded["v"].astype(object)}),
        pandas.DataFrame({**rounded, "v": pandas.Categorical(rounded["v"])}),
        pyarrow.table({**rounded, "v": pyarrow.array(rounded["v"]).dictionary_encode()}),
        pyarrow.table({**rounded, "v": pyarrow.array(decimals)}),
        polars.DataFrame({**rounded, "v": decimals}),
    ):
        model = fitted(table)
        assert model.model_.states == ("q", "v")
        np.testing.assert_allclose(model.coefficients(), expected.coefficients(), rtol=1e-12)


@pytest.mark.parametrize("word", ["Next", "NEXT", " next", "nxt", "Delta", "deltas", "derivate", "Derivative", "derivatives"])
def test_misspelt_targets_are_refused(word: str) -> None:
    for fit in (
        lambda: ff.PWA(1, target=word).fit(X, T),
        lambda: ff.PWA(1, target=word).fit(X, y=X[:, 0]),
        lambda: ff.SINDy(target=word).fit(X, T),
    ):
        with pytest.raises(RequestError, match="did you mean '(next|delta|derivative)'"):
            fit()
    # A column of that name is one.
    model = ff.PWA(1, target=word).fit(X, columns={word: X @ [1.0, 2.0]})
    assert model.model_.outputs == (word,) or word.strip() in model.model_.outputs[0]


def test_stamps_by_position_are_no_target() -> None:
    jitter = T + 0.01 * np.random.default_rng(2).uniform(-1.0, 1.0, ROWS)
    for stamps in (T, jitter, T + 1.7e9, (T * 1e9).astype(np.int64)):
        with pytest.raises(RequestError, match="write t= in front of stamps, or y="):
            fitted(X[:, 0], stamps, how={"dt": 0.1})
        with pytest.raises(RequestError, match="write t= in front of stamps, or y="):
            ff.PWA(1, target="effort").fit(X, stamps)
    # By name they are what they are called; targets that do not rise, and those of features that do, are targets.
    fitted(X[:, 0], y=T, how={"dt": 0.1})
    fitted(X[:, 0], X[:, 1], how={"dt": 0.1})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        ff.PWA(1, target="effort").fit(T[:, None], 2.0 * T + 1.0)


def test_columns_like_words_of_targets_are_columns() -> None:
    for name in ("delta1", "next1", "ext", "derivation"):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            model = ff.PWA(1, target=name).fit(X, y=X @ [1.0, 2.0])
        assert model.model_.outputs == (name,)


def test_stamps_are_no_target() -> None:
    lost = np.delete(np.arange(ROWS + 4) * 0.1, [9, 10, 30, 31])
    for stamps in (lost, T[:, None], lost[:, None]):
        with pytest.raises(RequestError, match="write t= in front of stamps, or y="):
            fitted(X[:, 0], stamps, how={"dt": 0.1})
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    # The clock of a table rises, and is no feature.
    with pytest.raises(RequestError, match="write t= in front of stamps, or y="):
        fitted(pandas.DataFrame(columns()), lost, how={"target": "effort"})


def test_errors_name_the_cell_of_text() -> None:
    words = [["1", "2"], ["3", "x"]]
    for given in (words, np.array(words), np.array(words, dtype=object), [[1.0, 2.0], [3.0, "x"]]):
        with pytest.raises(DataError, match="'x' in row 2, column 2, counted from 1"):
            ff.open({"q": given})


# -- Names


@pytest.fixture(scope="module")
def driven() -> Any:
    """A model of two states and two inputs, whose tables have another order."""
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    u = np.column_stack([np.sin(3.0 * T), np.cos(2.0 * T)])
    slopes = np.column_stack([X[:, 1] + u[:, 0], -X[:, 0] - 0.5 * u[:, 1]])
    fit = fitted(X, T, slopes, u=u, feature_names=["q", "v"], input_names=["a", "b"])
    turned = pandas.DataFrame({"b": u[:, 1], "a": u[:, 0]})
    return fit, u, turned, slopes, pandas.DataFrame({"v": slopes[:, 1], "q": slopes[:, 0]})


def test_inputs_and_derivatives_of_tables_go_by_name(driven: Any) -> None:
    fit, u, turned, slopes, slopes_turned = driven
    np.testing.assert_array_equal(fit.predict(X, turned), fit.predict(X, u))
    wanted = fit.score(X, T, slopes, u)
    assert fit.score(X, T, slopes_turned, turned) == wanted
    assert fit.score(X, T, slopes_turned.add_suffix("_dot"), turned) == wanted
    again = fitted(X, T, slopes_turned, u=u, feature_names=["q", "v"], input_names=["a", "b"])
    np.testing.assert_array_equal(again.coefficients(), fit.coefficients())
    for call in (lambda: fit.predict(X, turned[["b"]]), lambda: fit.score(X, T, slopes, turned[["b"]])):
        with pytest.raises(ModelError, match="no column `a`"):
            call()
    report = fit.model_.score(X, T, slopes_turned, turned)
    assert np.mean([one["r2"] for one in report["targets"]]) == pytest.approx(wanted, abs=1e-12)


def test_a_series_that_lacks_a_state_is_refused(driven: Any) -> None:
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    model = driven[0].model_
    wanted = model.step([1.0, 2.0], [0.1, 0.2])
    np.testing.assert_array_equal(model.step(pandas.Series({"v": 2.0, "q": 1.0}), [0.1, 0.2]), wanted)
    np.testing.assert_array_equal(model.step(pandas.Series([1.0, 2.0]), [0.1, 0.2]), wanted)
    with pytest.raises(ModelError, match="x: the series has no entry `v`; it has q, w"):
        model.step(pandas.Series({"q": 1.0, "w": 2.0}), [0.1, 0.2])


# -- Kinds of columns


@pytest.mark.parametrize("library", tables())
def test_columns_that_hold_no_signal_are_left_out(library: str) -> None:
    nested = [{"a": 1.0}] * ROWS
    with pytest.warns(ff.FleetfootWarning, match=r"columns? `gone`(, `none`)? \(no value\)"):
        fitted = ff.SINDy(library="poly(1)").fit(tables()[library]({**columns(), "gone": [None] * ROWS}))
    assert fitted.model_.states == ("q", "v")
    with pytest.warns(ff.FleetfootWarning, match=r"column `deep` \(nested values\)"):
        fitted = ff.SINDy(library="poly(1)").fit(tables()[library]({**columns(), "deep": nested}))
    assert fitted.model_.states == ("q", "v")
    dates = [datetime.date(2026, 1, 1)] * ROWS
    with pytest.warns(ff.FleetfootWarning, match=r"column `day` \(words or dates\)"):
        fitted = ff.SINDy(library="poly(1)").fit(tables()[library]({**columns(), "day": dates}))
    assert fitted.model_.states == ("q", "v")


def test_durations_are_seconds_at_every_door(driven: Any) -> None:
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    fit, u, turned, *_ = driven
    model, tenth = fit.model_, datetime.timedelta(seconds=0.1)
    # Tables of inputs.
    spans = pandas.DataFrame({"a": pandas.to_timedelta(u[:, 0], unit="s"), "b": u[:, 1]})
    np.testing.assert_allclose(fit.predict(X, spans), fit.predict(X, u), atol=1e-8)
    rows = {"q": X[:, 0], "v": X[:, 1], "a": u[:, 0], "b": u[:, 1]}
    for dt in (tenth, np.timedelta64(100, "ms"), pandas.Timedelta("100ms")):
        np.testing.assert_array_equal(model.step([1.0, 2.0], [0.1, 0.2], dt), model.step([1.0, 2.0], [0.1, 0.2], 0.1))
        for a, b in zip(model.linearize([1.0, 2.0], [0.1, 0.2], dt), model.linearize([1.0, 2.0], [0.1, 0.2], 0.1)):
            np.testing.assert_array_equal(a, b)
        assert fit.score(X, u=u, dt=dt, x_dot=driven[3]) == fit.score(X, u=u, dt=0.1, x_dot=driven[3])
        assert ff.open(rows, dt=dt).recipe == ff.open(rows, dt=0.1).recipe
        np.testing.assert_array_equal(ff.read(rows, dt=dt)["q"], X[:, 0])
        for make in (lambda one: ff.SINDy(library="poly(1)", dt=one), lambda one: ff.PWA(1, dt=one)):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                np.testing.assert_array_equal(make(dt).fit(X).coefficients(), make(0.1).fit(X).coefficients())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        inputs_model = ff.SINDy(library="poly(1)").fit(X, T, u=u, feature_names=["q", "v"], input_names=["a", "b"]).model_
        rollouts, wanted = (inputs_model.rollout(rows, 5, dt=dt, recipe={"time": {"dt": 0.1}}) for dt in (tenth, 0.1))
    assert rollouts.table == wanted.table


def test_nanoseconds_of_durations_are_kept() -> None:
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    spans = np.array([pandas.Timedelta(at, "ns") for at in (1, 1001, 2001)], dtype=object)
    np.testing.assert_array_equal(since_first(spans, "t"), [1e-9, 1.001e-6, 2.001e-6])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        stamps = np.array(["NaT", "2026-01-01T00:00:01", "2026-01-01T00:00:03"], dtype="datetime64[ns]")
        np.testing.assert_array_equal(since_first(stamps, "t"), [np.nan, 0.0, 2.0])


def test_uneven_stamps_of_lists_are_reported() -> None:
    uneven = np.cumsum(np.tile([0.1, 0.3], ROWS // 2))
    for stamps in (uneven, uneven.tolist()):
        with pytest.warns(ff.FleetfootWarning, match="t of run 0 is uneven"):
            ff.SINDy(library="poly(1)", target="next").fit(X, stamps)


# -- Clocks of whole numbers


def test_integer_clocks_are_read_as_in_files() -> None:
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    rows = {"q": X[:, 0], "v": X[:, 1]}
    wanted = fitted(pandas.DataFrame(rows), T)
    for name, step in (("t", 100), ("time", 100_000), ("stamp_us", 100_000)):
        table = pandas.DataFrame({name: step * np.arange(ROWS), **rows})
        model = fitted(table, t=name)
        assert model.model_.dt == pytest.approx(0.1)
        np.testing.assert_allclose(model.coefficients(), wanted.coefficients(), rtol=1e-9, atol=1e-12)
        assert model.score(table, t=name) == pytest.approx(wanted.score(pandas.DataFrame(rows), T), abs=1e-9)
    doubtful = pandas.DataFrame({"t": np.arange(ROWS), **rows})
    message = r'could be s \(1 Hz.* or ms \(1000 Hz.*\(recipe=\{"time": \{"column": "t", "unit": "ms"\}\}\)'
    for table in (doubtful, doubtful.set_index("t")):
        for how in ({}, {"states": ["q", "v"]}):
            with pytest.raises(DataError, match=message):
                fitted(table, how=how)
    # The advice of the message helps.
    recipe = {"time": {"column": "t", "unit": "ms"}}
    for how in ({}, {"states": ["q", "v"]}):
        assert fitted(doubtful, how={**how, "recipe": recipe}).model_.dt == pytest.approx(1e-3)
    other = doubtful.rename(columns={"t": "tick"})
    model = fitted(other, how={"recipe": {"time": {"column": "tick", "unit": "ms"}}})
    assert model.model_.dt == pytest.approx(1e-3) and model.model_.states == ("q", "v")
    # Beside arrays stamps are seconds.
    assert fitted(X, np.arange(ROWS)).model_.dt == 1.0
