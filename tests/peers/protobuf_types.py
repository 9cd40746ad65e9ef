"""Protobuf messages, described at run time so that no compiler is needed."""

import math

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2

from robot import SECOND, noise, state

Kind = descriptor_pb2.FieldDescriptorProto
SCALARS = ["double", "float", "int64", "uint64", "int32", "fixed64", "fixed32", "bool", "string", "bytes", "uint32", "sfixed32",
           "sfixed64", "sint32", "sint64"]  # fmt: skip


def add(message, name: str, number: int, kind: str, repeated=False, type_name=None, packed=None, optional=False, oneof=None):
    """Adds a field to a message."""
    field = message.field.add(name=name, number=number, type=getattr(Kind, f"TYPE_{kind.upper()}"))
    field.label = Kind.LABEL_REPEATED if repeated else Kind.LABEL_OPTIONAL
    if type_name:
        field.type_name = type_name
    if packed is not None:
        field.options.packed = packed
    if oneof is not None:
        field.oneof_index = oneof
    if optional:
        field.proto3_optional = True
        field.oneof_index = len(message.oneof_decl)
        message.oneof_decl.add(name=f"_{name}")


def add_map(message, name: str, number: int, key: str, value: str, type_name=None):
    """Adds a map: a repeated nested message with a key and a value."""
    entry = message.nested_type.add(name="".join(word.title() for word in name.split("_")) + "Entry")
    entry.options.map_entry = True
    add(entry, "key", 1, key)
    add(entry, "value", 2, value, type_name=type_name)
    add(message, name, number, "message", repeated=True, type_name=f".fleet.Robot.{entry.name}")


def geometry() -> descriptor_pb2.FileDescriptorProto:
    file = descriptor_pb2.FileDescriptorProto(name="fleet/geometry.proto", package="fleet", syntax="proto3")
    vector = file.message_type.add(name="Vector")
    for number, name in enumerate("xyz", 1):
        add(vector, name, number, "double")
    return file


def robot() -> descriptor_pb2.FileDescriptorProto:
    file = descriptor_pb2.FileDescriptorProto(name="fleet/robot.proto", package="fleet", syntax="proto3")
    file.dependency.extend(["google/protobuf/timestamp.proto", "fleet/geometry.proto"])
    mode = file.enum_type.add(name="Mode")
    for name, number in [("IDLE", 0), ("DRIVE", 1), ("FAULT", -7)]:
        mode.value.add(name=name, number=number)
    message = file.message_type.add(name="Robot")
    wheel = message.nested_type.add(name="Wheel")
    add(wheel, "speed", 1, "float")
    add(wheel, "slips", 2, "bool")
    message.oneof_decl.add(name="goal")
    add(message, "timestamp", 1, "message", type_name=".google.protobuf.Timestamp")
    add(message, "velocity", 2, "message", type_name=".fleet.Vector")
    add(message, "mode", 3, "enum", type_name=".fleet.Mode")
    add(message, "wheels", 4, "message", repeated=True, type_name=".fleet.Robot.Wheel")
    add(message, "currents", 5, "double", repeated=True)
    add(message, "ticks", 6, "sint32", repeated=True, packed=False)
    add(message, "modes", 7, "enum", repeated=True, type_name=".fleet.Mode")
    add(message, "names", 8, "string", repeated=True)
    add(message, "speed_goal", 9, "double", oneof=0)
    add(message, "place_goal", 10, "message", type_name=".fleet.Vector", oneof=0)
    add(message, "payload", 11, "float", optional=True)
    add_map(message, "voltages", 12, "string", "double")
    add_map(message, "corners", 13, "int32", "message", ".fleet.Vector")
    for number, kind in enumerate(SCALARS, 20):
        add(message, f"a_{kind}", number, kind)
    add(message, "flags", 2000, "bool", repeated=True)
    add(message, "far", 536870911, "fixed32")
    return file


def robot_class():
    """The class of the message `fleet.Robot`."""
    pool = descriptor_pool.DescriptorPool()
    stamp_file = descriptor_pb2.FileDescriptorProto()
    timestamp_pb2.DESCRIPTOR.CopyToProto(stamp_file)
    for file in (stamp_file, geometry(), robot()):
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName("fleet.Robot"))


def fill(message, place: int, seconds: float, at: int):
    """The robot's state at a time; what is optional comes and goes."""
    _, _, _, speed, rate = state(seconds)
    message.timestamp.seconds, message.timestamp.nanos = at // SECOND, at % SECOND
    if place % 6:
        message.velocity.x, message.velocity.z = speed, rate
    message.mode = [0, 1, -7][place % 3]
    for k in range(place % 4):
        message.wheels.add(speed=speed + k, slips=k == 1)
    message.currents.extend(0.5 * k + noise(8, place) for k in range(place % 5))
    message.ticks.extend([-place, place, -(2**31)][: place % 4])
    message.modes.extend([1, 0, -7][: place % 4])
    message.names.extend(["left", "right"])
    if place % 3 == 0:
        message.speed_goal = 0.0
    elif place % 3 == 1:
        message.place_goal.y = -speed
    if place % 2:
        message.payload = 0.0 if place % 4 == 1 else 2.5
    message.voltages["battery"] = 24.0 + noise(9, place)
    if place % 2:
        message.voltages["logic"] = 5.0
    message.corners[-3].x = float(place)
    message.flags.extend([True, False, True])
    message.far = place
    extremes(message, place)


def extremes(message, place: int):
    """Every scalar type at its ends."""
    if place % 3 == 2:
        return
    low = place % 3 == 0
    message.a_double, message.a_float = (-math.inf, math.nan) if low else (5e-324, 0.1)
    message.a_int64 = message.a_sint64 = message.a_sfixed64 = -(2**63) if low else 2**63 - 1
    message.a_int32 = message.a_sint32 = message.a_sfixed32 = -(2**31) if low else 2**31 - 1
    message.a_uint64 = message.a_fixed64 = 2**64 - 1 if low else 2**53 + 1
    message.a_uint32 = message.a_fixed32 = 2**32 - 1 if low else 1
    message.a_bool, message.a_string, message.a_bytes = low, "näme" if low else "", b"\x00\xff\x80" if low else b""
