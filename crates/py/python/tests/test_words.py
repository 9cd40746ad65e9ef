"""Messages speak of arguments: no error and no warning of a fit names a flag, a section of a recipe, or a place in JSON."""

from __future__ import annotations

import builtins
import logging
import re
import warnings

import numpy as np
import pytest

import fleetfoot as ff
from fleetfoot import _words
from fleetfoot.exceptions import FleetfootError

T = np.arange(200) * 0.01
X = np.column_stack([np.cos(2 * T), -2 * np.sin(2 * T)])
#: Flags, sections of a recipe, commands, places in JSON.
FOREIGN = re.compile(r"(?<!\w)--[a-z]|\[(pwa|sindy|sparse|narx|model|states|inputs|latents|tasks)\]|`fit \w+`|line \d+ column \d+|`fleetfoot ")


@pytest.mark.parametrize(
    ("estimator", "words"),
    [
        (lambda: ff.PWA(folds=101), "folds=101"),
        (lambda: ff.PWA(select="best"), "best.*rollout"),
        (lambda: ff.PWA(horizon=20), r"horizon=20.*select='rollout'"),
        (lambda: ff.PWA(shrinkage="much"), "shrinkage='much'"),
        (lambda: ff.PWA("kmeens:3"), "kmeens"),
        (lambda: ff.PWA(2, partition_on=["z"]), "partition_on.*z"),
        (lambda: ff.PWA(recipe={"pwa": {"fold": 3}}), "fold"),
        (lambda: ff.PWA(recipe={"states": {"x0": {"derivative": 3}}}), "give a word"),
        (lambda: ff.SINDy(partition=["null", "average"]), r"partition="),
        (lambda: ff.SINDy(optimizer="frols", threshold=0.1), "threshold=0.1"),
        (lambda: ff.SINDy(max_iterations=3, optimizer="frols"), "max_iterations=3"),
        (lambda: ff.SINDy(inclusion=0.5), "inclusion=0.5"),
        (lambda: ff.SINDy(groups="term", optimizer="group-lasso"), r"BlockSparse\(groups='term'\)"),
        (lambda: ff.SINDy(folds="many"), "folds='many'"),
        (lambda: ff.NARX(lags_in=2), r"inputs="),
        (lambda: ff.NARX(0, 0), "lags_out=0"),
        (lambda: ff.NARX(2, terms=0), "terms=0"),
        (lambda: ff.NARX(2, starts=3, select="bic"), "starts"),
        (lambda: ff.NARX(2, library=["lag(x0, 1)"]), "NARX"),
        (lambda: ff.BlockSparse(bolasso="rows:8", stability=True), "bolasso.*stability"),
        (lambda: ff.BlockSparse(lam="big"), "lam"),
        (lambda: ff.BlockSparse(latents={"F": {"of": ["x0"]}}), "tasks"),
        (lambda: ff.BlockSparse(tasks={"a": ("x0", "F")}), "latents"),
    ],
)
def test_errors_name_arguments(estimator, words):
    with pytest.raises((FleetfootError, ValueError), match=words) as caught:
        estimator().fit(X, T)
    assert not FOREIGN.search(str(caught.value)), str(caught.value)


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("the recipe: unknown field at line 1 column 12", "the recipe: unknown field"),
        ("`mcap convert --fast a.bag` helps", "`mcap convert --fast a.bag` helps"),
        ("runs/a--b.csv is cut", "runs/a--b.csv is cut"),
    ],
)
def test_only_places_in_json_are_left_out(text, wanted):
    assert _words.of_python(text) == wanted
    assert _words.of_python(wanted) == wanted


