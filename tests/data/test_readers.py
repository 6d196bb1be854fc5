"""Scans as people have them: rows without names, arrays, compressed clouds, other spellings."""

import gzip
import io

import numpy as np
import pytest
from hostile_files import pcd, ply
from known_files import POINTS, written

from icpshap.data.scans import read_scan, read_timed_scan
from icpshap.errors import DataError

FLOATS = POINTS.astype("<f4")
INTENSITY = np.linspace(0, 1, len(POINTS), dtype="<f4")
RING = np.arange(len(POINTS), dtype="<f4") % 32
KITTI = np.column_stack([FLOATS, INTENSITY])
NUSCENES = np.column_stack([KITTI, RING])
FIVE = ["x", "y", "z", "intensity", "ring"]


def stored(path, content):
    path.write_bytes(content)
    return path


def npy(array):
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def npz(save=np.savez, **arrays):
    file = io.BytesIO()
    save(file, **arrays)
    return file.getvalue()


def structured(names, *columns):
    array = np.zeros(len(columns[0]), [(name, "<f8") for name in names])
    for name, column in zip(names, columns, strict=True):
        array[name] = column
    return array


def problem(path, expected, time=None, **options):
    """The whole message of the error of reading a scan, which names the file and hints."""
    with pytest.raises(DataError) as error:
        read_timed_scan(path, time, **options)
    message = str(error.value)
    assert message.startswith(str(path)) and message.count("\nHint: ") == 1, message
    assert expected in message, message
    return message


class TestFloats:
    """.bin, as KITTI and nuScenes have them."""

    def test_four_columns_are_kitti_s(self, tmp_path):
        path = stored(tmp_path / "000000.bin", KITTI.tobytes())
        np.testing.assert_array_equal(read_scan(path)[0], FLOATS.astype(float))

    def test_five_columns_are_named_by_key(self, tmp_path):
        path = stored(tmp_path / "a.pcd.bin", NUSCENES.tobytes())
        points, dropped = read_scan(path, columns=FIVE)
        np.testing.assert_array_equal(points, FLOATS.astype(float))
        assert dropped == 0

    def test_any_columns_in_any_order_and_their_time(self, tmp_path):
        times = np.linspace(0, 0.1, len(POINTS), dtype="<f4")
        path = stored(tmp_path / "a.bin", np.column_stack([times, FLOATS[:, ::-1]]).tobytes())
        points, found, _ = read_timed_scan(path, "t", columns=["t", "z", "y", "x"])
        np.testing.assert_array_equal(points, FLOATS.astype(float))
        np.testing.assert_array_equal(found, times.astype(float))

    def test_five_columns_without_the_key_are_noticed_by_their_size(self, tmp_path):
        path = stored(tmp_path / "a.bin", NUSCENES[:1199].tobytes())
        message = problem(path, "23980 bytes, expected a multiple of 16: 4 columns (x, y, z, inten")
        assert "set `columns: [x, y, z, intensity, ring]` of the folder" in message

    def test_five_columns_without_the_key_are_noticed_by_negative_intensities(self, tmp_path):
        path = stored(tmp_path / "a.bin", NUSCENES.tobytes())
        message = problem(
            path, "read as rows of 4 columns (x, y, z, intensity), an intensity is neg"
        )
        assert "set `columns: [x, y, z, intensity, ring]` of the folder" in message

    def test_four_columns_read_as_five_are_noticed(self, tmp_path):
        path = stored(tmp_path / "a.bin", KITTI.tobytes())
        problem(path, "an intensity is negative", columns=FIVE)

    def test_a_file_that_is_cut_off(self, tmp_path):
        problem(
            stored(tmp_path / "a.bin", KITTI.tobytes()[:-3]), "19197 bytes, expected a multiple"
        )

    def test_a_time_must_be_among_the_columns(self, tmp_path):
        path = stored(tmp_path / "a.bin", KITTI.tobytes())
        message = problem(path, "expected one column 'stamp' with the times", time="stamp")
        assert "its columns are x, y, z, intensity" in message

    def test_none_at_all(self, tmp_path):
        problem(stored(tmp_path / "a.bin", b""), "no points")


