"""Both engines: the calls of a port for each step of a conversation, and the last frames of an abandoned one."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable

import pytest

from barewire.conversation import Abandoned, Conversation, Heard, Listen, Send, SendAll
from barewire.errors import PortError
from barewire.io.engine import asyncio as aio, blocking

TextConversation = Conversation[str, list[Heard[str]]]


class Port:
    """A port for both engines that receives the items it sent, and fails with the item `broken`."""

    def __init__(self, broken: str = "") -> None:
        self.log: list[str] = []
        self.broken = broken
        self.coming: deque[str] = deque()

    def send(self, item: str) -> None:
        self.log.append(item)
        if item == self.broken:
            raise PortError("unplugged")
        self.coming.append(item)

    def receive(self, timeout: float) -> str | None:
        return self.coming.popleft() if self.coming else None

    def close(self) -> None: ...


class AsyncPort:
    """The same for the asyncio engine; calls of `sent` are logged too."""

    def __init__(self, port: Port) -> None:
        self.port = port
        self.write = port.send

    async def sent(self) -> None:
        self.port.log.append("sent")
        await asyncio.sleep(0)

    async def receive(self, timeout: float) -> str | None:
        return self.port.receive(timeout)


def with_blocking(port: Port, conversation: TextConversation) -> list[Heard[str]]:
    return blocking.run(conversation, port)


def with_asyncio(port: Port, conversation: TextConversation) -> list[Heard[str]]:
    return asyncio.run(aio.run(conversation, AsyncPort(port)))


engines = pytest.mark.parametrize("run", [with_blocking, with_asyncio])
Run = Callable[[Port, TextConversation], list[Heard[str]]]


def sent_items(port: Port) -> list[str]:
    return [item for item in port.log if item != "sent"]


@engines
@pytest.mark.parametrize("failing", ["send", "receive"])
def test_an_oserror_of_a_port_of_the_application_is_a_port_error_with_its_cause(
    failing: str, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    cause = OSError(5, "input/output error")

    def fail(*_: object) -> None:
        raise cause

    def conversation() -> TextConversation:
        heard = [(yield Send("a"))]
        try:
            heard.append((yield Listen(0.0)))
        except Abandoned:
            yield Send("abort")  # fails too
        return heard

    port = Port()
    monkeypatch.setattr(port, failing, fail)
    with pytest.raises(PortError, match=r"^(Async)?Port: input/output error$") as caught:
        run(port, conversation())
    assert caught.value.__cause__ is cause


@engines
def test_an_oserror_of_the_conversation_itself_is_not_one_of_the_port(run: Run) -> None:
    def conversation() -> TextConversation:
        yield Send("a")
        raise BrokenPipeError("of a callback that prints")

    with pytest.raises(BrokenPipeError, match="prints"):
        run(Port(), conversation())


@engines
def test_send_all_sends_in_order_and_is_resumed_once(run: Run) -> None:
    def conversation() -> TextConversation:
        received = [(yield Send("a")), (yield SendAll(("b", "c", "d"))), (yield SendAll(()))]
        for _ in range(5):
            received.append((yield Listen(0.0)))
        return received

    port = Port()
    received = run(port, conversation())
    assert sent_items(port) == ["a", "b", "c", "d"]
    assert [item for item, _ in received] == [None, None, None, "a", "b", "c", "d", None]
    times = [now for _, now in received]
    assert times == sorted(times)


def test_asyncio_waits_once_until_all_of_a_send_all_is_sent() -> None:
    def conversation() -> TextConversation:
        yield Send("a")
        yield SendAll(("b", "c"))
        return []

    port = Port()
    with_asyncio(port, conversation())
    assert port.log == ["a", "sent", "b", "c", "sent"]


@engines
def test_a_port_that_fails_within_a_send_all_gets_the_abort_frames(run: Run) -> None:
    def conversation() -> TextConversation:
        try:
            yield SendAll(("a", "b", "c"))
        except Abandoned:
            yield SendAll(("abort", "end"))
            raise
        return []

    port = Port(broken="b")
    with pytest.raises(PortError, match="unplugged"):
        run(port, conversation())
    assert sent_items(port) == ["a", "b", "abort", "end"]
