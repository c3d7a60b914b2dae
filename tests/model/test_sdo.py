"""SDO transfers in the model checker (`sdo`), and two clients on one channel (`sdo_two`)."""

from __future__ import annotations

import pytest

from barewire.canopen import Channel, SdoServer
from barewire.canopen.sdo.transfer import ClientTransfer
from tests.canopen.sdo.sdo_bus import RefusingServer
from tests.model.choices import run_all, run_random
from tests.model.sdo import DEFAULT_OPTIONS, Mode, SdoTally, Transfers, sdo_scenario
from tests.model.sdo_two import TwoClients, TwoTally, two_clients_scenario

pytestmark = pytest.mark.long


SETUPS = {
    "one transfer, two faults": Transfers(length=1, faults=2),
    "three expedited transfers, one fault": Transfers(length=3, modes=("expedited",)),
    "three transfers, plain or expedited": Transfers(length=3, modes=("plain", "expedited")),
    "three expedited transfers, one cancelled, one fault": Transfers(
        length=3, cancelled=(3,), modes=("expedited",), outcomes=("arrives", "is lost", "is late")
    ),
}
LARGE = {
    "two transfers, one fault": Transfers(),
    "two transfers, also plain": Transfers(modes=("plain", "segments", "blocks")),
    "two transfers, one cancelled, one fault": Transfers(cancelled=(5,), outcomes=("arrives", "is lost", "is late")),
    "three plain exchanges, two cancelled, one fault": Transfers(
        length=3, cancelled=(3, 5), modes=("plain",), outcomes=("arrives", "is lost", "is late")
    ),
    "three transfers, also plain, one cancelled, no fault": Transfers(
        length=3, cancelled=(3,), faults=0, modes=("plain", "segments", "blocks")
    ),
}
"""Of these `make test` plays some orders, `make proof` every one."""


@pytest.mark.parametrize("name", [*SETUPS, *(pytest.param(name, marks=pytest.mark.proof) for name in LARGE)])
def test_no_value_is_delivered_to_another_transfer_in_any_order_of_faults(name: str) -> None:
    tally = SdoTally()
    assert run_all(sdo_scenario((SETUPS | LARGE)[name], tally)) > 100
    check(tally)


@pytest.mark.parametrize("name", LARGE)
def test_nor_in_random_orders(name: str) -> None:
    tally = SdoTally()
    run_random(sdo_scenario(LARGE[name], tally), 200)
    check(tally)


def check(tally: SdoTally) -> None:
    """Check that no run had a wrong value or stood still, and that values and errors came."""
    assert not tally.wrong, tally.wrong[0]
    assert not tally.stuck, tally.stuck[0]
    assert min(tally.right, tally.errors) > 20


def test_the_public_client_with_default_options_delivers_no_value_to_another_transfer() -> None:
    tally = SdoTally()
    run_random(sdo_scenario(DEFAULT_OPTIONS, tally), 60)
    assert not tally.wrong, tally.wrong[0]
    assert not tally.stuck, tally.stuck[0]
    assert min(tally.right, tally.errors) > 500


@pytest.mark.parametrize(
    ("owner", "name", "value"),
    [
        (Channel, "timeout", property(lambda channel: 0.0, lambda channel, timeout: None)),
        (Channel, "be_quiet", lambda *arguments: None),
        (ClientTransfer, "stay_quiet", lambda transfer: None),
        (ClientTransfer, "in_blocks", property(lambda transfer: False, lambda transfer, in_blocks: None)),
    ],
    ids=[
        "the window is that of the call",
        "what is still to come is forgotten",
        "a time-out is forgotten",
        "segments of blocks are forgotten",
    ],
)
def test_the_checker_finds_a_channel_that_forgets_what_is_still_to_come(
    monkeypatch: pytest.MonkeyPatch, owner: type, name: str, value: object
) -> None:
    monkeypatch.setattr(owner, name, value)
    tally = SdoTally()
    run_random(sdo_scenario(DEFAULT_OPTIONS, tally), 30, until=lambda: tally.wrong)
    assert tally.wrong


def test_the_checker_finds_a_plain_exchange_on_a_channel_that_should_be_quiet(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Channel, "begin_plain", lambda channel: True)
    tally = SdoTally()
    setup = Transfers(length=3, cancelled=(3,), modes=("plain",), outcomes=("arrives", "is late"))
    run_all(sdo_scenario(setup, tally), until=lambda: tally.wrong)
    assert tally.wrong


def test_the_checker_finds_frames_that_are_late_by_more_than_the_channel_waits() -> None:
    tally = SdoTally()
    run_all(sdo_scenario(Transfers(modes=("expedited",), delays=(2.75,)), tally), until=lambda: tally.wrong)
    assert tally.wrong


def test_a_doubled_request_can_confirm_the_next_download_of_the_same_object_if_that_is_lost() -> None:
    """What SDO cannot exclude: its responses name the object, and not the request."""
    tally = SdoTally()
    setup = Transfers(verbs=("download",), modes=("expedited",), faults=2)
    run_all(sdo_scenario(setup, tally), until=lambda: tally.wrong)
    assert tally.wrong


@pytest.mark.parametrize(
    ("mode", "server"),
    [
        ("plain", SdoServer),
        ("expedited", SdoServer),
        ("expedited", RefusingServer),
        ("segments", RefusingServer),
        pytest.param("plain", RefusingServer, marks=pytest.mark.proof),
        pytest.param("segments", SdoServer, marks=pytest.mark.proof),
        pytest.param("blocks", SdoServer, marks=pytest.mark.proof),
        pytest.param("blocks", RefusingServer, marks=pytest.mark.proof),
    ],
)
def test_two_clients_on_one_channel_get_their_own_values_or_errors(server: type[SdoServer], mode: Mode) -> None:
    tally = TwoTally()
    assert run_all(two_clients_scenario(TwoClients(modes=(mode,), server=server), tally)) > 100
    assert not tally.wrong, tally.wrong[0]
    assert min(tally.right, tally.noticed) > 100


@pytest.mark.parametrize("server", [SdoServer, RefusingServer])
def test_two_clients_get_their_own_values_or_errors_in_random_orders(server: type[SdoServer]) -> None:
    tally = TwoTally()
    setup = TwoClients(transfers=4, modes=("plain", "expedited", "segments", "blocks"), server=server)
    run_random(two_clients_scenario(setup, tally), 400)
    assert not tally.wrong, tally.wrong[0]
    assert min(tally.right, tally.noticed) > 400


def test_clients_whose_ports_hide_the_requests_of_others_can_get_their_values() -> None:
    tally = TwoTally()
    run_all(two_clients_scenario(TwoClients(hears=False), tally))
    assert tally.wrong
    assert not tally.noticed
