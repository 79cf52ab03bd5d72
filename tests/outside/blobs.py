"""blobs.py CAMERAS.json INDEX OUT.ply - blobs, apart from each other in a camera's picture, with all SH bands.

A .ply as trainers write it. The higher bands are small: a blob is bright from everywhere. None is round: a
turn that is read wrongly shows.
"""
import json
import math
import random
import struct
import sys

ACROSS, DOWN = 6, 4


def main():
    camera = json.load(open(sys.argv[1], encoding="utf-8"))[int(sys.argv[2])]
    width, height, f, at, turn = (camera[k] for k in ("width", "height", "fx", "position", "rotation"))
    random.seed(4)
    rows = []
    for i in range(ACROSS * DOWN):
        z = random.uniform(2, 6)
        u = (i % ACROSS + random.uniform(0.4, 0.6)) * width / ACROSS
        v = (i // ACROSS + random.uniform(0.4, 0.6)) * height / DOWN
        local = ((u - width / 2) * z / f, (v - height / 2) * z / f, z)
        mean = [at[r] + sum(turn[r][c] * local[c] for c in range(3)) for r in range(3)]
        scale = math.log(random.uniform(2, 4) * z / f)
        base = [random.uniform(0.5, 1.5) for _ in range(3)]
        rest = [random.gauss(0, 0.1) for _ in range(45)]
        rows.append(mean + base + rest + [4.0] + [scale, scale - 0.3, scale + 0.2] + [random.gauss(0, 1) for _ in range(4)])
    names = ["x", "y", "z"] + [f"f_dc_{i}" for i in range(3)] + [f"f_rest_{i}" for i in range(45)] + ["opacity"]
    names += [f"scale_{i}" for i in range(3)] + [f"rot_{i}" for i in range(4)]
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
    head += [f"property float {name}" for name in names] + ["end_header", ""]
    with open(sys.argv[3], "wb") as file:
        file.write("\n".join(head).encode())
        for row in rows:
            file.write(struct.pack(f"<{len(row)}f", *row))


main()
