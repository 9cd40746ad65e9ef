"""Recipes as dictionaries: read from TOML, laid over each other."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from typing import Any

from . import _core

Recipe = dict[str, Any]


def of_toml(text: str, name: str = "the recipe") -> Recipe:
    """A recipe in TOML as a dictionary, its tables in their order."""
    found: Recipe = json.loads(_core.recipe_json(text, name)) if text.strip() else {}
    return found


def of_anything(recipe: str | os.PathLike[str] | Mapping[str, Any] | None) -> Recipe:
    """A TOML file, TOML text or a mapping as a dictionary."""
    if recipe is None:
        return {}
    from ._data import _recipe

    return of_toml(_recipe(recipe, None, None, None))


def over(above: Mapping[str, Any], below: Mapping[str, Any]) -> Recipe:
    """``below`` with all that ``above`` says; tables are joined entry by entry."""
    joined = dict(below)
    for key, value in above.items():
        own = joined.get(key)
        joined[key] = over(value, own) if isinstance(value, Mapping) and isinstance(own, Mapping) else value
    return joined


#: The sections that say how methods go.
METHODS = tuple(section for section, _ in _core.settings())


def say(arguments: Mapping[str, Any], recipe: Mapping[str, Any]) -> Recipe:
    """``recipe`` with what the caller's arguments say above it, by the rule of the command line's flags: what is said
    of a method also silences what contradicts it."""
    settings = {name: arguments[name] for name in METHODS if name in arguments}
    below: Mapping[str, Any] = json.loads(_core.say(to_json(settings), to_json(recipe))) if settings else recipe
    return over({name: value for name, value in arguments.items() if name not in settings}, below)


def said(**entries: Any) -> Recipe:
    """The entries that say something."""
    return {name: value for name, value in entries.items() if value is not None}


def to_json(recipe: Mapping[str, Any]) -> str:
    """A recipe for the engine."""
    from ._data import _plain

    try:
        return json.dumps(recipe, default=_plain, allow_nan=False)
    except ValueError as error:
        raise ValueError(f"the recipe holds a number that is not finite: {error}") from error
