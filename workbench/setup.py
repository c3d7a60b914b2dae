"""The build steps that pyproject.toml cannot describe: the vectors go into the distribution as one compressed file.

    ../vectors/cases/rtu/crc16.json, ...   ->   barewire_workbench/vectors/vectors.zip

The sdist has this file instead of the folder, and a wheel that is built from it copies it. In a source tree, and so in
an editable installation, `barewire vectors` reads the folder itself.
"""

from __future__ import annotations

import zipfile
from pathlib import Path

VECTORS = Path(__file__).parent.parent / "vectors"
PACKED = Path("barewire_workbench") / "vectors" / "vectors.zip"
NEEDED = ("VERSION", "kinds.json", "index.json", "profiles.json")
"""The files beside the folders of cases that `barewire vectors` reads."""
_EPOCH = (1980, 1, 1, 0, 0, 0)
"""The time of every file in the archive, so that the same vectors make the same bytes."""


def pack_vectors(folder: Path, target: Path) -> None:
    """Write the JSON files of the vectors into one archive."""
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for file in [*(folder / name for name in NEEDED), *sorted(folder.glob("cases/*/*.json"))]:
            name = zipfile.ZipInfo(file.relative_to(folder).as_posix(), _EPOCH)
            name.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(name, file.read_bytes())


if __name__ == "__main__":
    from setuptools import setup
    from setuptools.command.build_py import build_py
    from setuptools.command.sdist import sdist

    class BuildWithVectors(build_py):
        """Copies the modules, and packs the vectors beside them."""

        @property
        def _packed(self) -> list[Path]:
            return [] if self.editable_mode or not VECTORS.is_dir() else [Path(self.build_lib) / PACKED]

        def run(self) -> None:
            """Build the package. An editable installation has no packed vectors; an sdist has them already."""
            super().run()
            for target in self._packed:
                pack_vectors(VECTORS, target)

        def get_outputs(self, include_bytecode: bool = True) -> list[str]:
            """Return the built files."""
            return [*super().get_outputs(include_bytecode), *map(str, self._packed)]

    class SourcesWithVectors(sdist):
        """Collects the sources, and packs the vectors among them."""

        def make_release_tree(self, base_dir: str, files: list[str]) -> None:
            """Make the tree of the sdist."""
            super().make_release_tree(base_dir, files)
            if VECTORS.is_dir():
                pack_vectors(VECTORS, Path(base_dir) / "src" / PACKED)

    setup(cmdclass={"build_py": BuildWithVectors, "sdist": SourcesWithVectors})
