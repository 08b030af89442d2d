#!/usr/bin/env python3
"""Writes outdoors.obj, outdoors.mtl and sky.hdr: blocks, balls and a fence on a plaza under a sky with a low sun.

    python3 generate.py
"""
import math
import pathlib

HERE = pathlib.Path(__file__).parent
MATERIALS = {
    "ground": "Kd 0.45 0.42 0.38",
    "red": "Kd 0.6 0.16 0.1",
    "white": "Kd 0.75 0.75 0.75",
    "metal": "Kd 0 0 0\nPm 1\nPr 0.35\nKs 0.9 0.7 0.45",
    "mirror": "Kd 0 0 0\nKs 0.9 0.9 0.9\nillum 3",
    "glass": "Kd 1 1 1\nNi 1.5\nillum 7",
}


class Model:
    def __init__(self):
        self.lines = ["mtllib outdoors.mtl"]
        self.vertices, self.normals = 0, 0

    def mesh(self, name, material, vertices, faces, normals=()):
        self.lines += [f"o {name}", f"usemtl {material}"]
        self.lines += ["v %.6g %.6g %.6g" % v for v in vertices]
        self.lines += ["vn %.5g %.5g %.5g" % n for n in normals]
        corner = (lambda i: f"{self.vertices + i + 1}//{self.normals + i + 1}") if normals else lambda i: str(self.vertices + i + 1)
        self.lines += ["f " + " ".join(corner(i) for i in face) for face in faces]
        self.vertices += len(vertices)
        self.normals += len(normals)

    def block(self, name, material, low, high):
        corners = [tuple((low, high)[k >> axis & 1][axis] for axis in range(3)) for k in range(8)]
        faces = [(4, 5, 7, 6), (1, 0, 2, 3), (0, 4, 6, 2), (5, 1, 3, 7), (6, 7, 3, 2), (0, 1, 5, 4)]
        self.mesh(name, material, corners, faces)

    def ball(self, name, material, centre, radius, rings=24):
        vertices, normals, faces, around = [], [], [], 2 * rings
        for i in range(rings + 1):
            polar = math.pi * i / rings
            for j in range(around):
                azimuth = 2 * math.pi * j / around
                unit = (math.sin(polar) * math.sin(azimuth), math.cos(polar), math.sin(polar) * math.cos(azimuth))
                normals.append(unit)
                vertices.append(tuple(c + radius * u for c, u in zip(centre, unit)))
        for i in range(rings):
            for j in range(around):
                a, b = i * around + j, i * around + (j + 1) % around
                c, d = a + around, b + around
                faces.append((a, c, d) if i == 0 else (a, c, d, b) if i < rings - 1 else (a, c, b))
        self.mesh(name, material, vertices, faces, normals)


def radiance(x, y, width, height):
    up = math.cos(math.pi * (y + 0.5) / height)
    if up < 0:
        return (0.2, 0.18, 0.15)
    if y == 12 and x in (52, 53):
        return (900.0, 780.0, 600.0)
    haze = (1 - up) ** 3
    return tuple(blue + haze * (warm - blue) for blue, warm in zip((0.25, 0.45, 0.9), (0.95, 0.85, 0.75)))


def rgbe(colour):
    mantissa, exponent = math.frexp(max(colour))
    scale = mantissa * 256 / max(colour)
    return bytes(int(c * scale) for c in colour) + bytes([exponent + 128])


def main():
    model = Model()
    model.mesh("plaza", "ground", [(-9, 0, 9), (9, 0, 9), (9, 0, -9), (-9, 0, -9)], [(0, 1, 2, 3)])
    model.block("tower", "white", (0.3, 0, -2.6), (1.7, 2.6, -1.5))
    model.block("house", "red", (-2.4, 0, -2), (-0.9, 1.5, -0.7))
    for i in range(7):
        model.block(f"post {i}", "white", (-2.9 + 0.32 * i, 0, 0.9), (-2.8 + 0.32 * i, 0.6, 1))
    for i, material in enumerate(("metal", "mirror", "glass")):
        model.ball(material, material, (0.1 + 1.15 * i, 0.5, 0.1), 0.5)
    (HERE / "outdoors.obj").write_text("\n".join(model.lines) + "\n")
    text = "\n\n".join(f"newmtl {name}\n{lines}" for name, lines in MATERIALS.items())
    (HERE / "outdoors.mtl").write_text(text + "\n")
    width, height = 64, 32
    texels = b"".join(rgbe(radiance(x, y, width, height)) for y in range(height) for x in range(width))
    header = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n"
    (HERE / "sky.hdr").write_bytes(header.encode() + texels)


if __name__ == "__main__":
    main()
