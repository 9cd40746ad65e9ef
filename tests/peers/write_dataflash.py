"""Writes a log of ArduPilot, binary and as text, by the letters of types that pymavlink knows.

    python write_dataflash.py OUTDIR [ROWS]

`flight.bin` and `flight.log`: the same messages. 2,000 rows of the fastest type unless ROWS says otherwise. The definitions are those of ArduPilot's
`LogStructure.h`, with units, factors, instances by number and by text, an array, half precision and a type without a clock.

Needs pymavlink.
"""

import math
import random
import struct
import sys
from pathlib import Path

from pymavlink.DFReader import FORMAT_TO_STRUCT

ROWS = int(sys.argv[2]) if len(sys.argv) > 2 else 2000

# Number, name, letters, fields, units, factors.
TYPES = [
    (0x80, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns", "-b---", "-----"),
    (0x81, "UNIT", "QbZ", "TimeUS,Id,Label", "s--", "F--"),
    (0x82, "FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds", "s---", "F---"),
    (0x83, "MULT", "Qbd", "TimeUS,Id,Mult", "s--", "F--"),
    (0x40, "PARM", "QNff", "TimeUS,Name,Value,Default", "s---", "F---"),
    (0x41, "MSG", "QZ", "TimeUS,Message", "s-", "F-"),
    (0x42, "IMU", "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz", "s#EEEooo--O--zz", "F-000000-----00"),
    (0x43, "ATT", "QccccCCCCB", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw,AEKF", "sddddhhdh-", "FBBBBBBBB-"),
    (0x44, "GPS", "QBBIHBcLLeffffB", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U", "s#-s-S-DUmnhnh-", "F--C-0BGGB000--"),
    (0x45, "BAT", "QBfffffcf", "TimeUS,Instance,Volt,VoltR,Curr,CurrTot,EnrgTot,Temp,Res", "s#vvAaXOw", "F-000C?0?"),
    (0x46, "NVF", "QNf", "TimeUS,Name,Value", "s#-", "F--"),
    (0x47, "ISBD", "QHHaaa", "TimeUS,N,seqno,x,y,z", "s--ooo", "F--???"),
    (0x48, "HALF", "QggH", "TimeUS,A,B,Volt", "s--v", "F--C"),
    (0x49, "TICK", "If", "Count,Load", "-%", "-0"),
    (0x4A, "MODE", "QMBB", "TimeUS,Mode,ModeNum,Rsn", "s---", "F---"),
    (0x4B, "BIG", "qQiIhHbBeE", "Q1,Q2,I1,I2,H1,H2,B1,B2,E1,E2", "----------", "----------"),
]
UNITS = {"-": "", "?": "UNKNOWN", "s": "s", "b": "B", "E": "rad/s", "o": "m/s/s", "O": "degC", "z": "Hz", "d": "deg", "h": "degheading", "S": "satellites",
         "D": "deglatitude", "U": "deglongitude", "m": "m", "n": "m/s", "v": "V", "A": "A", "a": "Ah", "X": "W.h", "w": "Ohm", "%": "%", "#": "instance"}
MULTS = {"-": 0.0, "?": 1.0, "2": 1e2, "1": 1e1, "0": 1.0, "A": 1e-1, "B": 1e-2, "C": 1e-3, "D": 1e-4, "E": 1e-5, "F": 1e-6, "G": 1e-7, "!": 3.6, "/": 3600.0}
BY_NAME = {entry[1]: entry for entry in TYPES}
# Multipliers are constants of four bytes in the writer.
single = lambda value: struct.unpack("<f", struct.pack("<f", value))[0]


class Log:
    def __init__(self):
        self.binary = bytearray()
        self.text: list[str] = []

    def add(self, name, *values):
        number, _, letters, *_ = BY_NAME[name]
        self.binary += bytes([0xA3, 0x95, number])
        words = [name]
        for letter, value in zip(letters, values, strict=True):
            form, factor, _ = FORMAT_TO_STRUCT[letter]
            if letter == "a":
                self.binary += struct.pack("<32h", *value)
                continue
            if letter in "nNZ":
                self.binary += struct.pack("<" + form, value.encode())
                words.append(value)
                continue
            self.binary += struct.pack("<" + form, value)
            if factor:
                value = value * factor
            elif letter in "fg":
                value = struct.unpack("<" + form, struct.pack("<" + form, value))[0]
            words.append(repr(value))
        # pymavlink cannot read arrays from text.
        if "a" not in letters or name == "FMT":
            self.text.append(", ".join(words))


def head(log: Log):
    for number, name, letters, fields, *_ in TYPES:
        length = 3 + struct.calcsize("<" + "".join(FORMAT_TO_STRUCT[letter][0] for letter in letters))
        log.add("FMT", number, length, name, letters, fields)
    for place, (letter, unit) in enumerate(UNITS.items()):
        log.add("UNIT", 1000 + place, ord(letter), unit)
    for letter, mult in MULTS.items():
        log.add("MULT", 2000, ord(letter), single(mult))
    for number, _, _, _, units, mults in TYPES:
        log.add("FMTU", 3000, number, units, mults)
    for place, (name, value, default) in enumerate([("RLL2SRV_P", 0.75, 1.0), ("SYSID_THISMAV", 1.0, 1.0), ("ARSPD_RATIO", 1.9936, math.nan)]):
        log.add("PARM", 4000 + place, name, value, default)
    log.add("MSG", 5000, "ArduPlane V4.5.7 (0358a9c2)")


def main():
    folder = Path(sys.argv[1])
    rng = random.Random(7)
    log = Log()
    head(log)
    for k in range(ROWS):
        time = 10_000_000 + 2_500 * k
        wave = lambda speed, size: size * math.sin(speed * k)
        for instance in range(2):
            log.add("IMU", time + 3 * instance, instance, wave(0.1, 0.3), rng.gauss(0, 0.01), rng.gauss(0, 0.01), wave(0.05, 2.0), 0.1 * instance, -9.81,
                    k % 3, 0, 31.5, 1, 1, 1000, 1000)
        if k % 4 == 0:
            angle = int(wave(0.02, 3000))
            log.add("ATT", time + 10, angle, angle - 3, -angle, 250 - angle, 18000 + angle, 17990 + angle, 2, 3, 3)
        if k % 20 == 0:
            for instance in range(2):
                log.add("GPS", time + 20 + instance, instance, 3, 300_000_000 + 200 * k, 2280, 14 + instance, 87, -353_632_621 + k, 1_491_652_300 - k,
                        58_400 + k, 12.5, 359.9, -0.25, 0.0, 1 - instance)
            log.add("BAT", time + 30, 0, 12.6 - 0.001 * k, 12.7, 5.25, 1.5 * k, 0.0185 * k, 3150, 0.02)
            log.add("NVF", time + 31, "rpm", 100.0 + k)
            log.add("NVF", time + 32, "flap", 0.5 * k)
        if k % 50 == 0:
            log.add("ISBD", time + 40, k % 65536, 0, *([rng.randrange(-32768, 32768) for _ in range(32)] for _ in range(3)))
            log.add("HALF", time + 41, 0.1 * k, -65504.0 if k % 100 else 2.0**-24, 12_345)
            log.add("TICK", k, 0.25)
            log.add("BIG", -(2**40) - k, 2**53 - k, -(2**31), 2**32 - 1, -(2**15), 2**16 - 1, -128, 255, -123_456, 4_000_000_000)
        if k == ROWS // 2:
            log.add("PARM", time + 50, "RLL2SRV_P", 0.9, 1.0)
            log.add("MODE", time + 51, 10, 10, 2)
            log.add("MSG", time + 52, "Mission: 3 WP")
    (folder / "flight.bin").write_bytes(log.binary)
    (folder / "flight.log").write_text("".join(line + "\n" for line in log.text))


if __name__ == "__main__":
    main()
