"""What can be odd about an EDS: the closed list of rules, and what is reported when one is broken.

    12: number-form: [1018] SubNumber = 3h: another form of a number; read as meant
    |   |            |                      |
    |   |            where, and what        what a rule says, from RULES or LINT_RULES
    |   rule
    line of the file, from 1; 0 is the file as a whole

`PARSE_RULES` are checked by `parse`. Each is a departure from CiA 306 (or, as an octal number, from what was probably
meant) with a defined reading, so that the file can be used; only `strict=True` makes it an error.
`LINT_RULES` are checked by `lint`: the file can be read without doubt, but keys are missing, or two places contradict
each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from barewire.errors import BarewireError

PARSE_RULES: dict[str, str] = {
    # The text
    "byte-order-mark": "the file begins with a byte order mark",
    "not-ascii": "characters beyond ASCII",
    "line-ends": "another line end than in the line before",
    "control-character": "a character that is none; read over",
    # The lines
    "blanks": "blanks before or inside a name, or before the equals sign; read over",
    "inline-comment": "a comment behind something; read over",
    "foreign-comment": "comments begin with a semicolon; read as one",
    "conflict": "a mark of a version control that could not merge; both sides are read",
    "no-equals": "neither a section, a key nor a comment; read over",
    "colon": "a colon in place of the equals sign; read as one",
    "no-key": "a value without a key; read over",
    "no-section": "a key before the first section; read over",
    "section-open": "the section has no closing bracket; the rest of the line is its name",
    "behind-section": "something behind the section; read over",
    # The names
    "section-form": "another form of the section's name; read as meant",
    "key-form": "another form of the key's name; read as meant",
    "sub-range": "no such index or sub-index: 0000h to FFFFh, 00h to FFh; read over",
    "duplicate-section": "the section was there before; both are read as one",
    "duplicate-key": "the key was there before; the first one counts",
    # Numbers and values
    "bad-number": "not a number; read over",
    "number-form": "another form of a number; read as meant",
    "leading-zeros": "a leading zero makes a number octal; read so, and as decimal if it has an 8 or a 9",
    "decimal-comma": "a comma in a number; read as a point",
    "real-for-integer": "a number with a point for an integer; read as meant",
    "blanks-in-number": "blanks inside a number; read over",
    "quoted": "quotes around the value; read over",
    "empty": "the value is missing; read as if the key were",
    "bad-formula": "no formula: expected $NODEID+number; read over",
    "formula-form": "another form of $NODEID+number; read as meant",
    "unsigned-decimal": "a negative number written as a decimal without its sign; read as meant",
    "out-of-range": "does not fit the data type; read over",
    "hex-form": "bytes are pairs of hexadecimal digits, without a prefix or blanks; read as meant",
    "bad-hex": "no hexadecimal digits, two for each byte; read as text",
    "bad-text": "characters that VISIBLE_STRING does not have; taken as their bytes in UTF-8",
    # Objects
    "not-listed": "stands in none of the three lists of objects; read all the same",
    "no-object": "listed, but there is no such section; read over",
    "listed-twice": "listed before",
    "no-parent": "sub-indices without a section for their object; read as a record",
    "no-subs": "an array or record without sub-indices; read as a variable",
    "subs-of-variable": "a variable with sub-indices; read as a record",
    "no-sub0": "no sub-index 0; one is made",
    "bad-object-type": "no object type that has a value; read as a variable",
    "no-name": "no ParameterName; the place serves as a name",
    "no-data-type": "no DataType; read as bytes",
    "own-data-type": "a data type of the file's own; read as what its DEFTYPE says",
    "bad-data-type": "no known data type and no DEFTYPE of it; read as bytes",
    "no-access": "no AccessType; read as ro",
    "access-form": "another word for the AccessType; read as meant",
    "bad-access": "none of ro, wo, rw, rwr, rww and const; read as ro",
    "sub-type": "a sub-index has no sub-indices of its own; read as a variable",
    "limits-crossed": "LowLimit is above HighLimit; both are read over",
    "compact-and-subs": "CompactSubObj and sub-indices; what is told of a sub-index counts",
    "compact-variable": "CompactSubObj of a variable; read as an array",
    "compact-entry": "names or values for what CompactSubObj does not make; read over",
}

LINT_RULES: dict[str, str] = {
    "missing-section": "a section that every EDS must have is missing",
    "missing-key": "a key that the section must have is missing",
    "missing-object": "an object that every device must have is missing",
    "unknown-section": "CiA 306 has no such section",
    "unknown-key": "CiA 306 has no such key here",
    "capitals": "other capitals than in CiA 306; the same to it, but not to every tool",
    "key-not-here": "the sub-indices tell this, their object does not",
    "long-line": "more than 255 characters",
    "date-form": "expected mm-dd-yyyy",
    "time-form": "expected hh:mm with AM or PM",
    "version-form": "expected a version: x.y for EDSVersion, 0 to 255 for the file",
    "wrong-list": "the object belongs into another list",
    "list-count": "the number of entries is another one",
    "list-gap": "the entries are not numbered from 1 without gaps",
    "sub-number": "SubNumber is not the number of sub-indices",
    "sub0-type": "sub-index 0 is not UNSIGNED8",
    "sub0-value": "sub-index 0 does not tell the highest sub-index",
    "default-outside": "the value lies outside of its limits",
    "flags": "only bits 0 and 1 of ObjFlags are defined",
    "identity": "[DeviceInfo] and object 1018h contradict each other",
    "granularity": "Granularity is 0 to 64 bits",
    "pdo-count": "the number of PDOs in [DeviceInfo] is not that of their records",
    "pdo-pair": "a PDO has one of its two records only",
    "pdo-mapping": "the mapping names what cannot be mapped",
    "pdo-bits": "more than 64 bits are mapped",
    "cob-id": "the identifier is reserved for another service",
    "commissioning": "not what the section must say",
}


class Diagnostic(NamedTuple):
    """One oddity: the line, the rule, and a sentence."""

    line: int
    rule: str
    text: str

    def __str__(self) -> str:
        return f"{self.line}: {self.rule}: {self.text}"


def diagnostic(line: int, rule: str, what: str) -> Diagnostic:
    """An oddity with the sentence that its rule has.

    >>> print(diagnostic(3, "blanks", "1 = 0x1003"))
    3: blanks: 1 = 0x1003: blanks before or inside a name, or before the equals sign; read over
    """
    says = PARSE_RULES.get(rule) or LINT_RULES[rule]
    shown = what if len(what) <= 80 else what[:77] + "..."
    return Diagnostic(line, rule, f"{shown}: {says}")


class EdsError(BarewireError, ValueError):
    """A file that is not as CiA 306 wants it, and was to be read strictly. All of its `diagnostics` come along."""

    def __init__(self, diagnostics: Sequence[Diagnostic]) -> None:
        self.diagnostics = tuple(diagnostics)
        rest = len(self.diagnostics) - 1
        super().__init__(f"line {self.diagnostics[0]}" + (f" (and {rest} more)" if rest else ""))
