"""EDS files of a few objects."""

from __future__ import annotations

from barewire.canopen import eds


def described(*objects: str) -> eds.Eds:
    """Return an EDS of variables, given as 'index name type-code access' and further keys."""
    lines = []
    for text in objects:
        index, name, code, access, *more = text.split()
        lines += [
            f"[{index}]",
            f"ParameterName={name}",
            "ObjectType=7",
            f"DataType={code}",
            f"AccessType={access}",
            *more,
        ]
    return eds.parse("\r\n".join([*lines, ""]).encode())
