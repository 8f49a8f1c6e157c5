"""Skops archives that a stranger may have written: known classes by name, bounded memory, never a pickle."""

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

TRUSTED = frozenset(
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
"""Classes that a file may name beside estimators of scikit-learn, arrays and plain values."""
LOADABLE = frozenset({path.rpartition(".")[2] for path in ESTIMATORS} | {"LabelBinarizer", "Pipeline"})
"""Names of the classes of scikit-learn that a file may name: those of pipelines, and what they contain."""
MOST_BYTES = 1 << 30
"""Largest file that is read."""
MOST_SCHEMA_BYTES = 1 << 24
"""Largest description of objects in it; those of real pipelines take well under a tenth."""
SCHEMA, ARRAY = "schema.json", re.compile(r"\d+\.npy")


class UntrustedFileError(ValueError):
    """A file is not what we write: it is refused before any object is made of it."""


def archive_of(document: Any) -> bytes:
    """Return a skops archive: the same bytes for the same content.

    skops names objects by their addresses; here they are numbered as they come, and members bear no date.
    """
    import skops.io

    with ZipFile(io.BytesIO(skops.io.dumps(document))) as archive:
        members = {member.filename: archive.read(member) for member in archive.infolist()}
    number: dict[str, int] = {}

    def numbered(node: dict[str, Any]) -> dict[str, Any]:
        if "__id__" in node:
            node["__id__"] = number.setdefault(str(node["__id__"]), len(number) + 1)
        if (array := node.get("file")) in members:
            node["file"] = f"{number.setdefault(Path(array).stem, len(number) + 1)}.npy"
        return node

    schema = json.dumps(json.loads(members.pop(SCHEMA), object_hook=numbered), indent=2)
    arrays = {f"{number[Path(name).stem]}.npy": content for name, content in members.items()}
    buffer = io.BytesIO()
    with ZipFile(buffer, "w") as archive:
        for name, content in {**arrays, SCHEMA: schema.encode()}.items():
            archive.writestr(ZipInfo(name), content)
    return buffer.getvalue()


def load_trusted(data: bytes, *, members: frozenset[str] = frozenset({SCHEMA})) -> Any:
    """Return the object in a skops archive that names trusted classes only.

    Parameters
    ----------
    data : bytes
        The file.
    members : frozenset of str
        Members it may hold beside arrays.

    Raises
    ------
    UntrustedFileError
        If it is no whole archive of ours, or names a class that is not trusted; the message says which.
    """
    import skops.io

    check_archive(data, members)
    if SCHEMA not in members_of(data):
        raise UntrustedFileError(f"it holds no {SCHEMA}. Expected a skops archive")
    try:
        foreign = foreign_in(data)
        made = None if foreign else skops.io.loads(data, trusted=sorted(TRUSTED))
    except Exception as error:  # whatever a made-up description of objects leads to, RecursionError included
        raise UntrustedFileError(f"it cannot be read ({type(error).__name__}: {error})") from error
    if foreign:
        ours = any(name.startswith("texclass.") for name in foreign)
        moved = "; if an earlier texclass made it, make it again with `texclass train` or `texclass tradeoff`"
        raise UntrustedFileError(
            f"it names {', '.join(foreign[:3])}. Expected classes of scikit-learn and texclass that are "
            f"known to be safe{moved if ours else ''}"
        )
    return made


def foreign_in(data: bytes) -> list[str]:
    """Return the classes and parameters in an archive that are not on the allow-list, sorted."""
    import skops.io

    foreign = set(skops.io.get_untrusted_types(data=data)) - TRUSTED

    def look(node: dict[str, Any]) -> dict[str, Any]:
        module, name = str(node.get("__module__")), node.get("__class__")
        if module.startswith("sklearn.") and node.get("__loader__") == "ObjectNode" and name not in LOADABLE:
            foreign.add(f"{module}.{name}")
        for key in REFUSED_PARAMETERS & node.keys():
            value = node[key] if isinstance(node[key], dict) else {}
            if value.get("__loader__") != "JsonNode" or value.get("content") not in ("null", "false", "0"):
                foreign.add(f"the parameter {key!r}")
        return node

    with ZipFile(io.BytesIO(data)) as archive:
        json.loads(archive.read(SCHEMA), object_hook=look)
    return sorted(foreign)


def read_bounded(path: str | Path) -> bytes:
    """Return the bytes of a file.

    Raises
    ------
    FileNotFoundError
        If there is none.
    UntrustedFileError
        If it is larger than any model.
    """
    with Path(path).open("rb") as file:
        data = file.read(MOST_BYTES + 1)
    if len(data) > MOST_BYTES:
        raise UntrustedFileError(f"it is larger than {MOST_BYTES >> 20} MiB, the limit")
    return data


def check_archive(data: bytes, members: frozenset[str] = frozenset({SCHEMA})) -> None:
    """Check that an archive is whole, holds these members and arrays, and unpacks to no more than itself.

    Raises
    ------
    UntrustedFileError
        If not. Members are stored, not compressed, so that there is nothing to unpack.
    """
    try:
        with ZipFile(io.BytesIO(data)) as archive:
            for problem in _problems(archive.infolist(), len(data), members):
                raise UntrustedFileError(problem)
            if (broken := archive.testzip()) is not None:
                raise UntrustedFileError(f"{broken} is damaged. Expected an untouched file")
            for name in filter(ARRAY.fullmatch, archive.namelist()):
                content = archive.read(name)
                buffer = io.BytesIO(content)
                first = np.lib.format.read_magic(buffer) == (1, 0)
                read = np.lib.format.read_array_header_1_0 if first else np.lib.format.read_array_header_2_0
                shape, _, dtype = read(buffer)
                # Of Python's integers: a product that does not overflow.
                size, follows = math.prod((dtype.itemsize, *shape)), len(content) - buffer.tell()
                if dtype.hasobject or size != follows:
                    raise UntrustedFileError(
                        f"{name} announces {shape} of {dtype}, {follows} bytes follow. "
                        "Expected numbers, all of them"
                    )
    except UntrustedFileError:
        raise
    except BadZipFile as error:
        raise UntrustedFileError(f"it is truncated or no archive at all ({error})") from error
    except Exception as error:
        raise UntrustedFileError(f"it cannot be read ({type(error).__name__}: {error})") from error


def members_of(data: bytes) -> Mapping[str, bytes]:
    """Return the members of a checked archive by name, sorted."""
    with ZipFile(io.BytesIO(data)) as archive:
        return {name: archive.read(name) for name in sorted(archive.namelist())}


def _problems(members: list[ZipInfo], n_bytes: int, allowed: frozenset[str]) -> Iterator[str]:
    names = [member.filename for member in members]
    if len(set(names)) < len(names):
        yield "two members have the same name. Expected unique names"
    for member in members:
        if member.filename not in allowed and not ARRAY.fullmatch(member.filename):
            yield f"it holds {member.filename[:60]!r}. Expected descriptions and arrays"
        if member.compress_type != ZIP_STORED or member.compress_size != member.file_size:
            yield f"{member.filename} is compressed. Expected stored members, which unpack to no more"
        if not ARRAY.fullmatch(member.filename) and member.file_size > MOST_SCHEMA_BYTES:
            yield f"{member.filename} has {member.file_size} bytes. Expected at most {MOST_SCHEMA_BYTES}"
    if sum(member.file_size for member in members) > n_bytes:
        yield "its members overlap. Expected separate members"
