"""The parts of URLs, and the errors for wrong ones."""

from __future__ import annotations

from urllib.parse import parse_qsl, unquote as their_unquote, urlsplit

import pytest
from hypothesis import example, given, reject, strategies as st

from barewire.errors import EncodeError
from barewire.io.endpoint import CARRIERS, Endpoint, pairs, split, unquote
from barewire.io.modbus.carriers import ModbusOptions, unit_options
from tests.helpers import every_case, modest


@pytest.mark.parametrize(
    ("url", "scheme", "place"),
    [
        ("tcp://127.0.0.1:1502?unit=1", "tcp", "127.0.0.1:1502"),
        ("rtu:///dev/ttyUSB0", "rtu", "/dev/ttyUSB0"),
        ("rtu:///dev/pts/3?parity=N", "rtu", "/dev/pts/3"),
        ("ascii://COM3", "ascii", "COM3"),
        ("rtu://pty", "rtu", "pty"),
        ("rtu://PTY?unit=2", "rtu", "pty"),
        ("can://socketcan/can0?node=5", "can", "socketcan/can0"),
        ("can://slcan//dev/ttyACM0", "can", "slcan//dev/ttyACM0"),
    ],
)
def test_the_parts_of_a_url(url: str, scheme: str, place: str) -> None:
    endpoint = Endpoint.parse(url)
    assert (endpoint.scheme, endpoint.place) == (scheme, place)


@every_case(
    ("url", "message"),
    [
        ("127.0.0.1:502", "expected tcp://HOST:PORT"),
        ("tpc://127.0.0.1", "can://...; did you mean 'tcp'"),
        ("http://127.0.0.1", "expected tcp://HOST:PORT"),
        ("tcp://", "it names no port"),
        ("tcp://127.0.0.1?units=1", "unknown option 'units', expected any_transaction, any_unit"),
        ("tcp://127.0.0.1?units=1", "unit, of servers also connections, idle; did you mean 'unit'"),
        ("tcp://127.0.0.1?node=1", "; did you mean 'unit'?"),
        ("can://socketcan", "expected can://INTERFACE/CHANNEL"),
        ("tcp:127.0.0.1", "expected tcp://HOST:PORT"),
        ("tcp://[::1", "an IPv6 address stands in brackets"),
        ("tcp://[gateway]:502", "an IPv6 address stands in brackets"),
        ("tcp://a..b:502", "cannot be the name of a host"),
        ("tls://10.0.0.5?server_name=", "server_name='': expected a name or address"),
        ("tls://10.0.0.5?server_name=%00", "server_name='\\x00': expected a name or address"),
        ("tls://10.0.0.5?server_name=.", "server_name='.': expected"),
        ("tls://10.0.0.5?server_name=.local", "server_name='.local': expected"),
        ("tls://10.0.0.5?server_name=a..b", "server_name='a..b': expected"),
        ("tls://10.0.0.5?server_name=" + 300 * "a", "aaa...: expected a name or address"),
        ("tls://10.0.0.5?server_name=" + 150 * "a." + "a", "a....: expected a name or address"),
        ("tcp://127.0.0.1:99999", "port '99999' is not a number in 0..65535"),
        ("tcp://127.0.0.1:" + "9" * 5000, "999...: port '999"),
        ("rtu:///tmp/a%00b", "it names no port"),
        ("rtu:///dev/x?unit=1&unit=2", "an option is given twice"),
        ("rtu:///dev/x?unit=256", "expected 0..255"),
        ("rtu:///dev/x?bytesize=7", "RTU needs 8 data bits"),
        ("rtu:///dev/tty#1", "'#' has no meaning in an endpoint; in a name it is %23"),
        ("tcp://::1", "an IPv6 address stands in brackets"),
        ("tcp://fe80::1:502", "an IPv6 address stands in brackets"),
        ("tcp:///", "it names no port"),
        ("tcp://127.0.0.1?dead_after=-1", "dead_after -1: expected 0..1000000"),
        ("tcp://127.0.0.1?unit=-1", "unit -1: expected 0..255"),
        ("tcp://127.0.0.1?gap.7=soon", "gap.7='soon' is not a number of seconds"),
        ("tcp://127.0.0.1?dead_after.7=-1", "dead_after.7 -1: expected 0..1000000"),
        ("tcp://127.0.0.1?gap.256=1", "'gap.256': expected gap.UNIT, a unit address in 0..255, such as gap.7"),
        ("tcp://127.0.0.1?gap.=1", "'gap.': expected gap.UNIT"),
        ("tcp://127.0.0.1?gap.07=1", "'gap.07': expected gap.UNIT"),
        ("tcp://127.0.0.1?gpa.7=1", "unknown option 'gpa.7', expected dead_after.7, gap.7, longest_pause.7, timeout.7"),
        ("tcp://127.0.0.1?gpa.7=1", "did you mean 'gap.7'?"),
        ("tcp://127.0.0.1?retries.7=1", "unknown option 'retries.7', expected dead_after.7, gap.7"),
        ("can://socketcan/can0?timeout.7=1", "unknown option 'timeout.7'"),
        ("tcp://127.0.0.1?idle=300?unit=5", "a second '?': options are joined with '&'"),
        ("tcp://127.0.0.1?idle=soon", "idle='soon' is not a number of seconds"),
        ("tcp://127.0.0.1?connections=0", "connections 0: expected 1..1000000"),
        ("tcp://127.0.0.1?any_unit=yes", "any_unit='yes', expected one of 0, 1"),
        ("udp://127.0.0.1?recovery=hope", "recovery='hope', expected one of probe, wait"),
        ("tcp://127.0.0.1?timeout=nan", "timeout='nan' is not a number of seconds"),
        ("rtu:///dev/x?baudrate=0", "baudrate 0: expected 1..100000000"),
        ("rtu:///dev/x?retries=1001", "retries 1001: expected 0..1000"),
        ("can://socketcan/can0?retries=" + "9" * 30, "9: expected 0..1000"),
        ("rtu:///dev/x?retries=\u0665", "is not a whole number"),
        ("rtu:///dev/x?timeout=\u0665", "is not a number of seconds"),
        ("tcp://127.0.0.1:\u0665\u0660\u0662", "is not a number in 0..65535"),
        ("rtu:///dev/x?parity=Q", "parity='Q', expected one of N, E, O"),
        ("rtu:///dev/x?parity=", "parity='', expected one of N, E, O"),
        ("rtu:///dev/x?latency=fast", "latency='fast', expected one of uart, usb, tunnel"),
        ("rtu+tcp://10.0.0.5:4001?patience=long", "patience='long' is not a number of seconds"),
        ("ascii:///dev/x?patience=strict", "patience='strict' is not a number of seconds"),
        ("rtu:///dev/x?pace=2", "pace='2', expected one of 0, 1"),
        ("can://socketcan/can0?node=0", "node 0: expected 1..127"),
        ("can://socketcan/can0?bitrate=fast", "bitrate='fast' is not a whole number"),
        ("can://slcan//dev/ttyACM0?bitrate=125", "bitrate 125: expected 1000..1000000"),
        ("can://slcan//dev/ttyACM0?bitrate=2000000", "bitrate 2000000: expected 1000..1000000"),
        ("can://socketcand/127.0.0.1:" + "9" * 5000 + "/can0", "port 999999999 is not a number in 0..65535"),
        ("can://socketcand/127.0.0.1:99999/can0", "is not a number in 0..65535"),
    ],
)
def test_a_wrong_url_is_an_error_of_one_line(url: str, message: str) -> None:
    with pytest.raises(EncodeError) as caught:
        Endpoint.parse(url)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("url", "host", "port"),
    [
        ("tcp://127.0.0.1", "127.0.0.1", 502),
        ("tcp://gateway:802", "gateway", 802),
        ("tcp://[::1]:1502", "::1", 1502),
        ("tcp://[::1]", "::1", 502),
    ],
)
def test_host_and_port(url: str, host: str, port: int) -> None:
    assert Endpoint.parse(url).host_and_port == (host, port)


