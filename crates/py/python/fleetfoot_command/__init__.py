"""The command ``fleetfoot`` of the wheel, apart from the package: it starts without numpy and scikit-learn, which the package imports."""

from __future__ import annotations

import signal
import sys
from importlib.machinery import PathFinder
from importlib.util import find_spec, module_from_spec
from types import ModuleType
from typing import NoReturn


def main() -> NoReturn:
    """Run the command with the arguments of the process, and end with its exit code."""
    # The command stops its work at Ctrl-C itself: Python's handler would add a traceback.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.exit(_engine().command(["fleetfoot", *sys.argv[1:]]))


def _engine() -> ModuleType:
    """The extension module of the package: the one that is imported, else its file alone."""
    imported = sys.modules.get("fleetfoot._core")
    if imported is not None:
        return imported
    # The spec of a package is found without importing it.
    package = find_spec("fleetfoot")
    folders = package.submodule_search_locations if package else None
    spec = PathFinder.find_spec("_core", list(folders or []))
    if spec is None or spec.loader is None:
        sys.exit("error: the package fleetfoot has no engine: install its wheel again (pip install --force-reinstall)")
    engine = module_from_spec(spec)
    spec.loader.exec_module(engine)
    return engine
