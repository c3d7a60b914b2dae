"""lss-talk: the services of an LSS master (CiA 305). A service is a generator: it yields a frame, is sent what comes.

7E5 # service, then what it says    the master
7E4 # service, then what it says    the devices: the same service, or 44 for 43, 4F for 46 to 4B and 51, 50 for 4C
"""

from can_frames import read_text
from texts import number, octets

SELECTED, IDENTIFIED, UNCONFIGURED = 0x44, 0x4F, 0x50
NO_NODE = 0xFF


class NoAnswer(Exception):
    """The time-out of an answer that must come."""


class Declined(Exception):
    """A device has refused: args are the error and its detail."""


def frame(service, *parts):
    """Return a frame of the master: its service, then numbers of one byte and bytes, filled up with zeros."""
    data = b"".join(part if isinstance(part, bytes) else bytes([part]) for part in (service, *parts))
    return f"7E5#{data.ljust(8, bytes(1)).hex().upper()}"


def long(text):
    """Return a number of four bytes, low byte first."""
    return octets(text)[::-1]


def answers(heard, service):
    """Return the answers of this service among the frames that have come."""
    frames = [read_text({"text": text})["frame"] for text in heard]
    found = [octets(one["data"]) for one in frames if one["id"] == "7E4"]
    return [data for data in found if len(data) == 8 and data[0] == service]


def asked(service, *parts):
    """Say a service and return the first answer."""
    found = answers((yield frame(service, *parts)), service)
    if not found:
        raise NoAnswer
    return found[0]


def configured(service, *parts):
    """Say a service whose answer has an error and its detail."""
    answer = yield from asked(service, *parts)
    if answer[1]:
        raise Declined(answer[1], answer[2])
    return {"done": True}


def serve(ask):
    """Carry out a service; return how it ends."""
    match ask["do"]:
        case "switch global":
            yield frame(0x04, ask["mode"])
            return {"done": True}
        case "activate bit rate":
            yield frame(0x15, ask["delay"] & 0xFF, ask["delay"] >> 8)
            return {"done": True}
        case "switch selective":
            for part, text in enumerate(ask["address"]):
                heard = yield frame(0x40 + part, long(text))
            return {"found": bool(answers(heard, SELECTED))}
        case "identify":
            for part, text in enumerate(ask["limits"]):
                heard = yield frame(0x46 + part, long(text))
            return {"count": len(answers(heard, IDENTIFIED))}
        case "identify unconfigured":
            return {"count": len(answers((yield frame(0x4C)), UNCONFIGURED))}
        case "inquire address":
            address = []
            for part in range(4):
                answer = yield from asked(0x5A + part)
                address.append(answer[4:0:-1].hex().upper())
            return {"address": address}
        case "inquire node":
            answer = yield from asked(0x5E)
            return {"node": None if answer[1] == NO_NODE else answer[1]}
        case "configure node":
            return (yield from configured(0x11, NO_NODE if ask["node"] is None else ask["node"]))
        case "configure bit rate":
            return (yield from configured(0x13, ask["table"], ask["entry"]))
        case "store":
            return (yield from configured(0x17))
    return (yield from fastscan(ask["known"]))


def fastscan(known):
    """Find the address of one device without a node-ID, bit by bit: 51, number, lowest bit, part, next part."""
    if not (yield from fits(0, 0x80, 0, 0)):
        return {"address": None}
    address = []
    for part, text in enumerate(known):
        value = 0 if text is None else int(text, 16)
        for bit in range(31, -1, -1) if text is None else ():
            if not (yield from fits(value, bit, part, part)):
                value |= 1 << bit  # nobody has a zero there
        if not (yield from fits(value, 0, part, (part + 1) % 4)):
            return {"address": None}
        address.append(f"{value:08X}")
    return {"address": address}


def fits(value, bit, part, following):
    """Return whether a device has this value down to this bit."""
    heard = yield frame(0x51, number(value, 4, "little"), bit, part, following)
    return bool(answers(heard, IDENTIFIED))


def run(given):
    """ask, talk -> talk, ends"""
    service, steps, ends = serve(given["ask"]), [{} for _ in given["talk"]], "it says more"
    try:
        says = next(service)
        for step, row in zip(given["talk"], steps):
            row["say"] = says
            says = service.send(step["hear"])
    except StopIteration as stop:
        ends = stop.value
    except NoAnswer:
        ends = {"no_answer": True}
    except Declined as declined:
        ends = {"error": declined.args[0], "detail": declined.args[1]}
    return {"talk": steps, "ends": ends}


KINDS = {"lss-talk": {"run": run}}
