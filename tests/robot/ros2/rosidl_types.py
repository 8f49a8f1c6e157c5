"""Write the types that the ROS 2 tools (rosidl) derive from the .msg files of a package to types.json.

    /usr/bin/python3 rosidl_types.py PACKAGE_FOLDER OUTPUT_FOLDER

A process of its own, because the system's Python has rosidl, not that of the tests.
"""

import json
import sys
from pathlib import Path

from rosidl_adapter.msg import convert_msg_to_idl
from rosidl_parser.definition import (
    BasicType,
    IdlLocator,
    Message,
    NamespacedType,
    UnboundedSequence,
    UnboundedString,
)
from rosidl_parser.parser import parse_idl_file


def describe(kind):
    if isinstance(kind, UnboundedSequence):
        return f"sequence<{describe(kind.value_type)}>"
    if isinstance(kind, UnboundedString):
        return "string"
    if isinstance(kind, NamespacedType):
        return "::".join(kind.namespaced_name())
    assert isinstance(kind, BasicType), kind
    return kind.typename


def main(package, output):
    types = {}
    for path in sorted((package / "msg").glob("*.msg")):
        folder = output / package.name / "msg"
        idl = convert_msg_to_idl(package, package.name, path.relative_to(package), folder)
        content = parse_idl_file(IdlLocator(output, idl.relative_to(output))).content
        (message,) = content.get_elements_of_type(Message)
        types[path.stem] = {
            "name": "::".join(message.structure.namespaced_type.namespaced_name()),
            "fields": [[member.name, describe(member.type)] for member in message.structure.members],
            "constants": {constant.name: constant.value for constant in message.constants},
        }
    (output / "types.json").write_text(json.dumps(types), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve())
