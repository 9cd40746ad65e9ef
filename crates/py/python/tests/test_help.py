"""A default stands once: what an estimator does without an argument is what the command's help says of the flag."""

from __future__ import annotations

import inspect
import re

import pytest
from command import run

import fleetfoot as ff

#: Arguments whose flag has another name.
FLAGS = {"lam": "lambda", "target": "predict", "t": "time"}
#: Arguments that count in bytes what their flag counts in MiB.
MEBIBYTES = {"memory"}


def helped(command: str) -> dict[str, str]:
    """The flags of a command, each with what its help says of the default."""
    text = run("fit", command, "--help").stdout
    defaults = {}
    for part in re.split(r"\n(?=  (?:-\w, |    )--)", text):
        flag = re.search(r"--([a-z][\w-]*)", part)
        default = re.search(r"\(default: ([^()]*)", " ".join(part.split()))
        if flag and default:
            defaults[flag[1].replace("-", "_")] = default[1]
    return defaults


def worded(name: str, default: object) -> str:
    if isinstance(default, bool):
        return str(default).lower()
    if name in MEBIBYTES and isinstance(default, int):
        return str(default // 2**20)
    return f"{default:g}" if isinstance(default, float) else str(default)


@pytest.mark.parametrize(
    ("command", "estimator"),
    [("pwa", ff.PWA), ("sindy", ff.SINDy), ("narx", ff.NARX), ("network", ff.Network), ("sparse", ff.BlockSparse), ("parameters", ff.Parameters)],
)
def test_defaults_match_the_command(command, estimator):
    flags = helped(command)
    compared, wrong = 0, []
    for name, argument in inspect.signature(estimator).parameters.items():
        printed = flags.get(FLAGS.get(name, name))
        if printed is None or argument.default in (None, (), inspect.Parameter.empty):
            continue
        compared += 1
        expected = worded(name, argument.default)
        if not re.match(re.escape(expected) + r"(?![\w.-])", printed):
            wrong.append(f"{name}={argument.default!r}, and --{FLAGS.get(name, name)} says `{printed}`")
    assert compared >= 2, flags
    assert not wrong, "\n".join(wrong)
