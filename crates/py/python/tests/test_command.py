"""The command within the package: arguments, exit codes, messages, signals, and files with the bytes of the package's own fits."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from command import COMMAND, run

import fleetfoot as ff


def log(path: Path, rows: int) -> Path:
    """A damped oscillation with noise."""
    t = np.arange(rows) * 0.01
    rng = np.random.default_rng(5)
    q = np.exp(-0.02 * t) * np.cos(2 * t)
    columns = [t, q + 1e-4 * rng.standard_normal(rows), np.gradient(q, t)]
    np.savetxt(path, np.column_stack(columns), delimiter=",", header="t,q,v", comments="", fmt="%.17g")
    return path


def test_installed_script_and_module_agree():
    expected = f"fleetfoot {ff.__version__}\n"
    assert run("--version").stdout == expected
    helped = run("fit", "pwa", "--help").stdout
    assert "Usage: fleetfoot fit pwa" in helped
    for arguments, output in ((["--version"], expected), (["fit", "pwa", "--help"], helped)):
        module = subprocess.run([sys.executable, "-m", "fleetfoot", *arguments], capture_output=True, text=True, check=True)
        assert (module.stdout, module.stderr) == (output, "")


def test_import_starts_no_command():
    code = "import sys; sys.argv[1:] = ['--version']; import fleetfoot.__main__, fleetfoot_command; print('imported')"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("imported\n", "")


def test_script_imports_no_numpy():
    code = "import atexit, sys, fleetfoot_command; atexit.register(lambda: print({'numpy', 'fleetfoot'} & set(sys.modules))); fleetfoot_command.main()"
    done = subprocess.run([sys.executable, "-c", code, "--version"], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == (f"fleetfoot {ff.__version__}\nset()\n", "")


def test_exit_codes_tell_the_kind_of_error(tmp_path):
    assert "Usage: fleetfoot" in run(code=2).stderr
    assert "--unknown" in run("info", "--unknown", code=2).stderr
    assert "method before the options" in run("fit", "--states", "q", "log.csv", code=2).stderr
    missing = run("info", "missing.csv", folder=tmp_path, code=1)
    assert missing.stdout == "" and "missing.csv" in missing.stderr
    assert run("info", str(log(tmp_path / "log.csv", 50))).stdout.count("\n") > 3


def test_fits_have_the_bytes_of_python(tmp_path):
    log(tmp_path / "log.csv", 2000)
    run("fit", "pwa", "log.csv", "--states", "q,v", "-p", "average,kmeans:3", "-o", "command.json", folder=tmp_path)
    ff.PWA(["average", 3], states=["q", "v"]).fit(ff.open(tmp_path / "log.csv")).save(tmp_path / "package.json")
    assert (tmp_path / "command.json").read_bytes() == (tmp_path / "package.json").read_bytes()


def test_messages_name_the_place_and_flags(tmp_path):
    path = log(tmp_path / "log.csv", 50)
    lines = path.read_text().splitlines()
    lines[30] = "0.3,broken,1"
    path.write_text("\n".join(lines))
    message = run("fit", "pwa", "log.csv", "--states", "q,v", "-o", "model.json", folder=tmp_path, code=1).stderr
    assert "log.csv" in message and "broken" in message and "31" in message, message
    assert not (tmp_path / "model.json").exists()
    # Messages of this process have the words of the command line, not those of the package.
    log(path, 50)
    message = run("fit", "pwa", "log.csv", "--states", "q,v", "--folds", "60", folder=tmp_path, code=1).stderr
    assert "fewer folds (--folds)" in message, message


def test_closed_output_is_no_error():
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run([COMMAND, "completions", "bash"], stdout=writing, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writing)
    assert (done.returncode, done.stderr) == (0, "")


def test_other_threads_of_python_go_on(tmp_path):
    """With the interpreter's lock held, the other thread would not count at all."""
    code = (
        "import sys, threading, time\n"
        "from fleetfoot import _core\n"
        "ends, count = threading.Event(), 0\n"
        "def tick():\n"
        "    global count\n"
        "    while not ends.wait(0.01):\n"
        "        count += 1\n"
        "thread = threading.Thread(target=tick)\n"
        "thread.start()\n"
        "before, begun = count, time.perf_counter()\n"
        "code = _core.command(['fleetfoot', 'generate', 'diffdrive', '--seconds', '60', '--runs', '4', '-q', '-o', 'runs'])\n"
        "counted, seconds = count - before, time.perf_counter() - begun\n"
        "ends.set()\n"
        "print(code, counted, seconds)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    status, counted, seconds = done.stdout.splitlines()[-1].split()
    # A hundred counts a second on an idle machine; a tenth of them on a busy one.
    assert status == "0" and float(counted) >= max(2.0, 10 * float(seconds)), done.stdout


def wait_until_signals_are_handled(process: subprocess.Popen[str]) -> None:
    """Wait until the command has the thread that waits for signals."""
    tasks = Path("/proc", str(process.pid), "task")
    if not tasks.is_dir():
        time.sleep(5)
        return
    begun = time.monotonic()
    while "signals\n" not in [thread.read_text() for thread in tasks.glob("*/comm")]:
        assert process.poll() is None and time.monotonic() < begun + 60, "the command does not wait for signals"
        time.sleep(0.01)


@pytest.mark.skipif(os.name == "nt", reason="Windows sends Ctrl-C to all processes of a console")
@pytest.mark.parametrize("kind", ["SIGINT", "SIGTERM"])
def test_interrupts_leave_no_file(tmp_path, kind):
    log(tmp_path / "log.csv", 3000)
    words = "fit narx log.csv --outputs q,v --lags-out 12 --degree 3 -o model.json"
    process = subprocess.Popen([COMMAND, *words.split()], cwd=tmp_path, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    wait_until_signals_are_handled(process)
    time.sleep(1)
    assert process.poll() is None, "the fit is done before it is stopped: give it more to do"
    process.send_signal(getattr(signal, kind))
    out, err = process.communicate(timeout=120)
    assert (process.returncode, out) == (130, ""), err
    assert err.endswith("stopped; nothing was written\n") and "Traceback" not in err
    assert [path.name for path in tmp_path.iterdir()] == ["log.csv"]