class TestArrays:
    """.npy and .npz."""

    @pytest.mark.parametrize(
        "array",
        [
            POINTS,
            np.asfortranarray(POINTS),
            np.column_stack([POINTS, INTENSITY]),
            structured(["z", "intensity", "x", "y"], POINTS[:, 2], INTENSITY, *POINTS.T[:2]),
            structured(["X", "Y", "Z"], *POINTS.T),
        ],
        ids=["rows", "Fortran", "more columns", "fields", "capital fields"],
    )
    def test_points_of_an_array(self, tmp_path, array):
        path = stored(tmp_path / "a.npy", npy(array))
        np.testing.assert_array_equal(read_scan(path)[0], POINTS)

    def test_floats_and_whole_numbers(self, tmp_path):
        path = stored(tmp_path / "a.npy", npy(FLOATS.astype(">f4")))
        np.testing.assert_array_equal(read_scan(path)[0], FLOATS.astype(float))
        path = stored(tmp_path / "a.npy", npy(FLOATS.astype("i2")))
        np.testing.assert_array_equal(read_scan(path)[0], FLOATS.astype("i2").astype(float))

    def test_columns_by_key(self, tmp_path):
        path = stored(tmp_path / "a.npy", npy(np.column_stack([INTENSITY, POINTS])))
        points, times, _ = read_timed_scan(path, "t", columns=["t", "x", "y", "z"])
        np.testing.assert_array_equal(points, POINTS)
        np.testing.assert_array_equal(times, INTENSITY.astype(float))

    @pytest.mark.parametrize(
        ("array", "expected"),
        [
            (POINTS.T, "an array of shape (3, 1200), expected a row for each point"),
            (POINTS.reshape(30, 40, 3), "shape (30, 40, 3), expected (points, columns)"),
            (POINTS[:, :2], "2 columns, expected x, y and z"),
            (POINTS > 0, "an array of bool, expected one of numbers"),
            (POINTS.astype(object), "an array of Python objects"),
            (structured(["a", "b"], *POINTS.T[:2]), "with the fields a, b; expected"),
            (
                np.column_stack([np.arange(1200), POINTS]),
                "the first grows from row to row, as times",
            ),
        ],
    )
    def test_arrays_that_are_no_scan(self, tmp_path, array, expected):
        problem(stored(tmp_path / "a.npy", npy(array)), expected)
        problem(stored(tmp_path / "a.npz", npz(points=array)), expected)

    def test_damaged_arrays(self, tmp_path):
        whole = npy(POINTS)
        path = stored(tmp_path / "a.npy", whole[:-8])
        problem(
            path, "28792 bytes of data, expected 28800: the header says an array of shape (1200"
        )
        path = stored(tmp_path / "a.npy", whole.replace(b"(1200, 3)", b"(9**9,3) "))
        problem(path, "no array as numpy writes it")
        path = stored(tmp_path / "a.npy", whole.replace(b"(1200, 3), }  ", b"(1200, 3333), }"))
        problem(path, "the header says an array of shape (1200, 3333)")
        for content in (b"", b"x,y,z\n", whole[:20]):
            problem(stored(tmp_path / "a.npy", content), "no array as numpy writes it")

    @pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
    @pytest.mark.parametrize(
        "arrays",
        [
            {"points": POINTS, "labels": RING},
            {"XYZ": POINTS, "T": np.eye(4)},
            {"arr_0": POINTS},
            {"x": POINTS[:, 0], "y": POINTS[:, 1], "z": POINTS[:, 2], "intensity": INTENSITY},
        ],
        ids=["points", "XYZ", "the only one", "x, y and z"],
    )
    def test_points_of_an_archive(self, tmp_path, save, arrays):
        path = stored(tmp_path / "a.npz", npz(save, **arrays))
        np.testing.assert_array_equal(read_scan(path)[0], POINTS)

    def test_times_of_an_archive(self, tmp_path):
        path = stored(tmp_path / "a.npz", npz(points=POINTS, stamp=INTENSITY))
        points, times, _ = read_timed_scan(path, "stamp")
        np.testing.assert_array_equal(points, POINTS)
        np.testing.assert_array_equal(times, INTENSITY.astype(float))
        problem(path, "expected one column 't' with the times of the points", time="t")
        path = stored(tmp_path / "a.npz", npz(points=POINTS, stamp=INTENSITY[:9]))
        problem(path, "arrays of 1200, 9 rows, expected as many of each", time="stamp")

    @pytest.mark.parametrize(
        ("content", "expected"),
        [
            (npz(a=POINTS, b=POINTS), "2 arrays (a, b), expected one of points, called points"),
            (npz(points=POINTS, cloud=POINTS), "2 arrays (points, cloud), expected one"),
            (npz(x=POINTS[:, 0], y=POINTS[:5, 1], z=POINTS[:, 2]), "arrays of 1200, 5, 1200 rows"),
            (npz(), "0 arrays (none)"),
            (npz(points=POINTS)[:-40], "no archive as numpy writes it"),
            (b"", "no archive as numpy writes it"),
        ],
    )
    def test_archives_that_are_no_scan(self, tmp_path, content, expected):
        problem(stored(tmp_path / "a.npz", content), expected)

    def test_a_flipped_bit_in_an_archive_is_noticed(self, tmp_path):
        content = bytearray(npz(points=POINTS))
        content[5000] ^= 4
        problem(stored(tmp_path / "a.npz", content), "Bad CRC-32")

    def test_an_archive_that_would_fill_the_memory(self, tmp_path, monkeypatch):
        path = stored(tmp_path / "a.npz", npz(np.savez_compressed, points=np.zeros((10**6, 3))))
        monkeypatch.setattr("icpshap.data.formats.numpy_archive.MAXIMUM_BYTES", 2**20)
        problem(path, "array points.npy: 24000128 bytes out of ")


