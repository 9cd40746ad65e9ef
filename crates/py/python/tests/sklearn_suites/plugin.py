"""A pytest plugin: a test module of scikit-learn, with fleetfoot's classes and functions in the place of its own.

The suite is named by the variable FLEETFOOT_SUITE and described by the module of that name beside this file: `MODULE`
is scikit-learn's test module,
`PACKAGES` are the packages whose public names are replaced, and `EXPECTED` says which tests fail or do not apply
(`fnmatch` pattern of the test's id) and why.
A test of that list that passes, and a pattern that fits no test, is an error. The outcomes go to the file that
FLEETFOOT_SUITE_REPORT names, as JSON.
"""

from __future__ import annotations

import fnmatch
import functools
import importlib
import json
import os
import sys
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

suite = importlib.import_module(f"sklearn_suites.{os.environ['FLEETFOOT_SUITE']}")
outcomes: dict[str, dict[str, Any]] = {}
calls: list[str] = []


def _counted(function: Any, name: str) -> Any:
    """The same function, which leaves a note when it is called."""

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        calls.append(name)
        return function(*args, **kwargs)

    return call


def _replace() -> list[str]:
    """Puts fleetfoot's names into scikit-learn's packages; the names that were replaced."""
    fleetfoot = importlib.import_module("fleetfoot")
    replaced = []
    for package in map(importlib.import_module, suite.PACKAGES):
        for name in fleetfoot.__all__:
            if name.startswith("_") or not hasattr(package, name):
                continue
            ours = getattr(fleetfoot, name)
            if isinstance(ours, type):
                for method in ("fit", "fit_predict", "fit_transform", "partial_fit"):
                    if method in vars(ours):
                        setattr(ours, method, _counted(getattr(ours, method), name))
            elif callable(ours):
                ours = _counted(ours, name)
            else:
                continue
            setattr(package, name, ours)
            replaced.append(f"{package.__name__}.{name}")
    return replaced


# Before the test module is imported: its parameters are made of the classes then.
replaced = _replace()


def _id(item: pytest.Item) -> str:
    return item.nodeid.rpartition("::")[2] if "::" in item.nodeid else item.nodeid


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Marks the tests that are expected to fail."""
    used = set()
    for item in items:
        for pattern, reason in suite.EXPECTED.items():
            if fnmatch.fnmatchcase(_id(item), pattern):
                used.add(pattern)
                item.add_marker(pytest.mark.xfail(strict=True, reason=reason))
                break
    unused = sorted(set(suite.EXPECTED) - used)
    if unused:
        raise pytest.UsageError(f"no test of {suite.MODULE} fits {unused}: take them off the list")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[Any]) -> Any:
    """Notes what became of a test, and which of fleetfoot's names it called."""
    report = yield
    entry = outcomes.setdefault(_id(item), {"outcome": "passed", "reason": "", "calls": []})
    if call.when == "setup":
        calls.clear()
    if call.when == "call":
        entry["calls"] = sorted(set(calls))
    if hasattr(report, "wasxfail"):
        # A strict one that passes is a failure without this mark.
        entry.update(outcome="expected" if report.skipped else "passed", reason=report.wasxfail)
    elif report.failed:
        entry.update(outcome="failed", reason=str(report.longrepr)[-2000:])
    elif report.skipped:
        entry.update(outcome="skipped", reason=str(report.longrepr[-1] if report.longrepr else ""))
    return report


def pytest_sessionfinish() -> None:
    """Writes the report."""
    target = os.environ.get("FLEETFOOT_SUITE_REPORT")
    if target:
        Path(target).write_text(json.dumps({"replaced": replaced, "tests": outcomes}), encoding="utf-8")
