"""pictures.py psnr A.png B.png LEAST - the PSNR of two pictures, at least LEAST dB.
pictures.py centres A.png B.png MOST - blobs on black: each one's centre in A is at most MOST px from its centre in B.

8-bit RGB or RGBA, not interlaced. Prints the figure; fails where it is beyond the bound.
"""
import math
import struct
import sys
import zlib


def unfilter(kind, row, above, step):
    for i in range(len(row)):
        left = row[i - step] if i >= step else 0
        up = above[i]
        corner = above[i - step] if i >= step else 0
        if kind == 1:
            add = left
        elif kind == 2:
            add = up
        elif kind == 3:
            add = (left + up) // 2
        elif kind == 4:
            near = left + up - corner
            add = min((left, up, corner), key=lambda v: abs(near - v))
        else:
            return
        row[i] = (row[i] + add) & 255


def load(path):
    """Width, height and rows of (r, g, b)."""
    with open(path, "rb") as file:
        data = file.read()
    at, packed = 8, b""
    while at < len(data):
        (size,), name = struct.unpack(">I", data[at:at + 4]), data[at + 4:at + 8]
        body = data[at + 8:at + 8 + size]
        if name == b"IHDR":
            width, height, depth, kind, _, _, interlaced = struct.unpack(">IIBBBBB", body)
            if depth != 8 or kind not in (2, 6) or interlaced:
                sys.exit(f"{path}: not 8-bit RGB")
        elif name == b"IDAT":
            packed += body
        at += size + 12
    step = 3 if kind == 2 else 4
    values, rows, above = zlib.decompress(packed), [], bytes(width * step)
    for y in range(height):
        start = y * (width * step + 1)
        row = bytearray(values[start + 1:start + 1 + width * step])
        unfilter(values[start], row, above, step)
        rows.append([tuple(row[step * x:step * x + 3]) for x in range(width)])
        above = row
    return width, height, rows


def psnr(a, b):
    total = sum((p - q) ** 2 for rows in zip(a[2], b[2]) for u, v in zip(*rows) for p, q in zip(u, v))
    return 10 * math.log10(255**2 * 3 * a[0] * a[1] / max(total, 1e-9))


def blobs(picture):
    """Centres, by their light, of what is connected and not black."""
    width, height, rows = picture
    light = [[sum(p) if sum(p) > 24 else 0 for p in row] for row in rows]
    found = []
    for y in range(height):
        for x in range(width):
            if not light[y][x]:
                continue
            stack, sums = [(x, y)], [0, 0, 0]
            while stack:
                u, v = stack.pop()
                if not (0 <= u < width and 0 <= v < height) or not light[v][u]:
                    continue
                w, light[v][u] = light[v][u], 0
                sums = [sums[0] + w, sums[1] + w * u, sums[2] + w * v]
                stack += [(u + 1, v), (u - 1, v), (u, v + 1), (u, v - 1)]
            if sums[0] > 400:
                found.append((sums[1] / sums[0], sums[2] / sums[0]))
    return found


def main():
    how, a, b, bound = sys.argv[1], load(sys.argv[2]), load(sys.argv[3]), float(sys.argv[4])
    if a[:2] != b[:2]:
        sys.exit(f"{a[0]} x {a[1]} and {b[0]} x {b[1]} px")
    if how == "psnr":
        value = psnr(a, b)
        print(f"{value:.1f} dB")
        sys.exit(value < bound)
    first, second = blobs(a), blobs(b)
    if len(first) != len(second) or not first:
        sys.exit(f"{len(first)} and {len(second)} blobs")
    worst = max(min(math.dist(p, q) for q in second) for p in first)
    print(f"{len(first)} blobs, at most {worst:.2f} px apart")
    sys.exit(worst > bound)


main()
