#!/usr/bin/env python3
"""models.py MODEL OTHER - how far the cameras of one model are from those of another, after alignment, in a line.

A model is a folder of COLMAP (sparse/0, binary) or a transforms.json. Pictures of the same name are compared. The alignment is
the similarity that brings MODEL's centres nearest to OTHER's (Horn 1987); the extent is the greatest distance of two centres.
"""
import json
import math
import os
import statistics
import struct
import sys

PARAMETERS = {0: 3, 1: 4, 2: 4, 3: 5, 4: 8, 5: 8, 6: 12, 7: 5, 8: 4, 9: 5, 10: 12}  # of COLMAP's kinds of cameras


def load_cameras(path):
    """The focal length of each camera, px."""
    focal = {}
    with open(path, "rb") as file:
        for _ in range(struct.unpack("<Q", file.read(8))[0]):
            camera, kind, _, _ = struct.unpack("<iiQQ", file.read(24))
            focal[camera] = struct.unpack(f"<{PARAMETERS[kind]}d", file.read(8 * PARAMETERS[kind]))[0]
    return focal


def rotation_of(w, x, y, z):
    s = 2 / (w * w + x * x + y * y + z * z)
    return [
        [1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)],
        [s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x)],
        [s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y)],
    ]


def turned(m):
    return [list(row) for row in zip(*m)]


def times(m, v):
    return [sum(a * b for a, b in zip(row, v)) for row in m]


def product(a, b):
    return [[sum(x * y for x, y in zip(row, column)) for column in zip(*b)] for row in a]


def load_colmap(folder):
    """By name: rotation from world to camera, centre, focal length."""
    focal = load_cameras(os.path.join(folder, "cameras.bin"))
    views = {}
    with open(os.path.join(folder, "images.bin"), "rb") as file:
        for _ in range(struct.unpack("<Q", file.read(8))[0]):
            _, *pose, camera = struct.unpack("<i7di", file.read(64))
            name = b""
            while (letter := file.read(1)) != b"\0":
                name += letter
            file.seek(24 * struct.unpack("<Q", file.read(8))[0], 1)
            R = rotation_of(*pose[:4])
            centre = [-c for c in times(turned(R), pose[4:])]
            views[name.decode()] = R, centre, focal[camera]
    return views


def load_transforms(path):
    """The same; their cameras look along -z, and y is up."""
    with open(path, encoding="utf-8") as file:
        project = json.load(file)
    views = {}
    for frame in project["frames"]:
        m = frame["transform_matrix"]
        R = turned([[row[0], -row[1], -row[2]] for row in m[:3]])
        focal = frame.get("fl_x", project.get("fl_x"))
        views[os.path.basename(frame["file_path"])] = R, [row[3] for row in m[:3]], focal
    return views


def load(path):
    return load_transforms(path) if path.endswith(".json") else load_colmap(path)


def align(a, b):
    """Rotation, scale and both middles of the similarity that takes points a to b."""
    n = len(a)
    middles = [[sum(p[k] for p in points) / n for k in range(3)] for points in (a, b)]
    a = [[x - m for x, m in zip(p, middles[0])] for p in a]
    b = [[x - m for x, m in zip(p, middles[1])] for p in b]
    S = [[sum(p[i] * q[k] for p, q in zip(a, b)) for k in range(3)] for i in range(3)]
    N = [
        [S[0][0] + S[1][1] + S[2][2], S[1][2] - S[2][1], S[2][0] - S[0][2], S[0][1] - S[1][0]],
        [0, S[0][0] - S[1][1] - S[2][2], S[0][1] + S[1][0], S[2][0] + S[0][2]],
        [0, 0, -S[0][0] + S[1][1] - S[2][2], S[1][2] + S[2][1]],
        [0, 0, 0, -S[0][0] - S[1][1] + S[2][2]],
    ]
    N = [[N[min(i, k)][max(i, k)] for k in range(4)] for i in range(4)]
    # The eigenvector of the greatest eigenvalue: all are made positive, and squaring leaves the greatest.
    shift = math.sqrt(sum(x * x for row in N for x in row))
    for i in range(4):
        N[i][i] += shift
    for _ in range(60):
        greatest = max(abs(x) for row in N for x in row)
        N = [[x / greatest for x in row] for row in N]
        N = product(N, N)
    quaternion = max(N, key=lambda row: sum(x * x for x in row))
    squares = [sum(x * x for p in points for x in p) for points in (a, b)]
    return rotation_of(*quaternion), math.sqrt(squares[1] / squares[0]), middles


def degrees_between(p, q):
    trace = sum(x * y for row, other in zip(p, q) for x, y in zip(row, other))
    return math.degrees(math.acos(max(-1, min(1, (trace - 1) / 2))))


def main():
    ours, theirs = load(sys.argv[1]), load(sys.argv[2])
    names = sorted(set(ours) & set(theirs))
    if len(names) < 3:
        sys.exit(f"{len(names)} pictures are in both models: too few to compare them")
    R, scale, (from_, to) = align([ours[n][1] for n in names], [theirs[n][1] for n in names])
    rotations, moved = [], []
    for name in names:
        rotations.append(degrees_between(product(ours[name][0], turned(R)), theirs[name][0]))
        at = times(R, [x - m for x, m in zip(ours[name][1], from_)])
        moved.append(math.dist([scale * x + m for x, m in zip(at, to)], theirs[name][1]))
    extent = max(math.dist(theirs[p][1], theirs[q][1]) for p in names for q in names)
    focal = [statistics.median(model[n][2] for n in names) for model in (ours, theirs)]
    print(
        f"{len(names)} pictures, medians: rotation {statistics.median(rotations):.3f} degrees, centre "
        f"{100 * statistics.median(moved) / extent:.3f} % of the extent, focal lengths {focal[0]:.1f} and {focal[1]:.1f} px"
    )


main()
