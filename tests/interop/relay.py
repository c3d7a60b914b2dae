"""Two pseudo-terminals with a wire between them: a serial line of which both ends are strangers' to open."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator

from barewire.errors import PortError
from barewire.shells.pseudo_terminal import PseudoTerminal


@contextlib.contextmanager
def relayed() -> Iterator[tuple[str, str]]:
    """The paths of the two ends."""
    ends, stop = (PseudoTerminal(), PseudoTerminal()), threading.Event()

    def carry(source: PseudoTerminal, target: PseudoTerminal) -> None:
        with contextlib.suppress(PortError):
            while not stop.is_set():
                if data := source.receive(0.05):
                    target.send(data)

    threads = [threading.Thread(target=carry, args=pair, daemon=True) for pair in (ends, ends[::-1])]
    for thread in threads:
        thread.start()
    try:
        yield ends[0].path, ends[1].path
    finally:
        stop.set()
        for thread in threads:
            thread.join(2)
        for end in ends:
            end.close()
