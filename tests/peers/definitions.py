"""Message definitions of the test logs, as .msg bodies, and what is generated from them.

Constants, defaults, comments, bounds and every basic type occur on purpose: each is a case of a schema parser.
"""

import re
from dataclasses import dataclass
from typing import Optional

ROS2 = {
    "builtin_interfaces/msg/Time": "int32 sec\nuint32 nanosec\n",
    "builtin_interfaces/msg/Duration": "int32 sec\nuint32 nanosec\n",
    "std_msgs/msg/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
    "std_msgs/msg/Empty": "",
    "geometry_msgs/msg/Vector3": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/msg/Point": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/msg/Quaternion": "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n",
    "geometry_msgs/msg/Pose": "Point position\nQuaternion orientation\n",
    "geometry_msgs/msg/Twist": "# Velocity of a free body.\nVector3  linear\nVector3  angular\n",
    "geometry_msgs/msg/PoseWithCovariance": "Pose pose\n\n# Row-major, about x y z and the fixed axes.\nfloat64[36] covariance\n",
    "geometry_msgs/msg/TwistWithCovariance": "Twist twist\nfloat64[36] covariance\n",
    "geometry_msgs/msg/Transform": "Vector3 translation\nQuaternion rotation\n",
    "geometry_msgs/msg/TransformStamped": "std_msgs/Header header\nstring child_frame_id\nTransform transform\n",
    "sensor_msgs/msg/Imu": """std_msgs/Header header

geometry_msgs/Quaternion orientation
float64[9] orientation_covariance # -1 first: no estimate

geometry_msgs/Vector3 angular_velocity
float64[9] angular_velocity_covariance
geometry_msgs/Vector3 linear_acceleration
float64[9] linear_acceleration_covariance
""",
    "sensor_msgs/msg/JointState": "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n",
    "sensor_msgs/msg/Image": """std_msgs/Header header
uint32 height
uint32 width
string encoding
uint8 is_bigendian
uint32 step
uint8[] data
""",
    "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms\n",
    "nav_msgs/msg/Odometry": """std_msgs/Header header
string child_frame_id
geometry_msgs/PoseWithCovariance pose
geometry_msgs/TwistWithCovariance twist
""",
    # No multiple of eight bytes on purpose, so that every element of an array of these aligns differently.
    "fleet_msgs/msg/Part": "uint8 kind\nfloat64 weight\nstring label\nint16 count\n",
    "fleet_msgs/msg/Assembly": "uint8 grade\nPart main\nPart[] spares\nbool done\n",
    "fleet_msgs/msg/Types": """# Every basic type.
int8 SMALLEST = -128
uint32 FLAGS=4294967295
float64 PI = 3.141592653589793
string GREETING = "a # b = c"
string FAREWELL='it\\'s'
bool YES=true

bool truth true
byte raw 200
char letter 65
float32 f32 0.1
float64 f64 -2.5e-3
int8 i8 -8
uint8 u8 8
int16 i16 -16
uint16 u16 16
int32 i32 -32   # a comment after a default
uint32 u32 32
int64 i64 -64
uint64 u64 64
string text "standard text"
string<=12 bounded 'short'
builtin_interfaces/Duration since
std_msgs/Empty nothing
uint8 last
""",
    "fleet_msgs/msg/Arrays": """bool[3] truths
byte[2] octets
char[2] letters
float32[3] singles
float64[] doubles
int8[<=4] i8s
uint16[] u16s
int32[2] i32s
int64[] i64s
uint64[<=2] u64s
uint8[70] blob
string[2] fixed_texts
string[] texts
string<=10[<=3] bounded_texts
geometry_msgs/Vector3[2] corners
Part[] parts
Assembly[<=2] assemblies
float64[] none_at_all
uint8 last
""",
    # Types that the Python packages cannot decode: the writers know the values.
    "fleet_msgs/msg/Wide": """wstring caption
uint8 after
wstring<=8 short_caption
float64 number
wstring[] captions
char[3] letters
float32[3] singles [0.5, -1.5, 0.1]
uint16[] u16s [1, 2, 3]
int16 last
""",
}

