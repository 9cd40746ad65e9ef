"""scikit-learn's `check_estimator` on every estimator of the package."""

from __future__ import annotations

import inspect
from typing import Any

import pytest

import fleetfoot

checks = pytest.importorskip(
    "sklearn.utils.estimator_checks", reason="scikit-learn, whose checks these are, is not installed"
)

from sklearn_suites import estimators  # noqa: E402


def _classes() -> list[type]:
    from fleetfoot._base import BaseEstimator

    exported = (getattr(fleetfoot, name) for name in fleetfoot.__all__)
    classes = [one for one in exported if inspect.isclass(one) and issubclass(one, BaseEstimator)]
    return [one for one in classes if one.__name__ not in estimators.OTHERS]


def _make(estimator: type) -> Any:
    return estimators.MAKE[estimator.__name__](estimator) if estimator.__name__ in estimators.MAKE else estimator()


def _expected(estimator: Any) -> dict[str, str]:
    return estimators.EXPECTED.get(type(estimator).__name__, {})


@checks.parametrize_with_checks(
    [_make(estimator) for estimator in _classes()], expected_failed_checks=_expected, xfail_strict=True
)
def test_scikit_learn_check(estimator: Any, check: Any) -> None:
    check(estimator)


def test_list_names_all_estimators() -> None:
    names = {estimator.__name__ for estimator in _classes()}
    assert set(estimators.EXPECTED) <= names
    assert set(estimators.MAKE) <= names
    assert not set(estimators.OTHERS) & names and all(hasattr(fleetfoot, name) for name in estimators.OTHERS)
