#!/usr/bin/env python3
"""Writes balls.obj and balls.mtl: a room with twelve balls, metal behind and coated in front, of roughness 0.02 to 1."""

import math
import pathlib

HERE = pathlib.Path(__file__).parent
ROUGHNESS = [0.02, 0.1, 0.25, 0.5, 0.75, 1.0]
AROUND, DOWN = 40, 20

lines, materials = ["# written by generate.py", "mtllib balls.mtl"], ["# written by generate.py"]
vertices = normals = 0


def material(name, *properties):
    materials.extend(["", f"newmtl {name}", *properties])


def quad(name, *corners):
    global vertices
    lines.append(f"usemtl {name}")
    lines.extend("v %g %g %g" % corner for corner in corners)
    lines.append("f %d %d %d %d" % tuple(vertices + i for i in (1, 2, 3, 4)))
    vertices += 4


def ball(name, centre, radius):
    global vertices, normals
    lines.append(f"usemtl {name}")
    for j in range(DOWN + 1):
        theta = math.pi * j / DOWN
        for i in range(AROUND):
            phi = 2 * math.pi * i / AROUND
            n = (math.sin(theta) * math.cos(phi), math.cos(theta), math.sin(theta) * math.sin(phi))
            lines.append("v %.5f %.5f %.5f" % tuple(c + radius * x for c, x in zip(centre, n)))
            lines.append("vn %.4f %.4f %.4f" % n)
    for j in range(DOWN):
        for i in range(AROUND):
            a, b = j * AROUND + i + 1, j * AROUND + (i + 1) % AROUND + 1
            c, d = b + AROUND, a + AROUND
            face = [a, c, d] if j == 0 else [a, b, d] if j == DOWN - 1 else [a, b, c, d]
            lines.append("f " + " ".join(f"{vertices + k}//{normals + k}" for k in face))
    vertices += AROUND * (DOWN + 1)
    normals += AROUND * (DOWN + 1)


material("white", "Kd 0.7 0.7 0.7")
material("red", "Kd 0.6 0.12 0.1")
material("blue", "Kd 0.12 0.2 0.6")
material("lamp", "Kd 0 0 0", "Ke 15 14 12")
for k, roughness in enumerate(ROUGHNESS):
    material(f"metal{k}", "Kd 0.9 0.75 0.5", f"Pr {roughness}", "Pm 1")
    material(f"coated{k}", "Kd 0.3 0.5 0.35", f"Pr {roughness}", "Ks 0.04 0.04 0.04")
quad("white", (-3, 0, -2), (-3, 0, 2), (3, 0, 2), (3, 0, -2))
quad("white", (-3, 3, -2), (3, 3, -2), (3, 3, 2), (-3, 3, 2))
quad("white", (-3, 0, -2), (3, 0, -2), (3, 3, -2), (-3, 3, -2))
quad("white", (-3, 0, 2), (-3, 3, 2), (3, 3, 2), (3, 0, 2))
quad("red", (-3, 0, 2), (-3, 0, -2), (-3, 3, -2), (-3, 3, 2))
quad("blue", (3, 0, -2), (3, 0, 2), (3, 3, 2), (3, 3, -2))
quad("lamp", (-1.5, 2.99, -0.4), (-0.7, 2.99, -0.4), (-0.7, 2.99, 0.4), (-1.5, 2.99, 0.4))
quad("lamp", (1, 2.99, -0.2), (1.4, 2.99, -0.2), (1.4, 2.99, 0.2), (1, 2.99, 0.2))
for k in range(6):
    ball(f"metal{k}", (-1.5 + 0.6 * k, 0.27, -1.1), 0.27)
    ball(f"coated{k}", (-1.5 + 0.6 * k, 0.27, -0.2), 0.27)
(HERE / "balls.obj").write_text("\n".join(lines) + "\n")
(HERE / "balls.mtl").write_text("\n".join(materials) + "\n")
