"""The file of `barewire save`: what is written is read again, and a wrong file is one clear error."""

from __future__ import annotations

from datetime import datetime, timedelta, timezone

import pytest
from hypothesis import given, strategies as st

from barewire_workbench.settings.compare import differences
from barewire_workbench.settings.saved import BadFile, SavedSettings, SavedValue

texts = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=20)
values = st.one_of(
    st.booleans(),
    st.integers(-(2**63), 2**64 - 1),
    st.floats(width=32, allow_nan=False),
    st.floats(allow_nan=False),
    texts,
)
saved_values = st.dictionaries(texts, st.builds(SavedValue, values, texts, texts), max_size=5)
zones = st.builds(timezone, st.integers(-14, 14).map(lambda hours: timedelta(hours=hours)))


@given(saved_values, saved_values, st.dictionaries(texts, texts, max_size=3), st.datetimes(timezones=zones))
def test_a_file_is_read_as_it_was_written(
    settings: dict[str, SavedValue], communication: dict[str, SavedValue], words: dict[str, str], time: datetime
) -> None:
    time = time.replace(microsecond=0)
    saved = SavedSettings("mine", "tcp://x", "My drive", time, words, settings, communication, words)
    again = SavedSettings.parse(saved.text().encode(), "file")
    assert again.text() == saved.text()
    assert (again.settings, again.communication) == (settings, communication)  # to the last digit
    assert (again.device, again.source, again.title, again.time) == ("mine", "tcp://x", "My drive", time)
    assert (again.identity, again.not_read) == (words, words)
    assert [difference for difference in differences(saved, again) if not difference.problem] == []
    assert list(again.settings) == list(settings)


def test_a_cut_file_is_refused_wherever_it_was_cut() -> None:
    limits = {name: SavedValue(2.5, "A", "holding 4") for name in ("Limit", "Low Limit")}
    text = SavedSettings("mine", "tcp://x", identity={"a": "b"}, settings=limits, communication=limits).text()
    for size in range(len(text.rstrip())):
        with pytest.raises(BadFile):
            SavedSettings.parse(text[:size].encode(), "file")
    with pytest.raises(BadFile, match=r"^file: cut: expected the line `# end`"):
        SavedSettings.parse("".join(text.splitlines(keepends=True)[:-2]).encode(), "file")
    added = SavedSettings.parse((text + '"More" = { value = 1 }\n').encode(), "file")
    assert list(added.communication) == [*limits, "More"]


GOOD = SavedSettings("mine", settings={"Limit": SavedValue(2.5, "A", "holding 4")}).text()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("format = ", "no TOML: "),
        ("\udcff", "no TOML: "),
        (GOOD.replace("2.5", "1" + "0" * 5000), "no TOML: "),
        (f"a = {'[' * 900}{']' * 900}", "(no TOML of|format = )"),
        (GOOD + ".".join("x" * 5000) + " = 1", "(no TOML of|.settings)"),
        ("", "format = None: expected 1"),
        ("[FileInfo]\nFileName=x", "no TOML: "),
        (GOOD.replace('"mine"', "7"), "device = 7: expected text"),
        (GOOD.replace('"mine"', '""'), "device = '': expected text"),
        (GOOD.replace("format = 1", "format = 2"), "format = 2: expected 1"),
        (GOOD.replace("format = 1", 'format = 1\ntime = "now"'), "time = 'now': expected a date and time"),
        (GOOD.replace("value = 2.5, ", ""), r"\[settings\] 'Limit' = .*: expected { value = "),
        (GOOD.replace("2.5", "[2]"), r"\[settings\] 'Limit': value = \[2\]: expected a number"),
        (GOOD.replace("unit", "unti"), r"\[settings\] 'Limit': 'unti': expected value, unit or address"),
        (GOOD.replace('"A"', "1"), r"\[settings\] 'Limit': expected unit and address as text"),
        (GOOD.replace("[settings]", "[[settings]]"), "settings = .*: expected a table"),
        (GOOD + "[not_read]\nX = 1\n", r"\[not_read\] 'X' = 1: expected text"),
    ],
)
def test_a_wrong_file_is_one_clear_error(text: str, message: str) -> None:
    with pytest.raises(BadFile, match=rf"^press.toml: {message}") as caught:
        SavedSettings.parse(text.encode("utf-8", "surrogateescape"), "press.toml")
    assert "\n" not in str(caught.value)
