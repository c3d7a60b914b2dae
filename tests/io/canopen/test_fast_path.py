"""Expedited transfers without a conversation: what the client does is what its conversation does, on any port."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import pytest

from barewire import CanopenClient
from barewire.canopen import CanFrame, Entry, ErrorFrame, ObjectDictionary
from barewire.errors import BarewireError, DecodeError, NoAnswer, PortError
from barewire.io.canopen import client_base
from barewire.io.canopen.bus.shared_bus import CanBus
from barewire.io.canopen.bus.subscriber import ChannelSubscriber
from tests.io.canopen.test_direct import KeepingPort

READ, WRITE = CanFrame.parse("605#4000100000000000"), CanFrame.parse("605#2B0010000F000000")
VALUE, DONE = CanFrame.parse("585#4300100092010200"), CanFrame.parse("585#6000100000000000")

IRREGULAR = {
    "abort": "585#8000100000000206",
    "abort of another object": "585#8001100000000206",
    "unsized": "585#4200100092010200",
    "of another object": "585#4301100092010200",
    "segments": "585#4100100004000000",
    "short": "585#43001000",
    "extended": "00000585#4300100092010200",
    "a request": "605#4008100000000000",
    "a heartbeat": "705#05",
    "nothing": "",
}


def ignore(done: int, size: int | None) -> None:
    """A progress function: with it a transfer is a conversation."""


def note_sent(sent: list[CanFrame], way: str, frame: CanFrame) -> None:
    """Keep the frames that a client sends; bound to a list it is a `watch` function."""
    if way == "sent":
        sent.append(frame)


@contextmanager
def client_on(port: KeepingPort, *, direct: bool) -> Iterator[CanopenClient]:
    with CanBus(port, lazy=direct) as bus, CanopenClient(bus, node=5, timeout=5.0) as client:
        yield client


@pytest.fixture(params=[True, False], ids=["read by itself", "read by a thread"])
def direct(request: pytest.FixtureRequest) -> bool:
    return bool(request.param)


@pytest.fixture
def plain_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let every conversation fail."""

    def refuse(*arguments: object) -> Any:
        raise AssertionError(f"a conversation: {arguments}")

    monkeypatch.setattr("barewire.io.canopen.client.run", refuse)


@pytest.mark.usefixtures("plain_only")
def test_expedited_transfers_need_no_conversation(direct: bool) -> None:
    port = KeepingPort({READ: [CanFrame(0x185), CanFrame.parse("706#05"), VALUE], WRITE: [DONE]})
    with client_on(port, direct=direct) as client:
        sdo = client.node().sdo
        for _ in range(3):
            assert sdo.upload(0x1000) == VALUE.data[4:]
            assert sdo.download(0x1000, 0, b"\x0f\x00") is None
        assert client.channel().counters.responses == 1
        assert client.channel().total.responses == 5
        assert client.bus.monitor.count(0x706) == 3


@pytest.mark.usefixtures("plain_only")
def test_a_frame_that_another_client_sent_meanwhile_does_not_stay_for_the_next_exchange() -> None:
    port = KeepingPort({READ: [VALUE]})
    with client_on(port, direct=True) as client:
        sdo = client.node().sdo
        port.hook = lambda: client.bus.send(CanFrame.parse("585#4300100000000000"))
        assert [sdo.upload(0x1000) for _ in range(3)] == [VALUE.data[4:]] * 3


@pytest.mark.usefixtures("plain_only")
def test_reads_and_writes_by_name_need_no_conversation_whatever_the_value(direct: bool) -> None:
    objects = ObjectDictionary([Entry(0x1000, 0, "on", "bool"), Entry(0x1001, 0, "speed", "i16")])
    port = KeepingPort(
        {
            READ: [CanFrame.parse("585#4F00100000000000")],
            CanFrame.parse("605#4001100000000000"): [CanFrame.parse("585#4B011000FEFF0000")],
            CanFrame.parse("605#2B01100003000000"): [CanFrame.parse("585#6001100000000000")],
        }
    )
    with client_on(port, direct=direct) as client:
        node = client.node(eds=objects)
        for _ in range(2):
            assert node.read("on") is False
            assert node.read("speed") == node.sdo.read_object(objects, "speed") == -2
            node.write("speed", 3)
            node.sdo.write_object(objects, "speed", 3)


