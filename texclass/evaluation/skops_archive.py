"""Reading of untrusted skops archives: only allow-listed classes, limited memory, and no pickle."""

import io
import json
import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from zipfile import ZIP_STORED, BadZipFile, ZipFile, ZipInfo

import numpy as np

from texclass.evaluation.allowed_estimators import ESTIMATORS, REFUSED_PARAMETERS

ALLOWED_CLASSES = frozenset(
    {
        "numpy.dtype",
        "texclass.evaluation.cost.CostModel",
        "texclass.tradeoff.cost_selection.CostAwareSelector",
        "texclass.tradeoff.cost_selection.Subset",
        "texclass.classifiers.kernel.View",
        "texclass.classifiers.kernel_discriminant.KernelDiscriminant",
        "texclass.classifiers.forward_selection.ForwardSelector",
        "texclass.classifiers.segment_voting.SegmentVoting",
    }
)
"""Classes allowed in a file, in addition to scikit-learn estimators, arrays and plain values."""
ALLOWED_SKLEARN_CLASSES = frozenset(
    {path.rpartition(".")[2] for path in ESTIMATORS} | {"LabelBinarizer", "Pipeline"}
)
"""Names of the scikit-learn classes allowed in a file: estimators of pipelines and their components."""
MAX_BYTES = 1 << 30
"""Largest size of a file in bytes."""
MAX_SCHEMA_BYTES = 1 << 24
"""Largest size of the schema in bytes. Schemas of real pipelines are more than ten times smaller."""
SCHEMA, ARRAY = "schema.json", re.compile(r"\d+\.npy")


class UnsafeFileError(ValueError):
    """Error raised if a file is not in the expected format, before any object is created from it."""


def dump_archive(document: Any) -> bytes:
    """Return a reproducible skops archive, which has the same bytes for the same content.

    skops identifies objects by memory addresses. This function replaces the addresses with consecutive
    numbers and writes the members of the archive without dates.
    """
    import skops.io

    with ZipFile(io.BytesIO(skops.io.dumps(document))) as archive:
        members = {member.filename: archive.read(member) for member in archive.infolist()}
    number: dict[str, int] = {}

    def replace_ids(node: dict[str, Any]) -> dict[str, Any]:
        if "__id__" in node:
            node["__id__"] = number.setdefault(str(node["__id__"]), len(number) + 1)
        if (array := node.get("file")) in members:
            node["file"] = f"{number.setdefault(Path(array).stem, len(number) + 1)}.npy"
        return node

    schema = json.dumps(json.loads(members.pop(SCHEMA), object_hook=replace_ids), indent=2)
    arrays = {f"{number[Path(name).stem]}.npy": content for name, content in members.items()}
    buffer = io.BytesIO()
    with ZipFile(buffer, "w") as archive:
        for name, content in {**arrays, SCHEMA: schema.encode()}.items():
            archive.writestr(ZipInfo(name), content)
    return buffer.getvalue()


def load_archive(data: bytes, *, members: frozenset[str] = frozenset({SCHEMA})) -> Any:
    """Load the object in a skops archive, if all its classes are on the allow-list.

    Parameters
    ----------
    data : bytes
        Content of the file.
    members : frozenset of str
        Names of the members allowed in the archive, in addition to arrays.

    Returns
    -------
    object
        The loaded object.

    Raises
    ------
    UnsafeFileError
        If the archive is incomplete, is not a skops archive, or contains a class that is not on the
        allow-list.
    """
    import skops.io

    check_archive(data, members)
    if SCHEMA not in read_members(data):
        raise UnsafeFileError(f"it does not contain {SCHEMA}. Expected a skops archive")
    try:
        disallowed = find_disallowed(data)
        document = None if disallowed else skops.io.loads(data, trusted=sorted(ALLOWED_CLASSES))
    except Exception as error:  # a manipulated schema can raise any error, even RecursionError
        raise UnsafeFileError(f"it cannot be read ({type(error).__name__}: {error})") from error
    if disallowed:
        is_ours = any(name.startswith("texclass.") for name in disallowed)
        hint = ". If another version of texclass wrote it, run `texclass train` or `texclass tradeoff` again"
        raise UnsafeFileError(
            f"it contains {', '.join(disallowed[:3])}. Expected only classes and parameters of scikit-learn "
            f"and texclass that are on the allow-list{hint if is_ours else ''}"
        )
    return document


