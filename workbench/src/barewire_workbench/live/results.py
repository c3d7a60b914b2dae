"""What both batteries say of a case and of a run: a line of text, and the errors of a run that ended early, or did not
begin. And the text of an error with its notes.
"""

from __future__ import annotations

from barewire.errors import BarewireError, NoAnswer


def case_line(verdict: str, name: str, text: str, remark: str) -> str:
    """Return the line of a case: FAILED stands out, - is a case that was not run or not judged."""
    sign = {"failed": "FAILED", "left out": "-", "not judged": "-"}.get(verdict, verdict)
    return f"{sign:6}  {name}  {text}{remark and f' ({remark})'}"


class Unfinished(NoAnswer):
    """The run ended early. `not_run` is the number of cases that were not run; the text has it too."""

    def __init__(self, why: str, not_run: int) -> None:
        super().__init__(f"{why} ({not_run} case{'' if not_run == 1 else 's'} not run)" if not_run else why)
        self.not_run = not_run


class TwoDevices(BarewireError):
    """Two devices have the node-ID: a run would blame each of them for the answers of the other."""

    def __init__(self, node: int, first: object, second: object) -> None:
        which = f"{first} and {second}" if str(first) != str(second) else f"{first}, twice"
        super().__init__(f"two devices answer as node {node}: one request got {which}")
        self.node = node


def text_with_notes(error: Exception) -> str:
    """Return the text of an error, with its notes: which names were being read, what was written before."""
    text = str(error)
    return "; ".join([text, *(extra for extra in getattr(error, "__notes__", []) if extra not in text)])
