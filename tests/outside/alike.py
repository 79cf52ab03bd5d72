"""alike.py HOW A.ply B.ply - whether two models hold the same Gaussians, in any order.

HOW   exact     to the bit
      rounded   decoded from the same bytes: within float rounding
      steps     B came through a .spz: within the steps of the format
      splat     decoded from the same .splat, whose rotations readers take as 128ths or as 255ths
"""
import math
import struct
import sys


def load(path):
    with open(path, "rb") as file:
        header, data = file.read().split(b"end_header\n", 1)
    lines = header.decode().split("\n")
    names = [line.split()[2] for line in lines if line.startswith("property")]
    count = int(next(line for line in lines if line.startswith("element vertex")).split()[2])
    rows = [struct.unpack_from(f"<{len(names)}f", data, 4 * len(names) * i) for i in range(count)]
    return [{n: v for n, v in zip(names, row) if not n.startswith("n")} for row in rows]


def sigmoid(x):
    return 1 / (1 + math.exp(-x))


def angle_off(p, q):
    names = [f"rot_{k}" for k in range(4)]
    norm = math.sqrt(sum(p[n] ** 2 for n in names) * sum(q[n] ** 2 for n in names))
    return 1 - abs(sum(p[n] * q[n] for n in names)) / norm


def bound(how, name):
    """How far two values of a name may be apart."""
    if how != "steps":
        return 0 if how == "exact" else 2e-5
    if name in ("x", "y", "z"):
        return 2.0**-5
    if name.startswith("scale"):
        return 1 / 32 + 1e-5
    if name.startswith("f_dc"):
        return 0.5 / 255 / 0.15 + 1e-5
    # The widest step of the SH in a file of ours: 4 bits less than a byte.
    return 0.5 + 1e-5


def check(how, p, q):
    for name, value in p.items():
        if name.startswith("rot"):
            continue
        other = q[name]
        if name == "opacity" and how != "exact":
            value, other = sigmoid(value), sigmoid(other)
            if abs(value - other) > 0.5 / 255 + 1e-5:
                return f"opacity {value} and {other}"
        elif name.startswith("scale") and how == "steps" and value < -10:
            continue
        elif abs(value - other) > bound(how, name):
            return f"{name} {value} and {other}"
    off = angle_off(p, q)
    most = {"exact": 1e-12, "rounded": 1e-6, "steps": 2e-4, "splat": 5e-4}[how]
    return None if off <= most else f"rotation {off}"


def main():
    how, a, b = sys.argv[1], load(sys.argv[2]), load(sys.argv[3])
    if len(a) != len(b) or not a:
        sys.exit(f"{len(a)} and {len(b)} Gaussians")
    if a[0].keys() != b[0].keys():
        sys.exit(f"values {sorted(a[0].keys() ^ b[0].keys())} are in one alone")
    if how == "steps":
        unmatched = list(b)
        for p in a:
            best = min(unmatched, key=lambda q: sum((p[n] - q[n]) ** 2 for n in ("x", "y", "z")) +
                       sum((p[n] - q[n]) ** 2 for n in ("f_dc_0", "f_dc_1", "f_dc_2")))
            unmatched.remove(best)
            wrong = check(how, p, best)
            if wrong:
                sys.exit(wrong)
        return
    for i, (p, q) in enumerate(zip(a, b)):
        wrong = check(how, p, q)
        if wrong:
            sys.exit(f"Gaussian #{i}: {wrong}")


main()
