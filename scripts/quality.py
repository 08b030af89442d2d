#!/usr/bin/env python3
"""Error and energy of renderings against two path-traced images of a scene, by number of passes (the tables of docs/defaults.md).

    python3 -m venv venv && venv/bin/pip install OpenEXR numpy
    venv/bin/python scripts/quality.py SCENE.toml FIRST.exr SECOND.exr --passes 1,4,16 --seeds 3 -- --preset interactive

The two references have different seeds, so that the noise of neither counts: the square of the error is the mean product of
the differences from each, over the square of the radiance around the pixel. Both, and with --half the rendering too, are averaged over squares of pixels down to the size of the
rendering. Pixels above a percentile of the reference do not count: lamps seen directly would hide the rest. --sphere counts the
pixels whose middle shows a sphere, one row for each. Flags after -- go to each rendering.
"""
import argparse
import json
import pathlib
import subprocess
import sys
import tempfile
import tomllib

import numpy as np
import OpenEXR


def read(path):
    with OpenEXR.File(str(path)) as file:
        channels = file.channels()
        name = next(name for name in ("RGBA", "RGB") if name in channels)
        return channels[name].pixels[..., :3].astype(np.float64)


def shrunk(image, height):
    """The image, averaged over squares of pixels to a height that divides its own."""
    n = image.shape[0] // height
    if image.shape[0] != n * height or image.shape[1] % n:
        sys.exit(f"a reference of {image.shape[1]}x{image.shape[0]} cannot be averaged to a height of {height}")
    return image.reshape(height, n, image.shape[1] // n, n, 3).mean(axis=(1, 3))


def weights(first, second, counted):
    """Inverse squares of the radiance that errors are relative to, with a hundredth of the mean's square added.

    The median of 5 x 5 pixels of both references: with the pixel itself the noise of the references would count after all, since both
    have small differences from the rendering where the weight is small.
    """
    mean = (first + second) / 2
    padded = np.pad(mean, ((2, 2), (2, 2), (0, 0)), mode="edge")
    window = np.lib.stride_tricks.sliding_window_view(padded, (5, 5), axis=(0, 1))
    middle = np.median(window.reshape(*mean.shape, 25), axis=-1)
    return 1 / (middle**2 + 0.01 * mean[counted].mean() ** 2)


def seen_spheres(scene, spheres, height, width):
    """The nearest sphere that the middle of each pixel shows, -1 for none."""
    camera = tomllib.loads(pathlib.Path(scene).read_text())["camera"]
    eye, target = np.array(camera["eye"]), np.array(camera["target"])
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, camera.get("up", [0.0, 1.0, 0.0]))
    right /= np.linalg.norm(right)
    slope = np.tan(np.radians(camera["fov_y"]) / 2)
    x = (2 * (np.arange(width) + 0.5) / width - 1) * slope * width / height
    y = (1 - 2 * (np.arange(height) + 0.5) / height) * slope
    wo = forward + x[None, :, None] * right + y[:, None, None] * np.cross(right, forward)
    wo /= np.linalg.norm(wo, axis=-1, keepdims=True)
    seen, nearest = np.full((height, width), -1), np.full((height, width), np.inf)
    for i, (*centre, radius) in enumerate(spheres):
        offset = eye - centre
        b = wo @ offset
        d = b * b - (offset @ offset - radius**2)
        distance = np.where(d >= 0, -b - np.sqrt(np.maximum(d, 0)), np.inf)
        hit = (distance > 0) & (distance < nearest)
        seen[hit], nearest[hit] = i, distance[hit]
    return seen


def render(args, seed, passes, folder):
    image, stats = folder / "image.exr", folder / "stats.json"
    command = [args.lightsum, "render", args.scene, "-o", image, "--float", "--no-layers", "--stats", stats]
    command += ["--max-depth", str(args.max_depth), "--seed", str(seed), "--passes", str(passes)]
    if args.size:
        command += ["--resolution", args.size]
    subprocess.run([*command, *args.flags], check=True, stdout=subprocess.DEVNULL)
    return read(image), json.loads(stats.read_text())["stages"]["render"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("references", nargs=2)
    parser.add_argument("--passes", default="1,16")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--size", help="of the rendering, as 320x240")
    parser.add_argument("--half", action="store_true", help="average renderings over 2x2 pixels, too")
    parser.add_argument("--max-depth", type=int, default=16)
    parser.add_argument("--percentile", type=float, default=99.5)
    parser.add_argument("--without", action="append", default=[], metavar="X0,Y0,X1,Y1", help="a rectangle of the image that does not count, from 0,0 to 1,1")
    parser.add_argument("--sphere", action="append", default=[], metavar="X,Y,Z,R")
    parser.add_argument("--lightsum", default="target/release/lightsum")
    parser.add_argument("--json", help="write the rows to a file")
    end = sys.argv.index("--") if "--" in sys.argv else len(sys.argv)
    args = parser.parse_args(sys.argv[1:end])
    args.flags = sys.argv[end + 1 :]
    spheres = [[float(x) for x in text.split(",")] for text in args.sphere]
    rectangles = [[float(x) for x in text.split(",")] for text in args.without]
    references, rows, before = [read(path) for path in args.references], [], {}
    print("passes | part | relative RMSE | energy, of each seed | mean radiance, reference | exponent | seconds")
    with tempfile.TemporaryDirectory() as folder:
        for passes in map(int, args.passes.split(",")):
            runs = [render(args, seed, passes, pathlib.Path(folder)) for seed in range(1, args.seeds + 1)]
            images = [shrunk(image, image.shape[0] // 2) if args.half else image for image, _ in runs]
            height, width, _ = images[0].shape
            first, second = [shrunk(reference, height) for reference in references]
            mean = (first + second) / 2
            luminance = mean.mean(axis=-1)
            counted = luminance <= np.percentile(luminance, args.percentile)
            for x0, y0, x1, y1 in rectangles:
                counted[int(y0 * height) : int(y1 * height), int(x0 * width) : int(x1 * width)] = False
            weight = weights(first, second, counted)
            seen = seen_spheres(args.scene, spheres, height, width) if spheres else None
            parts = {"all": counted} | {f"sphere {i}": counted & (seen == i) for i in range(len(spheres))}
            for part, mask in parts.items():
                square = np.mean([((image - first) * (image - second) * weight)[mask].mean() for image in images])
                error = np.sqrt(max(square, 0.0))
                radiance = mean[mask].mean()
                energies = [image[mask].mean() / radiance for image in images]
                old_passes, old_error = before.get(part, (passes, error))
                exponent = np.log(error / old_error) / np.log(passes / old_passes) if passes != old_passes else np.nan
                before[part] = passes, error
                seconds = float(np.median([run[1] for run in runs]))
                each = " ".join(f"{energy:.3f}" for energy in energies)
                values = f"{error:.4f} | {np.mean(energies):.4f}, {each} | {np.mean(energies) * radiance:.5f}, {radiance:.5f}"
                print(f"{passes} | {part} | {values} | {exponent:.2f} | {seconds:.2f}", flush=True)
                rows.append({"passes": passes, "part": part, "relative_rmse": error, "energies": energies, "seconds": seconds})
    if args.json:
        pathlib.Path(args.json).write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
