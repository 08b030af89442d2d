#!/usr/bin/env python3
"""Writes room.obj and room.mtl: a room of exactly 800 triangles with a glass ball on a table and a mirror on the wall.

Metres, y up. Faces look out of the furniture and into the room; the ball alone has smooth normals.
"""
import math
import os

SIZE = (4.0, 2.6, 4.0)
TRIANGLES = 800

MATERIALS = {  # name: statements
    'wall': 'Kd 0.75 0.74 0.7\nillum 1',
    'red_wall': 'Kd 0.6 0.14 0.1\nillum 1',
    'blue_wall': 'Kd 0.12 0.2 0.5\nillum 1',
    'floor': 'Kd 0.45 0.4 0.35\nillum 1',
    'rug': 'Kd 0.3 0.12 0.12\nillum 1',
    'wood': 'Kd 0.5 0.36 0.22\nillum 1',
    'book_light': 'Kd 0.7 0.66 0.5\nillum 1',
    'book_dark': 'Kd 0.15 0.3 0.2\nillum 1',
    'light': 'Kd 0 0 0\nKe 16 15 13\nillum 1',
    'mirror': 'Kd 0 0 0\nKs 0.9 0.9 0.9\nillum 3',
    'glass': 'Tf 0.97 1 0.98\nNi 1.5\nillum 7',
}


class Model:
    def __init__(self):
        self.vertices, self.normals, self.lines, self.triangles = {}, [], [], 0

    def part(self, name, material):
        self.lines += [f'o {name}', f'usemtl {material}']

    def vertex(self, point):
        return self.vertices.setdefault(tuple(round(x, 4) for x in point), len(self.vertices) + 1)

    def quad(self, *corners):
        """Four corners, counter-clockwise seen from the front."""
        self.lines.append('f ' + ' '.join(str(self.vertex(c)) for c in corners))
        self.triangles += 2

    def box(self, low, size, without=''):
        """A box; `without` names faces that nobody sees: l(eft) r(ight) b(ottom) t(op) n(ear, z low) f(ar)."""
        (x, y, z), (a, b, c) = low, (low[i] + size[i] for i in range(3))
        faces = {
            'l': ((x, y, z), (x, y, c), (x, b, c), (x, b, z)),
            'r': ((a, y, c), (a, y, z), (a, b, z), (a, b, c)),
            'b': ((x, y, z), (a, y, z), (a, y, c), (x, y, c)),
            't': ((x, b, c), (a, b, c), (a, b, z), (x, b, z)),
            'n': ((a, y, z), (x, y, z), (x, b, z), (a, b, z)),
            'f': ((x, y, c), (a, y, c), (a, b, c), (x, b, c)),
        }
        for key, corners in faces.items():
            if key not in without:
                self.quad(*corners)

    def ball(self, center, radius, rings, segments):
        """A sphere of 2 segments (rings - 1) triangles."""
        first = len(self.normals) + 1
        points = []
        for i in range(rings + 1):
            theta = math.pi * i / rings
            for j in range(segments):
                phi = 2.0 * math.pi * j / segments
                n = (math.sin(theta) * math.cos(phi), math.cos(theta), math.sin(theta) * math.sin(phi))
                self.normals.append(n)
                points.append(self.vertex([center[k] + radius * n[k] for k in range(3)]))

        def corner(i, j):
            k = i * segments + j % segments
            return f'{points[k]}//{first + k}'

        for i in range(rings):
            for j in range(segments):
                if i > 0:
                    self.lines.append(f'f {corner(i, j)} {corner(i, j + 1)} {corner(i + 1, j)}')
                    self.triangles += 1
                if i + 1 < rings:
                    self.lines.append(f'f {corner(i, j + 1)} {corner(i + 1, j + 1)} {corner(i + 1, j)}')
                    self.triangles += 1


