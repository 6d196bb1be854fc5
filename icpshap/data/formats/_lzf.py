"""LZF, the compression of .pcd files: runs of literal bytes and copies of what came before."""

# A copy of 264 bytes takes three, so nothing expands more than this.
MAXIMUM_EXPANSION = 88


def decompress(data, size):
    """The ``size`` bytes that ``data`` stands for.

    Raises ValueError for data that are damaged or stand for another number of bytes. No more than
    ``size`` bytes and one copy are ever held.
    """
    out = bytearray()
    position = 0
    while position < len(data) and len(out) <= size:
        control = data[position]
        position += 1
        if control < 32:
            literals = data[position : position + control + 1]
            position += control + 1
            out += literals
        else:
            length, distance, position = _copy(data, position, control)
            _repeat(out, distance, length)
    if position != len(data) or len(out) != size:
        raise ValueError("another number of bytes")
    return out


def _copy(data, position, control):
    """Length and distance of a copy [bytes], and the position behind what describes it."""
    length = control >> 5
    try:
        if length == 7:
            length += data[position]
            position += 1
        distance = ((control & 31) << 8) + data[position] + 1
    except IndexError:
        raise ValueError("the data end within a copy") from None
    return length + 2, distance, position + 1


def _repeat(out, distance, length):
    """Append ``length`` bytes that begin ``distance`` before the end, where they may overlap it."""
    start = len(out) - distance
    if start < 0:
        raise ValueError("a copy of what is before the start")
    piece = out[start : start + length]
    if distance < length:
        piece = (piece * (length // distance + 1))[:length]
    out += piece
