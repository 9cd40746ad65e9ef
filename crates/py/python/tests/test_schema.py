"""The JSON schema of recipes, by an independent validator: it takes each recipe that the parser takes, and refuses its unknown keys."""

from __future__ import annotations

import ast
import copy
import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from command import run

from fleetfoot import _core, exceptions

jsonschema = pytest.importorskip("jsonschema")
if sys.version_info >= (3, 11):
    import tomllib
else:
    tomllib = pytest.importorskip("tomli")

ROOT = Path(__file__).parents[4]
BLOCK = re.compile(r"^( *)```toml\n(.*?)^ *```$", re.MULTILINE | re.DOTALL)
#: Texts of Rust: plain ones with escapes, raw ones.
TEXT = re.compile(r'r#"(.*?)"#|(?<![\w\'])"((?:[^"\\]|\\.)*)"', re.DOTALL)


@pytest.fixture(scope="module")
def validator() -> Any:
    schema = json.loads(run("schema").stdout)
    jsonschema.Draft7Validator.check_schema(schema)
    return jsonschema.Draft7Validator(schema)


def refusal(recipe: dict[str, Any] | str) -> str | None:
    """The parser's message for a recipe, in TOML or as a tree; None if it takes the recipe."""
    try:
        _core.recipe(recipe if isinstance(recipe, str) else json.dumps(recipe), is_json=not isinstance(recipe, str))
    except exceptions.FleetfootError as error:
        return str(error)
    return None


def on_pages() -> Iterator[str]:
    """Recipes of the pages."""
    for page in [ROOT / "README.md", ROOT / "SKILL.md", *sorted((ROOT / "docs").rglob("*.md"))]:
        for block in BLOCK.finditer(page.read_text(encoding="utf-8")):
            yield "\n".join(line.removeprefix(block[1]) for line in block[2].splitlines())


def in_tests() -> Iterator[str]:
    """Texts of Rust's tests that may be recipes."""
    sources = [*(ROOT / "tests").rglob("*.rs"), *(ROOT / "crates").glob("*/tests/**/*.rs"), *(ROOT / "crates" / "recipe").rglob("*.rs")]
    for source in sorted(sources):
        for text in TEXT.finditer(source.read_text(encoding="utf-8")):
            raw, plain = text.groups()
            if plain is not None:
                joined = re.sub(r"\\\n\s*", "", plain).replace("\n", "\\n")
                try:
                    raw = ast.literal_eval(f'"{joined}"')
                except (SyntaxError, ValueError):
                    continue
            if re.match(r"\s*\[\[?\w+[\].]", raw) and " = " in raw:
                yield raw


def tree(text: str) -> dict[str, Any] | None:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return None


def test_recipes_of_pages_are_valid(validator):
    texts = list(on_pages())
    assert len(texts) > 30
    for text in texts:
        assert refusal(text) is None, text
        validator.validate(tomllib.loads(text))


def test_schema_takes_what_the_parser_takes(validator):
    taken = refused = 0
    for text in in_tests():
        recipe = tree(text)
        if recipe is None:
            continue
        message = refusal(text)
        if message is None:
            taken += 1
            errors = [error.message for error in validator.iter_errors(recipe)]
            assert not errors, f"{text}\n{errors}"
        elif "unknown field" in message or "unknown variant" in message:
            refused += 1
            assert not validator.is_valid(recipe), f"{text}\n{message}"
    assert taken > 100 and refused > 5, (taken, refused)


def test_drafted_recipes_are_valid(validator, tmp_path):
    robots = _core.robots()
    assert len(robots) >= 5
    for robot in robots:
        run("generate", robot, "--seconds", "2", "--runs", "1", "-o", robot, folder=tmp_path)
        logs = sorted(path.name for path in (tmp_path / robot).glob(f"{robot}_*"))
        run("init", f"{robot}/{logs[0]}", "-o", f"{robot}/draft.toml", folder=tmp_path)
        for name in ("robot.toml", "draft.toml"):
            validator.validate(tomllib.loads((tmp_path / robot / name).read_text(encoding="utf-8")))


