"""Parquet files that cannot be wrong in silence: whole or absent, and checked when they are read.

Pages carry checksums; a digest over schema, metadata and values covers what these do not (the
footer). A file is written beside its place, brought to the disk and renamed. A file in parts holds
several tables of one kind, such as the scans that a job read, of which each is read by itself.
"""

import errno
import hashlib
import json
import os
from collections.abc import Iterable, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from icpshap.errors import UserError

ABOUT, DIGEST, ABOUT_DIGEST = b"icpshap", b"digest", b"icpshap_digest"
ARROW = b"ARROW:schema"  # under which Arrow keeps a copy of all this
DIGEST_LENGTH = 32  # characters
END = 2**16  # bytes of a file's end that are searched
KEY = b"\x18\x07" + ABOUT + b"\x18"  # of 7 bytes, and the type of what follows
DIGEST_KEY = b"\x18\x0e" + ABOUT_DIGEST + b"\x18" + bytes([DIGEST_LENGTH])


class StorageError(UserError):
    """A file cannot be read, or is not what was written."""


def write(path: str | Path, table: pa.Table, about: Mapping[str, Any]) -> None:
    """Write an Arrow table with the mapping `about`, which JSON can hold, as its metadata.

    Raises StorageError if the file cannot be written; what was there before stays.
    """
    told = json.dumps(about, sort_keys=True).encode()
    digests = {DIGEST: _digest(table, told), ABOUT_DIGEST: _digest_of(told)}
    table = table.replace_schema_metadata({ABOUT: told, **digests})
    with _replaced(path) as file:
        pq.write_table(table, file, write_page_checksum=True)


def write_parts(
    path: str | Path,
    schema: pa.Schema,
    parts: Iterable[tuple[str, pa.Table, Mapping[str, Any]]],
    about: Mapping[str, Any],
) -> None:
    """Write the Arrow tables of `parts`, an iterable of (name, table, mapping), each as a part.

    schema: that of each table, which has rows; mapping: what `parts_of` tells of the part, besides
    its number of `rows` and its `digest`. Only one part at a time is held. Raises StorageError as
    `write` does.
    """
    found: dict[str, dict[str, Any]] = {}
    with _replaced(path) as file, pq.ParquetWriter(file, schema, write_page_checksum=True) as made:
        for name, table, more in parts:
            made.write_table(table, row_group_size=len(table))
            known = {
                "group": len(found),
                "rows": len(table),
                "digest": _digest_of_part(name, table),
            }
            found[name] = {**more, **known}
        told = json.dumps({**about, "parts": found}, sort_keys=True).encode()
        made.add_key_value_metadata({ABOUT: told, ABOUT_DIGEST: _digest_of(told)})


def read(path: str | Path) -> tuple[pa.Table, dict[str, Any]]:
    """The Arrow table of a file and what `write` was told of it; of one in parts, all of them.

    Raises StorageError if the file cannot be read or is not, to the bit, what was written.
    """
    with _opened(path) as file:
        about = _checked_about(path, file.metadata.metadata or {})
        if "parts" in about:
            names = sorted(about["parts"], key=lambda name: about["parts"][name]["group"])
            return pa.concat_tables(_part(path, file, about, name) for name in names), about
        table = file.read()
    metadata = table.schema.metadata or {}
    if metadata.get(DIGEST) != _digest(table, metadata[ABOUT]):
        raise _damaged(path, "its content does not have the digest that was written with it")
    return table, about


def read_part(path: str | Path, name: str) -> pa.Table:
    """The Arrow table of a part of a file; nothing else of it is read. Raises StorageError."""
    with _opened(path) as file:
        about = _checked_about(path, file.metadata.metadata or {})
        if name not in about.get("parts", {}):
            raise _damaged(path, f"it has no part {name}")
        return _part(path, file, about, name)


def parts_of(paths: Iterable[str | Path]) -> dict[str, tuple[str | Path, dict[str, Any]]]:
    """File and what is told of it of each part of several files, by name of the part."""
    return {
        name: (path, told)
        for path in paths
        for name, told in read_about(path).get("parts", {}).items()
    }


def read_about(path: str | Path) -> dict[str, Any]:
    """What `write` was told of a file; nothing else of it is read or checked.

    A run begins with thousands of these, so that first it is looked for in the end of the file as
    it is written there, and believed if it has its digest.

    Raises StorageError if there is no such file, or its end cannot be read or is not what was
    written.
    """
    if (told := _told_in_the_end(path)) is not None:
        return json.loads(told)
    try:
        metadata = pq.read_metadata(path).metadata or {}
    except (OSError, ValueError, pa.ArrowException) as error:
        raise _damaged(path, str(error).splitlines()[0] if str(error) else "unreadable") from None
    return _checked_about(path, metadata)


