"""A second packer in plain Python, written from the rules and not from the kernel.

Lists and loops only, as slow and as plain as it gets: every bin stays open at once, every bin
is a height map, every position of the map is tried. What the fast packer answers has to be the
same, cell by cell.
"""


def pack(bin, sizes, order, support=(1, 2), inclusive=True, largest=None, mask=None):
    """(bins, positions): where each item goes, by item; bin -1 if it is padding or fits no bin.

    `support` is (numerator, denominator), so that the share is compared in whole numbers.
    `largest` is the (length, width) above which an item never fits.
    """
    bins = [-1] * len(sizes)
    positions = [(0, 0, 0)] * len(sizes)
    open_bins = []
    for item in order:
        if mask is not None and not mask[item]:
            continue
        size = sizes[item]
        if largest is not None and (size[0] > largest[0] or size[1] > largest[1]):
            continue
        new = [[0] * bin[1] for _ in range(bin[0])]
        for number, heights in enumerate([*open_bins, new]):
            allowed = allowed_positions(bin, heights, size, support, inclusive)
            if not allowed:
                continue
            z, y, x = min((z, y, x) for x, y, z in allowed)
            for cell_x in range(x, x + size[0]):
                for cell_y in range(y, y + size[1]):
                    heights[cell_x][cell_y] = z + size[2]
            if number == len(open_bins):
                open_bins.append(new)
            bins[item] = number
            positions[item] = (x, y, z)
            break
    return bins, positions


def allowed_positions(bin, heights, size, support=(1, 2), inclusive=True):
    """Every (x, y, z) at which an item may rest on this height map."""
    length, width, height = size
    found = []
    for x in range(bin[0] - length + 1):
        for y in range(bin[1] - width + 1):
            under = []
            for row in heights[x : x + length]:
                under += row[y : y + width]
            z = max(under)
            # resting / footprint against numerator / denominator, multiplied out
            resting = under.count(z) * support[1]
            threshold = len(under) * support[0]
            stable = resting >= threshold if inclusive else resting > threshold
            if stable and z + height <= bin[2]:
                found.append((x, y, z))
    return found


def bin_contents(bin, sizes, bins, positions):
    """[(volume, highest point, sum of the height map)] of bins 0, 1, ... of a packing."""
    contents = []
    for number in range(max(bins) + 1):
        heights = [[0] * bin[1] for _ in range(bin[0])]
        volume = 0
        for item, (length, width, height) in enumerate(sizes):
            if bins[item] != number:
                continue
            volume += length * width * height
            x, y, z = positions[item]
            for cell_x in range(x, x + length):
                for cell_y in range(y, y + width):
                    heights[cell_x][cell_y] = max(heights[cell_x][cell_y], z + height)
        top = max(max(row) for row in heights)
        contents.append((volume, top, sum(sum(row) for row in heights)))
    return contents


def bins_used(bins):
    return len({number for number in bins if number >= 0})


def compactness(bin, sizes, bins, positions):
    """Mean over the bins of volume / (length * width * highest point)."""
    contents = bin_contents(bin, sizes, bins, positions)
    return sum(v / (bin[0] * bin[1] * top) for v, top, _ in contents) / len(contents)


def pyramid(bin, sizes, bins, positions):
    """Mean over the bins of volume / sum of the height map."""
    contents = bin_contents(bin, sizes, bins, positions)
    return sum(volume / shadow for volume, _, shadow in contents) / len(contents)
