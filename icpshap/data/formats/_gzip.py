"""Scan files that are compressed by gzip: unpacked into memory, whole and checked."""

import gzip
import zlib
from io import BytesIO

from icpshap.data.formats._lines import GET_AGAIN
from icpshap.errors import DataError

SUFFIX = ".gz"
MAXIMUM_BYTES = 2**31  # of what is unpacked; no scan is so large
BLOCK = 2**20


def opened(path):
    """The file at a `Path`, open for reading in binary; what ends in .gz is unpacked.

    Raises DataError for what cannot be unpacked.
    """
    if path.suffix.lower() != SUFFIX:
        return path.open("rb")
    content = BytesIO()
    with path.open("rb") as packed, gzip.GzipFile(fileobj=packed) as file:
        try:
            while block := file.read(BLOCK):
                content.write(block)
                if content.tell() > MAXIMUM_BYTES:
                    raise DataError(
                        f"{path}: more than {MAXIMUM_BYTES} bytes when unpacked, expected a scan.",
                        "unpack the file and look at what it holds.",
                    )
        except (gzip.BadGzipFile, EOFError, zlib.error) as error:
            raise DataError(f"{path}: cannot be unpacked ({error}).", GET_AGAIN) from None
    content.seek(0)
    return content
