"""The three parts of a URL, compared with `urllib`."""

from __future__ import annotations

from urllib.parse import parse_qsl, unquote as their_unquote, urlsplit

from hypothesis import example, given, reject, strategies as st

from barewire.io.url import pairs, split, unquote
from tests.helpers import modest

# urllib removes control characters, which stay here; "#" begins a fragment there, and is refused by Endpoint.
PLAIN = st.characters(exclude_categories=("Cc", "Cs"), exclude_characters="#")
TEXT = st.text(st.sampled_from("ab/:?&=+%2fF3éC.[]; ") | PLAIN, max_size=30)


@modest
@given(TEXT)
@example("%")
@example("%2")
@example("%zz%41")
@example("%C3%A9%FF")
@example("a%%41")
def test_quoted_text(text: str) -> None:
    assert unquote(text) == their_unquote(text)


@modest
@given(TEXT)
@example("a=1&&b&c=&=d&a=2")
@example("a=1;b=2")
def test_options(query: str) -> None:
    assert pairs(query) == parse_qsl(query, keep_blank_values=True)


@modest
@given(st.sampled_from(("tcp", "RTU", "rtu+tcp", "can")), TEXT)
@example("tcp", "[::1]:502?unit=1")
@example("rtu", "/dev/ttyUSB0")
@example("tcp", "10.0.0.5?a?b")
def test_the_three_parts(scheme: str, rest: str) -> None:
    url = f"{scheme}://{rest}".strip()
    try:
        theirs = urlsplit(url)
    except ValueError:
        reject()  # brackets around something other than an IPv6 address: Endpoint checks hosts itself
    assert split(url) == (theirs.scheme, theirs.netloc + theirs.path, theirs.query)


def test_a_text_without_colon_and_slashes_is_not_a_url() -> None:
    assert split("tcp:127.0.0.1") == ("", "", "")


def test_a_lone_surrogate_in_a_path_is_accepted() -> None:
    assert unquote("/dev/\udcff") == "/dev/\udcff"
    assert unquote("/dev/\udcff%41").endswith("A")
