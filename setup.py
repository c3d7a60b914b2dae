"""The build step that pyproject.toml cannot describe: the vectors go into the wheel as one compressed file.

    vectors/rtu/crc16.json, ...   ->   barewire/vectors/vectors.zip

In a source tree, and so in an editable installation, `barewire vectors` reads the folder itself.
"""

from __future__ import annotations

import zipfile
from pathlib import Path

HERE = Path(__file__).parent
NEEDED = ("VERSION", "kinds.json", "index.json")
"""The files beside the folders of cases that `barewire vectors` reads."""
_EPOCH = (1980, 1, 1, 0, 0, 0)
"""The time of every file in the archive, so that the same vectors make the same bytes."""


def pack_vectors(folder: Path, target: Path) -> None:
    """Write the JSON files of the vectors into one archive."""
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for file in [*(folder / name for name in NEEDED), *sorted(folder.glob("*/*.json"))]:
            if file.parent.name == "adapters":
                continue
            name = zipfile.ZipInfo(file.relative_to(folder).as_posix(), _EPOCH)
            name.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(name, file.read_bytes())


if __name__ == "__main__":
    from setuptools import setup
    from setuptools.command.build_py import build_py

    class BuildWithVectors(build_py):
        """Copies the modules, and packs the vectors beside them."""

        @property
        def _packed(self) -> Path:
            return Path(self.build_lib) / "barewire" / "vectors" / "vectors.zip"

        def run(self) -> None:
            """Build the package. An editable installation has no packed vectors."""
            super().run()
            if not self.editable_mode:
                pack_vectors(HERE / "vectors", self._packed)

        def get_outputs(self, include_bytecode: bool = True) -> list[str]:
            """Return the built files."""
            packed = [] if self.editable_mode else [str(self._packed)]
            return [*super().get_outputs(include_bytecode), *packed]

    setup(cmdclass={"build_py": BuildWithVectors})
