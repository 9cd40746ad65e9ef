"""The Python that the README and the pages of docs/ show is run, page by page, in a folder of its own.

Blocks with prompts are doctests; other blocks are run as they stand. Those of a page share their names. A comment ``<!-- needs: pysindy -->`` above a block
names a package or a recording that is not the project's; without it
the block is left out.
"""

from __future__ import annotations

import doctest
import importlib.util
import os
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[4]
#: Said by those who installed all of requirements-test.txt (`make test-python`).
INSTALLED = os.environ.get("FLEETFOOT_PEERS") == "installed"
BLOCK = re.compile(r"((?:^ *<!--[^\n]*-->\n)*)^( *)```python\n(.*?)^ *```$", re.MULTILINE | re.DOTALL)
NEEDS = re.compile(r"<!-- needs: (\S+) -->")


def pages() -> list[Path]:
    shown = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    return [page for page in shown if BLOCK.search(page.read_text())]


def there_is(name: str, folder: Path) -> bool:
    """True if a package, or a recording, is there; a recording is then linked into the folder. Packages of the tests' requirements must be there with them."""
    if "." not in name:
        present = importlib.util.find_spec(name) is not None
        assert present or not INSTALLED, f"{name} is absent, but the peers were installed (FLEETFOOT_PEERS)"
        return present
    recordings = Path(os.environ.get("FLEETFOOT_DATA") or ROOT.parent / "shared" / "data")
    if recordings.is_dir() and not (folder / name).exists():
        (folder / name).symlink_to(recordings / name)
    return recordings.is_dir()


def run(text: str, place: str, line: int, names: dict[str, object]) -> None:
    if ">>> " not in text:
        exec(compile("\n" * line + text, place, "exec"), names)
        return
    test = doctest.DocTestParser().get_doctest(text, names, place, place, line)
    output: list[str] = []
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    runner.run(test, out=output.append, clear_globs=False)
    names.update(test.globs)
    assert not output, "".join(output)


def test_wrong_output_of_pages_fails():
    assert {"README.md", "tutorial.md"} <= {page.name for page in pages()}
    with pytest.raises(AssertionError, match="Got"):
        run(">>> 1 + 1\n3\n", "page", 1, {})


@pytest.mark.filterwarnings("ignore::fleetfoot.FleetfootWarning")
@pytest.mark.parametrize("page", pages(), ids=lambda page: str(page.relative_to(ROOT)))
def test_page(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    names: dict[str, object] = {"__name__": "__main__"}
    text = page.read_text()
    for match in BLOCK.finditer(text):
        above, indentation, block = match.groups()
        if not all(there_is(name, tmp_path) for name in NEEDS.findall(above)):
            continue
        code = "".join(line.removeprefix(indentation) for line in block.splitlines(keepends=True))
        run(code, str(page), text[: match.start(3)].count("\n"), names)
