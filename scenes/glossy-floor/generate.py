#!/usr/bin/env python3
"""Writes room.obj and room.mtl: a teapot on a glossy floor before a wall of coloured squares, 4,068 triangles.

Metres, y up. Turned and swept things have smooth normals. Needs ../indirect-room/generate.py.
"""
import importlib.util
import math
import os

FOLDER = os.path.dirname(os.path.abspath(__file__))
SPEC = importlib.util.spec_from_file_location('indirect_room', os.path.join(FOLDER, '..', 'indirect-room', 'generate.py'))
INDIRECT_ROOM = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(INDIRECT_ROOM)

SIZE = (3.0, 2.4, 3.6)
SQUARE = 0.2
TEAPOT = (1.48, 0.0, 0.95)

# A profile has an edge where it turns by more than this.
CREASE = math.radians(50.0)

MATERIALS = {  # name: statements
    'wall': 'Kd 0.75 0.73 0.68\nillum 1',
    'ceiling': 'Kd 0.85 0.85 0.83\nillum 1',
    'floor': 'Kd 0.1 0.09 0.08\nKs 0.5 0.5 0.5\nPr 0.2\nillum 2',
    'cream': 'Kd 0.78 0.75 0.66\nillum 1',
    'red': 'Kd 0.55 0.08 0.06\nillum 1',
    'blue': 'Kd 0.06 0.14 0.45\nillum 1',
    'yellow': 'Kd 0.65 0.45 0.06\nillum 1',
    'teapot': 'Kd 0.25 0.55 0.5\nillum 1',
    'light': 'Kd 0 0 0\nKe 15 14.2 12.8\nillum 1',
}


def add(a, b):
    return tuple(x + y for x, y in zip(a, b))


def scaled(a, factor):
    return tuple(x * factor for x in a)


def difference(a, b):
    return tuple(x - y for x, y in zip(a, b))


def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def unit(a):
    length = math.sqrt(sum(x * x for x in a))
    return scaled(a, 1.0 / length) if length > 1e-12 else (0.0, 0.0, 0.0)


def spline(points, steps):
    """Catmull and Rom's curve through points of any dimension, `steps` pieces between two of them."""
    curve = []
    for i in range(len(points) - 1):
        p0, p1, p2, p3 = points[max(i - 1, 0)], points[i], points[i + 1], points[min(i + 2, len(points) - 1)]
        for s in range(steps):
            t = s / steps
            curve.append(tuple(
                0.5 * (2.0 * b + (c - a) * t + (2.0 * a - 5.0 * b + 4.0 * c - d) * t * t
                       + (3.0 * b - a - 3.0 * c + d) * t ** 3)
                for a, b, c, d in zip(p0, p1, p2, p3)))
    return curve + [tuple(points[-1])]


def rings(path, radii, side, segments):
    """Circles around the points of a path in the plane across the unit vector `side`; see `Model.surface`."""
    rows = []
    for i, (center, radius) in enumerate(zip(path, radii)):
        tangent = unit(difference(path[min(i + 1, len(path) - 1)], path[max(i - 1, 0)]))
        other = cross(side, tangent)
        angles = (2.0 * math.pi * j / segments for j in range(segments))
        rows.append([add(center, add(scaled(other, radius * math.cos(a)), scaled(side, -radius * math.sin(a))))
                     for a in angles])
    return rows


class Model(INDIRECT_ROOM.Model):
    def surface(self, rows):
        """A smooth surface through closed rows of points; a row of equal points is a pole.

        Seen from the front with the rows rising, the points of a row run to the left.
        """
        normals, count = [], len(rows[0])
        for i, row in enumerate(rows):
            below, above = rows[max(i - 1, 0)], rows[min(i + 1, len(rows) - 1)]
            normals.append([unit(cross(difference(above[j], below[j]),
                                       difference(row[(j + 1) % count], row[j - 1]))) for j in range(count)])
        for i, beside in ((0, 1), (-1, -2)):
            if rows[i][0] == rows[i][1]:
                total = (0.0, 0.0, 0.0)
                for n in normals[beside]:
                    total = add(total, n)
                normals[i] = [unit(total)] * count
        corners = []
        for row, row_normals in zip(rows, normals):
            pole = row[0] == row[1]
            first = len(self.normals) + 1
            self.normals += row_normals[:1] if pole else row_normals
            corners.append([f'{self.vertex(p)}//{first + (0 if pole else j)}' for j, p in enumerate(row)])
        for low, high in zip(corners, corners[1:]):
            for j in range(count):
                k = (j + 1) % count
                face = []
                for corner in (low[j], high[j], high[k], low[k]):
                    if corner not in face:
                        face.append(corner)
                self.lines.append('f ' + ' '.join(face))
                self.triangles += len(face) - 2

    def turned(self, center, profile, segments):
        """A smooth surface of revolution of (radius, height) points, with an edge where the profile turns sharply."""
        def row(radius, height):
            angles = (2.0 * math.pi * j / segments for j in range(segments))
            return [add(center, (radius * math.cos(a), height, radius * math.sin(a))) for a in angles]

        start = 0
        for i in range(1, len(profile)):
            last = i + 1 == len(profile)
            if not last:
                before, after = (math.atan2(profile[k + 1][1] - profile[k][1], profile[k + 1][0] - profile[k][0])
                                 for k in (i - 1, i))
                turn = abs((after - before + math.pi) % (2.0 * math.pi) - math.pi)
            if last or turn > CREASE:
                self.surface([row(*point) for point in profile[start:i + 1]])
                start = i


