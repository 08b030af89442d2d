#!/usr/bin/env python3
"""Writes room.obj and room.mtl: posts at growing distances behind a pane, before a chequered wall.

Metres, y up; the pane is the plane z = 0, the eye looks along -z.
"""
import os

FOLDER = os.path.dirname(os.path.abspath(__file__))
WIDTH, HEIGHT, NEAR, FAR = 1.6, 1.5, 2.0, -1.6
SQUARE = 0.2

MATERIALS = {  # name: statements
    'wall': 'Kd 0.7 0.68 0.64\nillum 1',
    'floor': 'Kd 0.45 0.38 0.3\nillum 1',
    'cream': 'Kd 0.8 0.77 0.68\nillum 1',
    'dark': 'Kd 0.12 0.14 0.2\nillum 1',
    'red': 'Kd 0.6 0.08 0.05\nillum 1',
    'yellow': 'Kd 0.7 0.5 0.06\nillum 1',
    'green': 'Kd 0.1 0.4 0.15\nillum 1',
    'blue': 'Kd 0.07 0.15 0.5\nillum 1',
    'pane': 'Tf 0.97 1 0.98\nNi 1.5\nillum 4',
    'light': 'Kd 0 0 0\nKe 9 8.6 8\nillum 1',
}

vertices, faces = [], []


def quad(material, corner, u, v):
    """The face looks along u x v."""
    at = [tuple(c + i * a + j * b for c, a, b in zip(corner, u, v)) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
    faces.append((material, [len(vertices) + k for k in (1, 2, 3, 4)]))
    vertices.extend(at)


def post(material, low, high):
    (x, y, z), (w, h, d) = low, tuple(b - a for a, b in zip(low, high))
    quad(material, (x, y, z + d), (w, 0, 0), (0, h, 0))
    quad(material, (x + w, y, z), (-w, 0, 0), (0, h, 0))
    quad(material, (x, y, z), (0, 0, d), (0, h, 0))
    quad(material, (x + w, y, z + d), (0, 0, -d), (0, h, 0))
    quad(material, (x, y + h, z + d), (w, 0, 0), (0, 0, -d))


def main():
    depth = NEAR - FAR
    quad('floor', (-WIDTH, 0, NEAR), (2 * WIDTH, 0, 0), (0, 0, -depth))
    quad('wall', (-WIDTH, HEIGHT, FAR), (2 * WIDTH, 0, 0), (0, 0, depth))
    quad('wall', (-WIDTH, 0, NEAR), (0, 0, -depth), (0, HEIGHT, 0))
    quad('wall', (WIDTH, 0, FAR), (0, 0, depth), (0, HEIGHT, 0))
    quad('wall', (WIDTH, 0, NEAR), (-2 * WIDTH, 0, 0), (0, HEIGHT, 0))
    columns, rows = round(2 * WIDTH / SQUARE), round(HEIGHT / SQUARE)
    for i in range(columns):
        for j in range(rows + 1):
            height = min(SQUARE, HEIGHT - j * SQUARE)
            if height > 1e-6:
                name = 'cream' if (i + j) % 2 else 'dark'
                quad(name, (i * SQUARE - WIDTH, j * SQUARE, FAR), (SQUARE, 0, 0), (0, height, 0))
    for name, x, behind in (('red', -0.62, 0.005), ('yellow', -0.25, 0.15), ('green', 0.12, 0.4), ('blue', 0.5, 0.8)):
        post(name, (x - 0.06, 0, -behind - 0.12), (x + 0.06, 0.75, -behind))
    quad('pane', (-0.85, 0.0, 0.0), (1.7, 0, 0), (0, 0.6, 0))
    for z in (0.7, -0.8):
        quad('light', (-0.6, HEIGHT - 0.01, z - 0.25), (1.2, 0, 0), (0, 0, 0.5))
    with open(os.path.join(FOLDER, 'room.mtl'), 'w', encoding='ascii') as f:
        f.write('# written by generate.py\n' + '\n'.join(f'newmtl {n}\n{s}\n' for n, s in MATERIALS.items()))
    with open(os.path.join(FOLDER, 'room.obj'), 'w', encoding='ascii') as f:
        f.write('# written by generate.py\nmtllib room.mtl\n')
        f.writelines('v %g %g %g\n' % v for v in vertices)
        last = None
        for name, corners in faces:
            if name != last:
                f.write(f'usemtl {name}\n')
            last = name
            f.write('f %d %d %d %d\n' % tuple(corners))


if __name__ == '__main__':
    main()
