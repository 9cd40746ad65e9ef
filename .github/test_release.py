"""Tests of release.py: `make workflows` runs them in the environment of `.github/requirements.txt`."""

from __future__ import annotations

import hashlib
import os
import tarfile
import tempfile
import unittest
import zipfile
from pathlib import Path

import rattler_build
import release

#: A command that prints its arguments for completions, and writes one manual page.
COMMAND = """#!/bin/sh
if [ "$1" = man ]; then mkdir -p "$3" && echo page > "$3/fleetfoot.1"; else echo "$@"; fi
"""
CHANGELOG = "# Changelog\n\nText.\n\n## Unreleased\n\n- new\n\n## 0.2.0 (2026-12-01)\n\n### Added\n\n- old\n\n## 0.1.0\n\n- first\n"


def rendered(text: str, platform: str) -> dict:
    """A recipe as rattler-build understands it for a platform; a mistake in it is an exception."""
    place = rattler_build.PlatformConfig(target_platform=platform, build_platform=platform, host_platform=platform)
    library = rattler_build.VariantConfig.from_yaml("c_stdlib: [sysroot]")
    (variant,) = rattler_build.Stage0Recipe.from_yaml(text).render(library, rattler_build.RenderConfig(platform=place))
    return variant.recipe.to_dict()


class Release(unittest.TestCase):
    def setUp(self) -> None:
        self.place = tempfile.TemporaryDirectory()
        self.addCleanup(self.place.cleanup)
        self.folder = Path(self.place.name)
        self.binary = self.folder / "fleetfoot"
        self.binary.write_text(COMMAND)
        self.binary.chmod(0o755)

    def test_files_agree(self) -> None:
        self.assertEqual(release.faults(None, None), [])

    def test_wrong_tags_and_repositories_are_faults(self) -> None:
        messages = "\n".join(release.faults("v9.9.9", "https://example.org/other"))
        self.assertIn(f"tag v{release.version()}", messages)
        self.assertIn('write `repository = "https://example.org/other"`', messages)

    def test_sections_of_the_changelog(self) -> None:
        self.assertEqual(release.section(CHANGELOG, "0.2.0"), "### Added\n\n- old\n")
        self.assertEqual(release.section(CHANGELOG, "0.1.0"), "- first\n")
        self.assertIsNone(release.section(CHANGELOG, "0.2"))

    def test_versions_of_compilers_compare_as_numbers(self) -> None:
        self.assertGreater(release.numbers("1.100"), release.numbers("1.95.1"))
        self.assertEqual(release.numbers("1.95"), release.numbers("1.95.0"))

    def test_five_targets_are_built(self) -> None:
        self.assertEqual(len(release.targets()), 5)
        self.assertIn("aarch64-unknown-linux-gnu", release.targets())

    def test_binstall_finds_the_binary_in_every_archive(self) -> None:
        for target in release.targets():
            out = self.folder / "dist"
            packed = release.archive(target, self.binary, out)
            address, binary = release.binstall(target, "https://example.org/x")
            self.assertEqual(address.rsplit("/", 1)[1], packed.name)
            if packed.suffix == ".zip":
                names = zipfile.ZipFile(packed).namelist()
            else:
                with tarfile.open(packed) as content:
                    names = content.getnames()
                    self.assertTrue(content.getmember(binary).mode & 0o100, "the command can be executed")
            self.assertIn(binary, names)
            top = binary.split("/")[0]
            for name in ("completions/_fleetfoot", "man/fleetfoot.1", "LICENSE-MIT", "LICENSE-APACHE", "README.md"):
                self.assertIn(f"{top}/{name}", names)
            digest = hashlib.sha256(packed.read_bytes()).hexdigest()
            self.assertEqual((out / f"{packed.name}.sha256").read_text(), f"{digest}  {packed.name}\n")

    def test_archives_have_the_same_bytes_whenever_they_are_packed(self) -> None:
        for target in ("x86_64-unknown-linux-gnu", "x86_64-pc-windows-msvc"):
            first = release.archive(target, self.binary, self.folder / "first").read_bytes()
            os.utime(self.binary, (0, 0))
            self.assertEqual(first, release.archive(target, self.binary, self.folder / "second").read_bytes())

    def test_the_recipe_names_the_source_of_the_release(self) -> None:
        source = self.folder / "fleetfoot-source.tar.gz"
        source.write_bytes(b"source")
        text = release.recipe(source, "https://example.org/x")
        self.assertIn(f"url: https://example.org/x/releases/download/v{release.version()}/fleetfoot-source.tar.gz\n", text)
        self.assertIn(f"sha256: {release.digest(source)}\n", text)
        self.assertIn("homepage: https://example.org/x\n", text)
        self.assertNotIn("path: ..", text)
        for wanted in (text, (release.ROOT / "conda/recipe.yaml").read_text(encoding="utf-8")):
            for platform in ("linux-64", "linux-aarch64", "osx-arm64", "win-64"):
                self.assertEqual(rendered(wanted, platform)["package"]["version"], release.version())


if __name__ == "__main__":
    unittest.main()
