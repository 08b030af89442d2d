#!/usr/bin/env python3
"""Writes metal.obj and metal.mtl: three discs of metal before lamps, with grains of three kinds."""

from math import cos, pi, sin
from pathlib import Path

SECTORS = 64
RADIUS = 0.62
INNER = 0.01

lines = ["# written by generate.py", "mtllib metal.mtl"]
vertices = 0


def quad(corners, uvs):
    global vertices
    lines.extend("v %.5g %.5g %.5g" % corner for corner in corners)
    lines.extend("vt %.5g %.5g" % uv for uv in uvs)
    lines.append("f " + " ".join("%d/%d" % (vertices + i, vertices + i) for i in (1, 2, 3, 4)))
    vertices += 4


def plane(name, corner, u, v):
    lines.append("usemtl " + name)
    at = lambda a, b: tuple(c + a * x + b * y for c, x, y in zip(corner, u, v))
    square = [(0, 0), (1, 0), (1, 1), (0, 1)]
    quad([at(a, b) for a, b in square], square)


def disc(name, x, turning):
    """u runs round the centre, or else to the right."""
    lines.append("usemtl " + name)
    for i in range(SECTORS):
        ring = [(r, 2 * pi * k / SECTORS) for r, k in ((INNER, i), (RADIUS, i), (RADIUS, i + 1), (INNER, i + 1))]
        corners = [(x + r * cos(t), 0.05, -r * sin(t)) for r, t in ring]
        quad(corners, [(4 * t / pi, r) if turning else (r * cos(t), r * sin(t)) for r, t in ring])


plane("ground", (-5, 0, 3), (10, 0, 0), (0, 0, -6))
plane("ground", (-5, 0, -3), (10, 0, 0), (0, 5, 0))
for x in (-2.7, 0, 2.7):
    plane("lamp", (x - 0.2, 2.0, -2.95), (0.4, 0, 0), (0, 0.4, 0))
disc("turned", -1.35, True)
disc("straight", 0, False)
disc("plain", 1.35, False)

HERE = Path(__file__).parent
(HERE / "metal.obj").write_text("\n".join(lines) + "\n")
metal = "Kd 0.85 0.8 0.72\nPm 1\nPr 0.28\n"
(HERE / "metal.mtl").write_text(
    "# written by generate.py\n\nnewmtl ground\nKd 0.2 0.22 0.25\n\nnewmtl lamp\nKd 0 0 0\nKe 36 34 30\n\n"
    + "\n".join(f"newmtl {name}\n{metal}" for name in ("turned", "straight", "plain"))
)
