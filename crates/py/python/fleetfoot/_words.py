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
    "control lqr": "Model.lqr",
    "info --values": "fleetfoot.info(path, values=True)",
    "info": "fleetfoot.info",
    "scan": "fleetfoot.scan",
    "score": "Model.score",
    "stats drop": "Stats.drop",
    "stats merge": "fleetfoot.merge",
    "stats info": "Stats",
    "generate": "fleetfoot.generate",
}
#: Letters beyond which a value is cut in a message.
_LONG = 80
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
    "functions": "library",
}
#: What follows a flag and is its value, not the next word of the sentence.
_VALUE = (
    r"[\w.]*:[\w.,+:]+|-?\d[\w.,:/()+-]*|null|average|rollout|bic|cv|one-se|aic|ebic|free-run|pool|refuse|next|delta|"
    r"derivative|auto|off|term|signal|stlsq|sr3|frols|ssr|lasso|ols|[A-Z]{2,}"
)
_COMMAND = re.compile(r"`(?:fleetfoot )?(fit \w+|stats \w+|control lqr|info --values|info)( [^`]*)?`|`?fleetfoot (\w+)`")
_FIRST = re.compile(r"^--([a-z][\w-]*) (\S+?):(?= )")
_TWICE = re.compile(rf"\[(\w+)\] (\w+) = (\S+?) \(--[\w-]+(?: (?:{_VALUE}|[\w.]+))?\)")
_FLAG = re.compile(rf"(?<![\w/.-])`?--([a-z][\w-]*)(?:[= ]((?:{_VALUE})(?:,(?:{_VALUE}))*(?![\w-])))?`?")
_ENTRY = re.compile(r"\[(?:pwa|sindy|sparse|narx|estimate|control|filter|model|time|library|prepare|resimulate|auto)\] (\w+)( = )?")
_NAMED = re.compile(r"(^|[;:(] )\[(states|inputs|latents|tasks|parameters)\] (\w+)")
_SECTION = re.compile(
    r"\[(states|inputs|latents|tasks|parameters|columns|library|model|sindy|sparse|pwa|narx|estimate|time)\](?! ?=)"
)
#: A flag with its value as an entry of a recipe has it, an entry at the beginning.
_ASSIGNED = re.compile(r'--([a-z][\w-]*) = ("[^"]*"|[^\s:;,"]+)(?=[:;,.]|$)')
_BEGINS = re.compile(r'^(\w+) = ("[^"]*")(?=:)')
#: What the reader of recipes says of arguments and dicts, which became TOML on the way.
_PARSED = re.compile(
    r"^(the arguments|recipe): TOML parse error at line \d+, column \d+\n.*?\n *\d+ \| ([^\n]*)\n[^\n]*\n(.*?)\s*$", re.DOTALL
)
_VARIANT = re.compile(r"unknown (variant|field) `([^`]*)`, expected (?:one of )?(.*)$", re.DOTALL)
_TYPE = re.compile(r"invalid (?:type|value): .*?, expected (.*)$", re.DOTALL)
#: Types of the engine as what a person gives.
_TYPES = {
    "a boolean": "True or False",
    "a sequence": "a list",
    "a map": "a dict",
    "a string": "a str",
    **dict.fromkeys(("u8", "u16", "u32", "u64", "usize"), "a whole number of 0 or more"),
    **dict.fromkeys(("i32", "i64", "isize"), "a whole number"),
    **dict.fromkeys(("f32", "f64"), "a number"),
}
#: The unit of a clock, which no argument names.
_UNIT = re.compile(r'--time .*? --time-unit \S+; in a recipe \[time\] column = "(.*?)", unit = "(\w+)"')
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
    if not any(sign in message for sign in ("--", "[", "`fit ", "`fleetfoot ", " at line ", ' = "', "write true")):
        return message
    parsed = _PARSED.match(message)
    if parsed:
        message = _unparsed(*parsed.groups())
    return "".join(part if _FOREIGN.fullmatch(part) else _translated(part) for part in _FOREIGN.split(message))


def _translated(message: str) -> str:
    message = _UNIT.sub(lambda found: f'recipe={{"time": {{"column": "{found[1]}", "unit": "{found[2]}"}}}}', message)
    message = _JSON_PLACE.sub("", message)
    message = _COMMAND.sub(_command, message)
    message = _FIRST.sub(lambda found: f"{_said(found[1], found[2])}:", message)
    message = _TWICE.sub(lambda found: f"{_name(found[2])}={found[3]}", message)
    message = _ASSIGNED.sub(lambda found: f"{_name(found[1].replace('-', '_'))}={_value(found[2])}", message)
    message = _BEGINS.sub(lambda found: f"{_name(found[1])}={_value(found[2])}", message)
    message = _FLAG.sub(lambda found: _said(found[1], found[2]), message)
    message = _ENTRY.sub(lambda found: f"{_name(found[1])}{'=' if found[2] else ''}", message)
    message = _NAMED.sub(lambda found: f"{found[1]}{found[2]}[{found[3]!r}]", message)
    message = message.replace('write true, false or "length"', "write True, False or 'length'")
    return _SECTION.sub(lambda found: found[1], message)


def _unparsed(whose: str, line: str, problem: str) -> str:
    """What the reader of recipes says of a line of TOML that no user wrote."""
    key, _, text = line.partition(" = ")
    value = _value(text)
    where = "" if whose == "the arguments" else f"{whose}: "
    for said in (f"{line}: ", f"{key}: "):
        problem = problem.removeprefix(said)
    variant, kind = _VARIANT.match(problem), _TYPE.match(problem)
    if variant:
        names = [repr(name) for name in re.findall(r"`([^`]*)`", variant[3])]
        listed = f"{', '.join(names[:-1])} or {names[-1]}" if len(names) > 1 else "".join(names)
        if variant[1] == "field":
            return f"{where}there is no {variant[2]!r}; give {listed}"
        problem = f"give {listed}"
    elif kind:
        problem = f"give {_TYPES.get(kind[1], kind[1])}"
    elif problem.startswith("expected "):
        problem = f"give {problem.removeprefix('expected ')}"
    return f"{where}{_name(key)}={value}: {problem or 'give another value'}" if text else f"{where}{problem}"


def _value(text: str) -> str:
    """A value of TOML as Python writes it, shortened where it is long."""
    if len(text) > 1 and text[0] == text[-1] == '"':
        text = repr(text[1:-1])
    return shown({"true": "True", "false": "False"}.get(text, text))


def shown(text: str) -> str:
    """A text in a message, without the middle where it is long."""
    return text if len(text) <= _LONG else f"{text[:20]}...{text[-10:]}"


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
