"""Prints every number of every message of ArduPilot's logs, decoded by pymavlink, with the factors of `MULT` and the topics of instances.

    python read_dataflash.py FILE...

The lines are described in columns.py; each also names its file.

Needs pymavlink.
"""

import os
import sys
from array import array

from columns import Columns
from pymavlink.DFReader import DFReader_binary, DFReader_text

DEFINING = {"FMT", "FMTU", "UNIT", "MULT", "PARM"}


def scaled(value, factor):
    """As DFReader divides where the factor belongs to the letter."""
    if factor in (0.0, 1.0) or isinstance(value, str):
        return value
    divisor = round(1 / factor)
    return value / divisor if factor < 1 and abs(1 / factor / divisor - 1) < 1e-9 else value * factor


def read(path: str) -> Columns:
    columns = Columns()
    log = DFReader_text(path) if path.endswith(".log") else DFReader_binary(path)
    factors, last = {}, 0
    while (message := log.recv_msg()) is not None:
        name, fields = message.get_type(), message.to_dict()
        if name == "FMTU":
            factors[fields["FmtType"]] = fields["MultIds"]
        if name in DEFINING:
            continue
        layout = message.fmt
        if "TimeUS" in fields:
            last = fields["TimeUS"] * 1000
        values = {}
        for place, field in enumerate(layout.columns):
            value = fields[field]
            if isinstance(value, array) or layout.format[place] == "a":
                value = [int(item) for item in value] if isinstance(value, array) else value
            elif layout.msg_mults[place] is None and field != "TimeUS":
                letter = factors.get(layout.type, "")[place : place + 1]
                value = scaled(value, log.mult_lookup.get(letter, 1.0))
            values[field] = value
        topic = f"/{name}"
        if layout.instance_field is not None and str(fields[layout.instance_field]) != "0":
            topic += f".{fields[layout.instance_field]}"
        columns.topic(topic).add(last, last, values)
    return columns


def main():
    for path in sys.argv[1:]:
        for line in read(path).lines(file=os.path.basename(path)):
            sys.stdout.write(line + "\n")


if __name__ == "__main__":
    main()
