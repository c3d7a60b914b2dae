"""How barewire runs a vector, kind by kind. `RUNNERS` is the table of contents; `tests/test_vectors.py` uses it."""