class TestText:
    """.xyz and .txt."""

    @pytest.mark.parametrize("suffix", [".xyz", ".txt", ".XYZ"])
    @pytest.mark.parametrize(
        "text",
        [
            "1 2 3\n4 5 6\n",
            "\ufeff1\t2\t3\r\n\r\n 4  5 6 \r\n",
            "1,2,3\n4, 5, 6\n",
            "1;2;3\n4;5;6\n",
            "1 2 3 0.5\n4 5 6 0.7\n1 2 3 0\n"[:-8],
            "# a scan of a hall\n1 2 3\n# half of it\n4 5 6\n",
            "//X Y Z R G B\n1 2 3 255 255 255\n4 5 6 0 0 0\n",
            "# intensity, z, y, x\n9 3 2 1\n9 6 5 4\n",
            "intensity z y x\n9 3 2 1\n9 6 5 4\n",
            "X;Y;Z\n1;2;3\n4;5;6\n",
            "x [m], y [m], z [m]\n1, 2, 3\n4, 5, 6\n",
        ],
    )
    def test_lines_of_numbers(self, tmp_path, suffix, text):
        path = written(tmp_path / f"a{suffix}", text)
        np.testing.assert_array_equal(read_scan(path)[0], [[1, 2, 3], [4, 5, 6]])

    def test_times_by_header_and_by_key(self, tmp_path):
        path = written(tmp_path / "a.xyz", "stamp x y z\n0.1 1 2 3\n0.2 4 5 6\n")
        assert read_timed_scan(path, "stamp")[1].tolist() == [0.1, 0.2]
        path = written(tmp_path / "a.xyz", "0.1 1 2 3\n0.2 4 5 6\n")
        columns = ["stamp", "x", "y", "z"]
        points, times, _ = read_timed_scan(path, "stamp", columns=columns)
        assert points.tolist() == [[1, 2, 3], [4, 5, 6]] and times.tolist() == [0.1, 0.2]
        problem(path, "expected one column 'stamp'", time="stamp")

    @pytest.mark.parametrize(
        ("text", "expected"),
        [
            ("1 2 3\n4 5\n", ", line 2: 2 columns, expected 3"),
            ("1 2 3\n\n4 5 x\n", ", line 3, column 3: 'x' is not a number"),
            ("1 2 3\n4 5 6_0\n", ", line 2, column 3: '6_0' is not a number"),
            ("1,5 2,5 3,5\n", "expected a header with the columns x, y and z"),
            ("a b c\n1 2 3\n", ", line 1: expected a header with the columns x, y and z"),
            ("x y z\nu v w\n1 2 3\n", ", line 2: expected a header"),
            ("hello\n", ", line 1: expected a header"),
            ("x y z i\n1 2 3\n", ", line 1: expected a header"),
            ("1 2\n3 4\n", "2 columns, expected x, y and z"),
            ("", "no points"),
            ("# nothing\n", "no points"),
            ("0 1 2 3\n1 1 2 4\n2 7 7 7\n", "4 columns without names, of which the first grows"),
        ],
    )
    def test_text_that_is_wrong(self, tmp_path, text, expected):
        problem(written(tmp_path / "a.xyz", text), expected)

    def test_rows_that_are_not_finite_are_counted(self, tmp_path):
        path = written(tmp_path / "a.xyz", "1 2 3\nnan 5 6\n")
        problem(path, "1 of 2 rows are not finite")
        assert read_scan(path, drop_non_finite=True)[1] == 1


