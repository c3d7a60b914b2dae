"""Conditions under which a row is written: `--when "STATUS WORD.3 == 1"`.

    NAME[.BIT] OPERATOR VALUE

    STATUS WORD.3 == 1          bit 3
    L1 current > 12.5           in the unit of the parameter
    Status == "Starter ready"   the name of a value, or text
    adxl: Status != 2           of this machine, if several have the name

The operators are == != < <= > >=. A VALUE is written as for `barewire write`.
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from barewire.codecs import Value
from barewire.devices import Parameter, UnknownName
from barewire.errors import EncodeError, shown
from barewire_workbench.value_log.sample import Column, Watched, columns_of

_OPERATORS: dict[str, Callable[[Any, Any], bool]] = {
    "==": operator.eq,
    "!=": operator.ne,
    "<=": operator.le,
    ">=": operator.ge,
    "<": operator.lt,
    ">": operator.gt,
}
_FORM = re.compile(r"(?P<name>[^=!<>]+)(?P<operator>==|!=|<=|>=|<|>|=)(?P<value>[^=].*)", re.DOTALL)
_BIT = re.compile(r"(?P<name>.+)\.(?P<bit>\d{1,2})")


class Condition(NamedTuple):
    """A comparison of one value, or of one of its bits."""

    text: str
    column: Column
    bit: int | None
    compare: Callable[[Any, Any], bool]
    limit: Value

    def holds(self, value: Value) -> bool:
        """Return whether it is true of the value of its column.

        >>> from barewire import load
        >>> machine = Watched("tcp://127.0.0.1", load("csd-mt"), ("Status Word",))
        >>> [condition("Status Word.3 == 1", [machine], lambda *_: 0).holds(value) for value in (0, 8)]
        [False, True]
        """
        return self.compare(value if self.bit is None else int(value) >> self.bit & 1, self.limit)


def condition(text: str, machines: Sequence[Watched], parse_value: Callable[[Parameter, str], Value]) -> Condition:
    """Return the condition of a text; `parse_value` returns the VALUE of a parameter.

    Raises EncodeError for one that cannot be understood, UnknownName for a name.
    """
    match = _FORM.fullmatch(text.strip())
    if match is None or match["operator"] == "=":
        hint = "; equal is ==" if match else ""
        expected = f"expected NAME[.BIT] OPERATOR VALUE with {' '.join(_OPERATORS)}"
        raise EncodeError(f"condition {shown(text)}: {expected}, such as 'Status Word.3 == 1'{hint}")
    name = match["name"].strip()
    column, bit = _column(name, machines)
    if bit is not None:
        limit: Value = _bit_value(text, column, bit, match["value"].strip())
    else:
        value = parse_value(column.parameter, _unquoted(match["value"].strip()))
        value = column.parameter.shortened(value)
        limit = value.hex(" ").upper() if isinstance(value, bytes) else value  # as `values_of` has it
    if isinstance(limit, float) and not math.isfinite(limit):
        raise EncodeError(f"condition {shown(text)}: expected a number to compare with")
    if isinstance(limit, str) and match["operator"] not in ("==", "!="):
        raise EncodeError(f"condition {shown(text)}: a text is compared with == or !=")
    return Condition(text, column, bit, _OPERATORS[match["operator"]], limit)


def name_in(text: str) -> str:
    """Return the name in the text of a condition, without a bit behind it; empty if there is none."""
    match = _FORM.fullmatch(text.strip())
    name = match["name"].strip() if match else ""
    with_bit = _BIT.fullmatch(name)
    return with_bit["name"] if with_bit else name


def _column(name: str, machines: Sequence[Watched]) -> tuple[Column, int | None]:
    """Return the column of a name, and the bit that is behind it."""
    unknown: UnknownName | None = None
    with_bit = _BIT.fullmatch(name)
    for plain, bit in ((name, None), *(((with_bit["name"], int(with_bit["bit"])),) if with_bit else ())):
        found = []
        for number, watched in enumerate(machines):
            label, colon, rest = plain.partition(": ")
            own = rest if colon and label == watched.label else plain
            try:
                found.append(Column(number, watched.label, watched.device.find(own)))
            except UnknownName as error:
                unknown = unknown or error
        shown_columns = set(columns_of(machines))
        # A name of several machines is that of the one of which it is read.
        found = [column for column in found if column in shown_columns] or found
        if len(found) > 1:
            titles = " or ".join(repr(column.title) for column in found)
            raise EncodeError(f"{plain} is a name of several machines: write {titles}")
        if found:
            return found[0], bit
    assert unknown is not None
    raise unknown


def _bit_value(text: str, column: Column, bit: int, value: str) -> int:
    numbers = {"0": 0, "1": 1, "off": 0, "on": 1}
    if value.lower() not in numbers:
        raise EncodeError(f"condition {shown(text)}: a bit is 0 or 1")
    width = re.fullmatch(r"[iu](\d+)", column.parameter.type)
    if bit >= (int(width[1]) if width else 0):
        raise EncodeError(f"condition {shown(text)}: {column.parameter.name} has no bit {bit}")
    return numbers[value.lower()]


def _unquoted(value: str) -> str:
    is_quoted = len(value) > 1 and value[0] == value[-1] and value[0] in "'\""
    return value[1:-1] if is_quoted else value
