"""The words of one line: split, unquoted, without the comment, taken one after the other.   [CiA 309-3, syntax]

        [1] 5 w 0x2000 0 vs "say ""no"" now" # a text    ->   w | 0x2000 | 0 | vs | say "no" now

What is missing or does not fit is GatewayError 101, and its text names the word.
"""

from __future__ import annotations

from barewire.canopen.gateway.codes import GatewayCode, GatewayError
from barewire.canopen.gateway.values import read_number
from barewire.errors import shown


class _Words:
    """The words that are left of a line."""

    def __init__(self, words: list[str]) -> None:
        self._words = words

    def __bool__(self) -> bool:
        return bool(self._words)

    def peek(self) -> str:
        """The next word in small letters, or nothing."""
        return self._words[0].lower() if self._words else ""

    def take(self, what: str) -> str:
        """The next word as it stands."""
        if not self._words:
            raise GatewayError(GatewayCode.SYNTAX, f"the line ends where {what} was expected")
        return self._words.pop(0)

    def among(self, what: str, *choices: str) -> str:
        """The next word, one of these; written shorter where a choice is followed by `|short`."""
        word = self.take(what).lower()
        for choice in choices:
            if word in choice.split("|"):
                return choice.split("|")[0]
        expected = ", ".join(choice.replace("|", " or ") for choice in choices)
        raise GatewayError(GatewayCode.SYNTAX, f"{shown(word)} is no {what}: expected {expected}")

    def number(self, what: str, low: int, high: int) -> int:
        """A whole number within limits, both included."""
        word = self.take(what)
        try:
            value = read_number(word)
        except ValueError:
            raise GatewayError(GatewayCode.SYNTAX, f"{what} {shown(word)}: expected a whole number") from None
        if not low <= value <= high:
            raise GatewayError(GatewayCode.SYNTAX, f"{what} {word}: expected {low}..{high}")
        return value

    def rest(self) -> list[str]:
        """All that is left."""
        words, self._words = self._words, []
        return words


def split_line(line: str) -> list[str]:
    """Words of a line. Double quotes hold a word together; a number sign outside of them begins a comment.

    >>> split_line('5 w 0x2000 0 vs "say ""no"" #1"  # a text')
    ['5', 'w', '0x2000', '0', 'vs', 'say "no" #1']
    """
    words: list[str] = []
    at, end = 0, len(line)
    while at < end and line[at] != "#":
        if line[at].isspace():
            at += 1
        elif line[at] == '"':
            word, at = _quoted(line, at + 1)
            words.append(word)
        else:
            begin = at
            while at < end and not line[at].isspace() and line[at] not in '#"':
                at += 1
            words.append(line[begin:at])
    return words


def _quoted(line: str, at: int) -> tuple[str, int]:
    parts: list[str] = []
    while True:
        closing = line.find('"', at)
        if closing < 0:
            raise GatewayError(GatewayCode.SYNTAX, "a double quote is not closed")
        parts.append(line[at:closing])
        if line[closing + 1 : closing + 2] != '"':
            return '"'.join(parts), closing + 1
        at = closing + 2


def sequence_of(line: str) -> tuple[int, str]:
    """The sequence number in its brackets, and the rest of the line. Raises GatewayError.

    >>> sequence_of("[ 7 ] start")
    (7, ' start')
    """
    before, opened, behind = line.partition("[")
    number, closed, rest = behind.partition("]")
    if before.strip() or not opened or not closed:
        raise GatewayError(GatewayCode.SYNTAX, "a line begins with its sequence number in brackets: [1] 5 start")
    try:
        sequence = read_number(number.strip())
    except ValueError:
        sequence = -1
    if not 0 <= sequence < 1 << 32:
        raise GatewayError(GatewayCode.SYNTAX, f"sequence number {shown(number.strip())}: expected 0..4294967295")
    return sequence, rest
