"""EDS and DCF: a device's object dictionary as a text file, read and written without loss.   [CiA 306]

        [1017]                                 text of a key           eds.get, eds.put
        ParameterName=Heartbeat time           described objects       eds.objects            EdsObject, EdsItem
        DataType=0x0006                        objects of a device     eds.dictionary(5)      ObjectDictionary
        DefaultValue=1000 ; ms                 departures from CiA 306 eds.diagnostics

Files, in reading order:

    diagnostics     the closed list of rules          value_syntax    text <-> numbers, values
    document        bytes <-> lines, sections, keys; changes of single lines
    objects         sections -> EdsObject, EdsItem -> object dictionary
    eds_file        Eds; parse, compose and to_dcf; one key of an object, a new object

Files in the field break every rule. Each departure has a defined reading and a diagnostic with its line; `parse` raises
only if `strict`. Unchanged lines are written byte for byte as they were read.
"""

from barewire.canopen.eds.diagnostics import LINT_RULES, PARSE_RULES, Diagnostic, EdsError
from barewire.canopen.eds.eds_file import Eds, add_object, compose, parse, to_dcf
from barewire.canopen.eds.objects import EdsItem, EdsObject
from barewire.canopen.eds.value_syntax import Formula

__all__ = [
    "parse",
    "Eds",
    "compose",
    "to_dcf",
    "add_object",
    "EdsObject",
    "EdsItem",
    "Formula",
    "Diagnostic",
    "EdsError",
    "PARSE_RULES",
    "LINT_RULES",
]
