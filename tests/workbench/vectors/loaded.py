"""The vectors of this repository, read once for all tests."""

from __future__ import annotations

from barewire_workbench.vectors.files import load_vectors

VECTORS = load_vectors()
