#!/usr/bin/env python3
"""How much the frames of an animation differ where nothing changes (see docs/defaults.md).

    python3 -m venv venv && venv/bin/pip install OpenEXR numpy
    venv/bin/python scripts/flicker.py SCENE.toml PATH.toml --passes 4 -- --preset interactive --resolution 320x240

Renders the animation twice: with the passes asked for, and with many to tell what changes. A pixel counts from one frame to the next
where the latter's radiance changes by less than 0.2 %. Flags after -- go to both.
"""
import argparse
import pathlib
import subprocess
import sys
import tempfile

import numpy as np

from quality import read

UNCHANGED = 0.002


def frames(args, passes, folder):
    folder.mkdir()
    command = [args.lightsum, "animate", args.scene, "--path", args.path, "--moving-passes", str(passes), "-o", folder / "%03d.exr"]
    subprocess.run([*command, *args.flags], check=True, stdout=subprocess.DEVNULL)
    return [read(path).mean(axis=-1) for path in sorted(folder.iterdir())]


def differences(images):
    """Relative differences of the luminance of consecutive frames."""
    return [np.abs(b - a) / np.maximum((a + b) / 2, 1e-6) for a, b in zip(images, images[1:])]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("path")
    parser.add_argument("--passes", type=int, default=4)
    parser.add_argument("--truth-passes", type=int, default=96)
    parser.add_argument("--lightsum", default="target/release/lightsum")
    end = sys.argv.index("--") if "--" in sys.argv else len(sys.argv)
    args = parser.parse_args(sys.argv[1:end])
    args.flags = sys.argv[end + 1 :]
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        noisy, truth = (differences(frames(args, n, folder / str(n))) for n in (args.passes, args.truth_passes))
    values = np.concatenate([d[t < UNCHANGED] for d, t in zip(noisy, truth)])
    share = values.size / sum(d.size for d in truth)
    print(f"{100 * share:.0f} % of the pixels don't change: mean {100 * values.mean():.2f} %, median {100 * np.median(values):.2f} %")


if __name__ == "__main__":
    main()
