"""Recipes as dictionaries: read from TOML and merged."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from . import _core
from ._arrays import period_seconds
from .exceptions import RequestError

Recipe = dict[str, Any]


def of_toml(text: str, name: str = "the recipe") -> Recipe:
    """A recipe in TOML as a dictionary, its tables in their order."""
    content: Recipe = json.loads(_core.recipe_json(text, name)) if text.strip() else {}
    return content


def of_anything(recipe: str | os.PathLike[str] | Mapping[str, Any] | None) -> Recipe:
    """A TOML file, TOML text or a mapping as a dictionary."""
    return {} if recipe is None else of_toml(as_toml(recipe))


def as_toml(
    recipe: Any,
    clock: str | None = None,
    unit: str | None = None,
    dt: float | None = None,
    where: str | None = None,
) -> str:
    """A checked recipe as TOML, with separately given clock and condition."""
    if recipe is None:
        text, origin, is_json = "", "the recipe", False
    elif isinstance(recipe, Mapping):
        text, origin, is_json = json.dumps(recipe, default=plain), "recipe", True
    elif isinstance(recipe, str) and ("\n" in recipe or "=" in recipe or recipe.strip() == ""):
        text, origin, is_json = recipe, "the recipe", False
    elif isinstance(recipe, (str, os.PathLike)):
        path = Path(recipe)
        try:
            with open(path, encoding="utf-8") as file:
                text, origin, is_json = file.read(), str(path), False
        except OSError as error:
            raise RequestError(
                f"{path} cannot be read as a recipe: {error.strerror}; give a TOML file, TOML text or a dict"
            ) from error
    else:
        raise TypeError(f"recipe is a {type(recipe).__name__}; give a TOML file, TOML text or a dict")
    return _core.recipe(text, origin, is_json, clock, unit, None if dt is None else period_seconds(dt, "dt"), where)


def plain(value: Any) -> Any:
    """numpy numbers and arrays, and paths, as JSON values."""
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    raise TypeError(f"recipe: {value!r} is no text, number, list or table")


def over(above: Mapping[str, Any], below: Mapping[str, Any]) -> Recipe:
    """``below`` with all entries of ``above``; tables are merged entry by entry."""
    joined = dict(below)
    for key, value in above.items():
        under = joined.get(key)
        joined[key] = over(value, under) if isinstance(value, Mapping) and isinstance(under, Mapping) else value
    return joined


#: The sections that say how methods go.
METHODS = tuple(section for section, _ in _core.settings())


def override(arguments: Mapping[str, Any], recipe: Mapping[str, Any]) -> Recipe:
    """``recipe`` with the caller's arguments above it, as with flags of the command line: an argument also removes
    contradicting entries."""
    settings = {name: arguments[name] for name in METHODS if name in arguments}
    below: Mapping[str, Any] = json.loads(_core.override_settings(to_json(settings), to_json(recipe))) if settings else recipe
    return over({name: value for name, value in arguments.items() if name not in settings}, below)


def without_none(**entries: Any) -> Recipe:
    """The entries that are set."""
    return {name: value for name, value in entries.items() if value is not None}


def to_json(recipe: Mapping[str, Any]) -> str:
    """A recipe for the engine."""
    try:
        return json.dumps(recipe, default=plain, allow_nan=False)
    except ValueError as error:
        raise ValueError(f"the recipe holds a number that is not finite: {error}") from error
