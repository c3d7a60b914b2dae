"""Texts and tables for people: the range of a parameter, and the readings of one call as a table of a notebook."""

from __future__ import annotations

from barewire._html import html_table
from barewire.devices.parameter import Parameter, Reading, limits_text


def range_text(parameter: Parameter) -> str:
    """Return the range of a parameter, such as '0..300', '5', 'at most 7' or an empty text.

    >>> range_text(Parameter("Set-point", "u16", minimum=0, maximum=100))
    '0..100'
    >>> range_text(Parameter("Number of starts", "u16", maximum=7))
    'at most 7'
    """
    low, high = parameter.minimum, parameter.maximum
    return "" if low is None and high is None else limits_text(low, high)


class Readings(list[Reading]):
    """The readings of one call, in the order of the names."""

    def _repr_html_(self) -> str:
        rows = ((reading.name, reading.parameter.text(reading.value)) for reading in self)
        return html_table(("name", "value"), rows)
