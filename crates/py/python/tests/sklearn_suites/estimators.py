"""What `check_estimator` is expected to find: by class the checks that fail or do not apply, with their reasons."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

#: Checks that fail, by class and check.
EXPECTED: dict[str, dict[str, str]] = {}

#: How to make an estimator for the checks, where its defaults will not do.
MAKE: dict[str, Callable[[Any], Any]] = {}
