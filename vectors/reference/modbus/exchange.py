"""exchange: whether a response is the answer to a request. Only the fields that must be those of the request count."""

from pdu import read
from texts import Refused, bits_of, bitted, octets, words

ECHOES = (5, 6, 0x15, 0x16)
"""Functions whose response is the request, byte by byte."""


def accept(given):
    """request, response -> message or exception_code"""
    request, response = octets(given["request"]), octets(given["response"])
    if not response:
        raise Refused("short")
    if response[0] == request[0] | 0x80:
        message = read("response", response)[1]
        return {"exception_code": message.get("exception_code", 0xFF)}
    if response[0] != request[0]:
        raise Refused("mismatch")
    asked, found = read("request", request)[1], read("response", response)[1]
    if not fits(request, asked, response, found):
        raise Refused("mismatch")
    if "bits" in found:
        return {"message": {"bits": bitted(bits_of(found["bits"])[: asked["quantity"]])}}
    return {"message": found}


def fits(request, asked, response, found):
    """Return whether a response belongs to its request."""
    code = request[0]
    if code in ECHOES:
        return request == response
    if code in (1, 2):
        return len(bits_of(found["bits"])) == (asked["quantity"] + 7) // 8 * 8
    if code in (3, 4):
        return len(words(found["registers"])) == asked["quantity"]
    if code == 8:
        echo = asked["sub_function"] in (0, 1, 3, 0x0A, 0x14)
        return found == asked if echo else found["sub_function"] == asked["sub_function"]
    if code in (0x0F, 0x10):
        return response == request[:5]
    if code == 0x14:
        return [place["length"] for place in asked["places"]] == [len(words(one)) for one in found["records"]]
    if code == 0x17:
        return len(words(found["registers"])) == asked["read_quantity"]
    if code == 0x2B and request[1] != response[1]:
        return False
    if "node" in asked:
        same = all(asked[name] == found[name] for name in ("node", "index", "sub_index", "start", "write", "dialect"))
        return same and found["count"] <= asked["count"]
    if code == 0x2B:
        return found["read_code"] == asked["read_code"]
    return True


KINDS = {"exchange": {"decode": accept}}
