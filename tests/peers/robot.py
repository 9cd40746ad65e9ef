"""The made-up robot of the test logs: what its topics say at a time.

Everything follows from the time and a counter-based noise, so that the files are the same on every machine.
"""

import math
import random

SECOND = 1_000_000_000
# 2026-05-28T20:26:40Z
START = 1_780_000_000 * SECOND
JOINTS = ["left_wheel", "right_wheel", "arm.lift", "gripper/0"]


def noise(seed: int, place: int) -> float:
    """A number between -1 and 1."""
    return 2.0 * random.Random(seed * 1_000_003 + place).random() - 1.0


def stamp(nanoseconds: int) -> dict:
    return {"sec": nanoseconds // SECOND, "nanosec": nanoseconds % SECOND}


def header(nanoseconds: int, frame: str) -> dict:
    return {"stamp": stamp(nanoseconds), "frame_id": frame}


def xyz(x: float, y: float, z: float) -> dict:
    return {"x": x, "y": y, "z": z}


def heading(yaw: float) -> dict:
    return {"x": 0.0, "y": 0.0, "z": math.sin(yaw / 2), "w": math.cos(yaw / 2)}


def state(seconds: float):
    """Place, heading and speeds of a slow figure of eight."""
    yaw = 3.0 * math.sin(0.7 * seconds)
    return math.sin(0.7 * seconds), 0.5 * math.sin(1.4 * seconds), yaw, 0.4 + 0.1 * math.cos(seconds), 2.1 * math.cos(0.7 * seconds)


def imu(place: int, seconds: float, at: int) -> dict:
    _, _, yaw, speed, rate = state(seconds)
    rates = xyz(0.01 * noise(1, place), 0.01 * noise(2, place), rate + 0.01 * noise(3, place))
    acceleration = xyz(0.1 * noise(4, place), speed * rate + 0.1 * noise(5, place), 9.81 + 0.1 * noise(6, place))
    return {
        "header": header(at, "imu_link"),
        "orientation": heading(yaw),
        "orientation_covariance": [1e-3, 0.0, 0.0, 0.0, 1e-3, 0.0, 0.0, 0.0, 1e-3],
        "angular_velocity": rates,
        "angular_velocity_covariance": [float(k) * 1e-4 for k in range(9)],
        "linear_acceleration": acceleration,
        "linear_acceleration_covariance": [-1.0] + [0.0] * 8,
    }


def odometry(place: int, seconds: float, at: int) -> dict:
    x, y, yaw, speed, rate = state(seconds)
    covariance = [math.nan if k == 35 and place % 7 == 0 else 1e-6 * (k + place) for k in range(36)]
    return {
        "header": header(at, "odom"),
        "child_frame_id": "base_link",
        "pose": {"pose": {"position": xyz(x, y, 0.0), "orientation": heading(yaw)}, "covariance": covariance},
        "twist": {"twist": {"linear": xyz(speed, 0.0, 0.0), "angular": xyz(0.0, 0.0, rate)}, "covariance": [0.0] * 36},
    }


def joint_state(place: int, seconds: float, at: int) -> dict:
    """Joints in changing order; every fifth message lacks one, every eleventh all efforts."""
    order = JOINTS if place % 3 else JOINTS[::-1]
    names = [name for name in order if not (place % 5 == 4 and name == "arm.lift")]
    phases = [JOINTS.index(name) for name in names]
    return {
        "header": header(at, ""),
        "name": names,
        "position": [math.sin(seconds + phase) for phase in phases],
        "velocity": [math.cos(seconds + phase) for phase in phases],
        "effort": [] if place % 11 == 10 else [0.1 * phase + 0.01 * noise(7, place) for phase in phases],
    }


def transforms(place: int, seconds: float, at: int) -> dict:
    """Two frames move; a third is told now and then, first in its message."""
    x, y, yaw, _, _ = state(seconds)
    frames = [("odom", "base_link", xyz(x, y, 0.0), heading(yaw)), ("base_link", "laser", xyz(0.1, 0.0, 0.2), heading(seconds))]
    if place % 4 == 0:
        frames.insert(0, ("map", "odom", xyz(1.0, 2.0 + 0.001 * place, 0.0), heading(0.5)))
    stamped = [
        {"header": header(at + k, parent), "child_frame_id": child, "transform": {"translation": shift, "rotation": turn}}
        for k, (parent, child, shift, turn) in enumerate(frames)
    ]
    return {"transforms": stamped}


def command(place: int, seconds: float) -> dict:
    return {"linear": xyz(0.5 if int(seconds) % 2 else -0.25, 0.0, 0.0), "angular": xyz(0.0, 0.0, round(math.sin(seconds), 1))}


def image(place: int, at: int) -> dict:
    data = bytes((row * column + place) % 251 for row in range(100) for column in range(100))
    return {"header": header(at, "camera"), "height": 100, "width": 100, "encoding": "mono8", "step": 100, "data": data}


def part(place: int) -> dict:
    return {"kind": place % 256, "weight": 0.5 * place, "label": "p" * (place % 9), "count": -place}


EXTREMES = [
    {"f32": math.inf, "f64": -math.inf, "i8": -128, "u8": 255, "i16": -32768, "u16": 65535, "i32": -(2**31), "u32": 2**32 - 1,
     "i64": -(2**63), "u64": 2**64 - 1, "truth": False, "raw": 255, "letter": 127, "text": "", "bounded": "twelve bytes"},
    {"f32": math.nan, "f64": 5e-324, "i8": 127, "i16": 32767, "i32": 2**31 - 1, "i64": 2**63 - 1, "u64": 2**53 + 1,
     "text": "äöü € 𝄞 \n\"quoted\"", "since": {"sec": -3, "nanosec": 999_999_999}},
    {"f32": 1.17549435e-38, "f64": 1.7976931348623157e308, "since": {"sec": 2**31 - 1, "nanosec": 0}, "last": 255},
    {},
]  # fmt: skip


def types(place: int) -> dict:
    """The extremes of every basic type, then defaults, in turn."""
    return dict(EXTREMES[place % len(EXTREMES)])


def arrays(place: int) -> dict:
    """Arrays of every kind, empty now and then."""
    some = place % 4
    return {
        "truths": [True, False, place % 2 == 0],
        "octets": [place % 256, 255],
        "letters": [65 + some, 66],
        "singles": [0.1 * place, -1.5, math.inf],
        "doubles": [0.25 * k - place for k in range(some * 3)],
        "i8s": list(range(-some, 0)),
        "u16s": [65535 - k for k in range(some)],
        "i32s": [-place, place],
        "i64s": [-(2**62) + k for k in range(some)],
        "u64s": [2**64 - 1 - k for k in range(min(some, 2))],
        "blob": [k * 3 % 256 for k in range(70)],
        "fixed_texts": ["a" * some, "second"],
        "texts": ["x" * k for k in range(some)],
        "bounded_texts": ["0123456789"[: 2 * k] for k in range(some)],
        "corners": [xyz(place, 1.5, -2.0), xyz(0.0, some, 1e300)],
        "parts": [part(k + place) for k in range(some)],
        "assemblies": [
            {"grade": k, "main": part(k), "spares": [part(j + k) for j in range(k + some)], "done": bool(k)} for k in range(min(some, 2))
        ],
        "last": 200,
    }


def wide(place: int) -> dict:
    return {
        "caption": ["", "plain", "Größe €", "𝄞 clef"][place % 4],
        "after": place % 256,
        "short_caption": "x" * (place % 9),
        "number": 1.5 * place,
        "captions": ["a", "", "bcd"][: place % 4],
        "letters": [65, 200, 255],
        "last": -2 - place,
    }
