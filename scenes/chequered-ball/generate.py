#!/usr/bin/env python3
"""Writes room.obj and room.mtl: a ball in a room whose walls have chequers."""

import math
import pathlib

HERE = pathlib.Path(__file__).parent
STEPS = 14
SQUARES = 6
LOW, HIGH = (-3.0, -1.0, -3.0), (3.0, 3.5, 4.5)
lines, materials = ["# written by generate.py", "mtllib room.mtl"], ["# written by generate.py"]
vertices = 0


def material(name, *properties):
    materials.extend(["", f"newmtl {name}", *properties])


def quad(name, corner, u, v):
    global vertices
    lines.append(f"usemtl {name}")
    for a, b in ((0, 0), (1, 0), (1, 1), (0, 1)):
        lines.append("v %g %g %g" % tuple(corner[k] + a * u[k] + b * v[k] for k in range(3)))
    lines.append("f %d %d %d %d" % tuple(vertices + i for i in (1, 2, 3, 4)))
    vertices += 4


def wall(axis, high, colours):
    """A wall of chequers that faces the room."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    for a in range(SQUARES):
        for b in range(SQUARES):
            u, v, corner = [0.0] * 3, [0.0] * 3, [0.0] * 3
            u[i], v[j] = (HIGH[i] - LOW[i]) / SQUARES, (HIGH[j] - LOW[j]) / SQUARES
            corner[axis] = (HIGH if high else LOW)[axis]
            corner[i], corner[j] = LOW[i] + a * u[i], LOW[j] + b * v[j]
            quad(colours[(a + b) % 2], corner, *((v, u) if high else (u, v)))


def ball(name, centre, radius):
    """A smooth ball."""
    global vertices
    lines.append("o ball")
    lines.append(f"usemtl {name}")
    for i in range(STEPS + 1):
        for j in range(2 * STEPS):
            theta, phi = math.pi * i / STEPS, math.pi * j / STEPS
            n = (math.sin(theta) * math.cos(phi), math.cos(theta), math.sin(theta) * math.sin(phi))
            lines.append("v %.4g %.4g %.4g" % tuple(centre[k] + radius * round(n[k], 4) for k in range(3)))
            lines.append("vn %.4g %.4g %.4g" % tuple(round(x, 4) for x in n))
    for i in range(STEPS):
        for j in range(2 * STEPS):
            at = lambda a, b: 2 * STEPS * (i + a) + (j + b) % (2 * STEPS) + 1
            corners = [at(0, 0), at(0, 1), at(1, 1), at(1, 0)]
            # At the poles two corners coincide.
            face = corners[:1] + corners[2:] if i == 0 else corners[:3] if i + 1 == STEPS else corners
            lines.append("f " + " ".join(f"{vertices + p}//{p}" for p in face))
    vertices += 2 * STEPS * (STEPS + 1)


material("white", "Kd 0.75 0.75 0.72")
material("blue", "Kd 0.15 0.25 0.5")
material("red", "Kd 0.6 0.12 0.1")
material("dark", "Kd 0.12 0.12 0.12")
material("lamp", "Kd 0 0 0", "Ke 16 15 13")
material("metal", "Kd 0.9 0.82 0.7", "Pm 1", "Pr 0.2")

wall(0, False, ("red", "white"))
wall(0, True, ("blue", "white"))
wall(1, False, ("white", "dark"))
quad("white", (LOW[0], HIGH[1], LOW[2]), (HIGH[0] - LOW[0], 0, 0), (0, 0, HIGH[2] - LOW[2]))
wall(2, False, ("white", "dark"))
wall(2, True, ("white", "blue"))
quad("lamp", (-1.0, HIGH[1] - 0.02, 0.6), (2.0, 0, 0), (0, 0, 1.6))
ball("metal", (0.0, 0.0, 0.0), 1.0)

(HERE / "room.obj").write_text("\n".join(lines) + "\n")
(HERE / "room.mtl").write_text("\n".join(materials) + "\n")
