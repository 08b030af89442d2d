#!/usr/bin/env python3
"""Writes balls.obj, balls.mtl and tables of lobes: three balls of one metal in a room, whose lobes come from tables."""

from math import acos, cos, exp, pi, sin, sqrt
from pathlib import Path

HERE = Path(__file__).parent
RINGS, SECTORS, RADIUS = 16, 32, 0.5
QUADS = 5

lines = ["# written by generate.py", "mtllib balls.mtl"]
vertices = 0


def quad(name, corner, u, v):
    global vertices
    lines.append("usemtl " + name)
    for a, b in ((0, 0), (1, 0), (1, 1), (0, 1)):
        lines.append("v %.5g %.5g %.5g" % tuple(c + a * x + b * y for c, x, y in zip(corner, u, v)))
    lines.append("f " + " ".join(str(vertices + i) for i in (1, 2, 3, 4)))
    vertices += 4


def ball(name, x):
    global vertices
    lines.extend(["usemtl " + name, "s 1"])
    for i in range(RINGS + 1):
        for k in range(SECTORS):
            t, p = pi * i / RINGS, 2 * pi * k / SECTORS
            n = (sin(t) * cos(p), cos(t), sin(t) * sin(p))
            lines.append("v %.5g %.5g %.5g" % (x + RADIUS * n[0], RADIUS * (1 + n[1]), RADIUS * n[2]))
            lines.append("vn %.5g %.5g %.5g" % n)
    normals = vertices - QUADS * 4
    at = lambda i, k: "%d//%d" % tuple(first + i * SECTORS + k % SECTORS + 1 for first in (vertices, normals))
    for i in range(RINGS):
        for k in range(SECTORS):
            corners = [at(i, k), at(i, k + 1), at(i + 1, k + 1), at(i + 1, k)]
            corners = corners[1:] if i == 0 else corners[:3] if i == RINGS - 1 else corners
            lines.append("f " + " ".join(corners))
    lines.append("s off")
    vertices += (RINGS + 1) * SECTORS


def table(name, f, azimuths):
    """f(wi, wo) about +z, at even steps of the angle."""
    count = 17
    cosines = [sin(0.5 * pi * i / (count - 1)) for i in range(count)]
    direction = lambda c, a: (sqrt(max(1 - c * c, 0)) * cos(a), sqrt(max(1 - c * c, 0)) * sin(a), c)
    values = [f(direction(i, a), direction(o, 0)) for i in cosines for o in cosines for a in azimuths]
    text = ["# written by generate.py"]
    for key, digits, numbers in (("cos_i", 7, cosines), ("cos_o", 7, cosines), ("azimuth", 7, azimuths), ("values", 4, values)):
        text.append("%s = [" % key)
        text.extend("    " + ", ".join("%.*g" % (digits, x) for x in numbers[i:i + 17]) + "," for i in range(0, len(numbers), 17))
        text.append("]")
    (HERE / (name + ".toml")).write_text("\n".join(text) + "\n")


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def back(wi, wo):
    return 0.8 * 12 / (2 * pi) * max(dot(wi, wo), 0) ** 11


def ring(wi, wo):
    h = [a + b for a, b in zip(wi, wo)]
    lean = acos(min(h[2] / max(sqrt(dot(h, h)), 1e-6), 1))
    return 0.3 * exp(-((lean - 0.45) / 0.15) ** 2)


def ahead(wi, wo):
    return 0.8 * 14 / (2 * pi) * max(wi[2] * wo[2] - wi[0] * wo[0] - wi[1] * wo[1], 0) ** 12


quad("ground", (-3, 0, 2), (6, 0, 0), (0, 0, -4))
quad("wall", (-3, 0, -2), (6, 0, 0), (0, 3, 0))
quad("left", (-3, 0, 2), (0, 0, -4), (0, 3, 0))
quad("right", (3, 0, -2), (0, 0, 4), (0, 3, 0))
quad("lamp", (-0.5, 2.8, 1.5), (1, 0, 0), (0, -0.5, 0.7))
for name, x in (("back", -1.2), ("ring", 0), ("ahead", 1.2)):
    ball(name, x)
(HERE / "balls.obj").write_text("\n".join(lines) + "\n")
paint = lambda name, colour: f"newmtl {name}\nKd {colour}\n"
metal = "Kd 0.85 0.75 0.55\nPm 1\nPr 0.4\n"
(HERE / "balls.mtl").write_text(
    "# written by generate.py\n\n"
    + "\n".join(
        [paint("ground", "0.5 0.5 0.5"), paint("wall", "0.6 0.6 0.6"), paint("left", "0.6 0.15 0.1"), paint("right", "0.1 0.3 0.6")]
        + ["newmtl lamp\nKd 0 0 0\nKe 22 21 19\n"]
        + [f"newmtl {name}\n{metal}" for name in ("back", "ring", "ahead")]
    )
)
even = [pi * i / 16 for i in range(17)]
dense = [pi * (1 - (1 - i / 16) ** 2) for i in range(17)]
table("back", back, [pi - a for a in reversed(dense)])
table("ring", ring, even)
table("ahead", ahead, dense)
