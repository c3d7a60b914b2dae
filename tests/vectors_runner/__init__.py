"""The runners of the vectors, a function for each kind; `kinds.RUNNERS` lists them, `tests/test_vectors.py` uses it."""
