"""What the engine wants its user to know, as Python warnings."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable


class FleetfootWarning(UserWarning):
    """Something about the data or a fit that its user should know; the answer stands all the same."""


_HERE = os.path.dirname(os.path.abspath(__file__))


def warn(message: str) -> None:
    """Warns from the line of the caller outside of the package."""
    import sys

    level, frame = 2, sys._getframe(1)
    while frame is not None and os.path.dirname(os.path.abspath(frame.f_code.co_filename)) == _HERE:
        if frame.f_back is None:
            break
        frame, level = frame.f_back, level + 1
    warnings.warn(message, FleetfootWarning, stacklevel=level)


def warn_all(messages: Iterable[str]) -> None:
    """A warning for every message."""
    for message in messages:
        warn(message)
