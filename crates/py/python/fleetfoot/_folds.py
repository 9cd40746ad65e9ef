"""Folds as groups of rows: one pass over the data for a whole cross-validation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ._base import HAS_SKLEARN, KFold, check_cv, splits
from ._core import Design

#: Groups of rows beyond which folds share so little that each is read by itself.
_MOST_GROUPS = 256


class Groups(NamedTuple):
    """Groups of rows that share their side in every fold."""

    #: Group of every row (rows,).
    labels: NDArray[np.uint32]
    #: For every fold the groups that train.
    trains: list[list[int]]
    #: For every fold the groups that test.
    tests: list[list[int]]


@dataclass(frozen=True)
class FoldDesigns:
    """For every fold its design, and the groups that train and that test."""

    folds: list[tuple[Design, list[int], list[int]]]


def neighbour_groups(splitter: Any, rows: int) -> Groups | None:
    """The groups of plain folds of neighbouring rows, without a list of indices; `None` for other folds."""
    if type(splitter) is not KFold or getattr(splitter, "shuffle", False):
        return None
    count = int(splitter.n_splits)
    if not 2 <= count <= min(rows, _MOST_GROUPS):
        return None
    # The first folds have the rows that are left over.
    sizes = np.full(count, rows // count)
    sizes[: rows % count] += 1
    labels = np.repeat(np.arange(count, dtype=np.uint32), sizes)
    trains = [[group for group in range(count) if group != fold] for fold in range(count)]
    return Groups(labels, trains, [[fold] for fold in range(count)])


def fold_groups(splits: Sequence[tuple[NDArray[np.intp], NDArray[np.intp]]], rows: int) -> Groups | None:
    """The groups of any folds.

    `None` if a fold names a row twice (as bootstrap samples do), or for too many groups.
    """
    labels = np.zeros(rows, dtype=np.uint32)
    # For every group its side in every fold: 1 where it trains, 2 where it tests, 3 where both.
    sides = np.zeros((1, 0), dtype=np.uint32)
    for train, test in splits:
        trains, tests = (_mask(part, rows) for part in (train, test))
        if trains is None or tests is None:
            return None
        # Codes are few: a table renames them, where sorting the rows would cost more than reading them.
        code = 4 * labels + trains + 2 * tests.view(np.uint8)
        seen = np.zeros(4 * len(sides), dtype=bool)
        seen[code] = True
        codes = np.flatnonzero(seen)
        if len(codes) > _MOST_GROUPS:
            return None
        names = np.cumsum(seen, dtype=np.uint32) - np.uint32(1)
        labels = names[code]
        sides = np.column_stack([sides[codes // 4], (codes % 4).astype(np.uint32)])
    trains_on, tests_on = (
        [[int(group) for group in np.flatnonzero(sides[:, fold] & side)] for fold in range(len(splits))]
        for side in (1, 2)
    )
    return Groups(labels, trains_on, tests_on)


def _mask(part: NDArray[np.intp], rows: int) -> NDArray[np.bool_] | None:
    """Mask of the named rows; `None` if a row is named twice."""
    mask = np.zeros(rows, dtype=bool)
    mask[part] = True
    return mask if np.count_nonzero(mask) == len(part) else None


def cross_validation(
    X: NDArray[np.floating],
    y: NDArray[np.floating],
    cv: Any,
    weight: NDArray[np.float64] | None = None,
    **params: Any,
) -> tuple[Design | None, FoldDesigns]:
    """As :func:`fold_designs`, from the user's `cv`; `params` are for its `split`."""
    splitter = check_cv(cv, classifier=False)
    groups = None if params else neighbour_groups(splitter, X.shape[0])
    if groups is None:
        return fold_designs(X, y, splits(splitter, X, y, **params), weight)
    return _shared(X, y, groups, weight)


def _shared(
    X: NDArray[np.floating], y: NDArray[np.floating], groups: Groups, weight: NDArray[np.float64] | None
) -> tuple[Design, FoldDesigns]:
    design = Design(X, y, weight, groups.labels, int(groups.labels.max()) + 1)
    return design, FoldDesigns([(design, train, test) for train, test in zip(groups.trains, groups.tests)])


def fold_designs(
    X: NDArray[np.floating],
    y: NDArray[np.floating],
    splits: Sequence[tuple[NDArray[np.intp], NDArray[np.intp]]],
    weight: NDArray[np.float64] | None = None,
) -> tuple[Design | None, FoldDesigns]:
    """Designs of all folds.

    If folds are unions of groups of rows, all folds share one design, which comes first; else each has one.
    """
    if not splits:
        raise ValueError("cv has no folds: give at least one (train, test)")
    for fold, (train, test) in enumerate(splits):
        if len(train) == 0 or len(test) == 0:
            raise ValueError(f"fold {fold} of cv has no rows to {'test' if len(train) else 'train'}")
    groups = fold_groups(splits, X.shape[0])
    if groups is not None:
        return _shared(X, y, groups, weight)
    folds = []
    for train, test in splits:
        rows = np.concatenate([train, test])
        sides = np.repeat(np.array([0, 1], dtype=np.uint32), [len(train), len(test)])
        fold_weight = None if weight is None else weight[rows]
        folds.append((Design(X[rows], y[rows], fold_weight, sides, 2), [0], [1]))
    return None, FoldDesigns(folds)


def fold_params(estimator: Any, params: dict[str, Any]) -> dict[str, Any]:
    """The extra arguments of `fit` for the splitter `estimator.cv`, by scikit-learn's metadata routing."""
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
    """Result of `get_metadata_routing` for extra arguments of the splitter."""
    routing = import_module("sklearn.utils.metadata_routing")
    mapping = routing.MethodMapping().add(caller="fit", callee="split")
    router = routing.MetadataRouter(owner=type(estimator).__name__)
    return router.add(splitter=check_cv(estimator.cv), method_mapping=mapping)
