"""A blocking client that reads its bus itself, and what happens when others come: no frame is lost or doubled."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from barewire import CanopenClient
from barewire.canopen import CanFrame, ErrorFrame
from barewire.conversation import Conversation, Listen, Send
from barewire.errors import PortError
from barewire.io.canopen.bus.shared_bus import CanBus
from barewire.io.canopen.bus.subscriber import BusDown, BusItem, BusUp, FramesLost, Subscriber
from tests.io.canopen.memory_bus import numbered

VALUE = CanFrame.parse("585#4300100092010200")
ANSWER = {CanFrame.parse("605#4000100000000000"): [VALUE]}


class KeepingPort:
    """A port of a system that keeps frames while nobody reads. `hook` is called in each read, by the reading thread."""

    name = "test/keeping"
    keeps_frames = True
    own_frames = False
    lost = 0

    def __init__(self, answers: dict[CanFrame, list[CanFrame]] | None = None) -> None:
        self.answers = answers or {}
        self.kept: deque[BusItem | Exception] = deque()
        self.readers: list[int] = []
        self.hook: Callable[[], None] = lambda: None
        self.closed = False
        self._arrived = threading.Condition()

    def arrive(self, *items: BusItem | Exception) -> None:
        with self._arrived:
            self.kept.extend(items)
            self._arrived.notify_all()

    def send(self, item: CanFrame) -> None:
        self.arrive(*self.answers.get(item, ()))

    def has_frames(self) -> bool:
        return bool(self.kept)

    def receive(self, timeout: float) -> CanFrame | None:
        raise AssertionError("`receive_any` is called")

    def receive_any(self, timeout: float) -> BusItem | None:
        self.readers.append(threading.get_ident())
        self.hook()
        with self._arrived:
            if not self.kept:
                self._arrived.wait(timeout)
            item = self.kept.popleft() if self.kept else None
        if isinstance(item, Exception):
            raise item
        return item

    def close(self) -> None:
        self.closed = True


@contextmanager
def client_on(port: KeepingPort) -> Iterator[CanopenClient]:
    with CanopenClient(port, node=5, timeout=30.0) as client:
        yield client
    assert port.closed


def readers() -> list[str]:
    return [thread.name for thread in threading.enumerate() if thread.name == "reader of test/keeping"]


def test_a_client_alone_reads_the_bus_itself() -> None:
    port = KeepingPort(ANSWER)
    with client_on(port) as client:
        for _ in range(3):
            assert client.node().sdo.upload(0x1000) == bytes.fromhex("92010200")
        client.send(CanFrame(0x80))
        assert set(port.readers) == {threading.get_ident()}
        assert not readers()


def test_frames_that_arrived_before_a_request_are_not_its_answer() -> None:
    port = KeepingPort(ANSWER)
    with client_on(port) as client:
        port.arrive(CanFrame.parse("585#4300100000000000"), CanFrame.parse("705#7F"), *numbered(200))
        assert client.node().sdo.upload(0x1000) == bytes.fromhex("92010200")
        assert client.bus.monitor.frames == 203
        assert not readers()


def test_a_stream_gets_no_old_frame_and_with_a_request_the_reader_starts() -> None:
    port = KeepingPort(ANSWER)
    with client_on(port) as client:
        port.arrive(*numbered(5))
        with client.frames() as stream:
            port.arrive(CanFrame(0x80))
            assert stream.get(30.0) == CanFrame(0x80)
            assert not readers()
            assert client.node().sdo.upload(0x1000) == bytes.fromhex("92010200")
            assert readers()
        read = len(port.readers)
        assert client.node().sdo.upload(0x1000) == bytes.fromhex("92010200")
        assert threading.get_ident() not in port.readers[read:]


def listen_for(count: int, until: float) -> Conversation[CanFrame, list[CanFrame]]:
    """Collect so many frames."""
    heard = yield Send(CanFrame(0x100))
    found: list[CanFrame] = []
    while len(found) < count:
        heard = yield Listen(heard.now + until)
        assert heard.item is not None, found
        found.append(heard.item)
    return found


@pytest.mark.parametrize("same_thread", [False, True])
@pytest.mark.parametrize("at", range(10))
def test_a_second_listener_at_any_read_loses_and_doubles_no_frame(at: int, same_thread: bool) -> None:
    """Ten frames arrive. During read `at` of the conversation a second listener subscribes."""
    port, frames, listeners = KeepingPort(), numbered(10), list[Subscriber]()
    port.answers = {CanFrame(0x100): frames}
    with client_on(port) as client:

        def listen() -> None:
            listeners.append(Subscriber(client.bus, None))

        def hook() -> None:
            if len(port.readers) != at + 1:
                return
            if same_thread:
                listen()
            else:
                thread = threading.Thread(target=listen)
                thread.start()
                thread.join(30.0)

        port.hook = hook
        assert client.run(listen_for(10, 30.0)) == frames
        port.arrive(CanFrame(0x7FF))
        (listener,) = listeners
        rest = [listener.receive(30.0) for _ in range(at, 11)]
        assert rest == [*frames[at:], CanFrame(0x7FF)]
        assert listener.receive(0.0) is None


def test_frames_that_another_subscriber_sends_reach_the_conversation_once() -> None:
    port, frames = KeepingPort(), numbered(10)
    with client_on(port) as client:
        begun = threading.Event()
        port.hook = begun.set

        def speak() -> None:
            assert begun.wait(30.0)
            with Subscriber(client.bus, frozenset()) as other:
                for frame in frames:
                    other.send(frame)

        thread = threading.Thread(target=speak)
        thread.start()
        assert client.run(listen_for(10, 30.0)) == frames
        thread.join()


def test_many_threads_with_one_client_each_get_their_answers() -> None:
    requests = {CanFrame(0x600 + node, bytes.fromhex("4000100000000000")): node for node in range(1, 9)}
    answers = {
        request: [CanFrame(0x580 + node, b"\x43\0\x10\0" + bytes([node] * 4))] for request, node in requests.items()
    }
    port = KeepingPort(answers)
    with client_on(port) as client:
        wrong: list[object] = []

        def read(node: int) -> None:
            try:
                for _ in range(50):
                    if (found := client.node(node).sdo.upload(0x1000)) != bytes([node] * 4):
                        wrong.append(found)
            except Exception as error:
                wrong.append(error)

        threads = [threading.Thread(target=read, args=(node,)) for node in range(1, 9)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(60.0)
    assert not wrong


def test_reports_of_the_controller_are_recorded() -> None:
    port = KeepingPort(ANSWER)
    with client_on(port) as client:
        port.arrive(ErrorFrame(0x40, bytes(8)))
        assert client.node().sdo.upload(0x1000) == bytes.fromhex("92010200")
        assert client.bus.monitor.error == ErrorFrame(0x40, bytes(8))


def test_a_bus_that_failed_while_nobody_read_is_opened_again_by_the_next_request() -> None:
    old, new = KeepingPort(ANSWER), KeepingPort(ANSWER)
    with CanBus(old, dial=lambda: new, pauses=(0.001, 0.001), lazy=True) as bus:
        client = CanopenClient(bus, node=5, timeout=30.0)
        assert client.node().sdo.upload(0x1000) == bytes.fromhex("92010200")
        old.arrive(PortError("the interface is down"))
        assert client.node().sdo.upload(0x1000) == bytes.fromhex("92010200")
        assert (old.closed, bool(readers())) == (True, True)


def test_closing_the_client_ends_a_request_of_another_thread() -> None:
    port, begun, failed = KeepingPort(), threading.Event(), list[Exception]()
    client = CanopenClient(port, node=5, timeout=60.0)
    port.hook = lambda: begun.set() if len(port.readers) > 1 else None

    def read() -> None:
        try:
            client.node().sdo.upload(0x1000)
        except PortError as error:
            failed.append(error)

    thread = threading.Thread(target=read)
    thread.start()
    assert begun.wait(30.0)
    client.close()
    thread.join(10.0)
    assert "the bus was closed" in str(failed[0])
    assert port.closed


def test_an_interrupt_leaves_the_bus_to_the_next_request() -> None:
    port = KeepingPort(ANSWER)

    def interrupt() -> None:
        if len(port.readers) == 1:
            raise KeyboardInterrupt

    with client_on(port) as client:
        port.hook = interrupt
        with pytest.raises(KeyboardInterrupt):
            client.node().sdo.upload(0x1000)
        client.channel().quiet_until = None
        assert client.node().sdo.upload(0x1000) == bytes.fromhex("92010200")
        assert not readers()


def test_another_thread_is_served_while_a_function_of_the_caller_runs() -> None:
    """The functions of the caller (`progress`, the sink of an upload) may take longer than any time-out."""
    size, first, second = "585#4100300008000000", "585#0041424344454647", "585#1D48000000000000"
    port = KeepingPort(
        {
            CanFrame.parse("605#4000300000000000"): [CanFrame.parse(size)],
            CanFrame.parse("605#6000000000000000"): [CanFrame.parse(first)],
            CanFrame.parse("605#7000000000000000"): [CanFrame.parse(second)],
            CanFrame.parse("606#4000100000000000"): [CanFrame.parse("586#4300100092010200")],
        }
    )
    others: list[bytes] = []

    with client_on(port) as client:

        def progress(done: int, total: int | None) -> None:
            if not others:
                # An unread frame of this transfer waits while the other thread reads.
                thread = threading.Thread(target=lambda: others.append(client.node(6).sdo.upload(0x1000)))
                thread.start()
                thread.join(timeout=20.0)

        assert client.node(5).sdo.upload(0x3000, progress=progress) == b"ABCDEFGH"
        assert others == [bytes.fromhex("92010200")]
        assert client.node(5).sdo.upload(0x3000) == b"ABCDEFGH"


# A stream of frames that is alone


def test_a_stream_of_frames_that_is_alone_reads_the_bus_itself() -> None:
    port, frames = KeepingPort(), numbered(10)
    with client_on(port) as client:
        port.arrive(CanFrame(0x7FF))  # nobody listens yet
        with client.frames() as stream:
            port.arrive(*frames)
            client.send(CanFrame(0x80))
            assert [stream.get(30.0) for _ in range(11)] == [CanFrame(0x80), *frames]
            assert (stream.get(0.0), stream.get(0.01)) == (None, None)
            port.arrive(ErrorFrame(0x40, bytes(8)), CanFrame(0x81))
            assert [stream.get(30.0), stream.get(30.0)] == [ErrorFrame(0x40, bytes(8)), CanFrame(0x81)]
            assert set(port.readers) == {threading.get_ident()}
        assert client.bus.monitor.frames == 12
        with client.frames((0x81, False)) as stream:
            port.arrive(*frames, CanFrame(0x81))
            assert stream.get(30.0) == CanFrame(0x81)
        assert not readers()
        assert client.receive(0.0) is None


@pytest.mark.parametrize("at", range(10))
@pytest.mark.parametrize("kind", ["stream", "request", "other thread"])
def test_a_second_listener_takes_no_frame_from_a_stream(at: int, kind: str) -> None:
    """Ten frames arrive. Before frame `at` is taken, or while it is read, somebody else listens."""
    port, frames, got = KeepingPort(dict(ANSWER)), numbered(10), list[object]()
    with client_on(port) as client, client.frames() as stream:
        listeners: list[Subscriber] = []

        def listen() -> None:
            listeners.append(Subscriber(client.bus, None))

        def hook() -> None:
            if len(got) == at and not listeners:
                thread = threading.Thread(target=listen)
                thread.start()
                thread.join(30.0)

        if kind == "other thread":
            port.hook = hook
        port.arrive(*frames)
        for number in range(10):
            if number == at and kind == "stream":
                listen()
            elif number == at and kind == "request":
                assert client.node().sdo.upload(0x1000) == bytes.fromhex("92010200")
            got.append(stream.get(30.0))
        more = [next(iter(ANSWER)), VALUE] if kind == "request" else []
        got += [stream.get(30.0) for _ in more]
        assert [frame for frame in got if frame not in more] == frames
        assert {frame for frame in got if frame in more} == set(more)
        assert readers()
        if listeners:
            port.arrive(CanFrame(0x7FF))
            assert stream.get(30.0) == CanFrame(0x7FF)
            rest = list(iter(lambda: listeners[0].receive(30.0), CanFrame(0x7FF)))
            # Those that had arrived are not for it; while a frame is read, they wait in the port, and it gets the rest.
            assert rest == ([] if kind == "stream" else frames[at:]) or rest == frames[at + 1 :]


def test_a_stream_that_is_alone_is_told_that_the_port_failed() -> None:
    old, new = KeepingPort(), KeepingPort()
    bus = CanBus(old, dial=lambda: new, pauses=(0.001, 0.001), lazy=True)
    with bus, CanopenClient(bus).frames() as stream:
        old.arrive(CanFrame(0x80), PortError("the interface is down"))
        assert stream.get(30.0) == CanFrame(0x80)
        assert stream.get(30.0) == BusDown("the interface is down")
        assert isinstance(stream.get(30.0), BusUp)
        new.arrive(CanFrame(0x81))
        assert stream.get(30.0) == CanFrame(0x81)


def test_closing_the_client_ends_a_stream_that_reads() -> None:
    port, begun, ended = KeepingPort(), threading.Event(), list[object]()
    client = CanopenClient(port)
    stream = client.frames()
    port.hook = begun.set

    def take() -> None:
        ended.extend(stream)
        ended.append("end")

    thread = threading.Thread(target=take)
    thread.start()
    assert begun.wait(30.0)
    client.close()
    thread.join(10.0)
    assert ended == ["end"]
    assert port.closed


def test_a_stream_that_is_alone_reports_frames_that_the_system_dropped() -> None:
    port = KeepingPort()
    with client_on(port) as client, client.frames() as stream:
        port.lost = 12
        port.arrive(CanFrame(0x80), CanFrame(0x81))
        assert [stream.get(30.0) for _ in range(3)] == [FramesLost(12), CanFrame(0x80), CanFrame(0x81)]
