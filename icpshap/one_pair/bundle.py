"""Two scans as a file to attach to an issue: what is needed to see again what a user saw."""

import io
import json
import platform
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from icpshap import __version__
from icpshap.jobs import provenance
from icpshap.one_pair.explanation import EPOCH, writable

REFERENCE, SOURCE = "reference.npy", "source.npy"
COMMAND, VERSIONS = "command.txt", "versions.json"


def write(
    path: str | Path,
    reference: np.ndarray,
    source: np.ndarray,
    transforms: Mapping[str, np.ndarray],
    options: list[str],
) -> None:
    """Write a ZIP of points (n, 3), (m, 3) [m], transforms, command line and versions.

    transforms: matrices (4, 4) by the option of the command that names them; options: the others.
    No name of a file, a user or a machine is in it. Raises UserError if it cannot be written.
    """
    parts = {REFERENCE: _array(reference), SOURCE: _array(source)}
    words = ["icpshap", "explain", *parts]
    for option, T in transforms.items():
        name = f"{option}.txt"
        words += [f"--{option}", name]
        parts[name] = "".join(f"{' '.join(map(repr, row))}\n" for row in T.tolist())
    parts[COMMAND] = " ".join(words + options) + "\n"
    versions = {
        "icpshap": __version__,
        "python": platform.python_version(),
        "machine": platform.machine(),
        "system": platform.system(),
        **provenance.packages(),
    }
    parts[VERSIONS] = json.dumps(versions, indent=1) + "\n"
    with writable(path), zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in parts.items():
            file.writestr(zipfile.ZipInfo(name, EPOCH), content, zipfile.ZIP_DEFLATED)


def _array(points):
    content = io.BytesIO()
    np.save(content, points)
    return content.getvalue()
