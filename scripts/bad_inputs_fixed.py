"""Hand-made files for `bad_inputs.py --fixed`: at least one for each rule of reading, each with its outcome.

A case has the rule that it is for, the scene, the files of its folder, "read" or "refused", and words of what the program prints: what
it has read, or why it does not.
"""

import base64
import json
import math
import os
import struct
import zlib
from pathlib import Path

CORNERS = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
OBJ = f"mtllib m.mtl\n{CORNERS}usemtl lamp\nf 1 2 3\n"
MTL = "newmtl lamp\nKe 1 1 1\n"
MODEL = {"a.obj": OBJ, "m.mtl": MTL}
TOML = 'model = "a.obj"\n'
ONE = "1 triangles"


def fifo(path):
    os.mkfifo(path)


def link(to):
    return lambda path: path.symlink_to(to)


def folder(path):
    path.mkdir()


def beside(name, text):
    """A file outside of the scene's folder."""

    def make(path):
        (path.parent.parent / name).write_text(text)

    return make


def sparse(size):
    def make(path):
        with open(path, "wb") as file:
            file.truncate(size)

    return make


def png(width, height):
    """A picture that claims a size and has hardly a byte."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 6, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(b"\0" * 64)) + chunk(b"IEND", b"")


def gltf(change=lambda document: None):
    data = base64.b64encode(struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)).decode()
    document = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}],
        "materials": [{"name": "lamp", "emissiveFactor": [1, 1, 1]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"uri": f"data:application/octet-stream;base64,{data}", "byteLength": 36}],
    }
    change(document)
    return json.dumps(document)


def chain(document, length, circle):
    """Nodes in one line, the last with the mesh; or back to the first."""
    document["nodes"] = [{"children": [i + 1]} for i in range(length)] + [{"children": [0]} if circle else {"mesh": 0}]


def doubled(document):
    """Nodes that are children of two others each: 2^40 ways to the mesh."""
    document["nodes"] = [{"children": [2 * i + 2, 2 * i + 3]} for i in range(41) for _ in range(2)] + [{"mesh": 0}] * 2


def ply(count, row="0 0 0", vertices=3, kind="ascii"):
    rows = f"{row}\n1 0 0\n0 1 0\n3 0 1 2\n"
    return (
        f"ply\nformat {kind} 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {count}\nproperty list uchar int vertex_indices\nend_header\n{rows}"
    )


def xml(inside):
    return f'<scene version="3.0.0">{inside}</scene>'


def polygon(corners):
    """A polygon along a parabola, whose triangles widen from one corner."""
    points = "".join(f"v {i} {i * i / corners} 0\n" for i in range(corners))
    return f"mtllib m.mtl\nusemtl lamp\n{points}f {' '.join(map(str, range(1, corners + 1)))}\n"


RECTANGLE = '<shape type="rectangle"><emitter type="area"><rgb name="radiance" value="1"/></emitter></shape>'
# What the operating system and the paths decide.
PLACES = [
    ("device file", "a.obj", {"a.obj": link("/dev/zero")}, "refused", "device or pipe"),
    ("device file", "a.obj", {**MODEL, "m.mtl": MTL + "map_Kd /dev/zero\n"}, "refused", "device or pipe"),
    ("device file", "a.toml", {"a.toml": 'model = "/dev/urandom.obj"\n'}, "refused", "urandom.obj"),
    ("device file", "a.gltf", {"a.gltf": gltf(lambda d: d["buffers"][0].update(uri="/dev/zero"))}, "refused", "buffer 0"),
    ("pipe", "a.obj", {"a.obj": fifo}, "refused", "device or pipe"),
    ("pipe", "a.obj", {**MODEL, "m.mtl": MTL + "map_Kd a.png\n", "a.png": fifo}, "refused", "device or pipe"),
    ("directory", "a.obj", {"a.obj": folder}, "refused", "directory"),
    ("file of the kernel", "a.obj", {"a.obj": link("/proc/self/status")}, "refused", "a.obj"),
    ("link out of the folder", "a.obj", {**MODEL, "m.mtl": MTL + "map_Kd a.png\n", "x": beside("out.png", ""), "a.png": link("../out.png")}, "refused", "outside of the scene's folder"),
    ("link out of the folder", "a.obj", {**MODEL, "m.mtl": link("../out.mtl"), "x": beside("out.mtl", MTL)}, "refused", "outside of the scene's folder"),
    ("link within the folder", "a.obj", {"b.obj": OBJ, "m.mtl": MTL, "a.obj": link("b.obj")}, "read", ONE),
    ("link to itself", "a.obj", {"a.obj": link("a.obj")}, "refused", "a.obj"),
    ("path out of the folder", "a.obj", {**MODEL, "m.mtl": MTL + "map_Kd ../../../../../../../../etc/passwd\n"}, "refused", "outside of the scene's folder"),
    ("path out of the folder", "a.xml", {"a.xml": xml('<include filename="../out.xml"/>'), "x": beside("out.xml", xml(RECTANGLE))}, "refused", "outside of the scene's folder"),
    ("missing file", "a.obj", {}, "refused", "a.obj"),
    ("empty file", "a.obj", {"a.obj": ""}, "refused", "no triangles"),
    ("name of 300 letters", "a.toml", {"a.toml": f'model = "{"a" * 300}.obj"\n'}, "refused", "aaaa"),
]
SIZES = [
    ("large file", "a.obj", {"a.obj": sparse(8 << 40)}, "refused", "--max-input-memory"),
    ("large file", "a.glb", {"a.glb": sparse(4 << 30)}, "refused", "--max-input-memory"),
    ("claimed size", "a.obj", {**MODEL, "m.mtl": MTL + "map_Kd a.png\n", "a.obj": OBJ, "a.png": png(1 << 30, 1 << 30)}, "refused", "a.png"),
    ("claimed size", "a.obj", {**MODEL, "m.mtl": MTL + "map_Kd a.png\n", "a.png": png(60000, 60000)}, "refused", "a.png"),
    ("claimed size", "a.ply", {"a.ply": ply(1 << 40)}, "refused", "a.ply"),
    ("claimed size", "a.ply", {"a.ply": ply(1, vertices=1 << 62, kind="binary_little_endian")}, "refused", "ends too early"),
    ("claimed size", "a.glb", {"a.glb": b"glTF\x02\0\0\0\xff\xff\xff\xff\xff\xff\xff\xffJSON{}"}, "refused", "a.glb"),
    ("claimed size", "a.gltf", {"a.gltf": gltf(lambda d: d["accessors"][0].update(count=1 << 40))}, "refused", "accessor"),
    ("claimed size", "a.gltf", {"a.gltf": gltf(lambda d: (d["accessors"][0].pop("bufferView"), d["accessors"][0].update(count=3 << 34)))}, "refused", "accessor"),
    ("claimed size", "a.gltf", {"a.gltf": gltf(lambda d: d["bufferViews"][0].update(byteOffset=(1 << 63) - 1))}, "refused", "bufferView 0"),
]
DEPTHS = [
    ("nesting", "a.xml", {"a.xml": xml("<a>" * 100_000 + "</a>" * 100_000)}, "refused", "a.xml"),
    ("nesting", "a.xml", {"a.xml": xml('<bsdf type="twosided">' * 31 + "</bsdf>" * 31 + RECTANGLE)}, "read", "2 triangles"),
    ("nesting", "a.gltf", {"a.gltf": '{"extras": ' * 100_000 + "1" + "}" * 100_000}, "refused", "a.gltf"),
    ("nesting", "a.toml", {"a.toml": TOML + "a = " + "[" * 100_000 + "]" * 100_000, **MODEL}, "refused", "a.toml:2"),
    ("nesting", "a.toml", {"a.toml": TOML + "a = " + "{b = " * 100_000 + "1" + "}" * 100_000, **MODEL}, "refused", "a.toml:2"),
    ("long chain", "a.gltf", {"a.gltf": gltf(lambda d: chain(d, 20_000, False))}, "read", ONE),
    ("circle", "a.gltf", {"a.gltf": gltf(lambda d: chain(d, 3, True))}, "refused", "node"),
    ("many ways", "a.gltf", {"a.gltf": gltf(doubled)}, "refused", "node"),
    ("long chain", "a.xml", {"a.xml": xml("".join(f'<default name="p{i}" value="$p{i - 1}$p{i - 1}"/>' if i else '<default name="p0" value="xx"/>' for i in range(60)))}, "refused", "more than"),
    ("circle", "a.xml", {"a.xml": xml('<include filename="a.xml"/>')}, "refused", "deeper than"),
    ("circle", "a.xml", {"a.xml": xml('<ref id="a"/><bsdf id="a" type="twosided"><ref id="a"/></bsdf><shape type="rectangle"><ref id="a"/></shape>')}, "refused", "deeper than"),
    ("circle", "a.toml", {"a.toml": 'model = "a.toml"\n'}, "refused", "a.toml"),
    ("entities", "a.xml", {"a.xml": '<!DOCTYPE a [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]><scene>&b;</scene>'}, "refused", "a.xml"),
    ("long polygon", "a.obj", {"m.mtl": MTL, "a.obj": polygon(100_000)}, "read", "99998 triangles"),
    ("long line", "a.obj", {**MODEL, "a.obj": OBJ + "#" + "x" * (32 << 20) + "\n"}, "read", ONE),
    ("many lines", "a.obj", {**MODEL, "a.obj": OBJ + "\\\n" * 1_000_000}, "read", ONE),
]
# As editors and other programs write them.
TEXTS = [
    ("mark of the byte order", "a.obj", {"a.obj": "\ufeff" + OBJ, "m.mtl": "\ufeff" + MTL}, "read", '"lamp"'),
    ("mark of the byte order", "a.toml", {**MODEL, "a.toml": "\ufeff" + TOML}, "read", '"lamp"'),
    ("mark of the byte order", "a.xml", {"a.xml": "\ufeff" + xml(RECTANGLE)}, "read", "2 triangles"),
    ("mark of the byte order", "a.toml", {**MODEL, "a.toml": TOML.encode("utf-16")}, "refused", "UTF-8"),
    ("CRLF", "a.obj", {"a.obj": OBJ.replace("\n", "\r\n"), "m.mtl": MTL.replace("\n", "\r\n")}, "read", '"lamp"'),
    ("CRLF", "a.ply", {"a.toml": "", "a.ply": ply(1).replace("\n", "\r\n")}, "read", ONE),
    ("tabs", "a.obj", {"a.obj": OBJ.replace(" ", "\t"), "m.mtl": MTL.replace(" ", "\t")}, "read", '"lamp"'),
    ("comment after a face", "a.obj", {**MODEL, "a.obj": OBJ.replace("f 1 2 3", "f 1 2 3 # the lamp")}, "read", ONE),
    ("Latin-1 name", "a.obj", {name: text.replace("lamp", "Lämp").encode("latin-1") for name, text in MODEL.items()}, "read", '"Lämp"'),
    ("Latin-1 name", "a.toml", {**MODEL, "a.toml": (TOML + "# für\n").encode("latin-1")}, "refused", "UTF-8"),
    ("name with spaces", "a b.obj", {"a b.obj": OBJ.replace("m.mtl", "m n.mtl"), "m n.mtl": MTL}, "read", '"lamp"'),
    ("name in UTF-8", "ä.obj", {"ä.obj": OBJ, "m.mtl": MTL}, "read", '"lamp"'),
    ("last line without an end", "a.obj", {**MODEL, "a.obj": OBJ.rstrip("\n")}, "read", ONE),
    ("backslashes in paths", "a.obj", {"a.obj": OBJ.replace("m.mtl", "..\\{folder}\\m.mtl"), "m.mtl": MTL}, "read", '"lamp"'),
    ("zero byte", "a.obj", {**MODEL, "a.obj": OBJ.replace("lamp", "lamp\0")}, "read", ONE),
]
NUMBERS = [
    ("NaN", "a.obj", {**MODEL, "a.obj": OBJ.replace("v 1 0 0", "v nan 0 0")}, "refused", "a.obj:3"),
    ("infinity", "a.obj", {**MODEL, "a.obj": OBJ.replace("v 1 0 0", "v 1 -inf 0")}, "refused", "a.obj:3"),
    ("NaN", "a.obj", {**MODEL, "m.mtl": "newmtl lamp\nKe 1 nan 1\n"}, "refused", "m.mtl:2"),
    ("NaN", "a.toml", {**MODEL, "a.toml": TOML + "[materials.lamp]\nroughness = nan\n"}, "refused", "roughness"),
    ("NaN", "a.ply", {"a.ply": ply(1, row="nan 0 0")}, "refused", "vertex 0"),
    ("NaN", "a.gltf", {"a.gltf": gltf().replace("[1, 1, 1]", "[1, NaN, 1]")}, "refused", "a.gltf"),
    ("infinity", "a.gltf", {"a.gltf": gltf().replace("[1, 1, 1]", "[1, 1e39, 1]")}, "refused", "emission"),
    ("beyond a range", "a.obj", {**MODEL, "m.mtl": "newmtl lamp\nKe 1 -1 1\n"}, "refused", "m.mtl:2"),
    ("beyond a range", "a.toml", {**MODEL, "a.toml": TOML + "[camera]\neye = [0, 0, 3]\ntarget = [0, 0, 0]\nfov_y = 180\n"}, "refused", "180"),
    ("index beyond the end", "a.obj", {**MODEL, "a.obj": OBJ.replace("f 1 2 3", "f 1 2 4")}, "refused", "a.obj:6"),
    ("index beyond the end", "a.obj", {**MODEL, "a.obj": OBJ.replace("f 1 2 3", "f 1 2 -4")}, "refused", "a.obj:6"),
    ("triangle without area", "a.obj", {**MODEL, "a.obj": OBJ.replace("v 0 1 0", "v 2 0 0")}, "refused", "area"),
    ("far vertex", "a.obj", {**MODEL, "a.obj": OBJ.replace("v 1 0 0", "v 1e12 0 0")}, "refused", "farther"),
]
CASES = PLACES + SIZES + DEPTHS + TEXTS + NUMBERS


def make(case, place):
    """Writes the files of a case into a new folder; returns the scene."""
    _, scene, files, _, _ = case
    place = Path(place)
    place.mkdir(parents=True)
    for name, content in files.items():
        path = place / name
        if callable(content):
            content(path)
        elif isinstance(content, bytes):
            path.write_bytes(content)
        else:
            path.write_bytes(content.replace("{folder}", place.name).encode())
    return str(place / scene)


def check(case, result, printed):
    """The fault of a run; None if there is none."""
    rule, _, _, expected, word = case
    if result != expected:
        return f"{rule}: {result}, not {expected}"
    return None if word in printed else f"{rule}: {result}, without the word {word!r}"
