"""An encoder for Common Data Representation in all forms that a ROS 2 log may hold.

Written from DDS-XTypes 1.3, 7.4: the Python package writes little-endian XCDR1 only.
"""

import struct

from definitions import PRIMITIVES, fields

CDR_BE, CDR_LE = 0x00, 0x01
CDR2_BE, CDR2_LE, D_CDR2_BE, D_CDR2_LE, PL_CDR2_BE, PL_CDR2_LE = 0x06, 0x07, 0x08, 0x09, 0x0A, 0x0B


class Encoder:
    """Encodes one message. `extensibility` maps type names to final, appendable or mutable where the schema says so."""

    def __init__(self, kind: int, extensibility=None, optional=()):
        self.data = bytearray()
        self.order = "<" if kind & 1 else ">"
        self.second = kind >= CDR2_BE
        self.default = "appendable" if kind in (D_CDR2_BE, D_CDR2_LE) else "final"
        self.extensibility = extensibility or {}
        self.optional = optional

    def align(self, size: int):
        """XCDR2 aligns to four bytes at most."""
        size = min(size, 4) if self.second else size
        self.data += bytes(-len(self.data) % size)

    def number(self, base: str, value):
        code, size = PRIMITIVES[base]
        self.align(size)
        self.data += struct.pack(self.order + code, value)

    def delimited(self, write):
        """Writes something behind its length."""
        self.number("uint32", 0)
        start = len(self.data)
        write()
        struct.pack_into(self.order + "I", self.data, start - 4, len(self.data) - start)

    def text(self, base: str, value: str):
        if base == "string":
            octets = value.encode() + b"\0"
            self.number("uint32", len(octets))
            self.data += octets
            return
        # 16-bit units without an end. XCDR2 counts their bytes; in XCDR1 the middlewares of ROS 2 count units and give each four bytes.
        units = value.encode("utf-16-le" if self.order == "<" else "utf-16-be")
        self.number("uint32", len(units) if self.second else len(units) // 2)
        if self.second:
            self.data += units
        else:
            for (unit,) in struct.iter_unpack(self.order + "H", units):
                self.number("uint32", unit)

    def one(self, base: str, value):
        if base in PRIMITIVES:
            self.number(base, value)
        elif base in ("string", "wstring"):
            self.text(base, value)
        else:
            self.struct(base, value)

    def member(self, field, value):
        if field.count is None:
            self.one(field.base, value)
            return

        def elements():
            if field.count < 0:
                self.number("uint32", len(value))
            elif len(value) != field.count:
                raise ValueError(f"{field.name} has {len(value)} elements")
            for item in value:
                self.one(field.base, item)

        if self.second and field.base not in PRIMITIVES:
            self.delimited(elements)
        else:
            elements()

    def struct(self, name: str, value: dict):
        kind = self.extensibility.get(name, self.default) if self.second else "final"
        if kind == "final":
            self.members(name, value)
        elif kind == "appendable":
            self.delimited(lambda: self.members(name, value))
        else:
            self.delimited(lambda: self.parameters(name, value))

    def members(self, name: str, value: dict):
        declared = fields(name)
        if not declared:
            self.number("uint8", 0)
        for field in declared:
            if (name, field.name) in self.optional:
                self.number("bool", value[field.name] is not None)
                if value[field.name] is None:
                    continue
            self.member(field, value[field.name])

    def parameters(self, name: str, value: dict):
        """Members of a mutable struct, each behind its id; the absent ones are left out."""
        for place, field in enumerate(fields(name)):
            item = value[field.name]
            if item is None:
                continue
            size = PRIMITIVES[field.base][1] if field.base in PRIMITIVES and field.count is None else None
            code = {1: 0, 2: 1, 4: 2, 8: 3, None: 4}[size]
            self.number("uint32", code << 28 | place)
            if size is None:
                self.delimited(lambda: self.member(field, item))
            else:
                self.member(field, item)


def encode(kind: int, name: str, value: dict, extensibility=None, optional=()) -> bytes:
    """A message with its four bytes of encapsulation."""
    encoder = Encoder(kind, extensibility, optional)
    encoder.struct(name, value)
    # XCDR2 streams end on four bytes and tell how many of them are padding.
    padding = -len(encoder.data) % 4 if encoder.second else 0
    return bytes([0, kind, 0, padding]) + bytes(encoder.data) + bytes(padding)


def complete(name: str, value: dict, optional=()) -> dict:
    """All fields of a type, missing ones by their defaults, numbers as precise as their types."""
    result = {}
    for field in fields(name):
        if (name, field.name) in optional and value.get(field.name) is None:
            result[field.name] = None
            continue
        content = value.get(field.name, MISSING)
        if content is MISSING:
            content = default(field)
        one = lambda item: exact(field.base, item, optional)  # noqa: E731
        result[field.name] = one(content) if field.count is None else [one(item) for item in content]
    return result


MISSING = object()


def default(field):
    """The value of a field that is not given."""
    if field.default is not None:
        text = field.default.strip()
        if field.count is not None:
            return [float(item) if "." in item else int(item) for item in text.strip("[]").split(",")]
        if field.base == "string":
            return text.strip("\"'")
        return {"true": True, "false": False}[text] if field.base == "bool" else float(text) if "float" in field.base else int(text)
    zero = "" if "string" in field.base else False if field.base == "bool" else 0 if field.base in PRIMITIVES else {}
    return zero if field.count is None else [zero] * max(field.count, 0)


def exact(base: str, value, optional):
    """A value as its type keeps it."""
    if base == "float32":
        return struct.unpack("f", struct.pack("f", value))[0]
    if base == "float64":
        return float(value)
    return complete(base, value, optional) if "/" in base else value
