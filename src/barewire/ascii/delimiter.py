"""What ends a message, where a unit was told to end it otherwise: LF, or the character of function 08/03.

    08 00 03 | character | 00        asked, with the ending of so far
    08 00 03 | character | 00        answered, with the ending of so far: from here on CR and this character
    08 00 01 | 00 or FF  | 00        restart: from its answer on CR LF once more                 [MB-APP 6.8.1]

A line learns it from what passes: the same message of a unit twice is a question and its answer, unless both were said
by us (asked again). A restart that is not answered (the unit listens only) was carried out all the same. To be heard, a
message may always end with CR LF too: other units of the line were told nothing.
"""

from __future__ import annotations

COLON, CR, LF = 0x3A, 0x0D, 0x0A
_CHANGE, _RESTART = b"\x08\x00\x03", b"\x08\x00\x01"
_ALL = 0


class Delimiters:
    """The endings of the units of one line.

    >>> endings = Delimiters()
    >>> for said in (True, False):
    ...     endings.passed(7, bytes.fromhex("08 0003 3B00"), said=said)
    >>> chr(endings.of(7)), chr(endings.of(8)), 0x3B in endings.heard
    (';', '\\n', True)
    """

    def __init__(self) -> None:
        self.heard = {LF}
        """The characters that end a message behind CR."""
        self._of: dict[int, int] = {}
        self._asked: dict[int, tuple[bytes, bool]] = {}

    def of(self, unit: int) -> int:
        """What ends a message to or from this unit."""
        return self._of.get(unit, self._of.get(_ALL, LF))

    def passed(self, unit: int, pdu: bytes, *, said: bool) -> None:
        """A message to or from this unit was said by us, or heard."""
        asked, by_us = self._asked.pop(unit, (b"", False))
        is_answer = asked == pdu and not (said and by_us)
        if is_answer or (asked[:3] == _RESTART and pdu[:1] != b"\x88"):
            self._obey(unit, asked)
            if is_answer:
                return
        elif asked and pdu[:1] == b"\x88":
            self.heard = {LF, *self._of.values()}  # declined
        if pdu[:3] in (_CHANGE, _RESTART) and len(pdu) == 5:
            if unit == _ALL:
                self._of.clear()
                self._obey(_ALL, pdu)  # nobody answers
            else:
                self._asked[unit] = (pdu, said)
                if pdu[:3] == _CHANGE and pdu[3] != COLON:
                    self.heard.add(pdu[3])

    def _obey(self, unit: int, pdu: bytes) -> None:
        """What was asked is in force."""
        character = pdu[3] if pdu[:3] == _CHANGE else LF
        if character != COLON:
            self._of[unit] = character
            self.heard = {LF, *self._of.values()}
