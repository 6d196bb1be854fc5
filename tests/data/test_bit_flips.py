"""A single flipped bit in a scan or pose file: an error, or at most other values in one row.

These formats have no checksums, so a bit within a number goes unnoticed. What must not happen is
another number of rows, a column in place of another, or an exception that is no DataError.
"""

import numpy as np
import pytest
from hostile_files import BODY, POINTS, compressed, csv, pcd, ply, text
from misbehaving_server import poses_csv
from scipy.spatial.transform import Rotation

from icpshap.data.poses import read_poses
from icpshap.data.scans import read_scan
from icpshap.errors import DataError

FLIPS = 400
FACE = b"\3" + np.arange(3, dtype="<i4").tobytes()
TURNS = Rotation.from_rotvec(np.random.default_rng(1).normal(0, 0.4, (6, 3)))
PLACES = np.random.default_rng(2).normal(0, 5, (6, 3))
MATRICES = np.tile(np.eye(4), (6, 1, 1))
MATRICES[:, :3, :3], MATRICES[:, :3, 3] = TURNS.as_matrix(), PLACES

SCANS = {
    "binary.ply": ply(),
    "faces.ply": ply("element face 1", "property list uchar int vertex_index", body=BODY + FACE),
    "text.ply": ply("comment here", encoding="ascii", body=text()),
    "binary.pcd": pcd(),
    "text.pcd": pcd("ascii", text()),
    "compressed.pcd": compressed(),
    "plain.csv": csv(),
}
TUM = "".join(
    f"{k} {' '.join(map(repr, [*place, *turn]))}\n"
    for k, (place, turn) in enumerate(zip(PLACES.tolist(), TURNS.as_quat().tolist(), strict=True))
)
POSE_FILES = {
    "kitti.txt": "".join(f"{' '.join(map(repr, T[:3].ravel().tolist()))}\n" for T in MATRICES),
    "named.tum": "# timestamp tx ty tz qx qy qz qw\n" + TUM,
    "leica.csv": poses_csv(MATRICES),
}


def flipped(content):
    """The content with one bit flipped, for bits all over it and for all in its first lines."""
    generator = np.random.default_rng(len(content))
    headed = [(position, bit) for position in range(120) for bit in range(8)]
    anywhere = zip(
        generator.integers(0, len(content), FLIPS), generator.integers(0, 8, FLIPS), strict=True
    )
    for position, bit in [*headed, *anywhere]:
        changed = bytearray(content)
        changed[position] ^= 1 << int(bit)
        yield bytes(changed)


def rows_changed(path, content, read, expected):
    """In how many rows each flip changes what is read; None for each that is refused."""
    path.write_bytes(content)
    np.testing.assert_allclose(read(path), expected, atol=1e-15)
    changes = []
    for damaged in flipped(content):
        path.write_bytes(damaged)
        try:
            found = read(path)
        except DataError as error:
            assert str(path) in str(error) and "\nHint: " in str(error)
            changes.append(None)
            continue
        assert found.shape == expected.shape
        different = ~np.isclose(found, expected, rtol=0, atol=1e-15)
        changes.append(np.count_nonzero(different.reshape(len(found), -1).any(axis=1)))
    return changes


@pytest.mark.parametrize("name", SCANS)
def test_flipped_bits_of_a_scan(tmp_path, name):
    changes = rows_changed(
        tmp_path / name, SCANS[name], lambda path: read_scan(path)[0], POINTS.astype(float)
    )
    assert changes.count(None) > FLIPS / 2
    # A bit of a compressed file can shift what follows.
    at_most = len(POINTS) if name == "compressed.pcd" else 1
    assert max(change for change in changes if change is not None) <= at_most


@pytest.mark.parametrize("name", POSE_FILES)
def test_flipped_bits_of_poses(tmp_path, name):
    content = POSE_FILES[name].encode()
    changes = rows_changed(tmp_path / name, content, lambda path: read_poses(path, 6), MATRICES)
    assert changes.count(None) > FLIPS / 2
    assert max(change for change in changes if change is not None) <= 1
