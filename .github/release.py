"""Files of a release: checks before it, archives of the command, notes from the changelog, the conda recipe.

    python .github/release.py check [--tag v0.2.0 --repository URL]
    python .github/release.py archive TARGET --binary target/release/fleetfoot --out dist
    python .github/release.py notes > notes.md
    python .github/release.py recipe --source TARBALL --repository URL --out dist/recipe.yaml
"""

from __future__ import annotations

import argparse
import functools
import gzip
import hashlib
import json
import re
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SHELLS = {"bash": "fleetfoot.bash", "zsh": "_fleetfoot", "fish": "fleetfoot.fish", "powershell": "_fleetfoot.ps1"}
LICENCES = ("LICENSE-MIT", "LICENSE-APACHE")


class Fault(Exception):
    """A reason not to release, with the remedy."""


@functools.cache
def metadata(*arguments: str) -> dict:
    """The packages of the workspace as Cargo reads them; with `--no-deps` without those of others."""
    command = ["cargo", "metadata", "--format-version", "1", "--locked", *arguments]
    return json.loads(subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE).stdout)


def package(name: str) -> dict:
    return next(one for one in metadata("--no-deps")["packages"] if one["name"] == name)


def version() -> str:
    return package("fleetfoot-cli")["version"]


def section(text: str, heading: str) -> str | None:
    """The lines below `## HEADING` of a changelog, without the heading; a date may follow the heading."""
    match = re.search(rf"^## {re.escape(heading)}(?: [^\n]*)?\n(.*?)(?=^## |\Z)", text, re.MULTILINE | re.DOTALL)
    return match and match[1].strip() + "\n"


def file_version(name: str) -> str:
    """The version that a file repeats."""
    match = re.search(r'^ *version: "?([0-9][^"\s]*)"?$', (ROOT / name).read_text(encoding="utf-8"), re.MULTILINE)
    if not match:
        raise Fault(f"{name}: no line `version: ...`")
    return match[1]


def targets() -> list[str]:
    """Targets that the workflow builds archives for."""
    jobs = (ROOT / ".github/workflows/release.yml").read_text(encoding="utf-8").split("\n  archives:\n")[1]
    return re.findall(r"target: ([a-z0-9_-]+)$", jobs.split("\n    steps:\n")[0], re.MULTILINE)


def stem(target: str) -> str:
    return f"fleetfoot-{version()}-{target}"


def archive_name(target: str) -> str:
    return stem(target) + (".zip" if "windows" in target else ".tar.gz")


def binary_name(target: str) -> str:
    return "fleetfoot.exe" if "windows" in target else "fleetfoot"


def binstall(target: str, repository: str) -> tuple[str, str]:
    """The address and the binary inside the archive that `cargo binstall` expects for a target."""
    manifest = package("fleetfoot-cli")
    table = manifest["metadata"]["binstall"]
    table = {**table, **table.get("overrides", {}).get(target, {})}
    values = {
        "repo": repository,
        "version": manifest["version"],
        "target": target,
        "bin": "fleetfoot",
        "binary-ext": ".exe" if "windows" in target else "",
    }
    address, binary = (re.sub(r"\{ ([a-z-]+) \}", lambda name: values[name[1]], table[key]) for key in ("pkg-url", "bin-dir"))
    return address, binary


def numbers(text: str) -> tuple[int, ...]:
    parts = [int(part) for part in text.split(".")]
    return tuple(parts + [0] * (3 - len(parts)))


def newer_compilers() -> list[str]:
    """Crates that need a newer compiler than `rust-version` of the workspace."""
    packages = metadata("--all-features")["packages"]
    minimum = next(one["rust_version"] for one in packages if one["name"] == "fleetfoot-cli")
    newer = [one for one in packages if one["rust_version"] and numbers(one["rust_version"]) > numbers(minimum)]
    return [
        f"{one['name']} {one['version']} needs Rust {one['rust_version']}, and Cargo.toml says {minimum}: "
        f'write `rust-version = "{one["rust_version"]}"` or take another version of the crate'
        for one in newer
    ]


