"""Scans, poses and folders with one thing wrong: each is refused by name, with what was expected.

Every row of a table is a fault: its name, the file, and what the message has to say.
"""

import errno
import os
import re
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pytest
from conftest import REPOSITORY
from hostile_files import BODY, POINTS, compressed, csv, literals, packed, pcd, ply, text
from known_files import written
from misbehaving_server import POSE_HEADER, poses_csv, scan_csv
from scipy.spatial.transform import Rotation

from icpshap.data.folder import find_folder_files
from icpshap.data.poses import read_poses
from icpshap.data.scans import read_scan
from icpshap.errors import DataError

LONG = 10**6


def refused(read, path, expected):
    """The message of the DataError: one that names the file, says ``expected`` and hints."""
    with pytest.raises(DataError) as error:
        read(path)
    message = str(error.value)
    assert str(path) in message.partition("\nHint: ")[0], message
    assert re.search(expected, message), message
    assert len(message) < 800 and message.count("\nHint: ") == 1, message
    return message


def cases(*rows):
    """Parameters named by the first value of each row."""
    return [pytest.param(*row[1:], id=row[0]) for row in rows]


# Scans that are right, whatever they look like

FACES = struct.pack("<B3i", 3, 0, 1, 2) + struct.pack("<B4i", 4, 0, 1, 2, 3)
LISTS = ("element face 2", "property list uchar int vertex_indices")
RIGHT = cases(
    ("ply", "a.ply", ply()),
    (
        "ply of big endian",
        "a.ply",
        ply(encoding="binary_big_endian", body=POINTS.astype(">f4").tobytes()),
    ),
    ("ply of doubles", "a.ply", ply(kind="double", body=POINTS.astype("<f8").tobytes())),
    ("ply with faces", "a.ply", ply(*LISTS, body=BODY + FACES)),
    ("ply with a line end behind", "a.ply", ply(body=BODY + b"\r\n")),
    ("ply with a foreign comment", "a.ply", ply("comment Größe", "obj_info \xff")),
    ("ply with lines of windows", "a.ply", ply(body=b"").replace(b"\n", b"\r\n") + BODY),
    ("ply with blank lines", "a.ply", ply(encoding="ascii", body=b"\n" + text() + b"\n \n")),
    ("pcd", "a.pcd", pcd()),
    ("pcd stretched by a page", "a.pcd", pcd(body=BODY + bytes(4096))),
    ("pcd without count", "a.pcd", pcd(COUNT=None)),
    ("pcd of text", "a.pcd", pcd("ascii", text())),
    ("pcd compressed", "a.pcd", compressed()),
    ("pcd compressed, stretched", "a.pcd", compressed(packed() + bytes(4096))),
    ("csv", "a.csv", csv()),
    ("csv of windows", "a.csv", csv().replace(b"\n", b"\r\n")),
    ("csv with a mark of utf-8", "a.csv", b"\xef\xbb\xbf" + csv()),
    ("csv with empty lines", "a.csv", csv().replace(b"\n", b"\n\n")),
    ("csv with quotes", "a.csv", csv(header=b'"x","y","z"\n').replace(b"e", b"E")),
    ("csv of upper case", "a.CSV", csv()),
    ("csv of many digits", "a.csv", csv(re.sub(rb"(\.\d+)", rb"\g<1>" + b"0" * 5000, csv()[6:]))),
)


@pytest.mark.parametrize(("name", "content"), RIGHT)
def test_scan_that_looks_odd_is_read_right(tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content)
    points, dropped = read_scan(path)
    np.testing.assert_array_equal(points, POINTS.astype(float))
    assert points.dtype == float and points.flags.writeable and not dropped


# Scans that are not

