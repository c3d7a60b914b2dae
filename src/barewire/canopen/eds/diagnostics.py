"""Diagnostics of an EDS: the closed list of rules, and the report of a broken one.

    12: number-form: [1018] SubNumber = 3h: another notation of a number; read as that number
    |   |            |                      |
    |   |            place and content      the text of the rule, from PARSE_RULES or LINT_RULES
    |   rule
    line of the file, from 1; 0 is the file as a whole

`PARSE_RULES` are checked by `parse`. Each is a departure from CiA 306 (or, as an octal number, from what the author
probably meant). It has a defined reading, so that the file can be used; only `strict=True` makes it an error.
`LINT_RULES` are checked by `lint` of the workbench: the file can be read without doubt, but lacks keys or contradicts
itself.
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
    "control-character": "a control character; ignored",
    # The lines
    "blanks": "blanks before or inside a name, or before the equals sign; ignored",
    "inline-comment": "a comment after other text; ignored",
    "foreign-comment": "comments begin with a semicolon; read as a comment",
    "conflict": "a merge conflict marker of a version control system; both sides are read",
    "no-equals": "neither a section, a key nor a comment; ignored",
    "colon": "a colon instead of the equals sign; read as one",
    "no-key": "a value without a key; ignored",
    "no-section": "a key before the first section; ignored",
    "section-open": "the section has no closing bracket; the rest of the line is its name",
    "behind-section": "text after the section; ignored",
    # The names
    "section-form": "another spelling of the section's name; read as that",
    "key-form": "another spelling of the key's name; read as that",
    "sub-range": "no such index or sub-index: 0000h to FFFFh, 00h to FFh; ignored",
    "duplicate-section": "the section occurs twice; both are read as one",
    "duplicate-key": "the key occurs twice; the first one is used",
    # Numbers and values
    "bad-number": "not a number; ignored",
    "number-form": "another notation of a number; read as that number",
    "leading-zeros": "a leading zero makes a number octal; read so, and as decimal if it has an 8 or a 9",
    "decimal-comma": "a comma in a number; read as a decimal point",
    "real-for-integer": "a number with a decimal point for an integer; read as that integer",
    "blanks-in-number": "blanks inside a number; ignored",
    "quoted": "quotes around the value; ignored",
    "empty": "the value is missing; read as if the key were missing",
    "bad-formula": "not a formula: expected $NODEID+number; ignored",
    "formula-form": "another notation of $NODEID+number; read as that",
    "unsigned-decimal": "a negative number as an unsigned decimal; read as negative",
    "out-of-range": "does not fit the data type; ignored",
    "hex-form": "bytes are pairs of hexadecimal digits, without a prefix or blanks; read without them",
    "bad-hex": "not pairs of hexadecimal digits; read as text",
    "bad-text": "characters that VISIBLE_STRING does not have; read as their bytes in UTF-8",
    # Objects
    "not-listed": "is in none of the three lists of objects; read all the same",
    "no-object": "listed, but there is no such section; ignored",
    "listed-twice": "listed before",
    "no-parent": "sub-indices without a section for their object; read as a record",
    "no-subs": "an array or record without sub-indices; read as a variable",
    "subs-of-variable": "a variable with sub-indices; read as a record",
    "no-sub0": "no sub-index 0; one is made",
    "bad-object-type": "not an object type with a value; read as a variable",
    "no-name": "no ParameterName; the name of the section is used",
    "no-data-type": "no DataType; read as bytes",
    "own-data-type": "a data type defined in the file; read as the base type of its DEFTYPE",
    "bad-data-type": "no known data type and no DEFTYPE of it; read as bytes",
    "no-access": "no AccessType; read as ro",
    "access-form": "another word for the AccessType; read as that",
    "bad-access": "none of ro, wo, rw, rwr, rww and const; read as ro",
    "sub-type": "a sub-index has no sub-indices of its own; read as a variable",
    "limits-crossed": "LowLimit is above HighLimit; both are ignored",
    "compact-and-subs": "CompactSubObj and sub-indices; sections of sub-indices take precedence",
    "compact-variable": "CompactSubObj of a variable; read as an array",
    "compact-entry": "names or values of sub-indices that CompactSubObj does not make; ignored",
}

LINT_RULES: dict[str, str] = {
    "missing-section": "a section that every EDS must have is missing",
    "missing-key": "a key that the section must have is missing",
    "missing-object": "an object that every device must have is missing",
    "unknown-section": "CiA 306 defines no such section",
    "unknown-key": "CiA 306 defines no such key here",
    "capitals": "other capitals than in CiA 306; equal in CiA 306, but not for every tool",
    "key-not-here": "this key belongs to the sub-indices, not to their object",
    "long-line": "more than 255 characters",
    "date-form": "expected mm-dd-yyyy",
    "time-form": "expected hh:mm with AM or PM",
    "version-form": "expected a version: x.y for EDSVersion, 0 to 255 for the file",
    "wrong-list": "the object belongs to another list",
    "list-count": "the stated number of entries is wrong",
    "list-gap": "the entries are not numbered from 1 without gaps",
    "sub-number": "SubNumber is not the number of sub-indices",
    "sub0-type": "sub-index 0 is not UNSIGNED8",
    "sub0-value": "sub-index 0 is not the highest sub-index",
    "default-outside": "the value is outside of its limits",
    "flags": "only bits 0 and 1 of ObjFlags are defined",
    "identity": "[DeviceInfo] and object 1018h contradict each other",
    "granularity": "Granularity is 0 to 64 bits",
    "pdo-count": "the number of PDOs in [DeviceInfo] is not that of their records",
    "pdo-pair": "a PDO has only one of its two records",
    "pdo-mapping": "the mapping has an object that cannot be mapped",
    "pdo-bits": "more than 64 bits are mapped",
    "cob-id": "the identifier is reserved for another service",
    "commissioning": "not a valid value in this section",
}


class Diagnostic(NamedTuple):
    """One finding: the line, the rule, and a sentence."""

    line: int
    rule: str
    text: str

    def __str__(self) -> str:
        return f"{self.line}: {self.rule}: {self.text}"


def diagnostic(line: int, rule: str, found: str) -> Diagnostic:
    """Return a finding with the text of its rule.

    >>> print(diagnostic(3, "blanks", "1 = 0x1003"))
    3: blanks: 1 = 0x1003: blanks before or inside a name, or before the equals sign; ignored
    """
    rule_text = PARSE_RULES.get(rule) or LINT_RULES[rule]
    shown = found if len(found) <= 80 else found[:77] + "..."
    return Diagnostic(line, rule, f"{shown}: {rule_text}")


class EdsError(BarewireError, ValueError):
    """A file that departs from CiA 306, parsed with `strict=True`. It has all `diagnostics`."""

    def __init__(self, diagnostics: Sequence[Diagnostic]) -> None:
        self.diagnostics = tuple(diagnostics)
        rest = len(self.diagnostics) - 1
        super().__init__(f"line {self.diagnostics[0]}" + (f" (and {rest} more)" if rest else ""))
