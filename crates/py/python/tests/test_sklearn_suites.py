"""scikit-learn's own tests (they come with its wheel) on fleetfoot's classes.

With ``-s`` the list of what does not pass is printed, with the reasons; it is also written into the folder that
FLEETFOOT_SUITES_OUT names.
"""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

SUITES = ["least_angle", "coordinate_descent", "k_means"]


@pytest.mark.parametrize("suite", SUITES)
def test_suite_of_scikit_learn(suite: str, tmp_path: Path) -> None:
    pytest.importorskip("sklearn", reason="scikit-learn, whose tests these are, is not installed")
    described = __import__(f"sklearn_suites.{suite}", fromlist=["MODULE"])
    if importlib.util.find_spec(described.MODULE) is None:
        pytest.skip(f"this scikit-learn comes without {described.MODULE}")
    report = tmp_path / "report.json"
    # It runs elsewhere: relative paths would not be found there.
    given = [str(Path(path).resolve()) for path in os.environ.get("PYTHONPATH", "").split(os.pathsep) if path]
    paths = [str(Path(__file__).parent), *given]
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(paths),
        "FLEETFOOT_SUITE": suite,
        "FLEETFOOT_SUITE_REPORT": str(report),
        # They leave out half of what they have for the sake of their own time.
        "SKLEARN_RUN_FLOAT32_TESTS": "1",
    }
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-p",
        "sklearn_suites.plugin",
        "-p",
        "no:cacheprovider",
        "--pyargs",
    ]
    process = subprocess.run(
        [*command, described.MODULE], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert report.exists(), process.stdout + process.stderr
    results = json.loads(report.read_text(encoding="utf-8"))
    text, failed = _summary(suite, results)
    print(text)
    target = os.environ.get("FLEETFOOT_SUITES_OUT")
    if target:
        Path(target).mkdir(parents=True, exist_ok=True)
        (Path(target) / f"{suite}.txt").write_text(text, encoding="utf-8")
    if not results["replaced"]:
        pytest.skip(f"fleetfoot has none of the names of {', '.join(described.PACKAGES)} yet")
    assert not failed, text + process.stdout[-8000:]
    assert process.returncode == 0, process.stdout[-8000:] + process.stderr


def _summary(suite: str, results: dict) -> tuple[str, list[str]]:
    """The list of what does not pass with the counts, and the tests that fail without being expected to."""
    tests = results["tests"]
    by = {
        kind: [name for name, test in tests.items() if test["outcome"] == kind]
        for kind in ("passed", "expected", "failed", "skipped")
    }
    ours = [name for name in by["passed"] if tests[name]["calls"]]
    lines = [
        f"{suite}: {len(tests)} tests; {len(by['passed'])} pass ({len(ours)} of them call fleetfoot), "
        f"{len(by['expected'])} expected not to, {len(by['failed'])} fail, {len(by['skipped'])} skipped",
        f"  in the place of: {', '.join(results['replaced']) or 'nothing'}",
    ]
    for kind in ("expected", "failed", "skipped"):
        lines += [f"  {kind}: {name}: {tests[name]['reason']}" for name in by[kind]]
    return "\n".join(lines) + "\n", by["failed"]
