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
    found = [one for one in exported if inspect.isclass(one) and issubclass(one, BaseEstimator)]
    return [one for one in found if one.__name__ not in estimators.OTHERS]


def _make(found: type) -> Any:
    return estimators.MAKE[found.__name__](found) if found.__name__ in estimators.MAKE else found()


def _expected(estimator: Any) -> dict[str, str]:
    return estimators.EXPECTED.get(type(estimator).__name__, {})


@checks.parametrize_with_checks(
    [_make(found) for found in _classes()], expected_failed_checks=_expected, xfail_strict=True
)
def test_scikit_learn_check(estimator: Any, check: Any) -> None:
    check(estimator)


def test_the_list_names_what_there_is() -> None:
    names = {found.__name__ for found in _classes()}
    assert set(estimators.EXPECTED) <= names
    assert set(estimators.MAKE) <= names
    assert not set(estimators.OTHERS) & names and all(hasattr(fleetfoot, name) for name in estimators.OTHERS)
