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
        (lambda: ff.PWA(recipe={"states": {"x0": {"derivative": 3}}}), "expected a word"),
        (lambda: ff.SINDy(partition=["null", "average"]), r"partition="),
        (lambda: ff.SINDy(optimizer="frols", threshold=0.1), "threshold=0.1"),
        (lambda: ff.SINDy(max_iterations=3, optimizer="frols"), "max_iterations=3"),
        (lambda: ff.SINDy(inclusion=0.5), "inclusion=0.5"),
        (lambda: ff.SINDy(groups="term", optimizer="group-lasso"), "BlockSparse groups='term'"),
        (lambda: ff.SINDy(folds="many"), "folds=many"),
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
    ("said", "wanted"),
    [
        ("choose fewer --folds, or a `--decimate`", "choose fewer folds=, or a decimate="),
        ("--partition kmeans:2,5: name one of --select bic", "partition='kmeans:2,5': name one of select='bic'"),
        ("give --force", "give force=True"),
        ("[states] x: it has no column", "states['x']: it has no column"),
        ("[sparse] lambda = big: write auto", "lam=big: write auto"),
        ("folds (--folds 0 for none)", "folds (folds=0 for none)"),
        ("the recipe: unknown field at line 1 column 12", "the recipe: unknown field"),
        ("`fit sparse --groups term` does", "BlockSparse groups='term' does"),
        ("`mcap convert --fast a.bag` helps", "`mcap convert --fast a.bag` helps"),
        ("runs/a--b.csv is cut", "runs/a--b.csv is cut"),
        ("3 rows - 2 -- and no more", "3 rows - 2 -- and no more"),
    ],
)
def test_words_are_translated_once(said, wanted):
    assert _words.of_python(said) == wanted
    assert _words.of_python(wanted) == wanted


def test_routine_facts_are_logged_and_what_may_be_wrong_warns(tmp_path, caplog):
    made = ff.generate("diffdrive", tmp_path, runs=3, seconds=3)
    data = ff.open(made.files[:2], recipe=made.recipe)
    with caplog.at_level(logging.INFO, "fleetfoot"), warnings.catch_warnings():
        warnings.simplefilter("error", ff.FleetfootWarning)
        fit = ff.PWA("average", target="next").fit(data)
        fit.score(ff.open(made.files[2:], recipe=made.recipe))
    assert any("the rows are the messages of" in record.message for record in caplog.records)
    assert any("the rows are the messages of" in note for note in fit.report_["notes"])
    twins = np.column_stack([X[:, 0], 2 * X[:, 0]])
    with pytest.warns(ff.FleetfootWarning, match="cannot separate"):
        ff.PWA().fit(twins, T)


def test_everything_at_once_leaves_the_builtins_alone():
    names: dict[str, object] = {}
    exec("from fleetfoot import *", names)
    shadowed = (set(names) & set(vars(builtins))) - {"__builtins__", "__doc__", "__name__"}
    assert not shadowed and names["SINDy"] is ff.SINDy
    assert ff.open is not builtins.open
