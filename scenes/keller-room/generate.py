#!/usr/bin/env python3
"""Writes room.obj and room.mtl: a furnished room of exactly 402 quads, as many as figure 10 of Keller 1997 has.

Metres, y up. Faces look out of the furniture and into the room.
"""
import os

SIZE = (6.0, 2.8, 5.0)
QUADS = 402

MATERIALS = {  # name: (Kd, Ke)
    'wall': ((0.75, 0.75, 0.73), None),
    'ceiling': ((0.85, 0.85, 0.85), None),
    'floor': ((0.50, 0.46, 0.42), None),
    'wood': ((0.48, 0.42, 0.36), None),
    'dark_wood': ((0.28, 0.25, 0.22), None),
    'fabric': ((0.40, 0.42, 0.46), None),
    'cushion': ((0.62, 0.60, 0.58), None),
    'rug': ((0.35, 0.33, 0.36), None),
    'book_light': ((0.66, 0.64, 0.60), None),
    'book_dark': ((0.22, 0.24, 0.30), None),
    'picture': ((0.55, 0.57, 0.62), None),
    'light': ((0.0, 0.0, 0.0), (18.0, 18.0, 18.0)),
}


class Model:
    def __init__(self):
        self.vertices, self.lines, self.quads = {}, [], 0

    def part(self, name, material):
        self.lines += [f'o {name}', f'usemtl {material}']

    def quad(self, *corners):
        """Four corners, counter-clockwise seen from the front."""
        indices = [self.vertices.setdefault(tuple(round(x, 4) for x in c), len(self.vertices) + 1) for c in corners]
        self.lines.append('f ' + ' '.join(map(str, indices)))
        self.quads += 1

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

    def legs(self, low, size, height, thickness):
        """Four legs at the corners of a rectangle on the floor; their ends are hidden."""
        (x, z), (w, d), t = low, size, thickness
        for px in (x, x + w - t):
            for pz in (z, z + d - t):
                self.box((px, 0, pz), (t, height, t), 'bt')


def shell(m):
    w, h, d = SIZE
    m.part('floor', 'floor')
    m.quad((0, 0, 0), (0, 0, d), (w, 0, d), (w, 0, 0))
    m.part('ceiling', 'ceiling')
    m.quad((0, h, 0), (w, h, 0), (w, h, d), (0, h, d))
    m.part('walls', 'wall')
    m.quad((0, 0, 0), (w, 0, 0), (w, h, 0), (0, h, 0))
    m.quad((w, 0, d), (0, 0, d), (0, h, d), (w, h, d))
    m.quad((0, 0, d), (0, 0, 0), (0, h, 0), (0, h, d))
    m.quad((w, 0, 0), (w, 0, d), (w, h, d), (w, h, 0))
    m.part('light', 'light')
    y = h - 0.02
    m.quad((2.4, y, 1.9), (3.6, y, 1.9), (3.6, y, 2.7), (2.4, y, 2.7))


def table(m, name, low, size, height):
    m.part(name, 'wood')
    m.box((low[0], height - 0.04, low[1]), (size[0], 0.04, size[1]))
    m.legs((low[0] + 0.05, low[1] + 0.05), (size[0] - 0.1, size[1] - 0.1), height - 0.04, 0.06)


def chair(m, name, x, z, back):
    """A chair of 0.42 m whose back rest is at its `near` or `far` side along z, or `left` or `right` along x."""
    m.part(name, 'dark_wood')
    m.box((x, 0.43, z), (0.42, 0.04, 0.42))
    rest = {
        'near': ((x, z), (0.42, 0.04)),
        'far': ((x, z + 0.38), (0.42, 0.04)),
        'left': ((x, z), (0.04, 0.42)),
        'right': ((x + 0.38, z), (0.04, 0.42)),
    }[back]
    m.box((rest[0][0], 0.55, rest[0][1]), (rest[1][0], 0.37, rest[1][1]))
    m.legs((x, z), (0.42, 0.42), 0.43, 0.035)


