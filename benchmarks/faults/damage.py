"""Files of a finished run, damaged: by bits, by blocks, cut off, emptied, overwritten."""

import base64
import struct
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.faults import in_process
from benchmarks.faults.outcome import Fault, of_call
from icpshap import storage, tables
from icpshap.jobs import start

BLOCK = 512  # bytes of a disk's sector
RESULTS = "results/tiny_fixed/own"
KEYS = (b"data", b"plan", b"registered", b"sequence", b"overlap", b"causes")  # of the metadata


def files():
    """A file of every kind, with the name of its table."""
    return {
        "resources/own/scans/0.parquet": "scans",
        "resources/own/poses.parquet": "poses",
        f"{RESULTS}/overlaps/0.parquet": "overlaps",
        f"{RESULTS}/pairs/0.parquet": "pairs",
        f"{RESULTS}/runs/0.parquet": "runs",
        f"{RESULTS}/uncertainty.parquet": "uncertainty",
        f"{RESULTS}/shap.parquet": "shap",
        f"{RESULTS}/resampled.parquet": "resampled",
        "results/tiny_fixed/shap.parquet": "shap",
    }


def faults(folder, config, seed, each):
    """Faults done to each kind of file; each: how many of each random kind of damage."""
    generator = np.random.default_rng(seed)
    folder = Path(folder)
    for path, table in files().items():
        whole = (folder / path).read_bytes()
        for words, damaged in damages(whole, generator, each):
            yield Fault(f"{path}: {words}", partial(_read, folder / path, table, whole, damaged))
    yield from _through_the_workflow(folder, config, generator, each)


def damages(whole, generator, each):
    """(words, bytes) of a file that is no longer whole."""
    size = len(whole)
    footer = size - 8 - struct.unpack("<I", whole[-8:-4])[0]
    for _ in range(each):
        yield flipped(whole, int(generator.integers(footer)), generator)
        yield flipped(whole, int(generator.integers(footer, size)), generator)
        cut = int(generator.integers(1, size))
        yield f"cut off at byte {cut} of {size}", whole[:cut]
        start = int(generator.integers(size)) // BLOCK * BLOCK
        zeros = whole[:start] + bytes(len(whole[start : start + BLOCK])) + whole[start + BLOCK :]
        yield f"a block of zeros at byte {start}", zeros
    yield "zero-length", b""
    yield "garbage", generator.bytes(size)
    yield "garbage between the magic words", b"PAR1" + generator.bytes(size - 8) + b"PAR1"
    yield "bytes behind its end", whole + generator.bytes(7)
    yield "written twice over", whole + whole


def flipped(whole, position, generator):
    damaged = bytearray(whole)
    bit = int(generator.integers(8))
    damaged[position] ^= 1 << bit
    return f"bit {bit} of byte {position} of {len(whole)} flipped", bytes(damaged)


def _read(path, table, whole, damaged):
    """The file as the scripts read it: named, or its content to the bit."""
    expected, about = storage.read(path)
    path.write_bytes(damaged)

    def is_right(found):
        (read, told), frame = found
        same = read.equals(expected, check_metadata=True) and told == about
        return same and frame.equals(expected.to_pandas())

    try:
        return of_call(lambda: (storage.read(path), tables.read(path, table)), is_right, path.name)
    finally:
        path.write_bytes(whole)


def _through_the_workflow(folder, config, generator, each):
    """Files whose end alone is looked at: when a run begins, by the explanation, by the joining."""
    with in_process.inside(folder):
        found = in_process.planner(config)
    for path in files():
        for _ in range(each):
            whole = (folder / path).read_bytes()
            footer = len(whole) - 8 - struct.unpack("<I", whole[-8:-4])[0]
            words, damaged = flipped(whole, int(generator.integers(footer, len(whole))), generator)
            attempt = partial(_look, folder, found, path, damaged)
            yield Fault(f"{path} as a run begins: {words}", attempt)
    for path in (f"{RESULTS}/runs/0.parquet", f"{RESULTS}/pairs/0.parquet"):
        whole = (folder / path).read_bytes()
        for key in KEYS[: 2 * each]:
            for position in _places(whole, key):
                words, damaged = flipped(whole, position, generator)
                attempt = partial(_explain, folder, found, path, damaged)
                yield Fault(f"{path}, explained: {key.decode()}, {words}", attempt)


def _places(whole, key):
    """A byte of a key of the metadata, in the clear and in the copy of them in base 64."""
    if (position := whole.find(b'"' + key + b'"')) >= 0:
        yield position + 2
    for shift in range(3):
        # Of the first and the last group of characters, some bits belong to the neighbours.
        text = base64.b64encode(bytes(shift) + b'"' + key + b'": ')[4:-4]
        if (position := whole.find(text)) >= 0:
            yield position + 1


def _look(folder, found, path, damaged):
    """What a run says as it begins; a file that it would put aside is made again."""
    file = folder / path
    whole, expected = file.read_bytes(), storage.read(file)[0]
    file.write_bytes(damaged)
    try:
        with in_process.inside(folder):
            selected = found.config.run, found.config.sequences
            return of_call(
                lambda: start.look(found, *selected, False) or storage.read(path)[0],
                lambda said: isinstance(said, list) or said.equals(expected),
                path,
            )
    finally:
        file.write_bytes(whole)


def _explain(folder, found, path, damaged):
    file, output = folder / path, folder / "explained"
    whole = file.read_bytes()
    output.mkdir(exist_ok=True)
    file.write_bytes(damaged)
    expected = storage.read(folder / RESULTS / "shap.parquet")[0]
    try:
        with in_process.inside(folder):
            return of_call(
                lambda: in_process.explain(found, "tiny_fixed", "own", output),
                lambda _: storage.read(output / "shap.parquet")[0].equals(expected),
                path,
            )
    finally:
        file.write_bytes(whole)
