"""Ports of a board, and what carries out a conversation on them, blocking or with asyncio; a server is one too.

All times are whole microseconds of the port's `clock`.
"""

import asyncio
import select
import time

from barewire.conversation import Heard, Listen, Send


class Clock:
    """Calling it returns the microseconds since it was made, which never begin again at 0.

    `time.ticks_us` does, after 18 minutes on most ports; so what has passed is added at each call. After 100 seconds
    without a call `time.ticks_ms` tells it, which is right for up to six days.
    """

    def __init__(self):
        self._us, self._ms = time.ticks_us(), time.ticks_ms()
        self._now = 0

    def __call__(self):
        us, ms = time.ticks_us(), time.ticks_ms()
        passed = time.ticks_diff(ms, self._ms)
        if 0 <= passed < 100_000:
            passed = time.ticks_diff(us, self._us)
        else:
            passed = 1000 * (passed if passed > 0 else 1 << 29)
        self._us, self._ms = us, ms
        self._now += passed
        return self._now


class Port:
    """What ports have in common. `arrived()` returns what was received, or None."""

    def __init__(self):
        self.clock = Clock()

    def receive(self, until):
        """Return bytes as soon as there are some, None if there are none until that time."""
        while True:
            data = self.arrived()
            if data or self.clock() >= until:
                return data
            time.sleep_us(200)

    async def receive_async(self, until):
        """Do the same, and let other tasks run meanwhile."""
        while True:
            data = self.arrived()
            if data or self.clock() >= until:
                return data
            await asyncio.sleep_ms(1)


class UartPort(Port):
    """A serial line on a `machine.UART`, made with `timeout=0` and with a receive buffer of 300 bytes or more.

    character    microseconds of a character: `timing.character`
    enable       the pin that turns on the transmitter of RS-485, if there is one
    """

    def __init__(self, uart, character, enable=None):
        super().__init__()
        self._uart = uart
        self._character = int(character) + 1
        self._enable = enable

    def send(self, data):
        """Send the bytes, and return when the last bit has left: from then on the silence counts."""
        if self._enable is not None:
            self._enable.value(1)
        self._uart.write(data)
        self._uart.flush()
        time.sleep_us(self._character)  # on some ports `flush` returns while the last character is still being sent
        if self._enable is not None:
            self._enable.value(0)

    def arrived(self):
        """Return what the UART has received."""
        return self._uart.read() if self._uart.any() else None


class SocketPort(Port):
    """A connection: Modbus TCP with a `TcpLine`, or RTU behind a converter with an `RtuLine`."""

    def __init__(self, connection):
        super().__init__()
        self._connection = connection
        connection.setblocking(False)
        self._poll = select.poll()
        self._poll.register(connection, select.POLLIN)

    def send(self, data):
        """Send the bytes. Raises OSError if the connection has ended."""
        self._connection.setblocking(True)
        while data:
            data = data[self._connection.send(data) :]
        self._connection.setblocking(False)

    def arrived(self):
        """Return what was received. Raises OSError if the connection has ended."""
        if not self._poll.poll(0):
            return None
        data = self._connection.recv(512)
        if not data:
            raise OSError("the connection has ended")
        return data


def run(conversation, port):
    """Carry out a conversation, such as `bus.ask(...)`, and return its result. Its errors propagate."""
    step = next(conversation)
    try:
        while True:
            data = None
            if isinstance(step, Listen):
                data = port.receive(step.until)
            else:
                for item in step.items:
                    port.send(item)
            step = conversation.send(Heard(data, port.clock()))
    except StopIteration as end:
        return end.value
    finally:
        conversation.close()  # after KeyboardInterrupt too: the bus then knows that an answer may still come


async def run_async(conversation, port):
    """Do the same, and let other tasks run while it waits. Of one bus, one conversation runs at a time: use a lock."""
    step = next(conversation)
    try:
        while True:
            data = None
            if isinstance(step, Listen):
                data = await port.receive_async(step.until)
            else:
                for item in step.items:
                    port.send(item)
            step = conversation.send(Heard(data, port.clock()))
    except StopIteration as end:
        return end.value
    finally:
        conversation.close()


def serving(server):
    """Return what serves a server on a port, until the port fails: `run(serving(server), port)`."""
    replies = []
    heard = yield Listen(0)
    while True:
        if replies and heard.item is None and heard.now >= replies[0].at:
            heard = yield Send(replies.pop(0).data)
            server.sent(heard.now)
        else:
            if heard.item and server.serial:  # in the silence before a response: its client does not expect it any more
                replies.clear()
            replies += server.feed(heard.item, heard.now)
        until = server.deadline
        until = heard.now + 1000000 if until is None else until
        heard = yield Listen(replies[0].at if replies else until)