ENDS_EARLY = "the file ends before the last one"
MORE = "more follows after all that it announces"
HEADER = r"no readable \.(ply|pcd) header .*: line \d+: "
NINE = b"\xff" * 9
TEXT = {"encoding": "ascii"}
FIELD = {"FIELDS": "x y z i", "SIZE": "4 4 4 4", "TYPE": "F F F F"}
MANY = " ".join(["1"] * 3000)
PLY_FAULTS = cases(
    ("fewer vertices", ply(vertices=39), MORE),
    ("no vertices", ply(vertices=0), MORE),
    ("more vertices", ply(vertices=41), f"41 points, but {ENDS_EARLY}"),
    ("minus five", ply(vertices=-5), HEADER + "element vertex '-5', expected a whole number"),
    ("1e8 vertices", ply(vertices=10**8), ENDS_EARLY),
    ("2^62 vertices", ply(vertices=2**62), HEADER + "element vertex '4611686018427387904'"),
    ("2^70 vertices", ply(vertices=2**70), HEADER + "element vertex"),
    ("vertices in words", ply(vertices="many"), HEADER + "element vertex 'many'"),
    ("vertices with an underscore", ply(vertices="4_0"), HEADER + "element vertex '4_0'"),
    ("vertices of 5000 digits", ply(vertices="9" * 5000), HEADER),
    ("unknown type", ply(kind="float16"), HEADER + "property 'float16 x', expected a type"),
    ("unknown encoding", ply(encoding="binary"), HEADER + "'format binary 1.0' is no line"),
    ("another version", ply().replace(b" 1.0", b" 2.0"), HEADER + "'format binary.* is no line"),
    ("no format", ply().replace(b"format", b"comment"), HEADER + "no format before it"),
    ("no vertex", ply().replace(b"vertex", b"point"), HEADER + "no element vertex"),
    ("vertices twice", ply("element vertex 40"), HEADER + "element 'vertex' for a second time"),
    ("unknown line", ply("elephant 5"), HEADER + "'elephant 5' is no line"),
    ("x twice", ply("property float x", body=BODY), "more than one column x .*expected one"),
    ("a list of numbers", ply("property list uchar int i"), HEADER + "the vertices have a list"),
    ("no magic", ply()[4:], HEADER + "'format .*expected ply"),
    ("a mark of utf-8", b"\xef\xbb\xbf" + ply(), HEADER + ".*expected ply"),
    ("utf-16", ply(encoding="ascii", body=text()).decode().encode("utf-16"), HEADER),
    ("only NUL", bytes(5000), HEADER),
    ("a line without end", b"ply\ncomment " + b"a" * 2 * LONG, HEADER + "no end_header within"),
    ("a header without end", b"ply\n" + b"comment\n" * LONG, HEADER + "no end_header within"),
    ("3000 properties", ply(*(f"property float p{k}" for k in range(3000))), "3003 columns .*1000"),
    ("text for binary", ply(body=text()), MORE),
    ("binary for text", ply(encoding="ascii"), "is not a number|columns, expected|" + ENDS_EARLY),
    ("faces missing", ply(*LISTS), f"2 face, but {ENDS_EARLY}"),
    ("a face missing", ply(*LISTS, body=BODY + FACES[:13]), f"2 face, but {ENDS_EARLY}"),
    ("faces cut off", ply(*LISTS, body=BODY + FACES[:-1]), f"2 face, but {ENDS_EARLY}"),
    ("one face more", ply(*LISTS, body=BODY + FACES + FACES[:13]), MORE),
    ("1e15 faces", ply("element face 100000000000000", LISTS[1]), ENDS_EARLY),
    ("vertices for faces", ply(*LISTS, body=BODY + FACES, vertices=39), "face has a list of 0"),
    ("a face of 2", ply("element face 1", LISTS[1], body=BODY + b"\2" + bytes(8)), "a list of 2"),
    ("a list of -1", ply(LISTS[0], "property list char int i", body=BODY + NINE), "a list of -1"),
    ("a list of 2^32", ply(LISTS[0], "property list uint int i", body=BODY + NINE), ENDS_EARLY),
    ("a list by float", ply(LISTS[0], "property list float int i"), HEADER + "property 'list"),
    ("2^40 colours", ply("element colour 1000000000000", "property int r"), ENDS_EARLY),
    ("text, fewer", ply(encoding="ascii", body=text(), vertices=39), f"line 47: .*{MORE}"),
    ("text, more", ply(encoding="ascii", body=text(), vertices=41), ENDS_EARLY),
    ("text, 1e14", ply(encoding="ascii", body=text(), vertices=10**14), ENDS_EARLY),
    ("text, faces", ply(*LISTS, **TEXT, body=text() + b"3 0 1 2\n"), ENDS_EARLY),
    ("text, a face of 5", ply(*LISTS, **TEXT, body=text() + b"5 0 1\n" * 2), "line 50: 3 "),
    ("text, vertices for faces", ply(*LISTS, **TEXT, body=text(), vertices=38), "columns"),
    ("text, NUL", ply(encoding="ascii", body=b"1 2 3\0\n" * 40), r"line 8, column z: '3\\x00'"),
    ("text, commas", ply(encoding="ascii", body=b"1,5 2 3\n" * 40), "line 8, column x: '1,5'"),
    ("text, other digits", ply(encoding="ascii", body="1 ٣ 3\n".encode() * 40), "column y: '٣'"),
    ("text, a line without end", ply(encoding="ascii", body=b"1 " * LONG), "line 8: longer than"),
)  # fmt: skip


@pytest.mark.parametrize(("content", "expected"), PLY_FAULTS)
def test_ply_that_is_wrong(tmp_path, content, expected):
    (tmp_path / "a.ply").write_bytes(content)
    refused(read_scan, tmp_path / "a.ply", expected)


