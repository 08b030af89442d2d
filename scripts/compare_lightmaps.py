#!/usr/bin/env python3
"""Light maps that another program baked, beside ours on the same texture coordinates: a picture, and ratios map by map.

    python3 -m venv venv && venv/bin/pip install numpy pillow zstandard OpenEXR
    venv/bin/python scripts/compare_lightmaps.py CornellBox.glb cornell.box=CornellBox-Box.zstd.ktx2 \
        large.box=CornellBox-Large.zstd.ktx2 small.box=CornellBox-Small.zstd.ktx2 -o maps.png

The model is a glTF file with TEXCOORD_1; each OBJECT=FILE names one of its objects and the object's map, a KTX 2.0 file of B10G11R11 floats,
plain or in Zstandard. Maps are compared as radiance of a white surface, irradiance / pi. Told for each map and channel, over texels that
both have, away from borders of charts:

- the ratio of means, ours to theirs, for their values as they are, and decoded as sRGB (extended above 1);
- the median of the ratios of texels, for both;
- the slope of log(theirs) against log(ours), for both: 1 if one is a multiple of the other, below 1 if theirs are compressed by a curve.

The picture has a column for each map and the rows of --rows: theirs (decoded if --decode srgb), ours, and the ratio of ours to theirs, white at 1, red
to 2 and blue to 1/2; grey: not compared.
"""
import argparse
import json
import pathlib
import struct
import subprocess
import sys
import tempfile

import numpy as np
import OpenEXR
import zstandard
from PIL import Image

B10G11R11 = 122
BORDER = 4


def floats(bits, mantissa):
    """Unsigned floats with five bits of exponent."""
    exponent, part = bits >> mantissa, (bits & ((1 << mantissa) - 1)) / 2.0 ** mantissa
    return np.where(exponent == 0, part * 2.0 ** -14, (1 + part) * 2.0 ** (exponent.astype(float) - 15))


def ktx2(path):
    """The first level of a KTX 2.0 file, height by width by 3."""
    data = path.read_bytes()
    if len(data) < 104 or data[:12] != b"\xabKTX 20\xbb\r\n\x1a\n":
        sys.exit(f"{path}: not a KTX 2.0 file")
    kind, _, width, height, depth, layers, faces, _, packing = struct.unpack("<9I", data[12:48])
    if (kind, depth, layers, faces) != (B10G11R11, 0, 0, 1) or packing not in (0, 2):
        sys.exit(f"{path}: format {kind}, supercompression {packing}; known: one image of format {B10G11R11}, plain or Zstandard")
    start, size, whole = struct.unpack("<3Q", data[80:104])
    texels = data[start:start + size]
    if packing == 2:
        texels = zstandard.ZstdDecompressor().decompress(texels, max_output_size=whole)
    words = np.frombuffer(texels, "<u4", width * height).reshape(height, width)
    return np.stack([floats(words & 0x7FF, 6), floats(words >> 11 & 0x7FF, 6), floats(words >> 22, 5)], -1)


def from_srgb(x):
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)


def baked(args, folder):
    """Our maps: radiance of a white surface, by object."""
    model = folder / "ours.glb"
    command = [args.lightsum, "bake", args.model, "-o", model, "--density", args.density, "--passes", args.passes]
    subprocess.run([str(word) for word in command] + ["--checkpoint", "off"], check=True)
    data = model.read_bytes()
    document = json.loads(data[20:20 + struct.unpack("<I", data[12:16])[0]])
    manifest = document["extras"]["lightsum"]["lightmap"]
    maps = {}
    for entry in manifest["objects"]:
        # Charts of the file are on the first page of an object, new ones, such as those of second sides, on later ones.
        page = manifest["pages"][entry["page"]]
        if entry["object"] not in maps:
            with OpenEXR.File(str(folder / page["irradiance"])) as file:
                pixels = file.channels()["RGB"].pixels.astype(float)
            maps[entry["object"]] = pixels * 2.0 ** -page["exposure"] / np.pi
    return maps


