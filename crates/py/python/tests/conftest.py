"""If the peers were installed, a test that skips one fails."""

from __future__ import annotations

import os

import pytest

#: Said by those who installed all of requirements-test.txt (`make test-python`).
INSTALLED = os.environ.get("FLEETFOOT_PEERS") == "installed"


def _fail_for_a_missing_peer(report: pytest.TestReport | pytest.CollectReport) -> None:
    reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else ""
    if INSTALLED and report.skipped and ("not installed" in reason or "could not import" in reason):
        report.outcome = "failed"
        report.longrepr = f"{reason}; but the peers were installed (FLEETFOOT_PEERS)"


def pytest_configure(config: pytest.Config) -> None:
    """Refuses to begin without the plugin that ends a test that hangs."""
    if not config.pluginmanager.hasplugin("timeout"):
        raise pytest.UsageError("pytest-timeout is not installed, so that a test may hang: pip install pytest-timeout")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    report = yield
    _fail_for_a_missing_peer(report)
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector):
    report = yield
    _fail_for_a_missing_peer(report)
    return report
