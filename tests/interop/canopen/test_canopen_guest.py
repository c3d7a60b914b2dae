"""The exchanges over SocketCAN: vcan0 of a User Mode Linux kernel (`guest`); one guest runs all of them.

Each exchange is a test here with its result in the guest. candump records every exchange and must have received the
frames of our side; cansend sends requests to our device; a simulated drive runs in a second process.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from xml.etree import ElementTree

import pytest

from tests.interop.canopen.canopen_exchanges import EXCHANGES, Exchange
from tests.interop.canopen.guest import Done, in_guest
from tests.interop.canopen.test_canopen_exchanges import proofs
from tests.workbench.vendor.made import written

pytestmark = [
    pytest.mark.needs("uml", "busybox", "cc", "candump", "ip"),
    pytest.mark.proof,  # half a minute of a kernel
]
TESTS = "tests/interop/canopen/test_canopen_exchanges.py"


PROGRAMS = "link_down", "kernel_cycles", "one_file"
"""Programs for the guest kernel, which run behind the tests."""


@pytest.fixture(scope="module")
def programs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Done]:
    """Run the tests and then the programs in one guest."""
    folder = tmp_path_factory.mktemp("one_file")
    written(folder, "sdo-client")
    tests = f"{sys.executable} -m pytest -q -p no:cacheprovider --junitxml=/run/job/report.xml {TESTS}"
    lines = [f"{sys.executable} -m tests.interop.canopen.{name}; echo {name} ended with $?" for name in PROGRAMS]
    environment = {"BAREWIRE_CARRIERS": "socketcan", "BAREWIRE_ONE_FILE": str(folder)}
    environment["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"  # a guest takes long to import them
    with in_guest(["sh", "-c", "; ".join([tests, *lines])], environment) as done:
        yield done


@pytest.fixture(scope="module")
def results(programs: Done) -> dict[str, str]:
    """Return the result of each test in the guest: an empty text if it passed, its failure otherwise."""
    report = programs.job / "report.xml"
    assert report.exists(), f"no report came out of the guest: {programs}"
    cases = ElementTree.parse(report).iter("testcase")
    return {case.get("name", ""): "\n".join(part.text or part.tag for part in case) for case in cases}


@pytest.mark.parametrize(
    "exchange",
    [
        pytest.param(exchange, marks=proofs(exchange, "socketcan"), id=exchange.name)
        for exchange in EXCHANGES
        if exchange.goes_over("socketcan")
    ],
)
def test_exchange_over_vcan0(results: dict[str, str], exchange: Exchange) -> None:
    name = f"test_exchange[socketcan-{exchange.name}]"
    assert name in results, f"the guest ran {', '.join(results) or 'nothing'}"
    assert not results[name], results[name]


def test_the_guest_ran_no_other_exchange(results: dict[str, str]) -> None:
    assert len(results) == sum(exchange.goes_over("socketcan") for exchange in EXCHANGES)


def test_a_guest_that_takes_too_long_is_ended() -> None:
    with in_guest(["sleep", "60"], {}, timeout=1.0) as done:
        assert done.status is None
        assert "the guest was not done after 1 s" in done.console
        until = time.monotonic() + 5
        while f"init={done.job}" in _running():  # a killed process takes a moment to end
            assert time.monotonic() < until
            time.sleep(0.01)
    assert not done.job.exists()


def _running() -> str:
    """Return the command lines of all processes."""
    found = []
    for file in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):
            found.append(file.read_text(errors="replace"))
    return "\n".join(found)


def test_client_and_device_recover_when_the_link_goes_down_and_up(programs: Done) -> None:
    assert "link_down ended with 0" in programs.out, str(programs)
    assert programs.out.count("gone and back: ") == 2, str(programs)


def test_the_kernel_sends_cyclic_frames(programs: Done) -> None:
    """Also while the program is stopped, and after the interface was down, but not after the end of the program."""
    assert "kernel_cycles ended with 0" in programs.out, str(programs)
    for part in ("check_data", "check_stopped", "check_down"):
        assert f"{part}: ok" in programs.out, str(programs)


def test_the_sdo_client_that_is_one_file(programs: Done) -> None:
    assert "one_file ended with 0" in programs.out, str(programs)
    assert "value -1500\nbytes 4\n" in programs.out, str(programs)
    assert "abort 0x6020000\nvcan7: no such device\n" in programs.out, str(programs)
