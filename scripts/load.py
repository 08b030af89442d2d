#!/usr/bin/env python3
"""Loads this machine with renderings and watches memory, images and files.

    scripts/load.py together target/release/lightsum           # 8 processes, one cache, one output folder
    scripts/load.py passes target/release/lightsum --passes 100000
    scripts/load.py edits target/release/lightsum-bench --edits 10000

together: each of 8 processes renders 5 times, every round after the caches were removed; all images must have the same bytes, two that name
one output are told, and no file may be left. passes: so many passes of a furnace of 4x4 pixels; resident memory may not change by more
than 1 % after the first tenth, and every pixel must have the closed form 1 + 1/2 + 1/4. edits: an object of a room of 1.2 million triangles
is moved so often, with the same bound on memory. Prints figures; exit code 1 if anything is wrong.
"""

import argparse
import json
import os
import shutil
import struct
import subprocess
import sys
import tempfile
import time
import zlib
from pathlib import Path

SCENES = Path(__file__).resolve().parent.parent / "scenes"


def resident(process):
    """Resident memory in KiB; None once it has ended."""
    try:
        for line in Path(f"/proc/{process.pid}/status").read_text().splitlines():
            if line.startswith("VmRSS:"):
                return int(line.split()[1])
    except OSError:
        pass
    return None


def watch(process, every=1.0):
    """Waits for a process; returns its text and pairs of seconds and resident memory."""
    start, samples = time.monotonic(), []
    while process.poll() is None:
        memory = resident(process)
        if memory:
            samples.append((time.monotonic() - start, memory))
        time.sleep(every)
    return process.communicate()[0].decode(errors="replace"), samples


def flat(samples):
    """Smallest and largest memory after the first tenth of the time."""
    last = samples[-1][0]
    late = [memory for seconds, memory in samples if seconds > 0.1 * last]
    return min(late), max(late)