def tables(node: Any) -> Iterator[dict[str, Any]]:
    """All tables of a tree, itself included."""
    if isinstance(node, dict):
        yield node
    for child in node.values() if isinstance(node, dict) else node if isinstance(node, list) else ():
        yield from tables(child)


def test_changed_keys_are_judged_alike(validator):
    """An unknown key in any table of any recipe, and any key misspelt: parser and schema agree."""
    judged = {True: 0, False: 0}
    for text in on_pages():
        recipe = tomllib.loads(text)
        for at, table in enumerate(tables(recipe)):
            for key in [None, *table]:
                changed = copy.deepcopy(recipe)
                place = list(tables(changed))[at]
                place[f"{key or 'unknown'}_"] = 0.5 if key is None else place.pop(key)
                is_taken = refusal(changed) is None
                judged[is_taken] += 1
                assert validator.is_valid(changed) == is_taken, (changed, refusal(changed))
    assert min(judged.values()) > 50, judged


def test_words_of_enumerations_are_those_of_the_parser(validator):
    """Every word of the schema is read; a word beside them is refused by both."""
    schema = validator.schema
    seen = 0
    for section, entry, words in enumerations(schema):
        for word in words:
            assert refusal({section: {entry: word}}) is None, (section, entry, word)
            seen += 1
        wrong = {section: {entry: "no-such-word"}}
        assert refusal(wrong) is not None and not validator.is_valid(wrong), (section, entry)
    assert seen > 50


def enumerations(schema: dict[str, Any]) -> Iterator[tuple[str, str, list[str]]]:
    """Entries of the sections whose values are words alone."""
    for section, part in schema["properties"].items():
        for entry, value in resolved(schema, part).get("properties", {}).items():
            words = words_of(schema, value)
            if words:
                yield section, entry, words


def resolved(schema: dict[str, Any], node: dict[str, Any]) -> dict[str, Any]:
    """A node behind its references."""
    if "allOf" in node and len(node["allOf"]) == 1:
        return resolved(schema, node["allOf"][0])
    if "$ref" in node:
        return resolved(schema, schema["definitions"][node["$ref"].rsplit("/", 1)[1]])
    return node


def words_of(schema: dict[str, Any], node: dict[str, Any]) -> list[str]:
    """Words of an enumeration; none if it takes other values."""
    node = resolved(schema, node)
    if "const" in node:
        return [node["const"]]
    if "enum" in node:
        return list(node["enum"])
    choices = [words_of(schema, choice) for choice in node.get("oneOf", node.get("anyOf", []))]
    return [word for choice in choices for word in choice] if choices and all(choices) else []


def test_descriptions_are_for_users(validator):
    described = 0
    for table in tables(validator.schema):
        text = table.get("description")
        if isinstance(text, str):
            described += 1
            assert "[`" not in text and "::" not in text, text
    assert described > 200
    for section, part in validator.schema["properties"].items():
        assert part.get("description"), section


def test_schema_is_written_beside_recipes(tmp_path):
    done = run("schema", "-o", "recipe.schema.json", folder=tmp_path)
    assert done.stdout == "wrote recipe.schema.json\n" and "#:schema ./recipe.schema.json" in done.stderr
    assert (tmp_path / "recipe.schema.json").read_text(encoding="utf-8") == run("schema").stdout == run("schema", "--json").stdout
    assert "replaces it" in run("schema", "-o", "recipe.schema.json", folder=tmp_path).stderr
    (tmp_path / "robot.toml").write_text("[states]\nq = {}\n", encoding="utf-8")
    assert "robot.toml" in run("schema", "-o", "robot.toml", folder=tmp_path, code=1).stderr
    assert (tmp_path / "robot.toml").read_text(encoding="utf-8") == "[states]\nq = {}\n"
