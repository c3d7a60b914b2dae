"""The vectors as one file in the wheel: the same cases as in the folder."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

from barewire.errors import EncodeError
from barewire_workbench.vectors import files
from barewire_workbench.vectors.files import load_vectors

ROOT = Path(__file__).parents[3]


@pytest.fixture
def setup() -> ModuleType:
    """The build step, workbench/setup.py."""
    spec = importlib.util.spec_from_file_location("barewire_setup", ROOT / "workbench" / "setup.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_an_installed_package_has_the_same_vectors(
    setup: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    setup.pack_vectors(ROOT / "vectors", tmp_path / "vectors.zip")
    folder = load_vectors(ROOT / "vectors")
    monkeypatch.setattr(files, "package_files", lambda package: tmp_path)
    assert load_vectors() == folder
    assert len(folder.files) > 60


def test_the_packed_vectors_are_the_same_bytes_every_time(setup: ModuleType, tmp_path: Path) -> None:
    for name in ("one", "two"):
        setup.pack_vectors(ROOT / "vectors", tmp_path / name)
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()


def test_a_package_without_vectors_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "package_files", lambda package: tmp_path)
    monkeypatch.setattr(files, "__file__", str(tmp_path / "a" / "b" / "c" / "d" / "files.py"))
    with pytest.raises(EncodeError, match="no vectors there"):
        load_vectors()


def test_damaged_vectors_in_a_package_say_so(
    setup: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    packed = tmp_path / "vectors.zip"
    setup.pack_vectors(ROOT / "vectors", packed)
    whole = packed.read_bytes()
    monkeypatch.setattr(files, "package_files", lambda package: tmp_path)
    for at in (len(whole) - 4000, len(whole) // 2, 1000):  # the list of its files, and two of the files
        packed.write_bytes(whole[:at] + bytes([whole[at] ^ 0x55]) + whole[at + 1 :])
        with pytest.raises(EncodeError, match=r"damaged|not JSON|no vectors there"):
            load_vectors()
    packed.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(EncodeError, match="damaged"):
        load_vectors()
