"""Checks a built site: no link within it is broken, no page loads anything from elsewhere, llms.txt lists every page.

    python docs/check_site.py target/site
"""

from __future__ import annotations

import re
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

#: What a page loads by itself.
LOADED = {("script", "src"), ("img", "src"), ("source", "srcset"), ("iframe", "src"), ("video", "src")}


class Page(HTMLParser):
    """Links, loaded files and anchors of a page."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.anchors: set[str] = set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attributes}
        self.anchors.update(given[name] for name in ("id", "name") if name in given)
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        loads = tag == "link" and given.get("rel") in ("stylesheet", "preload", "icon", "modulepreload")
        self.loaded += [given["href"]] if loads else [given[name] for element, name in LOADED if element == tag and name in given]


#: Pages that another listed page stands for: those of Sphinx, and those in the list of their own index.
UNLISTED = re.compile(r"(genindex|search|py-modindex|decisions/\d.*|gallery/plot_.*|rust/.*|_.*)")


def unlisted(text: str, pages: set[str]) -> list[str]:
    """Pages that `llms.txt` lists and the site lacks, and pages of the site that it does not list with a sentence."""
    entries = re.findall(r"^- \[[^\]]+\]\(([^)]+)\): \S", text, re.MULTILINE)
    messages = [f"llms.txt: {page}: there is no such page" for page in entries if page not in pages]
    messages += [f"llms.txt: {page} is listed twice" for page in sorted(set(entries)) if entries.count(page) > 1]
    wanted = {page for page in pages if not UNLISTED.fullmatch(page.removesuffix(".html"))}
    missing = sorted(wanted - set(entries))
    return messages + [f"llms.txt: {page} is missing: add `- [TITLE]({page}): A SENTENCE.` to docs/llms.txt" for page in missing]


def problems(root: Path) -> list[str]:
    # Rust's documentation is rustdoc's own, and the theme keeps its templates beside its files.
    paths = [path.resolve() for path in root.rglob("*.html") if not {"rust", "_static"} & set(path.relative_to(root).parts)]
    pages = {path: Page(path) for path in paths}
    messages = []
    for path, page in pages.items():
        place = path.relative_to(root.resolve())
        messages += [f"{place} loads {url}" for url in page.loaded if urlsplit(url).scheme in ("http", "https")]
        for link in page.links + page.loaded:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc or link.startswith("#!"):
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if "rust" in target.relative_to(root.resolve()).parts[:1] and not (root / "rust").is_dir():
                continue
            if not target.exists():
                messages.append(f"{place}: {link}: there is no such file")
            elif parts.fragment and target in pages and unquote(parts.fragment) not in pages[target].anchors:
                messages.append(f"{place}: {link}: there is no such place in the page")
    names = {path.relative_to(root).as_posix() for path in root.rglob("*.html")}
    messages += unlisted((root / "llms.txt").read_text(encoding="utf-8"), names)
    for style in root.rglob("*.css"):
        if "rust" not in style.relative_to(root).parts:
            urls = re.findall(r"url\(\s*[\"']?(https?://[^)\"']+)", style.read_text(encoding="utf-8"))
            messages += [f"{style.relative_to(root)} loads {url}" for url in urls]
    return messages


if __name__ == "__main__":
    wrong = problems(Path(sys.argv[1]))
    print("\n".join(wrong) or "no link is broken, nothing is loaded from elsewhere, and llms.txt lists every page")
    sys.exit(bool(wrong))
