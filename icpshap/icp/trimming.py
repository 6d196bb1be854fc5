"""Order statistics of link lengths."""

from icpshap.icp.compiled import jit


@jit
def select(values, count, rank):
    """The `rank`-th smallest (0-based) of values[:count], which is reordered (quickselect)."""
    low, high = 0, count - 1
    while low < high:
        a, b, c = values[low], values[(low + high) >> 1], values[high]
        pivot = max(min(a, b), min(max(a, b), c))
        i, j = low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if rank <= j:
            high = j
        elif rank >= i:
            low = i
        else:
            break
    return values[rank]
