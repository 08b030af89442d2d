#!/usr/bin/env python3
"""Writes box.obj and box.mtl: a room with a red wall, a short box and a tall glossy one."""

import math
import pathlib

HERE = pathlib.Path(__file__).parent
lines, materials = ["# written by generate.py", "mtllib box.mtl"], ["# written by generate.py"]
vertices = 0


def material(name, *properties):
    materials.extend(["", f"newmtl {name}", *properties])


def quad(name, *corners):
    global vertices
    lines.append(f"usemtl {name}")
    lines.extend("v %g %g %g" % corner for corner in corners)
    lines.append("f %d %d %d %d" % tuple(vertices + i for i in (1, 2, 3, 4)))
    vertices += 4


def box(name, x, z, half, height, degrees):
    """A box on the floor, turned about its axis; without its lower face."""
    turn = math.radians(degrees)
    foot = []
    for sx, sz in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
        a, b = half * sx, half * sz
        foot.append((round(x + a * math.cos(turn) - b * math.sin(turn), 5), round(z + a * math.sin(turn) + b * math.cos(turn), 5)))
    low = [(px, 0.0, pz) for px, pz in foot]
    high = [(px, height, pz) for px, pz in foot]
    quad(name, high[3], high[2], high[1], high[0])
    for i in range(4):
        j = (i + 1) % 4
        quad(name, low[i], high[i], high[j], low[j])


material("white", "Kd 0.7 0.7 0.7")
material("red", "Kd 0.65 0.05 0.05")
material("blue", "Kd 0.1 0.15 0.6")
material("lamp", "Kd 0 0 0", "Ke 18 17 15")
material("glossy", "Kd 0.25 0.25 0.25", "Ks 0.4 0.4 0.4", "Pr 0.45")

W, H, D = 5.6, 5.5, 5.6
quad("white", (0, 0, 0), (0, 0, D), (W, 0, D), (W, 0, 0))
quad("white", (0, H, 0), (W, H, 0), (W, H, D), (0, H, D))
quad("white", (0, 0, 0), (W, 0, 0), (W, H, 0), (0, H, 0))
quad("white", (0, 0, D), (0, H, D), (W, H, D), (W, 0, D))
quad("red", (0, 0, 0), (0, H, 0), (0, H, D), (0, 0, D))
quad("blue", (W, 0, 0), (W, 0, D), (W, H, D), (W, H, 0))
quad("lamp", (2.1, H - 0.01, 2.1), (3.5, H - 0.01, 2.1), (3.5, H - 0.01, 3.5), (2.1, H - 0.01, 3.5))
box("glossy", 2.0, 1.9, 0.85, 3.3, 17)
box("white", 3.9, 3.3, 0.8, 1.6, -18)

(HERE / "box.obj").write_text("\n".join(lines) + "\n")
(HERE / "box.mtl").write_text("\n".join(materials) + "\n")
