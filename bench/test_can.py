"""Clients on a CAN bus beside a neutral responder: expedited reads, a mebibyte in blocks, single frames.

`make bench` runs the races on socket pairs and on python-can's virtual bus. The races on vcan need a kernel with
SocketCAN: as root on any Linux that has it, else in the guest kernel of the interop tests:

    python -m bench.can_guest
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack

import pytest

from bench import can_clients as clients
from bench.can_clients import Make
from bench.can_places import PLACES
from bench.can_responder import EXPEDITED, VALUE
from bench.race import Factory, Race, Work, entries

FAMILY = "CAN bus"
SOCKETS = ("a socket pair", "vcan")
MANY = 200  # fewer than the receive buffer of a raw CAN socket holds
LISTENED, PAUSE = 50, 500  # frames, and microseconds after each: 2,000 frames a second


def race(what: str, size: int, place: str, makers: Mapping[str, Make], expect: bytes | None, **options: float) -> Race:
    """Return a race at one place, on which each contestant has a bus of its own."""

    def factory(make: Make) -> Factory:
        def at_place(closing: ExitStack) -> Work:
            return make(closing, PLACES[place](closing))

        return at_place

    contestants = {name: factory(make) for name, make in makers.items()}
    return Race(FAMILY, f"{what}, {place}", size, contestants, expect=expect, **options)  # type: ignore[arg-type]


def reads(place: str) -> Race:
    if place in SOCKETS:
        makers = {"by hand": clients.read_by_hand}
    else:
        makers = {"by hand": clients.read_by_hand_on_python_can}
    makers |= {"barewire": clients.read_by_us, "barewire, asyncio": clients.read_with_asyncio}
    if place in SOCKETS:
        makers |= {"by hand, asyncio": clients.read_by_hand_with_asyncio}
        makers |= {"barewire, python-can": clients.read_by_us_over_python_can}
    makers |= {"canopen": clients.read_by_canopen}
    return race("expedited read", 4, place, makers, EXPEDITED, rounds=61, turn=0.01)


def blocks(verb: str, place: str) -> Race:
    by_hand = clients.upload_by_hand if verb == "upload" else clients.download_by_hand
    makers = {
        "by hand": by_hand,
        "barewire": clients.block_by_us(verb),
        "barewire, asyncio": clients.block_with_asyncio(verb),
        "canopen": clients.block_by_canopen(verb),
    }
    return race(f"block {verb}", len(VALUE), place, makers, VALUE, rounds=3, turn=0.0)


def frames(place: str) -> tuple[Race, ...]:
    received = {
        "by hand": clients.receive_by_hand(MANY, 0),
        "barewire": clients.receive_by_our_port(MANY, 0),
        "python-can": clients.receive_by_python_can(MANY, 0),
    }
    sent = {
        "by hand": clients.send_by_hand(MANY),
        "barewire": clients.send_by_our_port(MANY),
        "python-can": clients.send_by_python_can(MANY),
    }
    listened = {
        "by hand": clients.receive_by_hand(LISTENED, PAUSE),
        "barewire, the port": clients.receive_by_our_port(LISTENED, PAUSE),
        "barewire": clients.receive_by_stream(LISTENED, PAUSE),
        "python-can": clients.receive_by_python_can(LISTENED, PAUSE),
        "python-can, Notifier": clients.receive_by_notifier(LISTENED, PAUSE),
    }
    return (
        race("a frame received", 8, place, received, None, rounds=11, turn=0.0),
        race("a frame sent", 8, place, sent, None, rounds=11, turn=0.0),
        race("a frame of 2,000 a second", 8, place, listened, None, rounds=11, turn=0.0),
    )


RACES = (
    *(reads(place) for place in PLACES),
    *(blocks(verb, place) for place in SOCKETS for verb in ("upload", "download")),
    # Not on vcan: its guest kernel counts processor time in steps of 10 ms, too coarse for these few frames.
    *(each for place in SOCKETS if place != "vcan" for each in frames(place)),
)


@pytest.mark.parametrize(("race", "contestant"), entries(*RACES))
def test_can(enter: Callable[[Race, str], None], race: Race, contestant: str) -> None:
    enter(race, contestant)