def find_disallowed(data: bytes) -> list[str]:
    """Return a sorted list of the classes and parameters in an archive that are not on the allow-list."""
    import skops.io

    disallowed = set(skops.io.get_untrusted_types(data=data)) - ALLOWED_CLASSES

    def check_node(node: dict[str, Any]) -> dict[str, Any]:
        module, name = str(node.get("__module__")), node.get("__class__")
        is_sklearn_object = module.startswith("sklearn.") and node.get("__loader__") == "ObjectNode"
        if is_sklearn_object and name not in ALLOWED_SKLEARN_CLASSES:
            disallowed.add(f"{module}.{name}")
        for key in REFUSED_PARAMETERS & node.keys():
            value = node[key] if isinstance(node[key], dict) else {}
            if value.get("__loader__") != "JsonNode" or value.get("content") not in ("null", "false", "0"):
                disallowed.add(f"the parameter {key!r}")
        return node

    with ZipFile(io.BytesIO(data)) as archive:
        json.loads(archive.read(SCHEMA), object_hook=check_node)
    return sorted(disallowed)


def read_bounded(path: str | Path) -> bytes:
    """Read a file of at most `MAX_BYTES`.

    Raises
    ------
    FileNotFoundError
        If the file does not exist.
    UnsafeFileError
        If the file is larger than the limit.
    """
    with Path(path).open("rb") as file:
        data = file.read(MAX_BYTES + 1)
    if len(data) > MAX_BYTES:
        raise UnsafeFileError(f"it is larger than the limit of {MAX_BYTES >> 20} MiB")
    return data


def check_archive(data: bytes, members: frozenset[str] = frozenset({SCHEMA})) -> None:
    """Check that an archive is complete and uncompressed, with only allowed members and numeric arrays.

    Raises
    ------
    UnsafeFileError
        If a check fails. Compressed members are refused, because they can expand to any size.
    """
    try:
        with ZipFile(io.BytesIO(data)) as archive:
            for problem in _problems(archive.infolist(), len(data), members):
                raise UnsafeFileError(problem)
            if (broken := archive.testzip()) is not None:
                raise UnsafeFileError(f"{broken} is damaged. Copy or create the file again")
            for name in filter(ARRAY.fullmatch, archive.namelist()):
                content = archive.read(name)
                buffer = io.BytesIO(content)
                is_version_1 = np.lib.format.read_magic(buffer) == (1, 0)
                read_header = (
                    np.lib.format.read_array_header_1_0
                    if is_version_1
                    else np.lib.format.read_array_header_2_0
                )
                shape, _, dtype = read_header(buffer)
                # Python integers do not overflow, unlike NumPy integers.
                n_expected, n_bytes = math.prod((dtype.itemsize, *shape)), len(content) - buffer.tell()
                if dtype.hasobject or n_expected != n_bytes:
                    raise UnsafeFileError(
                        f"{name} should contain {shape} of {dtype}, but has {n_bytes} bytes. "
                        "Expected a complete array of numbers"
                    )
    except UnsafeFileError:
        raise
    except BadZipFile as error:
        raise UnsafeFileError(f"it is truncated or not an archive ({error})") from error
    except Exception as error:
        raise UnsafeFileError(f"it cannot be read ({type(error).__name__}: {error})") from error


def read_members(data: bytes) -> Mapping[str, bytes]:
    """Return the content of each member of a checked archive, sorted by name."""
    with ZipFile(io.BytesIO(data)) as archive:
        return {name: archive.read(name) for name in sorted(archive.namelist())}


def _problems(members: list[ZipInfo], n_bytes: int, allowed: frozenset[str]) -> Iterator[str]:
    names = [member.filename for member in members]
    if len(set(names)) < len(names):
        yield "two members have the same name. Expected unique names"
    for member in members:
        if member.filename not in allowed and not ARRAY.fullmatch(member.filename):
            yield f"it contains {member.filename[:60]!r}. Expected a schema and arrays only"
        if member.compress_type != ZIP_STORED or member.compress_size != member.file_size:
            yield f"{member.filename} is compressed. Expected uncompressed members"
        if not ARRAY.fullmatch(member.filename) and member.file_size > MAX_SCHEMA_BYTES:
            yield f"{member.filename} has {member.file_size} bytes. Expected at most {MAX_SCHEMA_BYTES}"
    if sum(member.file_size for member in members) > n_bytes:
        yield "its members overlap. Expected separate members"
