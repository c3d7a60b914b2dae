"""One fault: its kind, and which answers it hits.

    KIND[=VALUE][:P][@ADDRESS][@every=N or @nth=N]

    drop                        one answer in ten, by dice                  late:0.5          one in two
    drop@every=3                the third, the sixth ...                    drop@nth=5        the fifth only
    exception=04@20             each answer to a request that touches address 20 of any table
    paced=0.005@holding:20-29   ... that touches holding registers 20 to 29; coil:, discrete:, input:
    wrong-unit@20@every=2       the second, the fourth ... of those that touch address 20
    drop:0.5@every=2            half of the second, the fourth ...: a probability holds for the selected answers

An address is decimal, or hexadecimal as 0x14 or 14h.

    kind                VALUE
    exception           the exception code in hexadecimal, 01..FF (default 06)
    late                the delay in seconds (default: that of the server, 1.5)
    paced               the pause between two bytes in seconds (default 0.005)
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TypeAlias

from barewire.errors import EncodeError, shown

KINDS = ("exception", "wrong-unit", "flip", "noise", "split", "late", "drop", "wrong-transaction", "paced")
"""All kinds of faults; one answer can have several."""

_DEFAULT_PROBABILITY = 0.1
"""The probability of a kind of fault that is given without one, and without the answers that it hits."""

LONGEST_DELAY = 3600.0
"""The longest delay in seconds: more is probably a mistake."""

_EXAMPLES = "drop:0.5, exception=04@20, paced@holding:20-29, late=2@every=3 or drop@nth=5"
_TABLES = ("coil", "discrete", "holding", "input")
_BY_FUNCTION = {
    0x01: "coil",
    0x02: "discrete",
    0x03: "holding",
    0x04: "input",
    0x05: "coil",
    0x06: "holding",
    0x0F: "coil",
    0x10: "holding",
    0x16: "holding",
    0x17: "holding",
    0x18: "holding",
}
_ONE_VALUE = (0x05, 0x06, 0x16, 0x18)
"""Functions whose second field is not a quantity."""


@dataclass(frozen=True, slots=True)
class Fault:
    """A kind of fault, and the answers that it hits: those that fit all that is given.

        kind            one of KINDS
        probability     of each answer that fits, 0..1
        value           the code of an exception, the delay of late answers, the pause of paced ones; None: the default
        addresses       the request touches one of these addresses; None: any request
        table           ... of this table: "coil", "discrete", "holding" or "input"; None: of any table
        every, nth      of the answers that fit so far, each n-th one; only the n-th one

    >>> Fault("exception", value=4, addresses=range(20, 30), every=3)
    Fault(kind='exception', probability=1.0, value=4, addresses=range(20, 30), table=None, every=3, nth=None)

    Raises EncodeError for a wrong value.
    """

    kind: str
    probability: float = 1.0
    value: float | None = None
    addresses: range | None = None
    table: str | None = None
    every: int | None = None
    nth: int | None = None

    def __post_init__(self) -> None:
        kind, value = self.kind, self.value
        if kind not in KINDS:
            raise EncodeError(f"fault {shown(kind)}: expected some of {', '.join(sorted(KINDS))}{_near(kind, KINDS)}")
        if not (isinstance(self.probability, (int, float)) and 0 <= self.probability <= 1):
            raise EncodeError(f"fault {kind!r}: {shown(self.probability)}: expected a probability, 0..1", "faults")
        if value is not None and kind == "exception":
            if not (isinstance(value, int) and 1 <= value <= 255):
                raise EncodeError(f"fault {kind!r}: {shown(value)}: expected an exception code, 1..255", "faults")
        elif value is not None and kind in ("late", "paced"):
            if not (isinstance(value, (int, float)) and 0 <= value < LONGEST_DELAY):
                text = f"expected seconds, from 0 on and below {LONGEST_DELAY:g}"
                raise EncodeError(f"fault {kind!r}: {shown(value)}: {text}", "faults")
        elif value is not None:
            raise EncodeError(f"fault {kind!r}: {shown(value)}: only exception, late and paced have a value", "faults")
        found = self.addresses
        if found is not None and not (isinstance(found, range) and found and found[0] >= 0 and found[-1] <= 0xFFFF):
            text = "expected a range of addresses in 0..65535"
            raise EncodeError(f"fault {kind!r}: addresses {shown(found)}: {text}", "faults")
        if self.table is not None and (self.table not in _TABLES or found is None):
            text = f"expected one of {', '.join(_TABLES)}, and addresses"
            raise EncodeError(f"fault {kind!r}: table {shown(self.table)}: {text}", "faults")
        for name, number in (("every", self.every), ("nth", self.nth)):
            if number is not None and not (isinstance(number, int) and number >= 1):
                text = "expected a whole number, from 1 on"
                raise EncodeError(f"fault {kind!r}: {name} = {shown(number)}: {text}", "faults")

    def fits(self, request: bytes) -> bool:
        """Whether the PDU of a request touches the addresses of this fault."""
        if self.addresses is None:
            return True
        return any(
            self.table in (None, table) and any(address in self.addresses for address in row)
            for table, row in _touched(request)
        )

    def hits(self, count: int) -> bool:
        """Whether the fault hits the answer with this number among those that fit; they are counted from 1."""
        return (self.every is None or count % self.every == 0) and (self.nth is None or count == self.nth)


GivenFaults: TypeAlias = str | Mapping[str, float] | Iterable[Fault]
"""A text as above with commas, probabilities by kind, or faults."""


def parse_faults(text: str) -> tuple[Fault, ...]:
    """Return the faults of a text, with commas between them. Raises EncodeError.

    >>> [(fault.kind, fault.probability) for fault in parse_faults("late:0.5,drop,flip@nth=2")]
    [('late', 0.5), ('drop', 0.1), ('flip', 1.0)]
    """
    return tuple(_parsed(item.strip()) for item in text.split(","))


def checked_faults(faults: GivenFaults) -> tuple[Fault, ...]:
    """Return the faults in any of their forms. Raises EncodeError."""
    if isinstance(faults, str):
        return parse_faults(faults)
    if isinstance(faults, Mapping):
        return tuple(Fault(kind, probability) for kind, probability in faults.items())
    found = tuple(faults) if isinstance(faults, Iterable) else (None,)
    if all(isinstance(fault, Fault) for fault in found):
        return found
    raise EncodeError(f"faults {shown(faults)}: expected a text such as 'late:0.5,drop', or a dict", "faults")


def _parsed(text: str) -> Fault:
    """Return the fault of KIND[=VALUE][:P][@WHICH]... Raises EncodeError."""
    what, *which = text.split("@")
    head, colon, chance = what.partition(":")
    kind, equals, value = head.partition("=")
    given: dict[str, object] = {}
    if colon or not which:
        given["probability"] = _number(
            chance, f"fault {shown(text)}: expected a probability, 0..1, after the colon", colon
        )
    if equals:
        if kind == "exception":
            expected = f"fault {shown(text)}: expected an exception code in hexadecimal, 01..FF, such as exception=0B"
            given["value"] = _whole(value, expected, base=16)
        else:
            expected = f"fault {shown(text)}: expected a number after the equals sign, such as {_EXAMPLES}"
            given["value"] = _number(value, expected)
    if kind in KINDS:  # otherwise `Fault` reports that first
        for part in which:
            selection = _selection(part, text)
            if given.keys() & selection.keys() or ({*selection, *given} >= {"every", "nth"}):
                raise EncodeError(
                    f"fault {shown(text)}: {shown(part)} is one selection too many, expected such as {_EXAMPLES}"
                )
            given |= selection
    return Fault(kind, **given)  # type: ignore[arg-type]  # `Fault` checks them


def _selection(part: str, text: str) -> dict[str, object]:
    """Return the fields of what follows an at sign: every=3, nth=5, 20, 20-29, holding:20."""
    name, equals, number = part.partition("=")
    if equals:
        if name not in ("every", "nth"):
            hint = _near(name, ("every", "nth"))
            raise EncodeError(f"fault {shown(text)}: {shown(name)}: expected every=N or nth=N after the at sign{hint}")
        return {name: _whole(number, f"fault {shown(text)}: {shown(part)}: expected a whole number, such as {name}=3")}
    table, colon, addresses = part.rpartition(":")
    if colon and table not in _TABLES:
        expected = f"expected {', '.join(_TABLES)} before the address{_near(table, _TABLES)}"
        raise EncodeError(f"fault {shown(text)}: {shown(table)}: {expected}")
    first, dash, last = addresses.partition("-")
    forms = "an address, such as 20, 20-29, 14h or holding:20, every=N or nth=N"
    expected = f"fault {shown(text)}: {shown(part)}: expected {forms}"
    start = _whole(first, expected)
    return {"addresses": range(start, (_whole(last, expected) if dash else start) + 1), "table": table or None}


def _number(text: str, expected: str, given: str = "=") -> float:
    if not given:
        return _DEFAULT_PROBABILITY
    try:
        number = float(text)
    except ValueError:
        raise EncodeError(expected) from None
    if "probability" in expected and not 0 <= number <= 1:
        raise EncodeError(expected)
    return number


def _whole(text: str, expected: str, base: int = 10) -> int:
    """Return a number in decimal (04 is four) or, as 0x14, 14h or with base 16, in hexadecimal."""
    digits = text.lower()
    if digits.endswith("h"):
        digits, base = digits[:-1], 16
    elif digits.startswith("0x"):
        base = 16
    try:
        return int(digits, base)
    except ValueError:
        raise EncodeError(expected) from None


def _near(name: object, known: Iterable[str]) -> str:
    from barewire.devices.device import suggest  # only errors need it

    return suggest(str(name), dict.fromkeys(known))


def _touched(pdu: bytes) -> Iterator[tuple[str, range]]:
    """Yield the table and the addresses that a request touches; nothing for functions without addresses."""
    table = _BY_FUNCTION.get(pdu[0]) if pdu else None
    if table is None or len(pdu) < 3:
        return
    for at in (1, 5) if pdu[0] == 0x17 else (1,):
        first, quantity = (int.from_bytes(pdu[place : place + 2], "big") for place in (at, at + 2))
        yield table, range(first, first + (1 if pdu[0] in _ONE_VALUE else quantity))
