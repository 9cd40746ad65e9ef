"""Messages of the engine in the words of Python: arguments in the place of flags and of sections of a recipe.

The engine speaks to all its users at once, and names what it means by the flag or by the key of the recipe. Here each
has its argument.
"""

from __future__ import annotations

import re

#: Commands as what does the same here.
_COMMANDS = {
    "fit pwa": "PWA",
    "fit sindy": "SINDy",
    "fit narx": "NARX",
    "fit parameters": "Parameters",
    "fit sparse": "BlockSparse",
    "info --values": "fleetfoot.info(path, values=True)",
    "info": "fleetfoot.info",
    "scan": "fleetfoot.scan",
    "score": "Model.score",
    "stats drop": "Stats.drop",
    "stats merge": "fleetfoot.merge",
    "stats info": "Stats",
    "generate": "fleetfoot.generate",
}
#: Flags that are switches.
_SWITCHES = {"append", "continuous", "direct", "force", "front", "tsqr"}
#: Keys and flags that have another name as an argument.
_NAMES = {
    "lambda": "lam",
    "predict": "target",
    "time": "t",
    "outputs": "feature_names",
    "key": "keys",
    "episode": "episodes",
    "file": "files",
    "plane": "axes",
}
#: What follows a flag and is its value, not the next word of the sentence.
_VALUE = (
    r"[\w.]*:[\w.,+:]+|-?\d[\w.,:/()+-]*|null|average|rollout|bic|cv|one-se|aic|ebic|free-run|pool|refuse|next|delta|"
    r"derivative|auto|off|term|signal|stlsq|sr3|frols|ssr|lasso|ols"
)
_COMMAND = re.compile(r"`(?:fleetfoot )?(fit \w+|stats \w+|info --values|info)( [^`]*)?`|`?fleetfoot (\w+)`")
_FIRST = re.compile(r"^--([a-z][\w-]*) (\S+?):(?= )")
_TWICE = re.compile(rf"\[(\w+)\] (\w+) = (\S+?) \(--[\w-]+(?: (?:{_VALUE}|[\w.]+))?\)")
_FLAG = re.compile(rf"(?<![\w/.-])`?--([a-z][\w-]*)(?:[= ]((?:{_VALUE})(?:,(?:{_VALUE}))*(?![\w-])))?`?")
_ENTRY = re.compile(r"\[(?:pwa|sindy|sparse|narx|estimate|control|filter|model|time|library|prepare|resimulate)\] (\w+)( = )?")
_NAMED = re.compile(r"(^|[;:(] )\[(states|inputs|latents|tasks|parameters)\] (\w+)")
_SECTION = re.compile(
    r"\[(states|inputs|latents|tasks|parameters|columns|library|model|sindy|sparse|pwa|narx|estimate|time)\](?! ?=)"
)
_JSON_PLACE = re.compile(r" at line \d+ column \d+")
#: Commands of others stay as they are.
_FOREIGN = re.compile(r"(`(?:mcap|rosbags-convert|pip) [^`]*`)")


def of_python(message: str) -> str:
    """A message with arguments of Python in the place of flags, commands, sections, and places in JSON.

    Examples
    --------
    >>> of_python("[pwa] folds = 101: write 0 to 100")
    'folds=101: write 0 to 100'
    >>> of_python("lambda can be given (`--lambda`), or chosen by `--select bic`")
    "lambda can be given (lam=), or chosen by select='bic'"
    >>> of_python("`fit sindy` chooses a span; `fleetfoot info --values` tells more")
    'SINDy chooses a span; fleetfoot.info(path, values=True) tells more'
    """
    if not any(sign in message for sign in ("--", "[", "`fit ", "`fleetfoot ", " at line ")):
        return message
    return "".join(part if _FOREIGN.fullmatch(part) else _translated(part) for part in _FOREIGN.split(message))


def _translated(message: str) -> str:
    message = _JSON_PLACE.sub("", message)
    message = _COMMAND.sub(_command, message)
    message = _FIRST.sub(lambda found: f"{_said(found[1], found[2])}:", message)
    message = _TWICE.sub(lambda found: f"{_name(found[2])}={found[3]}", message)
    message = _FLAG.sub(lambda found: _said(found[1], found[2]), message)
    message = _ENTRY.sub(lambda found: f"{_name(found[1])}{'=' if found[2] else ''}", message)
    message = _NAMED.sub(lambda found: f"{found[1]}{found[2]}[{found[3]!r}]", message)
    return _SECTION.sub(lambda found: found[1], message)


def _command(found: re.Match[str]) -> str:
    if found[3]:
        return f"fleetfoot.{found[3]}" if found[3] != "score" else _COMMANDS["score"]
    return _COMMANDS.get(found[1], found[1]) + (found[2] or "")


def _said(flag: str, value: str | None) -> str:
    """A flag, with its value where it has one, as an argument."""
    name = _name(flag.replace("-", "_"))
    if value is None:
        return f"{name}=True" if name in _SWITCHES else f"{name}="
    try:
        float(value)
    except ValueError:
        return f"{name}={value!r}"
    return f"{name}={value}"


def _name(word: str) -> str:
    return _NAMES.get(word, word)
