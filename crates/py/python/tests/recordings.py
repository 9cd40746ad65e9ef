"""Folder of the recordings of real machines: in ``FLEETFOOT_DATA``, else in ``shared/data`` beside the checkout."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parents[4]
NAMED = os.environ.get("FLEETFOOT_DATA")
DATA = Path(NAMED) if NAMED else CHECKOUT.parent / "shared" / "data"


def recording(name: str) -> Path:
    """A file or folder of the recordings. Without any the test is skipped; in a folder that is there, or was named, it must be."""
    path = DATA / name
    if path.exists():
        return path
    if NAMED or DATA.is_dir():
        pytest.fail(f"{name} is not in {DATA}")
    pytest.skip(f"there is no {DATA}; set FLEETFOOT_DATA to the folder of the recordings")
