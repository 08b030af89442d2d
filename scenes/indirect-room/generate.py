#!/usr/bin/env python3
"""Writes room.obj and room.mtl: a room of about 9,000 triangles that two lamps light by way of its ceiling.

Metres, y up. The floor is a mirror over a diffuse base, a glass ball floats below the ceiling. Needs ../glass-ball/generate.py.
"""
import importlib.util
import math
import os
import random

FOLDER = os.path.dirname(os.path.abspath(__file__))
SPEC = importlib.util.spec_from_file_location('glass_ball', os.path.join(FOLDER, '..', 'glass-ball', 'generate.py'))
GLASS_BALL = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(GLASS_BALL)

SIZE = (6.0, 3.0, 5.0)
LAMPS = ((0.55, 0.6), (5.45, 0.6))

MATERIALS = {  # name: statements
    'wall': 'Kd 0.78 0.76 0.72\nillum 1',
    'ceiling': 'Kd 0.85 0.85 0.83\nillum 1',
    'green_wall': 'Kd 0.3 0.5 0.25\nillum 1',
    'floor': 'Kd 0.3 0.22 0.16\nKs 0.25 0.25 0.25\nillum 3',
    'wood': 'Kd 0.5 0.34 0.2\nillum 1',
    'dark_wood': 'Kd 0.22 0.14 0.1\nillum 1',
    'cloth': 'Kd 0.55 0.12 0.1\nillum 1',
    'china': 'Kd 0.8 0.8 0.82\nillum 1',
    'clay': 'Kd 0.6 0.3 0.18\nillum 1',
    'metal': 'Kd 0.3 0.3 0.32\nillum 1',
    'light': 'Kd 0 0 0\nKe 180 162 132\nillum 1',
    'glass': 'Tf 0.97 0.99 1\nNi 1.5\nillum 7',
    'book_0': 'Kd 0.5 0.15 0.12\nillum 1',
    'book_1': 'Kd 0.15 0.2 0.45\nillum 1',
    'book_2': 'Kd 0.65 0.6 0.45\nillum 1',
    'book_3': 'Kd 0.12 0.3 0.16\nillum 1',
}


class Model(GLASS_BALL.Model):
    def lathe(self, center, profile, segments):
        """The surface of revolution of (radius, height) points, from below; its outside is on the right of the profile."""
        x, y, z = center

        def corner(i, j):
            radius, height = profile[i]
            phi = 2.0 * math.pi * j / segments
            return (x + radius * math.cos(phi), y + height, z + radius * math.sin(phi))

        for i in range(len(profile) - 1):
            for j in range(segments):
                low, high = profile[i][0] > 0.0, profile[i + 1][0] > 0.0
                k = (j + 1) % segments
                if low and high:
                    self.quad(corner(i, j), corner(i + 1, j), corner(i + 1, k), corner(i, k))
                elif low or high:
                    corners = [corner(i, j), corner(i + 1, j), corner(i, k)] if low else \
                        [corner(i, j), corner(i + 1, j), corner(i + 1, k)]
                    self.lines.append('f ' + ' '.join(str(self.vertex(c)) for c in corners))
                    self.triangles += 1


def shell(m):
    w, h, d = SIZE
    m.part('floor', 'floor')
    m.quad((0, 0, 0), (0, 0, d), (w, 0, d), (w, 0, 0))
    m.part('ceiling', 'ceiling')
    m.quad((0, h, 0), (w, h, 0), (w, h, d), (0, h, d))
    m.part('walls', 'wall')
    m.quad((0, 0, 0), (w, 0, 0), (w, h, 0), (0, h, 0))
    m.quad((w, 0, d), (0, 0, d), (0, h, d), (w, h, d))
    m.quad((w, 0, 0), (w, 0, d), (w, h, d), (w, h, 0))
    m.part('green_wall', 'green_wall')
    m.quad((0, 0, d), (0, 0, 0), (0, h, 0), (0, h, d))


def lamp(m, number, x, z):
    """A pole with a bowl that hides the lamp from all but the ceiling."""
    m.part(f'lamp_{number}', 'metal')
    m.lathe((x, 0, z), [(0.0, 0.0), (0.18, 0.0), (0.18, 0.02), (0.02, 0.04), (0.02, 1.7), (0.1, 1.74), (0.2, 1.95),
                        (0.19, 1.95), (0.12, 1.8), (0.0, 1.78)], 24)
    m.part(f'light_{number}', 'light')
    m.lathe((x, 0, z), [(0.1, 1.8), (0.0, 1.8)], 24)