@pytest.mark.parametrize("url", ["tcp://127.0.0.1:x", "tcp://127.0.0.1:70000"])
def test_a_wrong_port_number_is_an_error(url: str) -> None:
    with pytest.raises(EncodeError, match=r"is not a number in 0\.\.65535"):
        Endpoint.parse(url)


def test_options_are_integers_seconds_or_choices() -> None:
    endpoint = Endpoint.parse("rtu:///dev/x?unit=0x11&timeout=0.5&parity=e")
    assert endpoint.integer("unit", 1) == 17
    assert endpoint.seconds("timeout", 1.0) == 0.5
    assert endpoint.choice("parity", "N") == "E"
    assert endpoint.integer("baudrate", 19200) == 19200


def test_patience_strict_is_accepted_for_rtu_only() -> None:
    assert Endpoint.parse("rtu:///dev/x?patience=strict").options["patience"] == "strict"
    assert Endpoint.parse("rtu+tcp://10.0.0.5:4001?patience=strict").options["patience"] == "strict"


@pytest.mark.parametrize("query", ["unit=x", "timeout=-1", "timeout=soon", "timeout=nan", "parity=Q"])
def test_an_error_names_the_wrong_option(query: str) -> None:
    with pytest.raises(EncodeError, match=query.partition("=")[0]):
        Endpoint.parse(f"rtu:///dev/x?{query}")


def test_the_keywords_for_type_checkers_are_the_options_of_all_carriers() -> None:
    options = frozenset().union(*(carrier.options for carrier in CARRIERS.values()))
    assert set(ModbusOptions.__annotations__) == options - {"unit", "timeout"}


def test_a_unit_has_its_own_options_and_else_those_of_all_units() -> None:
    endpoint = Endpoint.parse("rtu:///dev/x?timeout=0.5&gap=0.1&gap.7=0&dead_after.9=2&longest_pause.9=4")
    assert endpoint.own_units == [7, 9]
    assert unit_options(endpoint) == unit_options(endpoint, 1) == (0.5, 0.1, 0, 30.0)
    assert unit_options(endpoint, 7) == (0.5, 0.0, 0, 30.0)
    assert unit_options(endpoint, 9) == (0.5, 0.1, 2, 4.0)


# The three parts of a URL, compared with `urllib`

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