def teapot(m, center):
    """A teapot 0.28 m high, its spout along x."""
    x, y, z = center
    # The foot is clear of what it stands on by less than one sees.
    foot = [(0.0, 0.004), (0.07, 0.004), (0.072, 0.0005), (0.082, 0.0005), (0.084, 0.008)]
    belly = spline([(0.08, 0.012), (0.118, 0.045), (0.14, 0.09), (0.134, 0.13), (0.112, 0.168), (0.096, 0.186)], 3)
    rim = [(0.101, 0.19), (0.101, 0.196), (0.096, 0.198), (0.086, 0.198)]
    m.turned(center, foot + belly + rim, 36)
    lid = spline([(0.091, 0.197), (0.076, 0.213), (0.05, 0.224), (0.022, 0.231), (0.012, 0.239), (0.018, 0.25),
                  (0.025, 0.261), (0.019, 0.273), (0.0, 0.277)], 2)
    m.turned(center, lid, 36)
    side = (0.0, 0.0, 1.0)
    outer = spline([(0.1, 0.055, 0.036), (0.155, 0.075, 0.03), (0.183, 0.118, 0.022), (0.2, 0.163, 0.017),
                    (0.228, 0.195, 0.015)], 3)
    inner = [(a, b, r - 0.004) for a, b, r in outer[-4:]]
    outside, inside = (rings([(x + a, y + b, z) for a, b, _ in curve], [r for _, _, r in curve], side, 16)
                       for curve in (outer, inner))
    m.surface(outside)
    m.surface([outside[-1], inside[-1]])
    end = (x + inner[0][0], y + inner[0][1], z)
    m.surface(inside[::-1] + [[end] * 16])
    handle = spline([(-0.1, 0.165), (-0.155, 0.182), (-0.205, 0.172), (-0.217, 0.13), (-0.185, 0.08), (-0.115, 0.055)], 3)
    m.surface(rings([(x + a, y + b, z) for a, b in handle], [0.011] * len(handle), side, 12))


def shell(m):
    w, h, d = SIZE
    m.part('floor', 'floor')
    m.quad((0, 0, 0), (0, 0, d), (w, 0, d), (w, 0, 0))
    m.part('ceiling', 'ceiling')
    m.quad((0, h, 0), (w, h, 0), (w, h, d), (0, h, d))
    m.part('walls', 'wall')
    m.quad((w, 0, d), (0, 0, d), (0, h, d), (w, h, d))
    m.quad((w, 0, 0), (w, 0, d), (w, h, d), (w, h, 0))
    m.quad((0, 0, d), (0, 0, 0), (0, h, 0), (0, h, d))
    m.part('light', 'light')
    y = h - 0.02
    m.quad((1.0, y, 1.5), (2.0, y, 1.5), (2.0, y, 2.2), (1.0, y, 2.2))


def squares(m):
    """The far wall."""
    across, up = round(SIZE[0] / SQUARE), round(SIZE[1] / SQUARE)
    colours = [[] for _ in range(4)]
    for i in range(across):
        for j in range(up):
            colours[0 if (i + j) % 2 == 0 else 1 + (i + 2 * j) % 3].append((i, j))
    for name, places in zip(('cream', 'red', 'blue', 'yellow'), colours):
        m.part(f'{name}_squares', name)
        for i, j in places:
            (x, y), (a, b) = (SQUARE * i, SQUARE * j), (SQUARE * (i + 1), SQUARE * (j + 1))
            m.quad((x, y, 0), (a, y, 0), (a, b, 0), (x, b, 0))


def build():
    m = Model()
    shell(m)
    squares(m)
    m.part('teapot', 'teapot')
    teapot(m, TEAPOT)
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
