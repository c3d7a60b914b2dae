"""The error of a conformance run that ended early, on both protocols."""

from __future__ import annotations

from barewire.errors import NoAnswer


class Unfinished(NoAnswer):
    """The run ended early. `not_run` is the number of cases that were not run; the text has it too."""

    def __init__(self, why: str, not_run: int) -> None:
        super().__init__(f"{why} ({not_run} case{'' if not_run == 1 else 's'} not run)" if not_run else why)
        self.not_run = not_run
