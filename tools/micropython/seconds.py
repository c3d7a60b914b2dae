"""Counts time in whole microseconds: every number of seconds in the sources becomes one of microseconds.

Many ports of MicroPython have floats of 32 bits. In these 86400.0 + 0.00175 is 86400.0: after a day of seconds the
silence before a frame is gone. Whole numbers are exact for ever. Durations that are rounded are rounded up.

    PATIENCE = 0.030             30000
    timeout: float = 1.0         1000000
    f"within {timeout:g} s"      "within {} us"

In the files that have times a float is a number of seconds, unless it is a factor.
"""

from __future__ import annotations

import ast
import math
import re
from fractions import Fraction

PER_SECOND = 1_000_000

_WITHOUT_TIMES = ("barewire.codecs", "barewire.errors")
"""Rooms whose floats are values."""


def microseconds(seconds: float) -> int:
    """Return a number of seconds, as it is written, in microseconds.

    >>> microseconds(1750e-6), microseconds(1e-7), microseconds(30.0)
    (1750, 1, 30000000)
    """
    return math.ceil(Fraction(repr(seconds)) * PER_SECOND)


class Seconds(ast.NodeTransformer):
    """Changes the numbers of one module, and the texts of its errors."""

    def visit_Constant(self, node: ast.Constant) -> ast.expr:
        return ast.Constant(microseconds(node.value)) if isinstance(node.value, float) else node

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        sides = (node.left, node.right)
        is_scaled = isinstance(node.op, (ast.Mult, ast.Div, ast.Pow))
        if not is_scaled or not any(isinstance(side, ast.Constant) for side in sides):
            self.generic_visit(node)
        return node

    def visit_JoinedStr(self, node: ast.JoinedStr) -> ast.expr:
        self.generic_visit(node)
        for part, after in zip(node.values, node.values[1:]):
            is_number = isinstance(part, ast.FormattedValue) and part.format_spec is not None
            if is_number and isinstance(after, ast.Constant) and re.match(r" s\b", str(after.value)):
                assert isinstance(part, ast.FormattedValue)
                part.format_spec = None
                after.value = " us" + str(after.value)[2:]
        return node


def count_in_microseconds(name: str, tree: ast.Module) -> None:
    """Change the times of a module."""
    if not name.startswith(_WITHOUT_TIMES):
        Seconds().visit(tree)