def shell(m):
    w, h, d = SIZE
    m.part('floor', 'floor')
    m.quad((0, 0, 0), (0, 0, d), (w, 0, d), (w, 0, 0))
    m.part('walls', 'wall')
    m.quad((0, h, 0), (w, h, 0), (w, h, d), (0, h, d))
    m.quad((0, 0, 0), (w, 0, 0), (w, h, 0), (0, h, 0))
    m.quad((w, 0, d), (0, 0, d), (0, h, d), (w, h, d))
    m.part('red_wall', 'red_wall')
    m.quad((0, 0, d), (0, 0, 0), (0, h, 0), (0, h, d))
    m.part('blue_wall', 'blue_wall')
    m.quad((w, 0, 0), (w, 0, d), (w, h, d), (w, h, 0))
    m.part('light', 'light')
    y = h - 0.02
    m.quad((1.6, y, 1.2), (2.4, y, 1.2), (2.4, y, 2.0), (1.6, y, 2.0))


def table(m):
    m.part('table', 'wood')
    m.box((1.2, 0.72, 1.1), (1.6, 0.04, 1.0))
    for x in (1.25, 2.67):
        for z in (1.15, 1.97):
            m.box((x, 0, z), (0.08, 0.72, 0.08), 'bt')
    m.part('book_0', 'book_dark')
    m.box((2.25, 0.76, 1.35), (0.3, 0.05, 0.4), 'b')
    m.part('book_1', 'book_light')
    m.box((2.28, 0.81, 1.4), (0.24, 0.04, 0.32), 'b')


def around(m):
    m.part('rug', 'rug')
    m.quad((0.9, 0.005, 0.8), (0.9, 0.005, 2.4), (3.1, 0.005, 2.4), (3.1, 0.005, 0.8))
    m.part('crate', 'wood')
    m.box((3.2, 0, 0.3), (0.6, 0.5, 0.5), 'b')
    m.part('pictures', 'book_light')
    m.quad((0.01, 1.2, 1.8), (0.01, 1.2, 1.0), (0.01, 1.8, 1.0), (0.01, 1.8, 1.8))
    m.quad((3.99, 1.2, 1.0), (3.99, 1.2, 1.8), (3.99, 1.8, 1.8), (3.99, 1.8, 1.0))


def mirror(m):
    m.part('mirror', 'mirror')
    m.quad((1.0, 1.1, 0.01), (3.0, 1.1, 0.01), (3.0, 2.0, 0.01), (1.0, 2.0, 0.01))
    m.part('frame', 'wood')
    m.box((0.94, 1.04, 0), (2.12, 0.06, 0.04), 'n')
    m.box((0.94, 2.0, 0), (2.12, 0.06, 0.04), 'n')
    m.box((0.94, 1.1, 0), (0.06, 0.9, 0.04), 'ntb')
    m.box((3.0, 1.1, 0), (0.06, 0.9, 0.04), 'ntb')


def build():
    m = Model()
    shell(m)
    table(m)
    around(m)
    mirror(m)
    m.part('ball', 'glass')
    # Clear of the table by less than one sees.
    m.ball((1.75, 0.76 + 0.251, 1.65), 0.25, 15, 24)
    assert m.triangles == TRIANGLES, f'{m.triangles} triangles instead of {TRIANGLES}'
    return m


def main():
    folder = os.path.dirname(os.path.abspath(__file__))
    m = build()
    with open(os.path.join(folder, 'room.obj'), 'w') as f:
        f.write(f'# written by generate.py: {m.triangles} triangles\nmtllib room.mtl\n')
        f.writelines(f'v {x:g} {y:g} {z:g}\n' for x, y, z in m.vertices)
        f.writelines(f'vn {x:.5f} {y:.5f} {z:.5f}\n' for x, y, z in m.normals)
        f.writelines(line + '\n' for line in m.lines)
    with open(os.path.join(folder, 'room.mtl'), 'w') as f:
        f.write('# written by generate.py\n')
        f.writelines(f'newmtl {name}\n{statements}\n\n' for name, statements in MATERIALS.items())


if __name__ == '__main__':
    main()