def largest_part(path: str | Path) -> int:
    """Rows of the largest part of a file; 0 if it is damaged, which who reads it says.

    FileNotFoundError if there is no such file.
    """
    if not os.path.exists(path):
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))
    try:
        return max((part["rows"] for part in read_about(path)["parts"].values()), default=0)
    except (StorageError, KeyError):
        return 0


def digest_of(mapping: object) -> str:
    """Short digest of a mapping that JSON can hold; lists and tuples are alike."""
    return hashlib.sha256(json.dumps(mapping, sort_keys=True).encode()).hexdigest()[:16]


@contextmanager
def _replaced(path):
    """A file to write into, which takes the place of `path` once it is whole."""
    path = Path(path)
    temporary = path.with_name(path.name + ".part")
    try:
        with open(temporary, "wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
        _sync_folder(path.parent)
    except OSError as error:
        raise StorageError(
            f"{path}: cannot be written: {error.strerror or error}.\n"
            "Hint: make room on the disk, or check the permissions of the folder."
        ) from None
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def _opened(path):
    """A Parquet file that checks its pages."""
    try:
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            yield file
    except FileNotFoundError:
        raise StorageError(f"{path}: no such file.\nHint: run the workflow; it makes it.") from None
    except StorageError:
        raise
    except (OSError, ValueError, pa.ArrowException) as error:
        raise _damaged(path, str(error).splitlines()[0] if str(error) else "unreadable") from None


def _part(path, file, about, name):
    """The table of a part of an open file: one of its row groups."""
    known = about["parts"][name]
    table = file.read_row_group(known["group"])
    if _digest_of_part(name, table) != known["digest"]:
        raise _damaged(path, f"its part {name} does not have the digest that was written with it")
    return table


def _digest_of_part(name, table):
    return _digest(table, name.encode()).decode()


def _told_in_the_end(path):
    """The bytes of what `write` was told; None unless they are found at once, with their digest.

    The footer of a Parquet file holds its metadata as Thrift's compact protocol writes two strings:
    field type, length (seven bits a byte, the lowest first), bytes; and again.
    """
    try:
        with open(path, "rb") as file:
            size = file.seek(0, os.SEEK_END)
            file.seek(-min(size, END), os.SEEK_END)
            end = file.read()
    except OSError:
        return None
    start = end.rfind(KEY)
    digest = end.rfind(DIGEST_KEY)
    if start < 0 or digest < 0:
        return None
    position, length, shift = start + len(KEY), 0, 0
    while position < len(end):
        byte = end[position]
        length |= (byte & 127) << shift
        position, shift = position + 1, shift + 7
        if byte < 128:
            break
    told = end[position : position + length]
    digest += len(DIGEST_KEY)
    return told if end[digest : digest + DIGEST_LENGTH] == _digest_of(told) else None


def _checked_about(path, metadata):
    """What `write` was told, of the metadata of a file; StorageError if they are not as written."""
    if ABOUT not in metadata:
        raise _damaged(path, "it has none of the metadata that are written")
    told = metadata[ABOUT]
    # Files of earlier versions have no such digest; their whole one is checked when they are read.
    same = metadata.get(ABOUT_DIGEST, _digest_of(told)) == _digest_of(told)
    if not same or set(metadata) - {ABOUT, ABOUT_DIGEST, DIGEST, ARROW}:
        raise _damaged(path, "its metadata do not have the digest that was written with it")
    try:
        return json.loads(told)
    except ValueError:
        raise _damaged(path, "its metadata are no JSON") from None


def _digest_of(told):
    return hashlib.sha256(told).hexdigest()[:DIGEST_LENGTH].encode()


def _damaged(path, why):
    return StorageError(
        f"{path}: the file is damaged or was not written by this program: {why}.\n"
        "Hint: remove it; the workflow makes it again."
    )


def _digest(table, told):
    """Digest over names, types, units, metadata and values of a table."""
    digest = hashlib.sha256(told)
    for field, column in zip(table.schema, table.columns, strict=True):
        described = sorted((field.metadata or {}).items())
        digest.update(repr((field.name, str(field.type), described, len(column))).encode())
        digest.update(_bytes(column))
    return digest.hexdigest()[:DIGEST_LENGTH].encode()


def _bytes(column):
    """The values of a column as bytes, however Arrow happens to hold them."""
    if pa.types.is_string(column.type) or pa.types.is_large_string(column.type):
        return json.dumps(column.to_pylist()).encode()
    return np.ascontiguousarray(column.to_numpy()).tobytes()


def _sync_folder(folder):
    """Bring a renaming to the disk, where the system can open folders."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        return
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
