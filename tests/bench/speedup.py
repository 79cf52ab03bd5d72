#!/usr/bin/env python3
"""The speed-up to expect of a fit on several machines (src/cluster/README.md): tables, and a chart as .svg.

    tests/bench/speedup.py [CHART.svg]

Seconds of a step on n machines: work / (n x balance), bytes of the busiest rank of each exchange / bandwidth, exchanges x
latency. Bytes are the formula's, with what was measured of 300,000 Gaussians at 960x540 (src/cluster/MEASURED.md): the share in
view and how many reach over a boundary between two bands. The work of a step is an assumption: each row of the first table
states it. Weak scaling: Gaussians and pixels rise in proportion to the machines; the second table has the part of the ideal.
"""
import sys
from math import log2

IN_VIEW = 177700 / 300000  # Gaussians in view of all
CROSSING = 4500 / 300000   # more bands that a Gaussian touches, for each boundary between bands
SENT, RETURNED = 33, 27    # bytes; rows of tiles beside: 1 byte where a band has at most 16, else 2
BLENDED = 0.93             # of those that travel, whose sums are not all zero
EXCHANGES = 8              # of a step
WIDTH, ROWS = 960, 34      # px; rows of tiles
WEAK = 300000              # Gaussians of a machine, with a picture of that size
NETWORKS = {"1 Gbit/s": (118e6, 0.2e-3), "10 Gbit/s": (1.18e9, 0.05e-3)}  # bytes a second, seconds an exchange
RANKS = (1, 2, 4, 8, 16, 32, 64)


# Mean over slowest, summed over the parts of a step between exchanges: 0.97, 0.88, 0.82 were measured of 2, 4, 8 ranks and 34 rows.
# Bands are whole rows of tiles: the fewer rows a band has, the less equal is the work.
def balance(n, larger):
    return 0.95 / (1 + 0.6 * n / (ROWS * larger))


# The busiest rank of each exchange, over the mean: 1.13, 1.21, 1.34 were measured.
def busiest(n):
    return 1.02 + 0.105 * log2(n)


# Of a rank in the mean. larger: times the picture's width and height.
def bytes_of_rank(n, gaussians, larger):
    touched = gaussians * (IN_VIEW + CROSSING / larger * (n - 1))
    of_one = SENT + (1 if ROWS * larger <= 16 * n else 2) + 1 / 8 + RETURNED * BLENDED
    halo = 2 * (n - 1) * 10 * 12 * WIDTH * larger
    of_all = (n - 1) / n * touched * of_one + halo + n * (n - 1) * 12 * ROWS * larger + 8192 * (n - 1)
    return of_all / n


# step: seconds of it on one machine. None: more machines than rows of tiles.
def speed_up(n, gaussians, step, network, larger=1.0):
    if n == 1:
        return 1.0
    if n > ROWS * larger:
        return None
    bandwidth, latency = NETWORKS[network]
    travels = bytes_of_rank(n, gaussians, larger) * busiest(n) / bandwidth + EXCHANGES * latency
    return step / (step / n / balance(n, larger) + travels)


# Of n times as many Gaussians and pixels: the part of n times the speed.
def weak(n, factor, network):
    return speed_up(n, n * WEAK, n * WEAK * STEP * factor, network, n ** 0.5) / n


# A step of one machine, seconds: 0.117 s of processor time for 300,000 Gaussians (measured, one thread, AVX-512), in proportion
# to the Gaussians; 8 threads: an eighth. A Raspberry Pi 4: 6.5 times the time of AVX-512 (src/bench/MEASURED.md, Cortex-A57 at 1.5 GHz,
# pair loops), 3.5 of 4 cores. Pi 5: 2.2 times (neoverse-n1 at 2.4 GHz).
STEP = 0.1168 / 300000
MACHINES = (
    ("Raspberry Pi 4", 6.5 / 3.5, "1 Gbit/s"),
    ("Raspberry Pi 5", 2.2 / 3.5, "1 Gbit/s"),
    ("server, 1 thread", 1.0, "10 Gbit/s"),
    ("server, 2 threads", 1 / 2, "10 Gbit/s"),
    ("server, 8 threads", 1 / 8, "10 Gbit/s"),
)
SCENES = ((300000, 1), (3000000, 2), (30000000, 4))  # Gaussians; pictures: 960x540, 1920x1080, 3840x2160


