"""EDS and DCF: a device's object dictionary as a text file, read and written without loss.   [CiA 306]

        [1017]                             "what the file says"        document.get, put      text of a key
        ParameterName=Heartbeat time       "what it means"             document.objects       EdsObject, EdsItem
        DataType=0x0006                    "what a device has of it"   document.dictionary(5) ObjectDictionary
        DefaultValue=1000 ; ms             "what is odd about it"      document.diagnostics, lint(document)

    lines     bytes <-> lines, each in pieces          names     sections and keys, and how else they are spelled
    document  lines -> sections; changing a line       values    numbers, formulas, data types <-> text
    read      sections -> objects                      objects   objects -> the dictionary of a device
    compact   sub-indices and PDOs without sections    compose   from scratch; EDS -> DCF; one key of an object
    rules     the closed list of oddities              lint      what is missing, what contradicts itself

Files in the wild break every rule. Each has an answer here and a diagnostic with its line; `parse` raises nothing,
unless it is told to be strict. What nobody changed is written byte for byte as it came.

I know: the text of CiA 306.  I never know: files on a disk, buses.
"""

from barewire.canopen.eds.diagnostics import LINT_RULES, PARSE_RULES, Diagnostic, EdsError
from barewire.canopen.eds.document import Document, parse
from barewire.canopen.eds.lint import lint
from barewire.canopen.eds.model import EdsItem, EdsObject
from barewire.canopen.eds.value_syntax import Formula
from barewire.canopen.eds.writer import add_object, compose, to_dcf

__all__ = [
    "parse",
    "Document",
    "lint",
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