TABLE = {"t": T, "x0": X[:, 0], "x1": X[:, 1]}
HUGE = 10**200


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda m: ff.PWA(select="foo").fit(X, T), "select='foo': give 'cv', 'bic' or 'rollout'"),
        (lambda m: ff.SINDy(select="foo").fit(X, T), "select='foo': give 'one-se', 'cv', 'aic', 'bic' or 'ebic'"),
        (lambda m: ff.NARX(2, select="foo").fit(X[:, :1], T), "select='foo': give free-run, one-se, cv, aic, bic or ebic"),
        (lambda m: ff.PWA(2, continuous="foo").fit(X, T), "continuous='foo': give True or False"),
        (lambda m: ff.PWA(objective="steps:0").fit(X, T), "objective='steps:0': write one-step, free-run, or steps:N"),
        (lambda m: ff.PWA(2, phase="foo").fit(X, T), "phase='foo': in `foo`, character 1: unknown column"),
        (lambda m: ff.PWA(lags="foo").fit(X, T), "lags='foo': `foo` is not a number of rows"),
        (lambda m: ff.SINDy(library=["x0^"]).fit(X, T), "library='x0^': in `x0^`, character 4"),
        (lambda m: ff.SINDy(normalize="foo").fit(X, T), "normalize='foo': write True, False or 'length'"),
        (lambda m: ff.SINDy(constraints={"a": {"foo": 1}}).fit(X, T), "there is no 'foo'; give 'of', 'coefficients'"),
        (lambda m: ff.PWA(recipe={"pwa": {"folds": "x"}}).fit(X, T), "recipe: folds='x': give a whole number of 0 or more"),
        (lambda m: ff.PWA(recipe={"foo": {}}).fit(X, T), "recipe: there is no 'foo'; give 'columns'"),
        (lambda m: ff.PWA(2, folds=HUGE).fit(X, T), "folds=10000000000000000000...0000000000: give a whole number"),
        (lambda m: ff.SINDy(threshold=10**400).fit(X, T), "threshold=10000000000000000000...0000000000: give a number"),
        (lambda m: ff.PWA(dt="foo").fit(X), "dt='foo': give a number of seconds"),
        (lambda m: m.rollout(TABLE, -3), "horizon=-3: give a whole number of 1 or more"),
        (lambda m: m.rollout(TABLE, 1.5), "horizon=1.5: give a whole number of 1 or more"),
        (lambda m: m.rollout(TABLE, 5, seed=-1), "seed=-1: give a whole number of 0 or more"),
        (lambda m: m.rollout(TABLE, 5, starts=[(-1, 0)]), "starts: episode=-1: give a whole number of 0 or more"),
        (lambda m: m.rollout(TABLE, 5, dt="foo"), "dt='foo': give a number"),
        (lambda m: m.filter(TABLE, noise="foo"), "noise='foo': give 'auto', 'white' or 'coloured'"),
        (lambda m: m.resimulate(TABLE, every=-1), "every=-1: give a whole number of 1 or more"),
        (lambda m: m.resimulate(TABLE, bounds={"x0": (1, 0)}), "bounds: 'x0' lies in (1, 0); give (low, high)"),
        (lambda m: m.describe(-1), "regions=-1: give a whole number of 0 or more"),
        (lambda m: ff.report(m, TABLE, "no.html", horizon=-1), "horizon=-1: give a whole number of 1 or more"),
        (lambda m: ff.generate("diffdrive", "no", seed=-1), "seed=-1: give a whole number of 0 or more"),
        (lambda m: ff.set_threads(-1), "count=-1: give a whole number of 0 or more"),
        (lambda m: ff.Plan({"time": {"dt": 1}}, TABLE, chunk_rows=0), "chunk_rows=0: give a whole number of 1 or more"),
    ],
)
def test_wrong_values_are_named_as_in_python(call, message):
    model = ff.PWA().fit(X, T).model_
    with pytest.raises(FleetfootError) as caught:
        call(model)
    text = str(caught.value)
    assert text.startswith(message) and "TOML" not in text and len(text) < 500, text


def test_toml_errors_keep_their_place():
    with pytest.raises(FleetfootError, match=r"the recipe: TOML parse error at line 1"):
        ff.PWA(recipe="[pwa\nfolds=").fit(X, T)


def test_one_name_is_no_list_of_letters():
    def of(names):
        return ff.PWA(2, partition_on=names, angles=names).fit(X, T).model_

    assert of("x0") == of(["x0"])
    assert ff.PWA(states="x0").fit(TABLE).model_.states == ("x0",)
    assert ff.PWA().fit(X[:, 0], T, feature_names="speed").model_.states == ("speed",)
    with pytest.raises(ValueError, match=r"feature_names has 1 names \(ab\) for 2 columns"):
        ff.PWA().fit(X, T, feature_names="ab")
    fixed = [ff.SINDy(fixed={"x0": terms}).fit(X, T).model_ for terms in ("x1", ["x1"])]
    assert fixed[0] == fixed[1]
    model = ff.PWA().fit(X, T).model_
    assert model.rollout(TABLE, 5, position="x0")["model"] == model.rollout(TABLE, 5, position=["x0"])["model"]


def test_facts_are_logged_and_problems_warn(tmp_path, caplog):
    made = ff.generate("diffdrive", tmp_path, runs=3, seconds=3)
    data = ff.open(made.files[:2], recipe=made.recipe)
    with caplog.at_level(logging.INFO, "fleetfoot"), warnings.catch_warnings():
        warnings.simplefilter("error", ff.FleetfootWarning)
        fit = ff.PWA("average", target="next", lags=1).fit(data)
        fit.score(ff.open(made.files[2:], recipe=made.recipe))
    assert any("one row per message of" in record.message for record in caplog.records)
    assert any("one row per message of" in note for note in fit.report_["notes"])
    twins = np.column_stack([X[:, 0], 2 * X[:, 0]])
    with pytest.warns(ff.FleetfootWarning, match="cannot separate"):
        ff.PWA().fit(twins, T)


def test_everything_at_once_leaves_the_builtins_alone():
    names: dict[str, object] = {}
    exec("from fleetfoot import *", names)
    shadowed = (set(names) & set(vars(builtins))) - {"__builtins__", "__doc__", "__name__"}
    assert not shadowed and names["SINDy"] is ff.SINDy
    assert ff.open is not builtins.open