def at_centres(theirs, size):
    """Their values at the centres of our texels: the median of 3 x 3 texels around, which outliers beside charts do not touch."""
    height, width = theirs.shape[:2]
    y, x = [((np.arange(n) + 0.5) / n * m).astype(int) for n, m in zip(size, (height, width))]
    around = [theirs[(y + dy).clip(0, height - 1)][:, (x + dx).clip(0, width - 1)] for dy in (-1, 0, 1) for dx in (-1, 0, 1)]
    return np.median(np.stack(around), 0)


def inner(mask):
    """Texels whose neighbours up to BORDER are all in the mask."""
    padded = np.pad(mask, BORDER)
    steps = range(2 * BORDER + 1)
    height, width = mask.shape
    return np.logical_and.reduce([padded[dy:dy + height, dx:dx + width] for dy in steps for dx in steps])


def ratios(name, ours, theirs):
    print(name)
    for way, values in (("as stored", theirs), ("as sRGB", from_srgb(theirs))):
        means = ours.mean(0) / values.mean(0)
        medians = np.median(ours / values, 0)
        slope = np.polyfit(np.log(ours.mean(1)), np.log(values.mean(1)), 1)[0]
        numbers = [" ".join(f"{x:.2f}" for x in three) for three in (means, medians)]
        print(f"  {way:9}: ratio of means {numbers[0]}, median of ratios {numbers[1]}, slope {slope:.2f}")


def shown(values):
    return (np.clip(values / 3, 0, 1) ** (1 / 2.2) * 255).astype(np.uint8)


def false_colour(ours, theirs, used):
    with np.errstate(divide="ignore", invalid="ignore"):
        stops = np.log2(ours.mean(-1) / theirs.mean(-1)).clip(-1, 1)
    rest = 1 - np.abs(stops)
    colour = np.where((stops > 0)[..., None], np.stack([np.ones_like(rest), rest, rest], -1), np.stack([rest, rest, np.ones_like(rest)], -1))
    return (np.where(used[..., None], colour, 0.25) * 255).astype(np.uint8)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", type=pathlib.Path)
    parser.add_argument("maps", nargs="+", metavar="OBJECT=FILE")
    parser.add_argument("-o", "--output", type=pathlib.Path, required=True)
    parser.add_argument("--lightsum", default="target/release/lightsum")
    parser.add_argument("--density", type=float, default=0.2, help="texels along a unit of the model")
    parser.add_argument("--passes", type=int, default=16)
    parser.add_argument("--decode", choices=("none", "srgb"), default="srgb", help="of their values in the picture")
    parser.add_argument("--rows", default="theirs,ours,ratio")
    parser.add_argument("--size", type=int, default=256, help="of a map in the picture, in pixels")
    args = parser.parse_args()
    rows = args.rows.split(",")
    if not set(rows) <= {"theirs", "ours", "ratio"}:
        sys.exit(f"--rows {args.rows}: known are theirs, ours and ratio")
    with tempfile.TemporaryDirectory() as folder:
        of_ours = baked(args, pathlib.Path(folder))
    picture = Image.new("RGB", (args.size * len(args.maps), args.size * len(rows)))
    for column, pair in enumerate(args.maps):
        name, _, file = pair.partition("=")
        if name not in of_ours:
            sys.exit(f"{pair}: no object {name!r} with light; there are {', '.join(of_ours)}")
        ours = of_ours[name]
        theirs = at_centres(ktx2(pathlib.Path(file)), ours.shape[:2])
        # Values above 1000 are what other programs leave beside charts.
        used = inner((ours.min(-1) > 0) & (theirs.min(-1) > 0) & (theirs.max(-1) < 1000))
        if not used.any():
            sys.exit(f"{pair}: no texel has light in both maps; is it the map of another object?")
        ratios(name, ours[used], theirs[used])
        linear = from_srgb(theirs) if args.decode == "srgb" else theirs
        images = {"theirs": shown(linear), "ours": shown(ours), "ratio": false_colour(ours, linear, used)}
        for row, way in enumerate(rows):
            image = Image.fromarray(images[way]).resize((args.size, args.size), Image.NEAREST)
            picture.paste(image, (args.size * column, args.size * row))
    picture.save(args.output, optimize=True)


if __name__ == "__main__":
    main()
