#!/usr/bin/env python3
"""Writes room.obj and room.mtl: matt balls and columns, and sheets that lie a little above what they cover.

Metres, y up. Faces look out of the things and into the room; balls and columns have smooth normals.
"""
import math
import os

SIZE = (4.0, 2.6, 4.0)

MATERIALS = {  # name: statements
    'wall': 'Kd 0.75 0.74 0.7\nillum 1',
    'red_wall': 'Kd 0.6 0.14 0.1\nillum 1',
    'blue_wall': 'Kd 0.12 0.2 0.5\nillum 1',
    'sheet': 'Kd 0.7 0.66 0.5\nillum 1',
    'ball': 'Kd 0.6 0.6 0.6\nillum 1',
    'light': 'Kd 0 0 0\nKe 16 15 13\nillum 1',
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

    def column(self, base, radius, height, segments):
        """The side of an upright cylinder."""
        first = len(self.normals) + 1
        around = [2.0 * math.pi * j / segments for j in range(segments)]
        self.normals += [(math.cos(phi), 0.0, math.sin(phi)) for phi in around]
        x, y, z = base
        low = [self.vertex((x + radius * math.cos(phi), y, z + radius * math.sin(phi))) for phi in around]
        high = [self.vertex((x + radius * math.cos(phi), y + height, z + radius * math.sin(phi))) for phi in around]
        for j in range(segments):
            a, b = j, (j + 1) % segments
            corner = lambda row, k: f'{row[k]}//{first + k}'
            self.lines.append(f'f {corner(low, b)} {corner(low, a)} {corner(high, a)} {corner(high, b)}')
            self.triangles += 2


def shell(m):
    w, h, d = SIZE
    m.part('walls', 'wall')
    m.quad((0, 0, 0), (0, 0, d), (w, 0, d), (w, 0, 0))
    m.quad((0, h, 0), (w, h, 0), (w, h, d), (0, h, d))
    m.quad((0, 0, 0), (w, 0, 0), (w, h, 0), (0, h, 0))
    m.quad((w, 0, d), (0, 0, d), (0, h, d), (w, h, d))
    m.part('red_wall', 'red_wall')
    m.quad((0, 0, d), (0, 0, 0), (0, h, 0), (0, h, d))
    m.part('blue_wall', 'blue_wall')
    m.quad((w, 0, 0), (w, 0, d), (w, h, d), (w, h, 0))
    m.part('light', 'light')
    y = h - 0.02
    m.quad((0.6, y, 0.6), (1.2, y, 0.6), (1.2, y, 1.2), (0.6, y, 1.2))


def things(m):
    m.part('sheets', 'sheet')
    for i, height in enumerate((0.01, 0.03, 0.06)):
        x = 0.3 + 1.15 * i
        m.quad((x, height, 1.9), (x, height, 2.7), (x + 1.0, height, 2.7), (x + 1.0, height, 1.9))
    for i, away in enumerate((0.02, 0.05, 0.1)):
        x = 0.3 + 1.15 * i
        m.quad((x, 1.2, away), (x + 1.0, 1.2, away), (x + 1.0, 1.9, away), (x, 1.9, away))
    m.part('balls', 'ball')
    m.ball((1.0, 0.35, 1.2), 0.35, 20, 32)
    m.ball((1.9, 0.2, 1.5), 0.2, 16, 24)
    for i in range(6):
        m.ball((1.6 + 0.28 * i, 0.07, 1.75), 0.07, 10, 16)
    m.part('columns', 'ball')
    m.column((2.5, 0, 0.9), 0.18, 2.6, 24)
    m.column((3.2, 0, 1.2), 0.04, 2.6, 12)


def build():
    m = Model()
    shell(m)
    things(m)
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
