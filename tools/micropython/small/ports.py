"""Ports of a board, and what carries out a conversation or serves a server on them, blocking and with asyncio.

All times are whole microseconds of one `Clock`.
"""

import asyncio
import select
import time

from barewire.conversation import Heard, Listen


class Clock:
    """Calling it returns the microseconds since it was made, which never begin again at 0.

    `time.ticks_us` does, after 18 minutes on most ports, so what passed is counted at each call. After a pause above 100
    seconds `time.ticks_ms` counts it, which is right up to six days.
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


class UartPort:
    """A serial line on a `machine.UART`, which must be made with `timeout=0` and a receive buffer of 512 bytes or more.

    character    microseconds of a character: `timing.character`
    enable       the pin that turns on the transmitter of RS-485, if there is one
    """

    def __init__(self, uart, character, enable=None):
        self.clock = Clock()
        self._uart = uart
        self._character = round(character)
        self._enable = enable

    def send(self, data):
        """Send the bytes, and return when the last bit is on the line: from here on the silence is counted."""
        if self._enable is not None:
            self._enable.value(1)
        self._uart.write(data)
        self._uart.flush()
        # On some ports `flush` returns while the last character is still being sent.
        time.sleep_us(self._character + 100)
        if self._enable is not None:
            self._enable.value(0)

    def receive(self, until):
        """Return bytes as soon as there are some, None if there are none until that time."""
        while True:
            data = self._uart.read() if self._uart.any() else None
            if data:
                return data
            rest = until - self.clock()
            if rest <= 0:
                return None
            time.sleep_us(rest if rest < 500 else 500)  # `rest` may be infinite


class SocketPort:
    """A connection over TCP, for a `TcpLine`, or for an `RtuLine` behind a converter."""

    def __init__(self, connected):
        self.clock = Clock()
        self._socket = connected
        self._socket.setblocking(False)
        self._poll = select.poll()
        self._poll.register(connected, select.POLLIN)

    def send(self, data):
        """Send the bytes. Raise OSError if the connection has ended."""
        while data:
            sent = self._socket.send(data)
            data = data[sent:] if sent else data

    def receive(self, until):
        """Return bytes as soon as there are some, None if there are none until that time."""
        rest = until - self.clock()
        milliseconds = 0 if rest <= 0 else -(-rest // 1000) if rest < 1000000000 else 1000000
        if not self._poll.poll(milliseconds):
            return None
        data = self._socket.recv(256)
        if not data:
            raise OSError("the connection was closed")
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


def serve(server, port):
    """Answer what arrives at a port, for ever."""
    while True:
        now = port.clock()
        deadline = server.deadline
        data = port.receive(now + 1000000 if deadline is None else deadline)
        for reply in server.feed(data, port.clock()):
            # On a serial line the silence comes first. Bytes that arrive in it follow the request: it is not answered.
            late = port.receive(reply.at)
            if late:
                server.feed(late, port.clock())
                break
            port.send(reply.data)
            server.line.sent(port.clock())