class TestTables:
    """.csv without a header, and with other ones than x,y,z."""

    @pytest.mark.parametrize(
        "text",
        [
            "1,2,3\n4,5,6\n",
            "1;2;3\n4;5;6\n",
            "1\t2\t3\n4\t5\t6\n",
            "1,2,3,0.5\n4,5,6,0.5\n",
            "X,Y,Z\n1,2,3\n4,5,6\n",
            "x;y;z\n1;2;3\n4;5;6\n",
            "x\ty\tz\n1\t2\t3\n4\t5\t6\n",
            "#x, y, z\n1,2,3\n4,5,6\n",
            "//X,Y,Z\n1,2,3\n4,5,6\n",
            "x [m],y [m],z [m]\n1,2,3\n4,5,6\n",
            "x(m),y(m),z(m)\n1,2,3\n4,5,6\n",
            "X_m,Y_m,Z_m\n1,2,3\n4,5,6\n",
            '"Points:0","Points:1","Points:2"\n1,2,3\n4,5,6\n',
            "Points_0,Points_1,Points_2\n1,2,3\n4,5,6\n",
            "intensity,pos_x,pos_y,pos_z\n0,1,2,3\n0,4,5,6\n",
            "X coordinate,Y coordinate,Z coordinate\n1,2,3\n4,5,6\n",
            # Those that are spelled just so come first.
            "X,Y,Z,z,y,x\n7,7,7,3,2,1\n8,8,8,6,5,4\n",
        ],
    )
    def test_tables(self, tmp_path, text):
        path = written(tmp_path / "a.csv", text)
        np.testing.assert_array_equal(read_scan(path)[0], [[1, 2, 3], [4, 5, 6]])

    def test_columns_by_key_with_and_without_a_header(self, tmp_path):
        for header in ("", "when,east,north,up\n"):
            path = written(tmp_path / "a.csv", f"{header}0.1,1,2,3\n0.2,4,5,6\n")
            columns = ["stamp", "x", "y", "z"]
            points, times, _ = read_timed_scan(path, "stamp", columns=columns)
            assert points.tolist() == [[1, 2, 3], [4, 5, 6]] and times.tolist() == [0.1, 0.2]

    @pytest.mark.parametrize(
        ("text", "expected"),
        [
            ("1,2,3\n4,x,6\n", ", line 2, column 2: 'x' is not a number"),
            ("1,2,3\n4,5\n", ", line 2: 2 columns, expected 3"),
            (
                "1,2,x\n4,5,6\n",
                ", line 1: expected a header with the columns x, y and z, each once",
            ),
            ("x [mm],y [mm],z [mm]\n1,2,3\n", "found 'x [mm],y [mm],z [mm]', no x, y, z.\nHint: "),
            ("X,Y,x,z\n1,2,3,4\n", "more than one x"),
            ("0,1,2,3\n1,4,5,6\n2,7,8,9\n", "the first grows from row to row"),
            ('1,2,3,"\n4,5,6,"\n', "columns|rows in"),
        ],
    )
    def test_tables_that_are_wrong(self, tmp_path, text, expected):
        path = written(tmp_path / "a.csv", text)
        if "|" in expected:
            with pytest.raises(DataError, match=expected):
                read_scan(path)
        else:
            problem(path, expected)

    @pytest.mark.parametrize(
        ("columns", "expected"),
        [
            (["x", "y", "z"], "4 columns, expected 3"),
            (["x", "y", "a", "b"], "`columns` names x, y, a, b; expected x, y and z, each once"),
        ],
    )
    def test_columns_that_do_not_fit(self, tmp_path, columns, expected):
        path = written(tmp_path / "a.csv", "a,b,c,d\n1,2,3,4\n")
        problem(path, expected, columns=columns)
        path = stored(tmp_path / "a.npy", npy(np.ones((5, 4))))
        expected = expected.replace("columns, expected 3", "columns, but `columns` names 3")
        problem(path, expected, columns=columns)


