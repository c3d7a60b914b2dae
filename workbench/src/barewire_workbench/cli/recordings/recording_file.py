"""A file that a command writes frame by frame, for `--write`."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Self

from barewire.errors import EncodeError, PortError
from barewire.io.ports.network import reason
from barewire_workbench.monitor.recording import LOG_ENDINGS


def check_ending(name: str, is_can: bool) -> None:
    """Raise EncodeError for a file whose ending promises another format than the one that would be written. A name
    without an ending, such as that of a pipe, gets pcapng."""
    endings = (".pcapng", *LOG_ENDINGS) if is_can else (".pcapng",)
    ending = Path(name).suffix
    if ending and ending.lower() not in endings:
        listed = " or ".join(filter(None, (", ".join(endings[:-1]), endings[-1])))
        raise EncodeError(f"--write {name}: expected a name that ends in {listed}")


class RecordingFile:
    """A file for `--write`, complete after every frame, however the command ends: it has no buffer, and the part of a
    frame for which the disk had no room is removed."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._frames = 0
        self._size = 0
        self._refused: PortError | None = None
        try:
            self._file = Path(name).open("wb", buffering=0)  # noqa: SIM115 - closed in `__exit__`
        except OSError as error:
            raise PortError(f"{name}: {error.strerror}") from None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, _: object, error: object, __: object) -> None:
        self._file.close()
        if isinstance(error, PortError) and error is not self._refused:  # of the line or bus
            error.add_note(f"{self.name} has the {self._frames} frames before" if self._frames else
                           f"{self.name} has no frame")  # fmt: skip

    def write(self, data: bytes, *, frame: bool = True) -> None:
        """Write a frame, or the head of the file. Raises PortError if that fails, and keeps the frames before."""
        left = memoryview(data)
        try:
            while left:
                left = left[self._file.write(left) :]
        except OSError as error:
            with suppress(OSError):
                self._file.truncate(self._size)
            kept = f"it has the {self._frames} frames before" if self._frames else "nothing was written"
            self._refused = PortError(f"{self.name}: {reason(error)}; {kept}")
            raise self._refused from None
        self._size += len(data)
        self._frames += frame