def together(program):
    wrong = []
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        cache = folder / "cache"
        os.environ["XDG_CACHE_HOME"] = str(cache)
        out = folder / "out"
        out.mkdir()
        base = [program, "render", str(SCENES / "cornell" / "scene.toml"), "--resolution", "48x36", "--particles", "8", "--passes", "6"]
        told, images, start = 0, set(), time.monotonic()
        for _ in range(5):
            shutil.rmtree(cache, ignore_errors=True)
            # The last two write one file.
            names = [f"{i}.exr" for i in range(7)] + ["6.exr"]
            runs = [
                subprocess.Popen(base + ["-o", str(out / name), "--checkpoint", "0.05"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
                for name in names
            ]
            for name, run in zip(names, runs):
                text = run.communicate()[0].decode(errors="replace")
                if run.returncode == 0 and "panicked" not in text:
                    images.add((out / name).read_bytes())
                elif name == "6.exr" and run.returncode == 1 and "another" in text:
                    told += 1
                else:
                    wrong.append(f"{name}: exit code {run.returncode}: {text}")
            left = set(os.listdir(out)) - set(names)
            if left:
                wrong.append(f"left: {sorted(left)}")
        print(f"40 processes by 8 in {time.monotonic() - start:.0f} s: {len(images)} image(s) that differ, {told} of 5 told of one output")
        if len(images) != 1:
            wrong.append("the images differ")
    return wrong


def floats(path):
    """Values of the channels R, G and B of an EXR file of floats in scan lines."""
    data = path.read_bytes()
    at, attributes = 8, {}
    while data[at]:
        name, at = data[at : data.index(0, at)].decode(), data.index(0, at) + 1
        at = data.index(0, at) + 1
        size = struct.unpack_from("<i", data, at)[0]
        attributes[name] = data[at + 4 : at + 4 + size]
        at += 4 + size
    at += 1
    channels, rest = [], attributes["channels"]
    while rest[0]:
        end = rest.index(0)
        channels.append((rest[:end].decode(), 2 if struct.unpack_from("<i", rest, end + 1)[0] == 1 else 4))
        rest = rest[end + 17 :]
    x0, y0, x1, y1 = struct.unpack("<4i", attributes["dataWindow"])
    width, height = x1 - x0 + 1, y1 - y0 + 1
    lines = {0: 1, 2: 1, 3: 16}[attributes["compression"][0]]
    row = width * sum(size for _, size in channels)
    values = []
    for block in range(-(-height // lines)):
        place = struct.unpack_from("<Q", data, at + 8 * block)[0]
        first, size = struct.unpack_from("<2i", data, place)
        rows = min(lines, height - (first - y0))
        raw = data[place + 8 : place + 8 + size]
        if size != rows * row:
            raw = bytearray(zlib.decompress(raw))
            for i in range(1, len(raw)):
                raw[i] = (raw[i - 1] + raw[i] - 128) & 255
            half = (len(raw) + 1) // 2
            raw = bytes(raw[i // 2 + (i % 2) * half] for i in range(len(raw)))
        position = 0
        for _ in range(rows):
            for name, size in channels:
                if name in "RGB":
                    values.extend(struct.unpack_from(f"<{width}f", raw, position))
                position += width * size
    return values


def passes(program, count):
    expected = 1.75
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        os.environ["XDG_CACHE_HOME"] = str(folder / "cache")
        command = [program, "render", str(SCENES / "furnace" / "scene.toml"), "--resolution", "4x4", "--particles", "4", "--max-depth", "3"]
        # All virtual lights at every point, without clipping: the expectation of each pixel is the closed form, which those in corners
        # reach slowly.
        command += ["--clip", "0", "--compensation", "off", "--interleave", "1x1", "--filter", "off", "--photons", "0", "--light-pool", "0"]
        command += ["--checkpoint", "off", "--float", "-o", "a.exr", "--stats", "a.json"]
        # The driver compiles the kernels.
        subprocess.run([*command, "--passes", "1"], cwd=folder, check=True, capture_output=True)
        command += ["--passes", str(count)]
        process = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        start = time.monotonic()
        text, samples = watch(process)
        if process.returncode != 0:
            return [f"exit code {process.returncode}: {text[-2000:]}"]
        done = json.loads((folder / "a.json").read_text())["passes"]
        low, high = flat(samples)
        print(f"{done} passes in {time.monotonic() - start:.0f} s, resident memory {low} to {high} KiB", flush=True)
        wrong = [] if done == count else ["passes are missing"]
        if high > 1.01 * low:
            wrong.append(f"resident memory changed from {low} to {high} KiB")
        values = floats(folder / "a.exr")
        mean = sum(values) / len(values)
        print(f"radiance {min(values):.6f} to {max(values):.6f}, mean {mean:.6f}, closed form {expected}")
        if len(values) != 48 or abs(mean / expected - 1) > 1e-3:
            wrong.append("the sums are wrong")
        return wrong


def edits(program, count):
    command = [program, "edits", "--scene", "room:1200000", "--resolution", "16x16", "--repeats", str(count), "--json"]
    start = time.monotonic()
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    text, samples = watch(process)
    if process.returncode != 0:
        return [f"exit code {process.returncode}: {text[-2000:]}"]
    low, high = flat(samples)
    print(f"{count} edits in {time.monotonic() - start:.0f} s, resident memory {low} to {high} KiB")
    return [f"resident memory changed from {low} to {high} KiB"] if high > 1.01 * low else []


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("load", choices=["together", "passes", "edits"])
    parser.add_argument("program")
    parser.add_argument("--passes", type=int, default=100_000)
    parser.add_argument("--edits", type=int, default=10_000)
    options = parser.parse_args()
    program = str(Path(options.program).resolve())
    loads = {
        "together": lambda: together(program),
        "passes": lambda: passes(program, options.passes),
        "edits": lambda: edits(program, options.edits),
    }
    wrong = loads[options.load]()
    for line in wrong:
        print(f"wrong: {line}")
    sys.exit(1 if wrong else 0)


main()