COPY_OF_NOTHING = b"\xe0\xff\xff"  # a copy of 264 bytes from before the start
PCD_FAULTS = cases(
    ("fewer points", pcd(POINTS=39, WIDTH=39), MORE),
    ("no points", pcd(POINTS=0, WIDTH=0), MORE),
    ("more points", pcd(POINTS=41, WIDTH=41), ENDS_EARLY),
    ("points and width differ", pcd(POINTS=39), HEADER + "POINTS 39, expected WIDTH 40 x HEIG"),
    ("width and height", pcd(HEIGHT=2), HEADER + r"POINTS 40, expected WIDTH 40 x HEIGHT 2 = 80"),
    ("minus forty", pcd(POINTS=-40, WIDTH=-40), HEADER + "POINTS '-40', expected a whole number"),
    ("1e8 points", pcd(POINTS=10**8, WIDTH=10**8), ENDS_EARLY),
    ("1e8 points, no width", pcd(POINTS=10**8, WIDTH=None, HEIGHT=None), ENDS_EARLY),
    ("2^62 points", pcd(POINTS=2**62, WIDTH=2**62), HEADER + "POINTS '4611686018427387904'"),
    ("points in words", pcd(POINTS="forty"), HEADER + "POINTS 'forty'"),
    ("points of 5000 digits", pcd(POINTS="4" * 5000), HEADER),
    ("two numbers of points", pcd(POINTS="40 40"), HEADER + "POINTS has 2 values, expected one"),
    ("count 2^40", pcd(**FIELD, COUNT=f"1 1 1 {2**40}"), "1099511627779 columns .*at most 1000"),
    ("count 2^40 of x", pcd(COUNT=f"{2**40} 1 1"), "more than one column x"),
    ("count -1", pcd(COUNT="1 1 -1"), HEADER + "COUNT '-1', expected a whole number"),
    ("count 0", pcd(COUNT="1 1 0"), HEADER + "COUNT 0, expected at least 1"),
    ("size 3", pcd(SIZE="4 4 3"), HEADER + "TYPE 'F' of SIZE '3' .*expected F of 4 or 8"),
    ("size 2^40", pcd(SIZE=f"4 4 {2**40}"), HEADER + "TYPE 'F' of SIZE '1099511627776'"),
    ("size -4", pcd(SIZE="4 4 -4"), HEADER + "TYPE 'F' of SIZE '-4'"),
    ("half a float", pcd(SIZE="4 4 2"), HEADER + "TYPE 'F' of SIZE '2'"),
    ("type X", pcd(TYPE="F F X"), HEADER + "TYPE 'X' of SIZE '4'"),
    ("a type missing", pcd(TYPE="F F"), HEADER + "TYPE has 2 values for 3 FIELDS"),
    ("a size too many", pcd(SIZE="4 4 4 4"), HEADER + "SIZE has 4 values for 3 FIELDS"),
    ("no fields", pcd(FIELDS=None), HEADER + "no FIELDS before it"),
    ("no type", pcd(TYPE=None), HEADER + "no TYPE before it"),
    ("no points entry", pcd(POINTS=None), HEADER + "no POINTS before it"),
    ("x twice", pcd(FIELDS="x y x z", SIZE="4 4 4 4", TYPE="F F F F", COUNT=None), "column x"),
    ("3000 fields", pcd(FIELDS="x y z " + MANY, SIZE="4 4 4 " + MANY, COUNT=None,
                        TYPE="F F F " + MANY.replace("1", "U")), "3003 columns .*at most 1000"),
    ("points twice", pcd(POINTS="40\nPOINTS 39"), HEADER + "POINTS for a second time"),
    ("unknown entry", pcd(ELEPHANTS=5), HEADER + "'ELEPHANTS', expected one of VERSION"),
    ("unknown data", pcd("binary_zipped"), HEADER + "DATA 'binary_zipped', expected one of ascii"),
    ("no data", pcd(body=b"").replace(b"DATA", b"#"), HEADER + "the file ends, expected DATA"),
    ("points behind", pcd(body=BODY + BODY[:12]), MORE),
    ("too many zeros", pcd(body=BODY + bytes(10**6)), MORE),
    ("text, fewer", pcd("ascii", text(), POINTS=39, WIDTH=39), f"line 50: .*{MORE}"),
    ("text, more", pcd("ascii", text(), POINTS=41, WIDTH=41), ENDS_EARLY),
    ("compressed, fewer", compressed(POINTS=39, WIDTH=39), "480 bytes .*expected 468: .* 39 p"),
    ("compressed, more", compressed(POINTS=41, WIDTH=41), "480 bytes .*expected 492: .* 41 p"),
    ("compressed, 1e8", compressed(POINTS=10**8, WIDTH=10**8), "480 bytes .*expected 1200000000"),
    ("compressed, 1e8, agreed", compressed(packed(unpacked_bytes=12 * 10**8), POINTS=10**8,
                                           WIDTH=10**8), "more than so few can stand for"),
    ("compressed, 3e8, lie", compressed(packed(unpacked_bytes=2**32 - 1)), "4294967295 bytes"),
    ("compressed, beyond the file", compressed(packed(packed_bytes=2**32 - 1)), ENDS_EARLY),
    ("compressed, less than there", compressed(packed(packed_bytes=400)), "another number of"),
    ("compressed, another row", compressed(**FIELD, COUNT=None), "480 bytes .*expected 640"),
    ("compressed, count 300", compressed(**FIELD, COUNT="1 1 1 300"), "480 bytes .*expected 48480"),
    ("compressed, no sizes", compressed(b"\0\0\0"), ENDS_EARLY),
    ("compressed, nothing", compressed(b""), ENDS_EARLY),
    ("compressed, too little", compressed(packed(lzf=literals(BODY[:-1]))), "another number"),
    ("compressed, too much", compressed(packed(lzf=literals(BODY + b"a"))), "another number"),
    ("compressed, of nothing", compressed(packed(lzf=COPY_OF_NOTHING * 9)), "before the start"),
    ("compressed, half a copy", compressed(packed(lzf=literals(BODY[:470]) + b"\xe0")), "within"),
    ("compressed, half literals", compressed(packed(lzf=literals(BODY)[:-3])), "another number"),
    ("compressed, points behind", compressed(packed() + BODY[:12]), MORE),
)  # fmt: skip


