"""Fixtures of tests on real ports: those of `tests/io`."""

from tests.io.conftest import certificates as certificates, log as log, patient as patient
