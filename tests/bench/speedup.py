#!/usr/bin/env python3
"""The speed-up to expect of a fit on several machines (src/cluster/README.md): a table, and a chart as .svg.

    tests/bench/speedup.py [CHART.svg]

Seconds of a step on n machines: work / (n x balance), bytes that a rank sends / bandwidth, exchanges x latency. Bytes are the
formula's, with what was measured of 300,000 Gaussians at 960x540 (src/cluster/MEASURED.md): the share in view and how
many reach over a boundary between two bands. The work of a step is an assumption: each row of the table states it.
"""
import sys
from math import log2

IN_VIEW = 177700 / 300000  # Gaussians in view of all
CROSSING = 4500 / 300000   # more bands that a Gaussian touches, for each boundary between bands
SENT, RETURNED = 44, 36    # bytes
EXCHANGES = 10             # of a step
BALANCE = 0.9              # mean over slowest; 0.94 was measured of two ranks
WIDTH, ROWS = 960, 34      # px; rows of tiles
NETWORKS = {"1 Gbit/s": (118e6, 0.2e-3), "10 Gbit/s": (1.18e9, 0.05e-3)}  # bytes a second, seconds an exchange
RANKS = (1, 2, 4, 8, 16, 32, 64)


def bytes_of_rank(n, gaussians):
    touched = gaussians * (IN_VIEW + CROSSING * (n - 1))
    of_all = (n - 1) / n * touched * (SENT + RETURNED) + 2 * (n - 1) * 10 * 12 * WIDTH + n * (n - 1) * 12 * ROWS + 8192 * (n - 1)
    return of_all / n


def speed_up(n, gaussians, step, network):
    if n == 1:
        return 1.0
    bandwidth, latency = NETWORKS[network]
    return step / (step / n / BALANCE + bytes_of_rank(n, gaussians) / bandwidth + EXCHANGES * latency)


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
SCENES = (300000, 3000000, 30000000)


def table():
    print("| machine, network | Gaussians | step of one | " + " | ".join("%d" % n for n in RANKS[1:]) + " |")
    print("| --- " * (3 + len(RANKS[1:])) + "|")
    for name, factor, network in MACHINES:
        for g in SCENES:
            step = STEP * g * factor
            ups = [speed_up(n, g, step, network) for n in RANKS[1:]]
            print("| %s, %s | %g million | %.2f s | " % (name, network, g / 1e6, step) + " | ".join("%.1f" % u for u in ups) + " |")


def chart(path):
    colors = ("#b2182b", "#ef8a62", "#2166ac", "#67a9cf", "#666666")
    left, top, size = 60, 20, 300
    x = lambda n: left + size * RANKS.index(n) / (len(RANKS) - 1)
    most = 64.0
    y = lambda s: top + size * (1 - log2(max(s, 0.5) / 0.5) / log2(most / 0.5))
    out = ['<svg xmlns="http://www.w3.org/2000/svg" width="620" height="370" font-family="sans-serif" font-size="12">',
           '<rect width="620" height="370" fill="white"/>']
    for n in RANKS:
        out.append('<text x="%.0f" y="%d" text-anchor="middle">%d</text>' % (x(n), top + size + 16, n))
    for s in (0.5, 1, 2, 4, 8, 16, 32, 64):
        out.append('<line x1="%d" x2="%d" y1="%.1f" y2="%.1f" stroke="#ddd"/>' % (left, left + size, y(s), y(s)))
        out.append('<text x="%d" y="%.1f" text-anchor="end">%g</text>' % (left - 6, y(s) + 4, s))
    out.append('<text x="%d" y="%d" text-anchor="middle">machines</text>' % (left + size / 2, top + size + 34))
    out.append('<text x="14" y="%d" transform="rotate(-90 14 %d)" text-anchor="middle">speed-up, 3 million Gaussians</text>' %
               (top + size / 2, top + size / 2))
    out.append('<polyline fill="none" stroke="#aaa" stroke-dasharray="3 3" points="%s"/>' %
               " ".join("%.1f,%.1f" % (x(n), y(n)) for n in RANKS))
    for i, (name, factor, network) in enumerate(MACHINES):
        line = " ".join("%.1f,%.1f" % (x(n), y(speed_up(n, 3e6, STEP * 3e6 * factor, network))) for n in RANKS)
        out.append('<polyline fill="none" stroke="%s" stroke-width="2" points="%s"/>' % (colors[i], line))
        out.append('<text x="%d" y="%d" fill="%s">%s, %s</text>' % (left + size + 20, top + 20 + 18 * i, colors[i], name, network))
    out.append('</svg>')
    with open(path, "w", encoding="utf-8") as f:
        f.write("\n".join(out) + "\n")


table()
if len(sys.argv) > 1:
    chart(sys.argv[1])
