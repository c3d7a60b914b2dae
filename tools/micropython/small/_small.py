"""What MicroPython lacks of Python, as far as the stack needs it. Only what is used goes into an edition."""

from struct import calcsize, pack, unpack, unpack_from


class Record:
    """The base of what was a dataclass."""

    _fields = ()

    def __eq__(self, other):
        if type(self) is not type(other):
            return False
        return all(getattr(self, name) == getattr(other, name) for name in self._fields)

    def __repr__(self):
        values = ", ".join(f"{name}={getattr(self, name)!r}" for name in self._fields)
        return f"{type(self).__name__}({values})"


class Row(Record):
    """The base of what was a NamedTuple."""

    def __iter__(self):
        return iter(self[:])

    def __getitem__(self, place):
        return tuple(getattr(self, name) for name in self._fields)[place]

    def __len__(self):
        return len(self._fields)


# bisect, collections, contextlib, copy, dataclasses, functools, operator


def bisect_insort(row, item):
    place = len(row)
    while place and item < row[place - 1]:
        place -= 1
    row.insert(place, item)


class collections_deque(list):
    def __init__(self, row=(), maxlen=None):
        super().__init__(row)
        self._most = maxlen

    def append(self, item):
        if len(self) == self._most:
            self.pop(0)
        super().append(item)

    def appendleft(self, item):
        if len(self) == self._most:
            self.pop()
        self.insert(0, item)

    def popleft(self):
        return self.pop(0)


class Missing:
    """The base of what was a dict with `__missing__`, which a dict does not call here."""

    def __init__(self):
        self._known = {}
        self.get = self._known.get
        self.items = self._known.items
        self.values = self._known.values

    def __contains__(self, key):
        return key in self._known

    def __getitem__(self, key):
        return self._known[key] if key in self._known else self.__missing__(key)

    def __setitem__(self, key, value):
        self._known[key] = value


class collections_defaultdict(Missing):
    def __init__(self, make):
        super().__init__()
        self._make = make

    def __missing__(self, key):
        made = self[key] = self._make()
        return made


collections_abc_Iterable = (list, tuple, bytes, bytearray, memoryview, type(_ for _ in ()))  # for isinstance


class contextlib_suppress:
    def __init__(self, *errors):
        self.errors = errors

    def __enter__(self):
        return self

    def __exit__(self, kind, error, trace):
        return error is not None and isinstance(error, self.errors)


def copy_copy(thing):
    made = object.__new__(type(thing))
    for name, value in thing.__dict__.items():
        setattr(made, name, value)
    return made


class Field:
    def __init__(self, name):
        self.name = name


def dataclasses_fields(record):
    return [Field(name) for name in record._fields]


def functools_partial(function, *first, **named):
    return lambda *rest: function(*(first + rest), **named)


def operator_index(value):
    if isinstance(value, int):
        return int(value)
    raise TypeError("not a whole number")


def operator_eq(a, b):
    return a == b


def operator_attrgetter(*names):
    if len(names) == 1:
        return lambda thing: getattr(thing, names[0])
    return lambda thing: tuple(getattr(thing, name) for name in names)


# struct: numbers that do not fit their field are refused, which MicroPython does not do

struct_error = ValueError
_BITS = {"B": 8, "H": 16, "I": 32, "Q": 64}


def struct_pack(form, *values):
    kinds = form[1:]
    if kinds[:-1].isdigit():
        kinds = kinds[-1] * int(kinds[:-1])
    if len(kinds) != len(values):
        raise struct_error("another number of values than the format has")
    for kind, value in zip(kinds, values):
        bits = _BITS.get(kind)
        if bits and not (isinstance(value, int) and 0 <= value < 1 << bits):
            raise struct_error("a value that does not fit")
    return pack(form, *values)


struct_calcsize = calcsize
struct_unpack = unpack
struct_unpack_from = unpack_from


class struct_Struct:
    def __init__(self, form):
        self.format = form
        self.size = calcsize(form)

    def pack(self, *values):
        return struct_pack(self.format, *values)

    def unpack(self, data):
        return unpack(self.format, data)

    def unpack_from(self, data, at=0):
        return unpack_from(self.format, data, at)


# Methods and displays that were lowered to calls


def bit_length(number):
    return len(f"{abs(number):b}") if number else 0


def exception_text(error):
    return str(error.args[0]) if error.args else ""


def fromhex(text):
    return bytes.fromhex(text.replace(" ", ""))


def has_length(thing):
    try:
        return len(thing) >= 0
    except TypeError:
        return False


def joined(parts):
    return b"".join([bytes(part) for part in parts])


def ljust(data, size, fill=b" "):
    return data + fill * (size - len(data))


def lstrip(data, characters=None):  # a bytearray has no such method
    data = bytes(data) if isinstance(data, bytearray) else data
    return data.lstrip() if characters is None else data.lstrip(characters)


def strip(data, characters=None):
    data = bytes(data) if isinstance(data, bytearray) else data
    return data.strip() if characters is None else data.strip(characters)


def merged(*tables):
    whole = {}
    for table in tables:
        whole.update(table)
    return whole


def removeprefix(text, beginning):
    return text[len(beginning) :] if text.startswith(beginning) else text


def signed_to_bytes(number, size, order, signed):
    return (number & (1 << 8 * size) - 1).to_bytes(size, order)


def signed_from_bytes(data, order, signed):
    number = int.from_bytes(data, order)
    return number - (1 << 8 * len(data)) if signed and number >> 8 * len(data) - 1 else number


def stepped(row, first, end, step):
    numbers = range(len(row))[first:end:step]
    return type(row)([row[number] for number in numbers])


class UnicodeEncodeError(ValueError):
    start = 0


class UnicodeDecodeError(UnicodeEncodeError):
    pass


_CHARACTERS = {"ascii": 128, "latin-1": 256}  # besides UTF-8, which MicroPython has


def text_encode(text, charset):
    if charset not in _CHARACTERS:
        return text.encode()
    for place, character in enumerate(text):
        if ord(character) >= _CHARACTERS[charset]:
            error = UnicodeEncodeError(charset)
            error.start = place
            raise error
    return bytes([ord(character) for character in text])


def text_decode(data, charset):
    if charset not in _CHARACTERS:
        try:
            return data.decode()
        except UnicodeError:
            raise UnicodeDecodeError(charset) from None
    for place, byte in enumerate(data):
        if byte >= _CHARACTERS[charset]:
            error = UnicodeDecodeError(charset)
            error.start = place
            raise error
    return "".join([chr(byte) for byte in data])


def translate(data, table, without=b""):
    return bytes([table[byte] if table else byte for byte in data if byte not in without])
