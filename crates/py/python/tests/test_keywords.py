"""A keyword that a call does not have is answered with the one that was meant."""

from __future__ import annotations

import inspect
import pickle
from typing import Any

import pytest

import fleetfoot as ff


@pytest.mark.parametrize(
    ("call", "wrong", "right"),
    [
        (ff.PWA, "random_state", "seed"),
        (ff.PWA, "n_regions", "partition"),
        (ff.PWA, "n_init", "restarts"),
        (ff.PWA, "max_iter", "iterations"),
        (ff.PWA, "partition_features", "partition_on"),
        (ff.PWA, "selection", "select"),
        (ff.PWA, "cv", "folds"),
        (ff.PWA, "predict", "target"),
        (ff.PWA, "objektive", "objective"),
        (ff.PWARegressor, "seed", "random_state"),
        (ff.PWARegressor, "restarts", "n_init"),
        (ff.PWARegressor, "iterations", "max_kmeans_iter"),
        (ff.PWARegressor, "partition_on", "partition_features"),
        (ff.PWARegressor, "select", "selection"),
        (ff.NARX, "restarts", "starts"),
        (ff.NARX, "random_state", "seed"),
        (ff.NARX, "ylag", "lags_out"),
        (ff.SINDy, "random_state", "seed"),
        (ff.SINDy, "max_iter", "max_iterations"),
        (ff.SINDy, "n_terms", "terms"),
        (ff.SINDy, "normalize_columns", "normalize"),
        (ff.BlockSparse, "alpha", "lam"),
        (ff.BlockSparse, "lambda", "lam"),
        (ff.Lasso, "lam", "alpha"),
        (ff.LassoCV, "folds", "cv"),
        (ff.Bolasso, "seed", "random_state"),
        (ff.KMeans, "restarts", "n_init"),
        (ff.SR3, "lam", "reg_weight_lam"),
        (ff.prepare, "alpha", "lam"),
    ],
)
def test_the_right_keyword_is_named(call: Any, wrong: str, right: str) -> None:
    with pytest.raises(TypeError, match=rf"^{call.__name__} has no argument '{wrong}'; did you mean {right}=\?$"):
        call(**{wrong: 1})


def test_methods_name_the_keyword_too() -> None:
    with pytest.raises(TypeError, match=r"^rollout has no argument 'random_state'; did you mean seed=\?$"):
        ff.Model.rollout(None, {}, 3, random_state=0)  # type: ignore[arg-type, call-arg]


def test_keywords_of_another_kind_are_listed() -> None:
    with pytest.raises(TypeError, match="Lasso has no argument 'zzz'; there are alpha, "):
        ff.Lasso(zzz=1)  # type: ignore[call-arg]


def test_signatures_stay() -> None:
    assert list(inspect.signature(ff.PWA).parameters)[:2] == ["partition", "target"]
    assert ff.PWA(seed=3).get_params()["seed"] == 3 and pickle.loads(pickle.dumps(ff.PWA(seed=3))).seed == 3

    class Own(ff.Lasso):
        def __init__(self, alpha: float = 2.0, **more: Any) -> None:
            super().__init__(alpha, **more)

    assert Own(max_iter=7).max_iter == 7