def table():
    print("| machine, network | Gaussians | step of one | " + " | ".join("%d" % n for n in RANKS[1:]) + " |")
    print("| --- " * (3 + len(RANKS[1:])) + "|")
    for name, factor, network in MACHINES:
        for g, larger in SCENES:
            step = STEP * g * factor
            ups = [speed_up(n, g, step, network, larger) for n in RANKS[1:]]
            print("| %s, %s | %g million | %.2f s | " % (name, network, g / 1e6, step) + " | ".join("%.2f" % u if u else "" for u in ups) + " |")
    print()
    print("| %d Gaussians a machine | " % WEAK + " | ".join("%d" % n for n in RANKS[1:]) + " |")
    print("| --- " * len(RANKS) + "|")
    for name, factor, network in MACHINES:
        print("| %s, %s | " % (name, network) + " | ".join("%.2f" % weak(n, factor, network) for n in RANKS[1:]) + " |")


COLORS = ("#b2182b", "#ef8a62", "#2166ac", "#67a9cf", "#666666")
SIZE, LEFT, TOP = 240, (60, 400), (20, 330)


# What a panel has: ticks of the ordinate with their values' heights from 0 to 1, the ideal, a line for each machine; None ends a line.
def panel(left, top, title, ticks, ideal, lines):
    def x(n):
        return left + SIZE * RANKS.index(n) / (len(RANKS) - 1)

    def y(height):
        return top + SIZE * (1 - height)

    out = []
    for n in RANKS:
        out.append('<text x="%.0f" y="%d" text-anchor="middle">%d</text>' % (x(n), top + SIZE + 16, n))
    for text, height in ticks:
        out.append('<line x1="%d" x2="%d" y1="%.1f" y2="%.1f" stroke="#ddd"/>' % (left, left + SIZE, y(height), y(height)))
        out.append('<text x="%d" y="%.1f" text-anchor="end">%s</text>' % (left - 6, y(height) + 4, text))
    out.append('<text x="%d" y="%d" text-anchor="middle">machines</text>' % (left + SIZE / 2, top + SIZE + 34))
    middle = top + SIZE / 2
    out.append('<text x="%d" y="%d" transform="rotate(-90 %d %d)" text-anchor="middle">%s</text>' %
               (left - 36, middle, left - 36, middle, title))
    for color, more, line in [("#aaa", ' stroke-dasharray="3 3"', ideal)] + [(c, ' stroke-width="2"', l) for c, l in zip(COLORS, lines)]:
        points = " ".join("%.1f,%.1f" % (x(n), y(height)) for n, height in zip(RANKS, line) if height is not None)
        out.append('<polyline fill="none" stroke="%s"%s points="%s"/>' % (color, more, points))
    return out


def strong_panel(left, top, gaussians, larger):
    def height(s):
        return None if s is None else log2(max(s, 0.5) / 0.5) / log2(64 / 0.5)

    lines = [[height(speed_up(n, gaussians, STEP * gaussians * factor, network, larger)) for n in RANKS] for _, factor, network in MACHINES]
    return panel(left, top, "speed-up, %g million Gaussians" % (gaussians / 1e6),
                 [("%g" % s, height(s)) for s in (0.5, 1, 2, 4, 8, 16, 32, 64)], [height(n) for n in RANKS], lines)


def chart(path):
    out = ['<svg xmlns="http://www.w3.org/2000/svg" width="680" height="680" font-family="sans-serif" font-size="12">',
           '<rect width="680" height="680" fill="white"/>']
    for k, (gaussians, larger) in enumerate(SCENES):
        out += strong_panel(LEFT[k % 2], TOP[k // 2], gaussians, larger)
    out += panel(LEFT[1], TOP[1], "part of the ideal, 300,000 a machine", [("%.1f" % s, s) for s in (0, 0.2, 0.4, 0.6, 0.8, 1)],
                 [1 for n in RANKS], [[weak(n, factor, network) for n in RANKS] for _, factor, network in MACHINES])
    for i, (name, _, network) in enumerate(MACHINES):
        out.append('<text x="%d" y="%d" fill="%s">%s, %s</text>' % (60 + 210 * (i % 3), 635 + 20 * (i // 3), COLORS[i], name, network))
    out.append('</svg>')
    with open(path, "w", encoding="utf-8") as f:
        f.write("\n".join(out) + "\n")


table()
if len(sys.argv) > 1:
    chart(sys.argv[1])
