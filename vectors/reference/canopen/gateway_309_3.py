"""gateway-309-3: the text gateway of CiA 309-3: lines in, frames and lines out.

[sequence] [[net] node] command         [5] 1 7 read 0x6041 0 u16
[sequence] value, OK or ERROR:code      [5] 1591
"""

import re

from can_frames import read_text
from gateway_values import SYNTAX, TYPES, Wrong, bytes_of, integer, text_of
from lss_talk import Declined, NoAnswer, serve
from sdo_blocks import Abort, Aborted, line_of, place_of
from sdo_client import download, upload
from texts import hexed, octets

NO_COMMAND, NO_NET, NO_NODE, OTHER_NET, OTHER_NODE, LSS_FAILED = 100, 104, 105, 106, 107, 501
NMT = {"start": 0x01, "stop": 0x02, "preop": 0x80, "preoperational": 0x80}
RESET = {"node": 0x81, "comm": 0x82, "communication": 0x82}
LSS = {
    "lss_switch_glob": ("switch global", "mode", 1),
    "lss_switch_sel": ("switch selective", "address", 4),
    "lss_set_node": ("configure node", "node", 1),
    "lss_get_node": ("inquire node", "", 0),
    "lss_store": ("store", "", 0),
}


class Gateway:
    """A gateway with one net."""

    def __init__(self, net):
        self.own_net = self.net = net
        self.node, self.says, self.hears = None, [], iter(())

    def line(self, text, hear):
        """Answer a line; return the frames that are said and the lines that are sent."""
        self.says, self.hears = [], iter(hear)
        words = re.findall(r'"[^"]*"|[^\s#"]+|#.*', text)
        words = [word for word in words if word[0] != "#"]
        if not words:
            return {"say": [], "text": []}
        try:
            result = self.command(*self.addressed(words[1:]))
        except Wrong as wrong:
            result = f"ERROR:{wrong.args[0]}"
        except (Abort, Aborted) as abort:
            result = f"ERROR:0x{abort.args[0]:08X}"
        return {"say": self.says, "text": [f"{words[0]} {result}"]}

    def addressed(self, words):
        """Return the net, the node and the rest of a line. Each is the default one if the line has none."""
        numbers = []
        while words and words[0][0].isdigit() and len(numbers) < 2:
            numbers.append(integer(words[0], 255))
            words = words[1:]
        if not words:
            raise Wrong(SYNTAX)
        net = numbers[0] if len(numbers) > 1 else self.net
        return net, numbers[-1] if numbers else self.node, words

    def command(self, net, node, words):
        """Carry out a command; return its result."""
        name, words = words[0], words[1:]
        if name == "set":
            return self.default(words)
        if name in LSS:
            return self.lss(*LSS[name], words)
        if name not in (*NMT, "reset", "r", "read", "w", "write"):
            raise Wrong(NO_COMMAND)
        if not net:
            raise Wrong(NO_NET)
        if net != self.own_net:
            raise Wrong(OTHER_NET)
        if node is None:
            raise Wrong(NO_NODE)
        if node > 127 or (node == 0 and name[0] in "rw" and name != "reset"):
            raise Wrong(OTHER_NODE)
        if name in NMT or name == "reset":
            if name == "reset" and (not words or words[0] not in RESET):
                raise Wrong(SYNTAX)
            self.says.append(f"000#{NMT[name] if name in NMT else RESET[words[0]]:02X}{node:02X}")
            return "OK"
        return self.sdo(node, name[0] == "r", words)

    def default(self, words):
        """Set the default net or node."""
        value = integer(words[1], 255)
        if words[0] == "node":
            self.node = value
        elif value in (0, self.own_net):
            self.net = value
        else:
            raise Wrong(OTHER_NET)
        return "OK"

    def sdo(self, node, is_read, words):
        """Read or write an object."""
        if len(words) != (3 if is_read else 4) or words[2] not in TYPES:
            raise Wrong(SYNTAX)
        given = {"index": f"{integer(words[0], 0xFFFF):04X}", "sub": f"{integer(words[1], 0xFF):02X}"}
        if is_read:
            value, _ = self.transfer(node, given, upload(given))
            return text_of(words[2], value)
        self.transfer(node, given, download(given | {"value": hexed(bytes_of(words[2], words[3]))}))
        return "OK"

    def transfer(self, node, given, side):
        """Exchange the frames of an SDO transfer; return its result."""
        try:
            lines = next(side)
            while True:
                heard = []
                for line in lines:
                    heard += self.say(f"{0x600 + node:03X}#{line.hex().upper()}", f"{0x580 + node:03X}")
                lines = side.send(heard[0] if heard else None)
        except StopIteration as stop:
            return stop.value
        except Abort as abort:
            self.say(
                f"{0x600 + node:03X}#{line_of(0x80, place_of(given), abort.args[0].to_bytes(4, 'little')).hex()}", ""
            )
            raise

    def say(self, text, answered_by):
        """Say a frame; return the data of the frames with this identifier that come then."""
        self.says.append(text.upper())
        frames = [read_text({"text": one})["frame"] for one in next(self.hears, ())]
        return [octets(frame["data"]) for frame in frames if frame["id"] == answered_by]

    def lss(self, service, field, count, words):
        """Carry out a service of the LSS master."""
        if len(words) != count:
            raise Wrong(SYNTAX)
        values = [integer(word, 0xFFFFFFFF) for word in words]
        given = [f"{value:08X}" for value in values] if field == "address" else sum(values)
        process = serve({"do": service, field: given})
        try:
            says = next(process)
            while True:
                self.says.append(says)
                says = process.send(next(self.hears, ()))
        except StopIteration as stop:
            return str(stop.value["node"]) if "node" in stop.value else "OK"
        except (NoAnswer, Declined):
            raise Wrong(LSS_FAILED) from None


def run(given):
    """net, lines -> lines"""
    gateway = Gateway(given.get("net", 1))
    return {"lines": [gateway.line(row["line"], row.get("hear", [])) for row in given["lines"]]}


KINDS = {"gateway-309-3": {"run": run}}