@pytest.mark.parametrize(("content", "expected"), PCD_FAULTS)
def test_pcd_that_is_wrong(tmp_path, content, expected):
    (tmp_path / "a.pcd").write_bytes(content)
    refused(read_scan, tmp_path / "a.pcd", expected)


NAMES = "line 1: expected a header with the columns x, y and z"
FOREIGN = r"line 1: expected a header .*\nHint: the file is not in UTF-8"
WIDE = b",".join(b"c%d" % k for k in range(LONG // 10)) + b",x,y,z\n"
CSV_FAULTS = cases(
    ("a million columns", csv(b"1," * LONG + b"1\n"), "line 2: 1000001 columns, expected 3"),
    ("a million names", csv(header=b"a," * LONG + b"x,y,z\n"), "line 1: longer than 1048576"),
    ("100,000 names", csv(header=WIDE), "line 2: 3 columns, expected 100003"),
    ("a wide line after empty ones", csv(b"\n\n1,2,3\n\n4,5\n"), "line 6: 2 columns, expected 3"),
    ("a wrong cell after empty lines", csv(b"\n\n1,2,3\n\n4,b,6\n"), "line 6, column y: 'b'"),
    ("NUL in a cell", csv(b"1,2\0,3\n"), r"line 2, column y: '2\\x00' is not a number"),
    ("only NUL", bytes(5000), FOREIGN),
    ("utf-16", csv().decode().encode("utf-16"), FOREIGN),
    ("utf-32", csv().decode().encode("utf-32"), FOREIGN),
    ("latin-1 names", "größe;x;y;z\n".encode("latin-1"), "no points"),
    ("lines of old macs", csv().replace(b"\n", b"\r"), NAMES),
    ("one lone CR", csv(b"1,2,3\r4,5,6\n"), "2 rows in 1 lines below the header"),
    ("digits for ever", csv(b"1," + b"9" * 10**5 + b",3\n"), "1 of 1 rows are not finite"),
    ("letters for ever", csv(b"1," + b"a" * 10**5 + b",3\n"), r"column y: 'a{57}\.\.\.' is not a"),
    ("1e400", csv(b"1,1e400,3\n"), "1 of 1 rows are not finite"),
    ("a decimal comma", csv(b"1,5,2,5,3,5\n"), "line 2: 6 columns, expected 3"),
    ("a quoted decimal comma", csv(b'"1,5",2,3\n'), "line 2, column x: '1,5' is not a number"),
    ("a thousands comma", csv(b'"1,234.5",2,3\n'), "line 2, column x: '1,234.5' is not a number"),
    ("a thousands apostrophe", csv(b"1'234.5,2,3\n"), 'column x: "1\'234.5" is not a number'),
    ("a thousands space", csv(b"1 234.5,2,3\n"), "column x: '1 234.5' is not a number"),
    ("a thousands underscore", csv(b"1_234.5,2,3\n"), "column x: '1_234.5' is not a number"),
    ("bars", csv(b"1|2|3\n", b"x|y|z\n"), NAMES),
    ("semicolons, decimal commas", csv(b"1,5;2;3\n", b"x;y;z\n"), "line 2, column x: '1,5' is not"),
    ("tabs, one too many", csv(b"1\t2\t3\t\n", b"x\ty\tz\n"), "line 2: 4 columns, expected 3"),
    ("a quote that swallows", csv(b'1,2,3,"\n4,5,6,"\n', b"x,y,z,n\n"), "1 rows in 2 lines"),
    ("a quote that stays open", csv(b'1,2,"3\n4,5,6\n'), "columns, expected|not a number|rows in"),
    ("letters", csv(b"1,2,three\n"), "line 2, column z: 'three' is not a number"),
    ("hexadecimal", csv(b"1,2,0x10\n"), "line 2, column z: '0x10' is not a number"),
    ("Fortran", csv(b"1,2,1.5d3\n"), "line 2, column z: '1.5d3' is not a number"),
    ("NA", csv(b"1,2,NA\n"), "line 2, column z: 'NA' is not a number"),
    ("other digits", csv("1,2,٣\n".encode()), "line 2, column z: '٣' is not a number"),
    ("Control-Z", csv(b"1,2,3\n\x1a"), "line 3: 1 columns, expected 3"),
    ("nan", csv(b"1,2,3\n1,NaN,3\n"), "1 of 2 rows are not finite .*first is row 2"),
    ("Infinity", csv(b"1,2,3\n1,-Infinity,3\n"), "1 of 2 rows are not finite .*first is row 2"),
    ("1e300", csv(b"1,2,3\n1,2,-1e300\n"), "z is -1e.300 in row 2 .*at most 100000 m.*\n.*units"),
    ("a map's coordinates", csv(b"500000,5200000,3\n"), "x is 500000 in .*\n.*origin of a map"),
)  # fmt: skip


@pytest.mark.parametrize(("content", "expected"), CSV_FAULTS)
def test_csv_that_is_wrong(tmp_path, content, expected):
    (tmp_path / "a.csv").write_bytes(content)
    refused(read_scan, tmp_path / "a.csv", expected)


def test_a_far_point_is_named_by_its_row_of_the_file(tmp_path):
    path = written(tmp_path / "a.csv", "x,y,z\n1,2,3\nnan,0,0\n1,2e5,3\n1,1e5,-1e5\n")
    with pytest.raises(DataError, match=r"y is 200000 in row 3 of the points"):
        read_scan(path, drop_non_finite=True)
    path = written(tmp_path / "a.csv", "x,y,z\n1e5,-1e5,3\n")
    np.testing.assert_array_equal(read_scan(path)[0], [[1e5, -1e5, 3]])


# Paths that are no files


def directory(path):
    path.mkdir()


def dangling(path):
    path.symlink_to("nowhere")


def circle(path):
    path.symlink_to(path.name)


def missing(path):
    pass


NOT_FILES = cases(
    ("a folder", directory, "a folder; expected a file"),
    ("a dangling link", dangling, "a symbolic link to nowhere, which is not there"),
    ("a link to itself", circle, "a symbolic link to|no such file|cannot be read"),
    ("nothing", missing, "no such file; expected a file"),
    ("a pipe", os.mkfifo, "no regular file but a device, pipe or socket"),
)
READERS = cases(
    ("csv", "a.csv", read_scan),
    ("ply", "a.ply", read_scan),
    ("pcd", "a.pcd", read_scan),
    ("ply.gz", "a.ply.gz", read_scan),
    ("bin", "a.bin", read_scan),
    ("npy", "a.npy", read_scan),
    ("npz", "a.npz", read_scan),
    ("xyz", "a.xyz", read_scan),
    ("poses", "poses.txt", lambda path: read_poses(path, 2)),
)


@pytest.mark.parametrize(("make", "expected"), NOT_FILES)
@pytest.mark.parametrize(("name", "read"), READERS)
def test_a_path_that_is_no_file(tmp_path, make, expected, name, read):
    make(tmp_path / name)
    refused(read, tmp_path / name, expected)


@pytest.mark.parametrize(
    ("code", "expected"),
    [
        (errno.EACCES, "Permission denied"),
        (errno.ENOENT, "No such file"),
        (errno.EIO, "put/output"),
    ],
)
@pytest.mark.parametrize(("name", "read"), READERS)
def test_a_file_that_the_system_refuses(tmp_path, monkeypatch, name, read, code, expected):
    """Unreadable, gone after it was found, on a failing disk."""
    path = written(tmp_path / name, "x,y,z\n")

    def fail(*arguments, **options):
        raise OSError(code, os.strerror(code), str(path))

    monkeypatch.setattr(Path, "open", fail)
    monkeypatch.setattr("builtins.open", fail)
    refused(read, path, f"cannot be read .*{expected}.*\nHint: check the permissions")


def test_absurd_counts_take_no_memory(tmp_path):
    """One process reads them all; nothing of what they announce is allocated, nothing crashes."""
    contents = {
        f"{number}{suffix}": row.values[0]
        for suffix, rows in ((".ply", PLY_FAULTS), (".pcd", PCD_FAULTS))
        for number, row in enumerate(rows)
    }
    for name, content in contents.items():
        (tmp_path / name).write_bytes(content)
    program = (
        "import resource, sys\n"
        "from pathlib import Path\n"
        "from icpshap.data.scans import read_scan\n"
        "from icpshap.errors import DataError\n"
        "def peak():\n"
        "    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024\n"
        "before, refused = peak(), 0\n"
        "for path in sorted(Path(sys.argv[1]).iterdir()):\n"
        "    try:\n"
        "        read_scan(path)\n"
        "    except DataError:\n"
        "        refused += 1\n"
        "print(refused, peak() - before)\n"
    )
    process = subprocess.run(
        [sys.executable, "-c", program, str(tmp_path)],
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        check=True,
    )
    count, megabytes = process.stdout.split()
    assert int(count) == len(contents)
    assert float(megabytes) < 60  # the longest of them has 8


@pytest.mark.parametrize("suffix", [".csv", ".ply", ".pcd"])
def test_memory_is_a_few_times_the_array(tmp_path, suffix):
    count = 2 * 10**6
    points = np.random.default_rng(0).normal(0, 8, (count, 3)).astype("<f4")
    path = tmp_path / f"a{suffix}"
    if suffix == ".csv":
        table = pa.table(dict(zip("xyz", points.astype(float).T, strict=True)))
        pa.csv.write_csv(table, path)
    elif suffix == ".ply":
        path.write_bytes(ply(vertices=count, body=points.tobytes()))
    else:
        path.write_bytes(pcd(WIDTH=count, POINTS=count, body=points.tobytes()))
    program = (
        "import resource, sys\n"
        "from icpshap.data.scans import read_scan\n"
        "def peak():\n"
        "    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024\n"
        "before = peak()\n"
        "points, _ = read_scan(sys.argv[1])\n"
        "print((peak() - before) / points.nbytes)\n"
    )
    process = subprocess.run(
        [sys.executable, "-c", program, str(path)],
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        check=True,
    )
    assert float(process.stdout) < 5


# Poses

ROW = "1 0 0 0 0 1 0 0 0 0 1 0\n"
POSES = np.tile(np.eye(4), (2, 1, 1))
TUM = "0 1 2 3 0 0 0 1\n1 1 2 3 0 0 0 1\n"
POSE_FAULTS = cases(
    ("NUL", ROW + ROW.replace("0\n", "0\0\n"), r"line 2, column 12: '0\\x00' is not a finite"),
    ("utf-16", (ROW * 2).encode("utf-16"), "line 1: not a text file in UTF-8"),
    ("utf-16 without mark", (ROW * 2).encode("utf-16-le"), "is not a finite number|columns"),
    ("latin-1 in line 3", (ROW + ROW + "# größe\n").encode("latin-1"), "line 3: not a text file"),
    ("binary", bytes(range(256)) * 9, "line 1?.*not a text file"),
    ("digits for ever", ROW + ROW.replace("1", "1" * 10**5, 1), r"column 1: '1{37}\.\.\.' is not"),
    ("letters for ever", ROW + ROW.replace("1", "a" * 10**5, 1), r"column 1: 'a{37}\.\.\.' is not"),
    ("a million columns", "1 " * LONG, "line 1: 1000000 columns; expected 12 or 16"),
    ("nan", ROW + ROW.replace("1", "nan", 1), "line 2, column 1: 'nan' is not a finite number"),
    ("Infinity", ROW + ROW.replace("1", "Infinity", 1), "column 1: 'Infinity' is not a finite"),
    ("1e400", ROW + ROW.replace("0", "1e400", 1), "column 2: '1e400' is not a finite number"),
    ("an underscore", ROW + ROW.replace("1", "1_0", 1), "column 1: '1_0' is not a finite number"),
    ("other digits", ROW + ROW.replace("1", "١", 1), "column 1: '١' is not a finite number"),
    ("decimal commas", "0,0 1,0 2,0 3,0 0,0 0,0 0,0 1,0\n" * 2, "line 1: 9 columns"),
    ("decimal and other commas", "1,0, 0,0, 0,0, 0,0, 0,0, 0,0\n" * 2, "not a rotation"),
    ("semicolons", ROW.replace(" ", ";") * 2, "line 1: 1 columns; expected 12 or 16"),
    ("quotes", ROW.replace("1", '"1"') * 2, "line 1, column 1: '\"1\"' is not a finite number"),
    ("a thousands apostrophe", ROW + ROW.replace("0 0 0 0", "0 0 1'0 0"), "\"1'0\" is not a fin"),
    ("1e300 m", ROW + ROW.replace("0", "1e300", 3).replace("1e300 1e300 1e300", "0 0 1e300"),
     r"line 2: a translation of 1e\+300, expected at most 1e\+07 m"),
    ("a mark of utf-8 in between", ROW + "\ufeff" + ROW, "line 2, column 1: '\ufeff1|ufeff1"),
    ("old mac line within", ROW.replace(" 0\n", "\r0\n") * 2, "line 1: 11 columns"),
    ("nothing but blanks", " \n\t\n" * 9, "no poses"),
    ("a whole scan", scan_csv(np.ones((10, 3))), "line 1: 7 columns; expected 12 or 16"),
    ("TUM, qx named last", "# t tx ty tz qy qz qw qx\n" + TUM, "line 1: the columns are qy qz qw"),
    ("TUM, norm 1e200", TUM.replace("0 0 0 1", "0 0 0 1e200"), "line 1: quaternion of norm inf"),
    ("TUM, zero", TUM.replace("0 0 0 1", "0 0 0 0"), "line 1: quaternion of norm 0"),
    ("leica, header alone", POSE_HEADER + "\n", "0 poses, but"),
    ("leica, fractional id", poses_csv(POSES).replace("\n1,", "\n1.5,"), "poseId 1.5, expected 1"),
    ("leica, id twice", poses_csv(POSES).replace("\n1,", "\n0,"), "poseId 0, expected 1"),
)  # fmt: skip


@pytest.mark.parametrize(("content", "expected"), POSE_FAULTS)
def test_poses_that_are_wrong(tmp_path, content, expected):
    path = tmp_path / "poses.txt"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    refused(lambda path: read_poses(path, 2), path, expected)


def test_a_scan_given_as_pose_file_is_not_read(tmp_path, monkeypatch):
    monkeypatch.setattr("icpshap.data.poses.MAXIMUM_BYTES", 100)
    path = written(tmp_path / "poses.txt", ROW * 20)
    refused(lambda path: read_poses(path, 20), path, "480 bytes, expected at most 100 .*\n.*a scan")


@pytest.mark.parametrize(
    "change", [str.upper, lambda text: text.replace("\n", "\r\n"), "\ufeff{}".format]
)
def test_poses_that_look_odd_are_read_right(tmp_path, change):
    path = tmp_path / "poses.txt"
    path.write_bytes(change(ROW.replace("0", "0e-5", 3) * 2).encode())
    np.testing.assert_array_equal(read_poses(path, 2), POSES)


# The order of quaternions


def tum(path, rotations, translations, scalar_first=False, comment=""):
    quaternions = rotations.as_quat(scalar_first=scalar_first)
    rows = np.column_stack([np.arange(len(rotations)), translations, quaternions])
    np.savetxt(path, rows, fmt="%.9f", header=comment, comments="# ")
    return path


def trajectory(kind, generator, count):
    """Rotations of ``count`` poses on the way of a vehicle or a person."""
    noise = Rotation.from_rotvec(generator.normal(0, np.deg2rad(1.0), (count, 3)))
    start = generator.uniform(-180, 180)
    yaw = start + np.cumsum(generator.uniform(5, 25, (count, 1)), axis=0) * generator.choice(
        [-1, 1]
    )
    turning = Rotation.from_euler("z", yaw, degrees=True)
    upside_down, sideways = (Rotation.from_euler("x", a, degrees=True) for a in (180, 90))
    optical = Rotation.from_matrix([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    return {
        "turning in place": turning,
        "turning, rough": turning * noise,
        "turned by half": Rotation.from_euler("z", 180, degrees=True) * noise,
        "upside down": turning * noise * upside_down,
        "upside down from the start": Rotation.from_euler("z", yaw - start, degrees=True)
        * upside_down,
        "upside down about y": turning * noise * Rotation.from_euler("y", 180, degrees=True),
        "upside down, sideways": turning
        * noise
        * upside_down
        * Rotation.from_euler("z", 90, degrees=True),
        "on its side": turning * noise * sideways,
        "a camera": turning * noise * optical,
        "a camera's first frame": optical.inv() * turning * noise * optical,
        "pitching": turning
        * Rotation.from_euler("y", generator.uniform(-40, 40, (count, 1)), degrees=True),
        "tumbling": Rotation.random(count, rng=generator),
        "nearly at rest": noise,
        "by hand": Rotation.from_rotvec(generator.normal(0, 0.4, (count, 3))),
    }[kind]


KINDS = (
    *("turning in place", "turning, rough", "turned by half", "upside down"),
    *("upside down from the start", "upside down about y", "upside down, sideways", "on its side"),
    *("a camera", "a camera's first frame", "pitching", "tumbling", "nearly at rest", "by hand"),
)


@pytest.mark.parametrize("kind", KINDS)
def test_right_quaternions_are_no_false_alarm(tmp_path, kind):
    generator = np.random.default_rng(KINDS.index(kind))
    for count in [2, 3, 5, 20, 45] * 20:
        rotations = trajectory(kind, generator, count)
        path = tum(tmp_path / "poses.tum", rotations, generator.normal(0, 5, (count, 3)))
        poses = read_poses(path, count)
        np.testing.assert_allclose(poses[:, :3, :3], rotations.as_matrix(), atol=1e-7)


@pytest.mark.parametrize("turn", [2, 10, 30, 200])
def test_scalar_first_is_refused(tmp_path, turn):
    generator = np.random.default_rng(turn)
    for count in (3, 5, 20, 45):
        yaw = np.linspace([0], [turn], count) + generator.uniform(-5, 5)
        rotations = Rotation.from_euler("z", yaw, degrees=True) * Rotation.from_rotvec(
            generator.normal(0, np.deg2rad(0.2), (count, 3))
        )
        path = tum(tmp_path / "poses.tum", rotations, np.zeros((count, 3)), scalar_first=True)
        message = refused(
            lambda path, count=count: read_poses(path, count), path, ", line 1: read as"
        )
        assert "columns are timestamp tx ty tz qx qy qz qw" in message


def test_scalar_first_without_any_rotation_is_refused(tmp_path):
    path = written(tmp_path / "poses.tum", "0 0 0 0 1 0 0 0\n1 1 0 0 1 0 0 0\n")
    message = refused(lambda path: read_poses(path, 2), path, "the scanner lies on its back")
    assert "line 1: read as qx qy qz qw" in message


def test_a_comment_says_that_the_scanner_hangs_upside_down(tmp_path):
    path = written(tmp_path / "poses.tum", "0 0 0 0 1 0 0 0\n1 1 0 0 1 0 0 0\n")
    hint = refused(lambda path: read_poses(path, 2), path, "read as").splitlines()[-1]
    comment = hint[hint.index("#") :]
    written(path, f"{comment}\n{path.read_text(encoding='utf-8')}")
    np.testing.assert_array_equal(read_poses(path, 2)[0, :3, :3], np.diag([1, -1, -1]))


# Folders


def folder_of(folder, *names):
    for name in names:
        (folder / name).touch()
    return folder


def find(folder):
    return find_folder_files(folder, 2)


FOLDER_FAULTS = cases(
    ("other formats", ["1.las", "2.LAS", "poses.txt"], r"found 2 \.las: known formats are \.csv, "),
    ("several formats", ["1.las", "2.las", "c.e57", "poses.txt"], r"found 2 \.las, 1 \.e57: known"),
    ("compressed", ["1.las.gz", "2.las.gz", "poses.txt"], r"found 2 \.gz: known formats"),
    ("notes alone", ["poses.txt", "readme.md", "LICENSE"], r"0 scans \(\.csv, \.bin, .*\), but"),
    ("s1 and s01", ["s1.csv", "s01.csv", "poses.txt"], r"s01\.csv and s1\.csv have the same numb"),
    ("1 and 001", ["001.ply", "1.ply", "poses.txt"], r"001\.ply and 1\.ply have the same numbers"),
    ("other digits", ["1.ply", "١.ply", "poses.txt"], "have the same numbers"),
)  # fmt: skip


@pytest.mark.parametrize(("names", "expected"), FOLDER_FAULTS)
def test_folder_that_is_wrong(tmp_path, names, expected):
    refused(find, folder_of(tmp_path, *names), expected)


@pytest.mark.parametrize("backwards", [False, True])
def test_order_is_not_the_directory_s(tmp_path, monkeypatch, backwards):
    folder_of(tmp_path, "s1.csv", "s01.csv", "s2.csv", "poses.txt")
    listed = sorted(tmp_path.iterdir(), reverse=backwards)
    monkeypatch.setattr(Path, "iterdir", lambda folder: iter(listed))
    with pytest.raises(DataError, match=r"s01\.csv and s1\.csv have the same numbers"):
        find_folder_files(tmp_path, 3)
    listed = [path for path in listed if path.name != "s01.csv"]
    assert [path.name for path in find(tmp_path)[0]] == ["s1.csv", "s2.csv"]


@pytest.mark.parametrize(("make", "expected"), NOT_FILES[:3] + NOT_FILES[4:])
@pytest.mark.parametrize("name", ["2.ply", "poses.txt"])
def test_folder_with_what_is_no_file(tmp_path, make, expected, name):
    folder_of(tmp_path, *({"1.ply", "2.ply", "poses.txt"} - {name}))
    make(tmp_path / name)
    if name == "poses.txt" and make is directory:
        expected = "expected one pose file"  # a folder of any name may lie there
    refused(find, tmp_path, expected)


def test_folder_that_is_a_file(tmp_path):
    refused(find, written(tmp_path / "a", ""), "no folder")


def test_folder_that_the_system_refuses(tmp_path, monkeypatch):
    def fail(folder):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(folder))

    monkeypatch.setattr(Path, "iterdir", fail)
    refused(find, tmp_path, "cannot be read .Permission denied")
