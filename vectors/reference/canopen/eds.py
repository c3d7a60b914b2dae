"""eds: lines of an EDS or a DCF (CiA 306) and the objects that they describe.

[2100]                 a section: index 2100h
ParameterName=Speed    key=value, the key in any capitals
[2100sub1]             index 2100h, sub-index 1h
"""

import re

from eds_values import TYPES, read, whole

ACCESS = ("ro", "wo", "rw", "rwr", "rww", "const")
VALUES = {"default": "defaultvalue", "low": "lowlimit", "high": "highlimit", "value": "parametervalue"}
OBJECT = re.compile(r"([0-9a-f]{4})(?:sub([0-9a-f]{1,2}))?")
COMMENT = re.compile(r"\s+[;#].*")
UNSIGNED8 = 5


class File:
    """The sections of a file, name -> key -> (value, line), in small letters; and the lines that are wrong."""

    def __init__(self, lines):
        self.sections, self.heads, self.wrong = {}, {}, set()
        self.keys = None  # of the present section
        for number, line in enumerate(lines, 1):
            self.line(line.strip(), number)

    def line(self, text, number):
        """Read a line."""
        if not text or text[0] == ";":
            return
        if text[0] == "[":
            name = text.strip("[]").lower()
            if text[-1] != "]" or name in self.sections:
                self.wrong.add(number)
            self.keys = self.sections.setdefault(name, {})
            self.heads.setdefault(name, number)
            return
        key, equals, value = (part.strip() for part in text.partition("="))
        if not equals or not key or self.keys is None or key.lower() in self.keys:
            self.wrong.add(number)
        elif COMMENT.search(value):
            self.wrong.add(number)
            self.keys[key.lower()] = (COMMENT.sub("", value), number)
        else:
            self.keys[key.lower()] = (value, number)

    def objects(self):
        """Return the objects in their order; note what is wrong in them."""
        found = {}
        for name, keys in self.sections.items():
            match = OBJECT.fullmatch(name)
            if not match:
                continue
            index, sub = match[1].upper(), match[2]
            if sub is not None:
                found[f"{index}:{int(sub, 16):02X}"] = self.object(name, keys)
            elif "compactsubobj" in keys:
                found |= self.compact(name, keys)
            elif whole(self.text(keys, "objecttype", "7"))[0] in (2, 7):
                found[f"{index}:00"] = self.object(name, keys)
        return [{"object": place, **found[place]} for place in sorted(found)]

    def text(self, keys, key, default=""):
        """Return the text of a key."""
        return keys.get(key, (default, 0))[0]

    def object(self, name, keys):
        """Return the fields of one object."""
        code, _ = whole(self.text(keys, "datatype"))
        access = self.text(keys, "accesstype", "ro").lower()
        if code not in TYPES:
            self.wrong.add(keys["datatype"][1] if "datatype" in keys else self.heads[name])
        if access not in ACCESS:
            self.wrong.add(keys["accesstype"][1])
            access = "ro"
        fields = {"name": self.text(keys, "parametername"), "type": TYPES.get(code), "access": access}
        for field, key in VALUES.items():
            text, number = keys.get(key, ("", 0))
            fields[field], right = read(code, text)
            if not right:
                self.wrong.add(number)
        if fields["low"] and fields["high"] and float(fields["low"]) > float(fields["high"]):
            fields["low"] = fields["high"] = None
        return fields | {"mapped": whole(self.text(keys, "pdomapping", "0"))[0] == 1}

    def compact(self, name, keys):
        """Return the objects of CompactSubObj: sub-index 0, and a number of others of one type."""
        index, count = name.upper(), whole(self.text(keys, "compactsubobj"))[0]
        names, values = (self.sections.get(name + part, {}) for part in ("name", "value"))
        whole_number = {"datatype": (str(UNSIGNED8), 0), "accesstype": ("ro", 0), "defaultvalue": (str(count), 0)}
        found = {f"{index}:00": self.object(name, whole_number)}
        for sub in range(1, count + 1):
            own = {"parametername": names.get(str(sub), keys.get("parametername", ("", 0)))}
            if str(sub) in values:
                own["parametervalue"] = values[str(sub)]
            found[f"{index}:{sub:02X}"] = self.object(name, keys | own)
        return found


def read_objects(given):
    """lines -> objects"""
    return {"objects": File(given["lines"]).objects()}


def check(given):
    """lines -> wrong"""
    file = File(given["lines"])
    file.objects()
    return {"wrong": sorted(file.wrong)}


KINDS = {"eds": {"read": read_objects, "check": check}}