def faults(tag: str | None, repository: str | None) -> list[str]:
    """Everything that keeps the checkout from being released; without a tag: that keeps it from being consistent."""
    current = version()
    problems = newer_compilers()
    for name in ("CITATION.cff", "conda/recipe.yaml"):
        if file_version(name) != current:
            problems.append(f"{name}: version {file_version(name)}, and Cargo.toml says {current}: write {current}")
    for name in LICENCES:
        if (ROOT / name).read_bytes() != (ROOT / "crates/py" / name).read_bytes():
            problems.append(f"crates/py/{name} differs from {name}: copy it anew")
    address = repository or "https://example.org/fleetfoot"
    for target in targets():
        expected = f"{address}/releases/download/v{current}/{archive_name(target)}", f"{stem(target)}/{binary_name(target)}"
        if binstall(target, address) != expected:
            problems.append(f"crates/cli/Cargo.toml: binstall looks for {binstall(target, address)}, the release has {expected}")
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    if tag is None:
        if section(changelog, "Unreleased") is None and section(changelog, current) is None:
            problems.append(f"CHANGELOG.md: no section `## Unreleased` or `## {current}`")
        return problems
    if tag != f"v{current}":
        problems.append(f"the tag is {tag}, and Cargo.toml says {current}: tag v{current} or write the version into Cargo.toml")
    if not (section(changelog, current) or "").strip():
        problems.append(f"CHANGELOG.md: no section `## {current}`: rename `## Unreleased`")
    if package("fleetfoot-cli")["repository"] != repository:
        said = package("fleetfoot-cli")["repository"]
        problems.append(f"crates/cli/Cargo.toml: repository is {said}: write `repository = \"{repository}\"` below [package]")
    return problems


def files_of_archive(binary: Path, target: str, folder: Path) -> None:
    """Writes the folder that becomes the archive: the command, its completions and manual pages, licences."""
    (folder / "completions").mkdir(parents=True)
    (folder / binary_name(target)).write_bytes(binary.read_bytes())
    (folder / binary_name(target)).chmod(0o755)
    for shell, name in SHELLS.items():
        said = subprocess.run([binary, "completions", shell], check=True, stdout=subprocess.PIPE).stdout
        (folder / "completions" / name).write_bytes(said)
    subprocess.run([binary, "man", "--output", folder / "man"], check=True, stdout=subprocess.DEVNULL)
    for name in (*LICENCES, "README.md", "CHANGELOG.md"):
        (folder / name).write_bytes((ROOT / name).read_bytes())


def pack(folder: Path, out: Path) -> None:
    """Packs a folder below its name: the same bytes for the same files, whoever packs and whenever."""
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    names = [path.relative_to(folder.parent).as_posix() for path in paths]
    if out.suffix == ".zip":
        with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
            for path, name in zip(paths, names):
                archive.writestr(zipfile.ZipInfo(name), path.read_bytes(), zipfile.ZIP_DEFLATED)
        return
    with out.open("wb") as raw, gzip.GzipFile("", "wb", 9, raw, mtime=0) as packed, tarfile.open(fileobj=packed, mode="w") as archive:
        for path, name in zip(paths, names):
            entry = tarfile.TarInfo(name)
            entry.size = path.stat().st_size
            entry.mode = 0o755 if path.stat().st_mode & 0o100 else 0o644
            with path.open("rb") as content:
                archive.addfile(entry, content)


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def archive(target: str, binary: Path, out: Path) -> Path:
    """Packs the command for a target, with its SHA-256 sum in the form of `sha256sum` beside it."""
    out.mkdir(parents=True, exist_ok=True)
    packed = out / archive_name(target)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / stem(target)
        files_of_archive(binary.resolve(), target, folder)
        pack(folder, packed)
    packed.with_name(packed.name + ".sha256").write_text(f"{digest(packed)}  {packed.name}\n", encoding="utf-8", newline="\n")
    return packed


def notes() -> str:
    text = section((ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), version())
    if not text:
        raise Fault(f"CHANGELOG.md: no section `## {version()}`: rename `## Unreleased`")
    return text


def recipe(source: Path, repository: str) -> str:
    """The conda recipe with the release's source tarball in place of the checkout."""
    text = (ROOT / "conda/recipe.yaml").read_text(encoding="utf-8")
    here = "source:\n  path: ..\n"
    if here not in text:
        raise Fault("conda/recipe.yaml: no `source:` with `path: ..`")
    address = f"{repository}/releases/download/v{version()}/{source.name}"
    there = f"source:\n  url: {address}\n  sha256: {digest(source)}\n"
    return text.replace(here, there).replace("about:\n", f"about:\n  homepage: {repository}\n")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    one = commands.add_parser("check")
    one.add_argument("--tag")
    one.add_argument("--repository")
    one = commands.add_parser("archive")
    one.add_argument("target")
    one.add_argument("--binary", type=Path, required=True)
    one.add_argument("--out", type=Path, required=True)
    commands.add_parser("notes")
    one = commands.add_parser("recipe")
    one.add_argument("--source", type=Path, required=True)
    one.add_argument("--repository", required=True)
    one.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    if given.command == "check":
        if wrong := faults(given.tag, given.repository):
            raise Fault("\n".join(wrong))
        print(f"version {version()}: the files agree")
    elif given.command == "archive":
        print(archive(given.target, given.binary, given.out))
    elif given.command == "notes":
        sys.stdout.write(notes())
    else:
        given.out.write_text(recipe(given.source, given.repository), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    try:
        main()
    except Fault as fault:
        sys.exit(f"error: {fault}")