ROS1 = {
    "std_msgs/Header": "uint32 seq\ntime stamp\nstring frame_id\n",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
    "sensor_msgs/Imu": """Header header
geometry_msgs/Quaternion orientation
float64[9] orientation_covariance
geometry_msgs/Vector3 angular_velocity
float64[9] angular_velocity_covariance
geometry_msgs/Vector3 linear_acceleration
float64[9] linear_acceleration_covariance
""",
    "sensor_msgs/JointState": "Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n",
    "fleet_msgs/Part": "uint8 kind\nfloat64 weight\nstring label\nint16 count\n",
    "fleet_msgs/Types": """int32 LIMIT=-7
string NAME=anything goes # even this
bool truth
byte octet
char letter
float32 single
float64 double
int8 i8
uint8 u8
int16 i16
uint16 u16
int32 i32
uint32 u32
int64 i64
uint64 u64
string text
time moment
duration span
time[] moments
Part part
Part[] parts
Part[2] pair
string[] texts
bool[3] truths
float32[] singles
uint8[] blob
int64[2] i64s
geometry_msgs/Vector3[] path
""",
}

SEPARATOR = "=" * 80

PRIMITIVES = {
    "bool": ("?", 1), "byte": ("B", 1), "char": ("B", 1), "float32": ("f", 4), "float64": ("d", 8),
    "int8": ("b", 1), "uint8": ("B", 1), "int16": ("h", 2), "uint16": ("H", 2), "int32": ("i", 4),
    "uint32": ("I", 4), "int64": ("q", 8), "uint64": ("Q", 8),
}  # fmt: skip
IDL_NAMES = {"bool": "boolean", "byte": "octet", "char": "uint8", "float32": "float", "float64": "double"}

FIELD = re.compile(
    r"(?P<base>[A-Za-z][\w/]*)(?:<=(?P<text_bound>\d+))?(?:\[(?P<bound><=)?(?P<count>\d*)\])?\s+(?P<name>[a-z]\w*)"
    r"(?:\s+(?P<default>[^\s=].*))?$"
)
CONSTANT = re.compile(r"(?P<base>\w+)\s+(?P<name>[A-Z][A-Z0-9_]*)\s*=\s*(?P<value>.*)$")


@dataclass
class Field:
    """A field: `count` is None for one value, -1 for any number of values."""

    name: str
    base: str
    count: Optional[int]
    bound: Optional[int]
    text_bound: Optional[int]
    default: Optional[str]


def full_name(base: str, package: str) -> str:
    """The full name of a type that is used in a package."""
    parts = base.split("/")
    return f"{package}/msg/{base}" if len(parts) == 1 else f"{parts[0]}/msg/{parts[-1]}"


def fields(name: str, definitions=ROS2) -> list[Field]:
    """The fields of a ROS 2 type."""
    listed = []
    for line in definitions[name].splitlines():
        line = line.split(" #")[0].strip()
        if not line or line.startswith("#") or "=" in line.replace("<=", ""):
            continue
        match = FIELD.match(line)
        if match is None:
            raise ValueError(f"{name}: `{line}` is no field")
        base, count = match["base"], match["count"]
        if base not in PRIMITIVES and base not in ("string", "wstring"):
            base = full_name(base, name.split("/")[0])
        size = None if count is None else -1 if count == "" or match["bound"] else int(count)
        bound = int(count) if match["bound"] else None
        text_bound = int(match["text_bound"]) if match["text_bound"] else None
        listed.append(Field(match["name"], base, size, bound, text_bound, match["default"]))
    return listed


def uses(name: str, definitions) -> list[str]:
    """All types that a type uses, each once, itself left out."""
    order: list[str] = []

    def walk(current: str):
        for line in definitions[current].splitlines():
            words = re.split(r"[\s\[<]", line.strip())
            base = "std_msgs/Header" if words[0] == "Header" else words[0]
            ros1 = base if "/" in base else f"{current.split('/')[0]}/{base}"
            for candidate in (full_name(base, current.split("/")[0]), ros1):
                if candidate in definitions and candidate not in order:
                    order.append(candidate)
                    walk(candidate)

    walk(name)
    return order


