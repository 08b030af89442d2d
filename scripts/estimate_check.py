#!/usr/bin/env python3
"""Ratio of the estimated to the true error of renderings with several seeds (see docs/error-estimate.md).

    python3 -m venv venv && venv/bin/pip install OpenEXR numpy
    venv/bin/python scripts/estimate_check.py SCENE.toml --passes 32 -- --resolution 96x72 --preset interactive

The truth for each seed is the mean of all other renderings and of a longer one. Flags after -- go to each rendering.
"""
import argparse
import json
import pathlib
import subprocess
import sys
import tempfile

import numpy as np
import OpenEXR

# As in src/estimate.rs.
MAX_PIXEL_ERROR = 2.0
COUNTED_PIXELS = 0.995


def relative_error(image, reference):
    """The error as docs/error-estimate.md defines it."""
    floor = 0.01 * reference.mean() ** 2
    squares = np.mean((image - reference) ** 2 / (reference**2 + floor), axis=-1).ravel()
    squares = np.sort(np.minimum(squares, MAX_PIXEL_ERROR**2))
    return np.sqrt(squares[: int(np.ceil(COUNTED_PIXELS * squares.size))].mean())


def render(args, seed, passes, folder):
    image, stats = folder / "image.exr", folder / "stats.json"
    command = [args.lightsum, "render", args.scene, "-o", image, "--float", "--no-layers", "--stats", stats]
    subprocess.run([*command, "--seed", str(seed), "--passes", str(passes), *args.flags], check=True, stdout=subprocess.DEVNULL)
    with OpenEXR.File(str(image)) as file:
        channels = file.channels()
        pixels = next(channels[name].pixels for name in ("RGBA", "RGB") if name in channels)[..., :3]
    return pixels.astype(np.float64), json.loads(stats.read_text())["error_estimate"]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene")
    parser.add_argument("--passes", type=int, default=32)
    parser.add_argument("--seeds", type=int, default=16)
    parser.add_argument("--truth-passes", type=int, default=256, help="passes of the longer rendering")
    parser.add_argument("--lightsum", default="target/release/lightsum")
    end = sys.argv.index("--") if "--" in sys.argv else len(sys.argv)
    args = parser.parse_args(sys.argv[1:end])
    args.flags = sys.argv[end + 1 :]
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        runs = [render(args, seed, args.passes, folder) for seed in range(1, args.seeds + 1)]
        longer, _ = render(args, 1000, args.truth_passes, folder)
    total = longer * args.truth_passes + sum(image for image, _ in runs) * args.passes
    others = args.truth_passes + (args.seeds - 1) * args.passes
    ratios = []
    for image, estimate in runs:
        true = relative_error(image, (total - image * args.passes) / others)
        ratios.append(estimate / true)
        print(f"estimated {estimate:.4f}, true {true:.4f}, ratio {ratios[-1]:.2f}")
    good = sum(0.77 <= ratio <= 1.3 for ratio in ratios)
    print(f"{args.scene}: {good} of {len(ratios)} ratios in 0.77 to 1.3, median {np.median(ratios):.2f}")


if __name__ == "__main__":
    main()
