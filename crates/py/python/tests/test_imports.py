"""Modules of the package import in one direction: no two of them need each other, whether an import stands at the head of
a module, within a function, or is for types alone.
"""

from __future__ import annotations

import ast
from pathlib import Path

import fleetfoot

#: Modules, and those that each imports, with the line of the first import.
Edges = dict[str, dict[str, int]]


def read(folder: Path) -> dict[str, str]:
    """The text of every module of a folder."""
    return {path.stem: path.read_text(encoding="utf-8") for path in sorted(folder.glob("*.py"))}


def edges(texts: dict[str, str], package: str) -> Edges:
    """Imports between the modules. An attribute of the package itself is its ``__init__``; compiled modules
    import nothing.
    """
    imports: Edges = {}
    for module, text in texts.items():
        arrows = imports.setdefault(module, {})
        for node in ast.walk(ast.parse(text)):
            for name in _imported(node, package):
                wanted = name if name in texts else "__init__"
                if name != "_core" and wanted != module:
                    arrows.setdefault(wanted, getattr(node, "lineno", 0))
    return imports


def _imported(node: ast.AST, package: str) -> list[str]:
    """Names of modules of the package that a statement imports."""
    if isinstance(node, ast.Import):
        parts = [alias.name.split(".") for alias in node.names]
        return [part[1] if len(part) > 1 else "__init__" for part in parts if part[0] == package]
    if not isinstance(node, ast.ImportFrom):
        return []
    path = (node.module or "").split(".") if node.module else []
    if not node.level:
        if path[:1] != [package]:
            return []
        path = path[1:]
    return [path[0]] if path else [alias.name for alias in node.names]


def circles(arrows: Edges) -> list[list[str]]:
    """Modules that reach each other: the strongly connected components of more than one module."""
    reached = {module: _reached(arrows, module) for module in arrows}
    components = {tuple(other for other in sorted(arrows) if other in seen and one in reached[other]) for one, seen in reached.items()}
    return sorted(list(circle) for circle in components if circle)


def _reached(arrows: Edges, start: str) -> set[str]:
    seen: set[str] = set()
    left = [start]
    while left:
        new = [other for other in arrows.get(left.pop(), {}) if other not in seen]
        seen.update(new)
        left += new
    return seen


def test_no_modules_import_each_other():
    texts = read(Path(fleetfoot.__file__).parent)
    assert len(texts) > 50, f"only {len(texts)} modules were found"
    arrows = edges(texts, "fleetfoot")
    messages = [
        f"{len(circle)} modules:\n"
        + "\n".join(f"    {one}.py:{line} imports {other}" for one in circle for other, line in arrows[one].items() if other in circle)
        for circle in circles(arrows)
    ]
    assert not messages, "\n".join(messages)


def test_imports_within_functions_count():
    texts = {
        "__init__": "from ._a import f\n",
        "_a": "import os\nfrom . import _core, _b\n",
        "_b": "def g():\n    from ._c import h\n",
        "_c": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from own._a import f\n",
        "_d": "import own\n",
    }
    arrows = edges(texts, "own")
    assert arrows == {"__init__": {"_a": 1}, "_a": {"_b": 2}, "_b": {"_c": 2}, "_c": {"_a": 3}, "_d": {"__init__": 1}}
    assert circles(arrows) == [["_a", "_b", "_c"]]