def msg_text(name: str, definitions=ROS2) -> str:
    """The concatenated definition as recorders store it."""
    text = definitions[name]
    for used in uses(name, definitions):
        parts = used.split("/")
        text += f"{SEPARATOR}\nMSG: {parts[0]}/{parts[-1]}\n{definitions[used]}"
    return text


def idl_text(name: str, annotations=None, optional=(), leading_separator=True) -> str:
    """The concatenated IDL files of a type, as rosidl's adapter makes them from .msg files."""
    sections = []
    for place, current in enumerate([name] + uses(name, ROS2)):
        head = f"{SEPARATOR}\nIDL: {current}\n" if place or leading_separator else ""
        sections.append(head + idl_file(current, (annotations or {}).get(current), optional))
    return "\n".join(sections)


def idl_file(name: str, annotation: Optional[str], optional) -> str:
    """One IDL file."""
    package, _, short = name.split("/")
    lines = [
        "// generated from rosidl_adapter/resource/msg.idl.em",
        f"// with input from {package}/msg/{short}.msg",
        "// generated code does not contain a copyright notice",
        "",
    ]
    declared = fields(name)
    includes = dict.fromkeys(field.base for field in declared if "/" in field.base)
    lines += [f'#include "{used}.idl"' for used in includes] + [""]
    lines += [f"module {package} {{", "  module msg {"]
    typedefs = dict.fromkeys(typedef(field) for field in declared if field.count is not None and field.count >= 0)
    lines += [f"    {text}" for text in typedefs]
    constants = [match for line in ROS2[name].splitlines() if (match := CONSTANT.match(line.strip()))]
    if constants:
        lines.append(f"    module {short}_Constants {{")
        for constant in constants:
            lines += idl_constant(constant)
        lines.append("    };")
    if annotation:
        lines.append(f"    @{annotation}")
    lines += ['    @verbatim (language="comment", text=']
    lines += [f'      "A type of the tests; struct {short} {{" "\\n"', '      "its second line.")']
    lines.append(f"    struct {short} {{")
    if not declared:
        lines.append("      uint8 structure_needs_at_least_one_member;")
    for field in declared:
        lines += idl_field(field, (name, field.name) in optional)
    return "\n".join(lines + ["    };", "  };", "};", ""])


def idl_constant(match: re.Match) -> list[str]:
    """A constant's line; texts in double quotes."""
    base, value = match["base"], match["value"]
    if base == "string":
        value = '"' + value.strip("\"'").replace("\\'", "'") + '"'
    if base == "bool":
        value = value.upper()
    return [f"      const {IDL_NAMES.get(base, base)} {match['name']} = {value};"]


def scalar_idl(field: Field) -> str:
    """The IDL name of a field's element."""
    if "/" in field.base:
        return field.base.replace("/", "::")
    bound = f"<{field.text_bound}>" if field.text_bound else ""
    return IDL_NAMES.get(field.base, field.base) + bound


def array_name(field: Field) -> str:
    """The name that rosidl gives to an array type."""
    return re.sub(r"[<>]", "_", scalar_idl(field).replace("::", "__")) + f"__{field.count}"


def typedef(field: Field) -> str:
    """The typedef of an array type: IDL members cannot be arrays without one in rosidl's grammar."""
    return f"typedef {scalar_idl(field)} {array_name(field)}[{field.count}];"


def idl_field(field: Field, optional: bool) -> list[str]:
    """A member with its annotations."""
    lines = []
    if field.default is not None:
        value = field.default.strip()
        quoted = f'"{value}"' if field.count is not None else value.upper() if field.base == "bool" else value
        if field.base == "string":
            quoted = '"' + value.strip("\"'") + '"'
        lines.append(f"      @default (value={quoted})")
    if field.base == "float64":
        lines.append('      @unit (value="m/s")')
    if optional:
        lines.append("      @optional")
    kind = scalar_idl(field)
    if field.count is not None and field.count >= 0:
        kind = array_name(field)
    elif field.count is not None:
        kind = f"sequence<{kind}, {field.bound}>" if field.bound else f"sequence<{kind}>"
    return lines + [f"      {kind} {field.name};", ""]
