"""Folds as groups of rows: one pass over the data for a whole cross-validation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._base import HAS_SKLEARN, check_cv
from ._core import Design

#: Groups of rows beyond which folds share so little that each is read by itself.
_MOST_GROUPS = 256


@dataclass(frozen=True)
class FoldDesigns:
    """For every fold the design that holds its rows, and its groups there that train and that test."""

    folds: list[tuple[Design, list[int], list[int]]]


def fold_groups(
    splits: Sequence[tuple[NDArray[np.intp], NDArray[np.intp]]], rows: int
) -> tuple[NDArray[np.uint32], list[list[int]], list[list[int]]] | None:
    """Labels of the rows (rows,), and the labels that every fold trains on and tests on.

    Rows that are in the same folds on the same sides share a group. `None` when a fold names a row twice (as bootstrap
    samples do), or when there
    would be too many groups.
    """
    labels = np.zeros(rows, dtype=np.int64)
    for train, test in splits:
        side = np.zeros(rows, dtype=np.int64)
        if len(np.unique(train)) != len(train) or len(np.unique(test)) != len(test):
            return None
        side[train] += 1
        side[test] += 2
        _, labels = np.unique(4 * labels + side, return_inverse=True)
        if labels.max(initial=0) >= _MOST_GROUPS:
            return None
    # The first row of every group speaks for it.
    _, first = np.unique(labels, return_index=True)

    def union(part: NDArray[np.intp]) -> list[int]:
        held = np.zeros(rows, dtype=bool)
        held[part] = True
        return [int(group) for group in np.flatnonzero(held[first])]

    return labels.astype(np.uint32), [union(train) for train, _ in splits], [union(test) for _, test in splits]


def fold_designs(
    X: NDArray[np.floating],
    y: NDArray[np.floating],
    splits: Sequence[tuple[NDArray[np.intp], NDArray[np.intp]]],
    weight: NDArray[np.float64] | None = None,
) -> tuple[Design | None, FoldDesigns]:
    """Designs of all folds.

    It is one for all where folds are unions of groups of rows (then it also comes first), else one for each.
    """
    if not splits:
        raise ValueError("cv has no folds: give at least one (train, test)")
    for fold, (train, test) in enumerate(splits):
        if len(train) == 0 or len(test) == 0:
            raise ValueError(f"fold {fold} of cv has no rows to {'test' if len(train) else 'train'}")
    found = fold_groups(splits, len(X))
    if found is not None:
        labels, trains, tests = found
        design = Design(X, y, weight, labels, int(labels.max()) + 1)
        return design, FoldDesigns([(design, train, test) for train, test in zip(trains, tests)])
    folds = []
    for train, test in splits:
        rows = np.concatenate([train, test])
        sides = np.repeat(np.array([0, 1], dtype=np.uint32), [len(train), len(test)])
        own = None if weight is None else weight[rows]
        folds.append((Design(X[rows], y[rows], own, sides, 2), [0], [1]))
    return None, FoldDesigns(folds)


def fold_params(estimator: Any, params: dict[str, Any]) -> dict[str, Any]:
    """What of the extra arguments of `fit` goes to the splitter `estimator.cv`, by scikit-learn's metadata routing."""
    if HAS_SKLEARN and import_module("sklearn").get_config().get("enable_metadata_routing"):
        routing = import_module("sklearn.utils.metadata_routing")
        return dict(routing.process_routing(estimator, "fit", **params).splitter.split)
    if params:
        raise ValueError(
            f"Passing extra keyword arguments ({', '.join(params)}) to {type(estimator).__name__}.fit "
            "is only supported if enable_metadata_routing=True: sklearn.set_config(enable_metadata_routing=True)"
        )
    return {}


def fold_router(estimator: Any) -> Any:
    """What `get_metadata_routing` answers where extra arguments go to the splitter."""
    routing = import_module("sklearn.utils.metadata_routing")
    mapping = routing.MethodMapping().add(caller="fit", callee="split")
    router = routing.MetadataRouter(owner=type(estimator).__name__)
    return router.add(splitter=check_cv(estimator.cv), method_mapping=mapping)
