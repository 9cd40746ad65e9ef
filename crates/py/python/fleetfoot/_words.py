"""Messages of the recipe parser about arguments, in words of Python.

Messages of the engine name arguments already (``words.rs`` of the module). Arguments become TOML or JSON for the
recipe parser. Its messages are shown without places in that text, and with Python's names of types.
"""

from __future__ import annotations

import re

#: Letters beyond which a value is cut in a message.
_LONG = 80
#: Arguments that have another name in a recipe.
_NAMES = {"lambda": "lam", "predict": "target", "outputs": "feature_names", "functions": "library"}
_PARSED = re.compile(
    r"^(the arguments|recipe): TOML parse error at line \d+, column \d+\n.*?\n *\d+ \| ([^\n]*)\n[^\n]*\n(.*?)\s*$", re.DOTALL
)
_VARIANT = re.compile(r"unknown (variant|field) `([^`]*)`, expected (?:one of )?(.*)$", re.DOTALL)
_TYPE = re.compile(r"invalid (?:type|value): .*?, expected (.*)$", re.DOTALL)
_JSON_PLACE = re.compile(r" at line \d+ column \d+")
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


def of_python(message: str) -> str:
    """A message without references to generated TOML and JSON.

    Examples
    --------
    >>> of_python("the recipe: unknown field at line 1 column 12")
    'the recipe: unknown field'
    """
    if " at line " not in message:
        return message
    parsed = _PARSED.match(message)
    return _unparsed(*parsed.groups()) if parsed else _JSON_PLACE.sub("", message)


def _unparsed(whose: str, line: str, problem: str) -> str:
    """A message of the recipe parser about generated TOML."""
    key, _, text = line.partition(" = ")
    value = _value(text)
    where = "" if whose == "the arguments" else f"{whose}: "
    for prefix in (f"{line}: ", f"{key}: "):
        problem = problem.removeprefix(prefix)
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
    return f"{where}{_NAMES.get(key, key)}={value}: {problem or 'give another value'}" if text else f"{where}{problem}"


def _value(text: str) -> str:
    """A TOML value in Python's notation, shortened if long."""
    if len(text) > 1 and text[0] == text[-1] == '"':
        text = repr(text[1:-1])
    return shown({"true": "True", "false": "False"}.get(text, text))


def shown(text: str) -> str:
    """A text in a message, without its middle if long."""
    return text if len(text) <= _LONG else f"{text[:20]}...{text[-10:]}"
