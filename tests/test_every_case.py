"""`every_case` of the helpers checks each case, and fails with all that are wrong."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.helpers import every_case

checked: list[int] = []


@every_case("second", [10, 20])
@every_case(("first", "expected"), [(1, 1), pytest.param(2, 3, id="the two"), (4, 4), (5, 6)])
def wrong(first: int, expected: int, second: int, tmp_path: Path) -> None:
    checked.append(first + second)
    assert first == expected, tmp_path


def test_every_case_is_checked_and_all_wrong_ones_are_named(tmp_path: Path) -> None:
    checked.clear()
    with pytest.raises(AssertionError) as failure:
        wrong(tmp_path=tmp_path)
    assert checked == [11, 12, 14, 15, 21, 22, 24, 25]
    text = "\n".join(failure.value.__notes__)
    assert "2 of 4 cases are wrong:\nthe two\n" in text
    assert "first=5, expected=6\n" in text
    assert "2 of 2 cases are wrong:\nsecond=10\n" in text


def test_an_expected_error_that_does_not_come_is_a_wrong_case() -> None:
    @every_case("text", ["1", "one", "2"])
    def is_no_number(text: str) -> None:
        with pytest.raises(ValueError, match="one"):
            int(text)

    with pytest.raises(pytest.fail.Exception, match="DID NOT RAISE") as failure:
        is_no_number()
    assert failure.value.__notes__[0].startswith("2 of 3 cases are wrong:\ntext='1'\n")


def test_no_case_and_a_marked_case_are_refused() -> None:
    for cases in ([], [pytest.param(1, marks=pytest.mark.proof)]):
        with pytest.raises(ValueError, match=r"^expected cases of number, at least one, and none with a mark$"):
            every_case("number", cases)