def test_a_value_that_is_not_of_its_type_is_refused_as_in_the_conversation(direct: bool) -> None:
    objects = ObjectDictionary([Entry(0x1000, 0, "speed", "i16")])
    port = KeepingPort({READ: [VALUE]})
    with client_on(port, direct=direct) as client:
        for _ in range(2):
            with pytest.raises(DecodeError) as caught:
                client.node(eds=objects).read("speed")
            assert caught.value.__notes__ == ["speed is i16 in the dictionary, but the device sent this"]
            assert not client.channel().busy


def outcome(act: Callable[[], object]) -> object:
    try:
        return act()
    except BarewireError as error:
        return type(error), re.sub(r"[\d.]+ s ago", "some time ago", str(error))


@pytest.mark.parametrize("second", ["good", "nothing"])
@pytest.mark.parametrize("first", IRREGULAR)
@pytest.mark.parametrize("verb", ["upload", "download"])
def test_whatever_is_irregular_ends_as_in_the_conversation(direct: bool, verb: str, first: str, second: str) -> None:
    found = []
    for progress in (None, ignore):
        good = VALUE if verb == "upload" else DONE
        frames = [CanFrame.parse(IRREGULAR[first])] if IRREGULAR[first] else []
        frames += [good] if second == "good" else []
        port, sent = KeepingPort({READ: frames, WRITE: frames}), list[CanFrame]()
        with client_on(port, direct=direct) as client:
            client.bus._watch = partial(note_sent, sent)
            sdo = client.node(timeout=0.08 if second == "nothing" else 1.0).sdo
            transfer = (
                partial(sdo.upload, 0x1000) if verb == "upload" else partial(sdo.download, 0x1000, 0, b"\x0f\x00")
            )
            result = outcome(partial(transfer, progress=progress))
            channel = client.channel()
            counted = repr(channel.counters), channel.quiet_until is None, channel.abandoned, channel.busy
        found.append((result, sent, counted))
    assert found[0] == found[1]


def test_a_frame_that_waits_is_not_the_answer_of_a_later_request(direct: bool) -> None:
    port = KeepingPort({READ: [VALUE]})
    with client_on(port, direct=direct) as client:
        sdo = client.node().sdo
        for _ in range(3):
            assert sdo.upload(0x1000) == VALUE.data[4:]
            before = client.bus.monitor.frames
            port.arrive(CanFrame.parse("585#4300100000000000"), CanFrame.parse("605#4000100000000000"), VALUE)
            while not direct and client.bus.monitor.frames < before + 3:
                pass


def test_a_device_that_is_slow_has_its_whole_time_out(direct: bool) -> None:
    port = KeepingPort()
    with client_on(port, direct=direct) as client:
        answering = threading.Timer(0.12, port.arrive, [VALUE])
        answering.start()
        assert client.node().sdo.upload(0x1000) == VALUE.data[4:]
        answering.join()


def test_no_answer_says_what_was_on_the_bus_and_makes_the_channel_wait(direct: bool) -> None:
    port = KeepingPort({READ: [CanFrame.parse("706#05")]})
    with client_on(port, direct=direct) as client:
        with pytest.raises(NoAnswer, match=r"within 0\.06 s.* 1 frame on the bus meanwhile"):
            client.node().sdo.upload(0x1000, timeout=0.06)
        assert client.channel().quiet_until is not None


def test_an_interrupt_sends_an_abort_and_the_late_answer_is_discarded(direct: bool) -> None:
    port, sent = KeepingPort(), list[CanFrame]()
    with client_on(port, direct=direct) as client:
        client.bus._watch = partial(note_sent, sent)

        def interrupt(*arguments: object) -> None:
            raise KeyboardInterrupt

        with pytest.MonkeyPatch.context() as patch:
            if direct:
                port.hook = interrupt
            else:
                patch.setattr(ChannelSubscriber, "receive", interrupt)
            with pytest.raises(KeyboardInterrupt):
                client.node().sdo.upload(0x1000)
        port.hook = lambda: None
        assert sent == [READ, CanFrame.parse("605#8000100000000008")]
        assert client.channel().abandoned == (0x1000, 0)
        port.answers = {READ: [VALUE]}
        port.arrive(CanFrame.parse("585#4300100000000000"))
        assert client.node().sdo.upload(0x1000) == VALUE.data[4:]