def shelf(m, name, x, z):
    """Shelves 0.9 m wide against the wall z = 0: two sides, a back and four boards."""
    m.part(name, 'wood')
    m.box((x, 0, z), (0.03, 1.9, 0.3))
    m.box((x + 0.87, 0, z), (0.03, 1.9, 0.3))
    m.box((x + 0.03, 0.05, z), (0.84, 1.85, 0.02))
    for y in (0.08, 0.62, 1.16, 1.70):
        m.box((x + 0.03, y, z + 0.02), (0.84, 0.03, 0.28))


def books(m):
    places = [(4.12, 0.65, 0.30), (4.20, 0.65, 0.27), (4.27, 0.65, 0.33), (4.40, 1.19, 0.28), (5.25, 0.65, 0.31),
              (5.34, 0.65, 0.26), (5.05, 1.19, 0.34)]
    for i, (x, y, height) in enumerate(places):
        m.part(f'book_{i}', 'book_dark' if i % 2 else 'book_light')
        m.box((x, y, 0.06), (0.06, height, 0.22), 'b')


def sofa(m):
    m.part('sofa', 'fabric')
    m.box((0.05, 0.10, 1.30), (0.85, 0.28, 1.90))
    m.box((0.05, 0.38, 1.30), (0.22, 0.45, 1.90))
    m.box((0.05, 0.10, 1.10), (0.85, 0.52, 0.20))
    m.box((0.05, 0.10, 3.20), (0.85, 0.52, 0.20))
    m.part('cushions', 'cushion')
    m.box((0.28, 0.38, 1.32), (0.60, 0.13, 0.92))
    m.box((0.28, 0.38, 2.26), (0.60, 0.13, 0.92))


def sideboard(m):
    m.part('sideboard', 'dark_wood')
    m.box((1.2, 0, 0.01), (2.0, 0.75, 0.45), 'b')
    m.part('doors', 'wood')
    for i in range(4):
        m.box((1.23 + 0.49 * i, 0.06, 0.46), (0.46, 0.63, 0.02), 'n')


def build():
    m = Model()
    shell(m)
    table(m, 'table', (3.3, 1.75), (1.8, 1.0), 0.74)
    for i, (x, z, back) in enumerate([(3.5, 1.45, 'near'), (4.4, 1.42, 'near'), (3.55, 2.68, 'far'), (4.45, 2.72, 'far'),
                                      (2.85, 2.05, 'left'), (5.15, 2.10, 'right')]):
        chair(m, f'chair_{i}', x, z, back)
    shelf(m, 'shelf_0', 4.05, 0.01)
    shelf(m, 'shelf_1', 4.98, 0.01)
    books(m)
    sofa(m)
    table(m, 'coffee_table', (1.35, 1.75), (0.6, 1.1), 0.42)
    sideboard(m)
    m.part('rug', 'rug')
    m.quad((0.95, 0.005, 1.3), (0.95, 0.005, 3.2), (2.4, 0.005, 3.2), (2.4, 0.005, 1.3))
    m.part('pictures', 'picture')
    m.quad((1.5, 1.3, 0.01), (2.9, 1.3, 0.01), (2.9, 2.1, 0.01), (1.5, 2.1, 0.01))
    m.quad((0.01, 1.3, 2.8), (0.01, 1.3, 1.7), (0.01, 2.1, 1.7), (0.01, 2.1, 2.8))
    assert m.quads == QUADS, f'{m.quads} quads instead of {QUADS}'
    return m


def main():
    folder = os.path.dirname(os.path.abspath(__file__))
    m = build()
    with open(os.path.join(folder, 'room.obj'), 'w') as f:
        f.write(f'# written by generate.py: {m.quads} quads\nmtllib room.mtl\n')
        f.writelines(f'v {x:g} {y:g} {z:g}\n' for x, y, z in m.vertices)
        f.writelines(line + '\n' for line in m.lines)
    with open(os.path.join(folder, 'room.mtl'), 'w') as f:
        f.write('# written by generate.py\n')
        for name, (kd, ke) in MATERIALS.items():
            f.write(f'newmtl {name}\nKd {kd[0]:g} {kd[1]:g} {kd[2]:g}\n')
            if ke:
                f.write(f'Ke {ke[0]:g} {ke[1]:g} {ke[2]:g}\n')
            f.write('illum 1\n\n')


if __name__ == '__main__':
    main()