def table(m):
    m.part('table', 'wood')
    m.lathe((3.0, 0, 2.0), [(0.0, 0.7), (0.75, 0.7), (0.78, 0.72), (0.75, 0.74), (0.0, 0.74)], 48)
    m.lathe((3.0, 0, 2.0), [(0.0, 0.0), (0.35, 0.0), (0.33, 0.04), (0.06, 0.08), (0.05, 0.7)], 32)
    cup = [(0.0, 0.0), (0.03, 0.0), (0.035, 0.01), (0.05, 0.08), (0.045, 0.08), (0.03, 0.015), (0.0, 0.012)]
    saucer = [(0.0, 0.0), (0.05, 0.0), (0.09, 0.015), (0.085, 0.017), (0.0, 0.008)]
    for i, (x, z) in enumerate(((2.55, 2.1), (3.4, 1.85))):
        m.part(f'cup_{i}', 'china')
        m.lathe((x, 0.745, z), saucer, 32)
        m.lathe((x, 0.755, z), cup, 32)
    m.part('vase', 'clay')
    vase = [(0.0, 0.0)] + [(0.06 + 0.05 * math.sin(4.2 * t / 20.0), 0.3 * t / 20.0) for t in range(21)]
    m.lathe((3.0, 0.745, 2.0), vase + [(vase[-1][0] - 0.008, 0.3), (0.05, 0.1), (0.0, 0.1)], 48)


def chair(m, number, x, z, back):
    """A chair; `back` is -1 or 1, where its back is along x."""
    m.part(f'chair_{number}', 'dark_wood')
    for a in (-0.2, 0.17):
        for b in (-0.2, 0.17):
            m.box((x + a, 0, z + b), (0.03, 0.44, 0.03), 't')
    m.box((x - 0.21, 0.44, z - 0.21), (0.42, 0.03, 0.42))
    side = x + back * 0.2 - 0.015
    for b in (-0.2, -0.1, 0.0, 0.1, 0.18):
        m.box((side, 0.47, z + b), (0.03, 0.45, 0.02), 'b')
    m.box((side, 0.92, z - 0.21), (0.03, 0.06, 0.42))
    m.part(f'cushion_{number}', 'cloth')
    m.box((x - 0.19, 0.47, z - 0.19), (0.36, 0.04, 0.38), 'b')


def shelf(m, numbers):
    """A shelf with books along the back wall."""
    m.part('shelf', 'wood')
    left, width, depth = 1.9, 2.2, 0.3
    for k in range(5):
        m.box((left, 0.08 + 0.42 * k, 0.01), (width, 0.03, depth))
    for x in (left - 0.03, left + width):
        m.box((x, 0, 0.01), (0.03, 1.82, depth))
    for k in range(4):
        x = left + 0.02
        while x < left + width - 0.08:
            thick, high = numbers.uniform(0.02, 0.05), numbers.uniform(0.22, 0.36)
            if numbers.random() < 0.85:
                m.part(f'book_{k}_{round(1000 * x)}', f'book_{numbers.randrange(4)}')
                m.box((x, 0.11 + 0.42 * k, 0.02), (thick, high, numbers.uniform(0.16, 0.24)), 'b')
            x += thick + 0.003


def build():
    m, numbers = Model(), random.Random(7)
    shell(m)
    for number, (x, z) in enumerate(LAMPS):
        lamp(m, number, x, z)
    table(m)
    for number, (x, z, back) in enumerate(((1.9, 2.0, -1), (4.1, 2.0, 1))):
        chair(m, number, x, z, back)
    shelf(m, numbers)
    m.part('ball', 'glass')
    m.ball((1.2, 2.3, 0.7), 0.22, 28, 48)
    return m


def main():
    m = build()
    with open(os.path.join(FOLDER, 'room.obj'), 'w') as f:
        f.write(f'# written by generate.py: {m.triangles} triangles\nmtllib room.mtl\n')
        f.writelines(f'v {x:g} {y:g} {z:g}\n' for x, y, z in m.vertices)
        f.writelines(f'vn {x:.5f} {y:.5f} {z:.5f}\n' for x, y, z in m.normals)
        f.writelines(line + '\n' for line in m.lines)
    with open(os.path.join(FOLDER, 'room.mtl'), 'w') as f:
        f.write('# written by generate.py\n')
        f.writelines(f'newmtl {name}\n{statements}\n\n' for name, statements in MATERIALS.items())


if __name__ == '__main__':
    main()
