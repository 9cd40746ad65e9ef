"""What a call means is never guessed against the caller: columns that are no numbers, stamps as targets, words like words."""

from __future__ import annotations

import decimal
import warnings
from typing import Any

import numpy as np
import pytest

import fleetfoot as ff
from fleetfoot.exceptions import DataError, RequestError

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
def test_a_column_of_text_does_not_vanish_from_the_states(library: str, place: int) -> None:
    words = [str(value) for value in X[:, 1]]
    words[place] = "-"
    with pytest.raises(DataError, match="column `v` cannot be read as numbers: it holds text"):
        fitted(tables()[library]({**columns(), "v": words}))
    for damaged in ("1.000,00", "+3 m", " .5"):
        with pytest.raises(DataError, match="column `mode`.*leave the column out"):
            fitted(tables()[library]({**columns(), "mode": [damaged, "b"] * (ROWS // 2)}))
    # Words can be labels; that they are no signal is said.
    with pytest.warns(ff.FleetfootWarning, match="left out: column `mode`"):
        found = ff.SINDy(library="poly(1)").fit(tables()[library]({**columns(), "mode": ["a", None] * (ROWS // 2)}))
    assert found.model_.states == ("q", "v")


def test_an_object_column_with_one_dash_does_not_vanish() -> None:
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    mixed = X[:, 1].astype(object)
    mixed[7] = "-"
    with pytest.raises(DataError, match=r"column `v` .*'-' at row 7"):
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
        found = fitted(table)
        assert found.model_.states == ("q", "v")
        np.testing.assert_allclose(found.coefficients(), expected.coefficients(), rtol=1e-12)


@pytest.mark.parametrize("word", ["Next", "NEXT", " next", "nxt", "Delta", "deltas", "derivate", "Derivative", "derivatives"])
def test_words_like_those_of_targets_are_refused(word: str) -> None:
    for fit in (
        lambda: ff.PWA(1, target=word).fit(X, T),
        lambda: ff.PWA(1, target=word).fit(X, y=X[:, 0]),
        lambda: ff.SINDy(target=word).fit(X, T),
    ):
        with pytest.raises(RequestError, match="write '(next|delta|derivative)'"):
            fit()
    # A column of that name is one.
    found = ff.PWA(1, target=word).fit(X, columns={word: X @ [1.0, 2.0]})
    assert found.model_.outputs == (word,) or word.strip() in found.model_.outputs[0]


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
