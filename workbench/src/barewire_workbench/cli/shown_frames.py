"""The frames of a command as they pass, each explained: `--frames` of read, write, drive and demo.

    sent      01 04 0F B1 00 02 22 F8        valid: a request to unit 1, Read Input Registers, 2 from 0FB1h; CRC ok
    received  01 04 04 00 00 01 10 FB D8     valid: a response from unit 1, ...; CRC ok

`barewire -v` shows every field of each frame, and the log of the client.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

from barewire.io.endpoint import Endpoint
from barewire_workbench.cli.output import Output, print_json

if TYPE_CHECKING:
    from barewire.canopen.frame import CanFrame
    from barewire.devices import Device
    from barewire.io.ports.base import Direction, Watch
    from barewire_workbench import Explanation

frames_option = click.option(
    "--frames",
    is_flag=True,
    help="Show each frame that passes, explained in one line; barewire -v: all its fields.",
)
_MBAP = 6
"""Bytes of the MBAP header up to the length."""


class ShownFrames:
    """Prints frames when they are complete. `watch` is the option of a client or server.

    >>> frames = ShownFrames("rtu:///dev/x")
    >>> frames.watch("sent", bytes.fromhex("01040FB1000222F8"))
    sent      01 04 0F B1 00 02 22 F8  valid: a request to unit 1, Read Input Registers, 2 from 0FB1h; CRC ok
    """

    def __init__(
        self,
        endpoint: str,
        device: Device | None = None,
        *,
        every_field: bool = False,
        output: Output | None = None,
        show: Callable[[str], Any] | None = None,
    ) -> None:
        place = Endpoint.parse(endpoint)
        framing = place.framing
        self._protocol = framing
        self._every_field = every_field
        self._output = output or Output("text")
        self._show_text = show or self._output.text
        self._received = b""
        self._is_closed = False
        self._explain_can = _can_explainer(device, place.options.get("node")) if framing == "can" else None

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self._protocol}>"

    def watch(self, direction: Direction, item: Any) -> None:
        """Take what was sent or received; a frame that arrives in pieces is joined."""
        if not isinstance(item, bytes | bytearray):
            self._print_can(direction, item)
        elif direction == "sent":
            self.flush()
            self._print(direction, bytes(item))
        else:
            self._received += bytes(item)
            while self._protocol == "tcp" and len(self._received) >= _MBAP:
                size = _MBAP + int.from_bytes(self._received[4:_MBAP], "big")
                if len(self._received) < size:
                    break
                frame, self._received = self._received[:size], self._received[size:]
                self._print(direction, frame)
            if self._received and self._explained(direction, self._received).valid:
                self.flush()

    def flush(self) -> None:
        """Print received bytes that are no whole frame."""
        if self._received:
            data, self._received = self._received, b""
            self._print("received", data)

    def show(self, word: str, item: Any) -> None:
        """Print one whole frame of a client with a word of its own, such as "would send"."""
        if isinstance(item, bytes):
            self._print("sent", item, word)
        else:
            self._print_can(word, item)

    def _explained(self, direction: Direction, data: bytes) -> Explanation:
        from barewire_workbench import explain

        return explain(self._protocol, data, "request" if direction == "sent" else "response")

    def _print(self, direction: Direction, data: bytes, word: str = "") -> None:
        text = data.decode("ascii", "replace").replace("\r\n", "\\r\\n") if self._protocol == "ascii" else None
        self._write(word or direction, text or data.hex(" ").upper(), self._explained(direction, data))

    def _print_can(self, word: str, frame: CanFrame) -> None:
        assert self._explain_can is not None
        self._write(word, str(frame), self._explain_can(frame))

    def _write(self, word: str, digits: str, explanation: Explanation) -> None:
        """Print a frame. A closed output must not fail the port, over which a drive may have to be stopped."""
        if self._is_closed:
            return
        try:
            self.show_frame(word, digits, explanation)
        except OSError:
            self._is_closed = True

    def show_frame(self, word: str, digits: str, explanation: Explanation) -> None:
        """Print one explained frame. `barewire panel` keeps it instead."""
        if self._output.as_json:
            print_json({"direction": word, "frame": digits, **explanation.as_dict()})
        elif self._every_field:
            self._show_text("\n".join([f"{word:<8}  {digits}", *(f"  {line}" for line in explanation.lines())]))
        else:
            self._show_text(f"{word:<8}  {digits}  {explanation.verdict}")


def _can_explainer(device: Device | None, node: str | None) -> Callable[[Any], Explanation]:
    """Return a function that explains a frame from its bytes and the frames before it, with the names of PDOs."""
    from barewire_workbench.monitor import CanMonitor, of_device

    number = int(node) if node and node.isdecimal() else None
    known = [of_device(device, number)] if device is not None and device.canopen is not None else []
    monitor = CanMonitor(tuple(known))
    count = 0

    def explained(frame: Any) -> Explanation:
        nonlocal count
        explanation = monitor.explain(frame)
        count += 1
        monitor.feed(frame, float(count))
        return explanation

    return explained


def is_verbose() -> bool:
    """Return whether -v was given: every field of a frame is shown."""
    context = click.get_current_context(silent=True)
    return context is not None and bool(context.find_root().params.get("verbose", 0))


@contextmanager
def frames_shown(endpoint: str, device: Device, wanted: bool, output: Output) -> Iterator[dict[str, Watch]]:
    """Yield the options of a client that shows its frames: none unless they are `wanted`. At the end, show the rest."""
    if not wanted:
        yield {}
        return
    shown = ShownFrames(endpoint, device, every_field=is_verbose(), output=output)
    try:
        yield {"watch": shown.watch}
    finally:
        shown.flush()
