"""The command of the installed package, for tests."""

from __future__ import annotations

import os
import subprocess
import sysconfig
from pathlib import Path

#: The command that installers write from the wheel's entry point.
COMMAND = str(Path(sysconfig.get_path("scripts"), "fleetfoot.exe" if os.name == "nt" else "fleetfoot"))


def run(*arguments: str, folder: Path | None = None, code: int = 0) -> subprocess.CompletedProcess[str]:
    """Run the command in a folder. It must end with the exit code, and never with a traceback."""
    done = subprocess.run([COMMAND, *arguments], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == code, f"{arguments}: exit code {done.returncode}\n{done.stdout}{done.stderr}"
    assert "Traceback" not in done.stderr and "panicked" not in done.stderr, done.stderr
    return done
