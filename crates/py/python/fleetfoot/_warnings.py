"""Messages of the engine: possible mistakes as Python warnings, usual assumptions as log lines."""

from __future__ import annotations

import logging
import os
import re
import warnings
from collections.abc import Iterable


class FleetfootWarning(UserWarning):
    """A possible mistake in the data or a fit; the result is still valid."""


_HERE = os.path.dirname(os.path.abspath(__file__))
_LOG = logging.getLogger("fleetfoot")
#: Facts that every recording of a kind has, and that nobody need act on.
_ROUTINE = re.compile(
    "|".join(
        [
            "(is|are) taken as the time",
            "(^|: )one row per message of",
            "(^|: )stamps are the",
            "the rows have no time stamps: they are taken in their order",
            "its columns are separated by",
            "no header: the columns are called",
            "decimal comma$",
            "no message is lost",
        ]
    )
)


def warn(message: str) -> None:
    """Warns from the line of the caller outside of the package."""
    import sys

    level, frame = 2, sys._getframe(1)
    while frame is not None and os.path.dirname(os.path.abspath(frame.f_code.co_filename)) == _HERE:
        if frame.f_back is None:
            break
        frame, level = frame.f_back, level + 1
    warnings.warn(message, FleetfootWarning, stacklevel=level)


def tell_all(messages: Iterable[str]) -> list[str]:
    """A warning for every message, or a line of the log ``fleetfoot`` for a usual assumption; returns the
    messages."""
    all_messages = list(messages)
    for message in all_messages:
        if _ROUTINE.search(message):
            _LOG.info(message)
        else:
            warn(message)
    return all_messages
