"""The character that ends a frame behind CR: LF, or the character that function 08/03 set for a unit.

    08 00 03 | character | 00        request, with the current ending
    08 00 03 | character | 00        response, with the current ending; from here on CR and this character
    08 00 01 | 00 or FF  | 00        restart: from its response on CR LF again                   [MB-APP 6.8.1]

The line derives the character from the frames that it sends and receives: if the same message of a unit passes twice,
it was a request and its response, unless both were sent by this side (a repeated request). A restart also takes effect
without a response, because a unit in listen only mode sends none. CR LF always ends a received frame as well, because
other units on the line still use it.
"""

from __future__ import annotations

COLON, LF = 0x3A, 0x0A
_CHANGE, _RESTART = b"\x08\x00\x03", b"\x08\x00\x01"
_ALL = 0


class Delimiters:
    """The endings of the units of one line.

    >>> endings = Delimiters()
    >>> for sent in (True, False):
    ...     endings.passed(7, bytes.fromhex("08 0003 3B00"), sent=sent)
    >>> chr(endings.of(7)), chr(endings.of(8)), 0x3B in endings.accepted
    (';', '\\n', True)
    """

    def __init__(self) -> None:
        self.accepted = {LF}
        """The characters that end a received frame behind CR."""
        self._of: dict[int, int] = {}
        self._asked: dict[int, tuple[bytes, bool]] = {}

    def of(self, unit: int) -> int:
        """Return the character that ends a frame to or from this unit."""
        return self._of.get(unit, self._of.get(_ALL, LF))

    def passed(self, unit: int, pdu: bytes, *, sent: bool) -> None:
        """Record a message to or from this unit. `sent`: this side transmitted it; otherwise it was received."""
        asked, was_sent = self._asked.pop(unit, (b"", False))
        is_answer = asked == pdu and not (sent and was_sent)
        if is_answer or (asked[:3] == _RESTART and pdu[:1] != b"\x88"):
            self._apply(unit, asked)
            if is_answer:
                return
        elif asked and pdu[:1] == b"\x88":
            self.accepted = {LF, *self._of.values()}  # declined
        if pdu[:3] in (_CHANGE, _RESTART) and len(pdu) == 5:
            if unit == _ALL:
                self._of.clear()
                self._apply(_ALL, pdu)  # a broadcast has no response
            else:
                self._asked[unit] = (pdu, sent)
                if pdu[:3] == _CHANGE and pdu[3] != COLON:
                    self.accepted.add(pdu[3])

    def _apply(self, unit: int, pdu: bytes) -> None:
        """Apply a request that took effect."""
        character = pdu[3] if pdu[:3] == _CHANGE else LF
        if character != COLON:
            self._of[unit] = character
            self.accepted = {LF, *self._of.values()}