class TestClouds:
    """.ply.gz and .pcd.gz, and their columns in other spellings."""

    @pytest.mark.parametrize(("name", "content"), [("a.ply.gz", ply()), ("a.PCD.GZ", pcd())])
    def test_compressed_clouds(self, tmp_path, name, content):
        plain = stored(tmp_path / name.lower()[:-3], content)
        path = stored(tmp_path / name, gzip.compress(content))
        np.testing.assert_array_equal(read_scan(path)[0], read_scan(plain)[0])

    @pytest.mark.parametrize(
        ("content", "expected"),
        [
            (gzip.compress(ply())[:-20], "cannot be unpacked"),
            (gzip.compress(ply()[:-20]), "the file ends before the last one"),
            (ply(), "cannot be unpacked (Not a gzipped file"),
            (gzip.compress(ply())[:60] + b"abc" + gzip.compress(ply())[63:], "cannot be unpacked"),
            (b"", "no readable .ply header"),
        ],
    )
    def test_damaged_ones(self, tmp_path, content, expected):
        problem(stored(tmp_path / "a.ply.gz", content), expected)

    def test_one_that_would_fill_the_memory(self, tmp_path, monkeypatch):
        monkeypatch.setattr("icpshap.data.formats._gzip.MAXIMUM_BYTES", 2**20)
        path = stored(tmp_path / "a.ply.gz", gzip.compress(bytes(2**22)))
        problem(path, "more than 1048576 bytes when unpacked")

    def test_capital_letters(self, tmp_path):
        content = pcd(FIELDS="X Y Z")
        path = stored(tmp_path / "a.pcd", content)
        plain = stored(tmp_path / "b.pcd", pcd())
        np.testing.assert_array_equal(read_scan(path)[0], read_scan(plain)[0])

    def test_they_name_their_columns_themselves(self, tmp_path):
        path = stored(tmp_path / "a.ply", ply())
        problem(path, ".ply files name their columns themselves", columns=["x", "y", "z"])


DAMAGED = {
    "a.bin": KITTI[:40].tobytes(),
    "a.npy": npy(POINTS[:40]),
    "fields.npy": npy(structured(["x", "y", "z"], *POINTS[:40].T)),
    "a.npz": npz(np.savez_compressed, points=POINTS[:40], stamp=INTENSITY[:40]),
    "plain.npz": npz(x=POINTS[:40, 0], y=POINTS[:40, 1], z=POINTS[:40, 2]),
    "a.xyz": b"# x y z\n" + b"1.25 2.5 3.75\n-4 5e-1 6\n" * 20,
    "a.csv": b"1.25;2.5;3.75\n-4;5e-1;6\n" * 20,
    "a.ply.gz": gzip.compress(ply()),
    "a.pcd.gz": gzip.compress(pcd()),
}


@pytest.mark.parametrize("name", DAMAGED)
def test_damage_is_an_error_that_names_the_file_or_changes_a_value(tmp_path, name):
    whole, generator = DAMAGED[name], np.random.default_rng(list(DAMAGED).index(name))
    path = tmp_path / name
    rows = len(read_scan(stored(path, whole))[0])
    for _ in range(300):
        damaged = bytearray(whole)
        if generator.random() < 0.3:
            damaged = damaged[: generator.integers(len(whole))]
        else:
            for place in generator.integers(len(whole), size=generator.integers(1, 4)):
                damaged[place] ^= 1 << generator.integers(8)
        stored(path, damaged)
        try:
            points, dropped = read_scan(path, drop_non_finite=True)
        except DataError as error:
            assert str(path) in str(error)
        else:
            assert points.shape[1:] == (3,) and len(points) + dropped <= rows


def test_a_real_scan_comes_back_from_every_format(real_data, tmp_path):
    path = real_data / "spinning_pair" / "scan_0.ply"
    points, _ = read_scan(path)
    floats = points.astype("<f4")
    np.testing.assert_array_equal(floats, points)  # as it was written
    rows = np.column_stack([floats, np.ones(len(floats), "<f4")])
    text = "".join(" ".join(map(repr, row)) + "\n" for row in points.tolist())
    written_as = {
        "a.bin": rows.tobytes(),
        "a.npy": npy(floats),
        "a.npz": npz(np.savez_compressed, points=points),
        "a.xyz": text.encode(),
        "a.csv": text.replace(" ", ",").encode(),
        "a.ply.gz": gzip.compress(path.read_bytes(), 1),
    }
    for name, content in written_as.items():
        np.testing.assert_array_equal(read_scan(stored(tmp_path / name, content))[0], points)