class FullPort(KeepingPort):
    """A port without room for the first attempts."""

    attempts = 0

    def try_send(self, item: CanFrame) -> bool:
        self.attempts += 1
        if self.attempts < 3:
            return False
        self.send(item)
        return True


def test_a_request_waits_for_room(direct: bool) -> None:
    port = FullPort({READ: [VALUE]})
    with client_on(port, direct=direct) as client:
        assert client.node().sdo.upload(0x1000) == VALUE.data[4:]
        assert client.channel().counters.responses == 1


def test_a_request_that_cannot_be_sent_leaves_the_channel_free(direct: bool) -> None:
    port = KeepingPort({READ: [VALUE]})
    with client_on(port, direct=direct) as client:
        sdo = client.node().sdo
        with pytest.MonkeyPatch.context() as patch:

            def fail(item: CanFrame) -> None:
                raise PortError("cannot send")

            patch.setattr(port, "send", fail)
            with pytest.raises(PortError, match="cannot send"):
                sdo.upload(0x1000)
        assert client.channel().quiet_until is None
        assert sdo.upload(0x1000) == VALUE.data[4:]


def test_a_bus_that_failed_and_was_opened_again_is_used_again(direct: bool) -> None:
    old, new = KeepingPort({READ: [VALUE]}), KeepingPort({READ: [VALUE]})
    with CanBus(old, dial=lambda: new, pauses=(0.001, 0.001), lazy=direct) as bus:
        client = CanopenClient(bus, node=5, timeout=30.0)
        sdo = client.node().sdo
        assert sdo.upload(0x1000) == VALUE.data[4:]
        old.answers = {READ: [PortError("unplugged")]}  # type: ignore[list-item]
        with pytest.raises(PortError, match="unplugged"):
            sdo.upload(0x1000)
        bus.wait_until_open(30.0)
        client.channel().be_settled()
        assert [sdo.upload(0x1000) for _ in range(2)] == [VALUE.data[4:]] * 2


def test_reports_of_the_controller_come_between(direct: bool) -> None:
    port = KeepingPort({READ: [ErrorFrame(0x40, bytes(8)), VALUE]})  # type: ignore[list-item]
    with client_on(port, direct=direct) as client:
        assert client.node().sdo.upload(0x1000) == VALUE.data[4:]
        assert client.bus.monitor.error == ErrorFrame(0x40, bytes(8))


def test_an_exchange_inside_another_one_is_an_error(direct: bool) -> None:
    port = KeepingPort({READ: [VALUE]})
    with client_on(port, direct=direct) as client:
        found: list[object] = []

        def watch(way: str, frame: CanFrame) -> None:
            if way == "sent" and not found:
                found.append(None)
                found.append(outcome(lambda: client.node().sdo.upload(0x1000)))

        client.bus._watch = watch
        assert client.node().sdo.upload(0x1000) == VALUE.data[4:]
        assert "begun inside another one" in str(found[1])


def test_a_client_takes_its_subscribers_along(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client_base, "_CHANNELS_MAX", 3)
    requests = {CanFrame(0x600 + node, READ.data): [CanFrame(0x580 + node, VALUE.data)] for node in range(1, 20)}
    with CanBus(KeepingPort(requests)) as bus:
        client = CanopenClient(bus)
        for _ in range(2):
            for node in range(1, 20):
                assert client.node(node).sdo.upload(0x1000) == VALUE.data[4:]
        assert 0 < len(bus.subscribers) <= 3
        client.close()
        assert not bus.subscribers


def test_a_subscriber_that_stays_holds_a_limited_number_of_frames() -> None:
    port = KeepingPort({READ: [VALUE]})
    with client_on(port, direct=False) as client:
        sdo = client.node().sdo
        assert sdo.upload(0x1000) == VALUE.data[4:]
        (subscriber,) = client.bus.subscribers
        for _ in range(subscriber.room + 10):
            subscriber.put(VALUE, 0.0)
        assert subscriber.lost == 10
        assert sdo.upload(0x1000) == VALUE.data[4:]


def test_threads_on_one_channel_wait_for_each_other(direct: bool) -> None:
    port = KeepingPort({READ: [VALUE]})
    with client_on(port, direct=direct) as client:
        found: list[bytes] = []

        def read() -> None:
            for _ in range(100):
                found.append(client.node().sdo.upload(0x1000))

        threads = [threading.Thread(target=read) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(60.0)
        assert found == [VALUE.data[4:]] * 400
