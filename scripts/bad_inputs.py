#!/usr/bin/env python3
"""Damages scene files in thousands of ways and reads each by `lightsum info`, within 10 s and 2 GiB.

    scripts/bad_inputs.py target/release/lightsum scenes tests/cpu/data --count 3000 --keep target/bad-inputs
    scripts/bad_inputs.py target/release/lightsum --fixed    # the hand-made files of bad_inputs_fixed.py instead

Every run must end with exit code 0, 1 or 2, an error with a line "error: ", and no panic. Files that found something else are kept
in the folder of --keep. The same seed makes the same files. Prints a table of outcomes; exit code 1 if any is wrong. Each hand-made
file has an outcome of its own, and words that the program must print.
"""

import argparse
import collections
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import bad_inputs_fixed as fixed

SECONDS = 10
BYTES = 2 << 30
KINDS = {".obj", ".mtl", ".gltf", ".glb", ".toml", ".ply", ".xml", ".bin", ".png", ".jpg", ".exr", ".hdr", ".tga"}
MODELS = {".obj", ".gltf", ".glb", ".toml", ".ply", ".xml"}
LARGEST = 1 << 20

NUMBERS = [
    "nan", "-nan", "inf", "-inf", "-0", "0", "1e39", "-1e39", "1e308", "1e-320", "1e-45", "3.4028235e38", "-1", "4294967295",
    "4294967296", "18446744073709551616", "2147483648", "-2147483649", "0x10", "1.", ".5", "+1", "1,5", "1" * 400, "1e999999999", "",
]
NAMES = [
    "/dev/zero", "/dev/full", "/proc/self/mem", "../../../../etc/passwd", ".", "", "a" * 300, "\\\\host\\share", "C:\\a.png",
    "%00", "%ff%fe", "data:,", "data:application/octet-stream;base64,AAAA", "http://example.org/a.png", "file:///dev/zero", "scene.toml",
]
BYTES_IN_TEXT = [b"\0", b"\xff\xfe", b"\xef\xbb\xbf", b"\r", b"\r\n", b"\t", b"\x1a", b"\xe9", b"\\\n", b"# comment\n", b"\"", b"'", b"{", b"[", b"<"]


def is_number(word):
    try:
        float(word)
        return True
    except ValueError:
        return False


def damage_text(data, rng):
    lines = data.split(b"\n")
    at = rng.randrange(len(lines))
    how = rng.randrange(11)
    if how == 0:
        del lines[at]
    elif how == 1:
        lines.insert(at, lines[rng.randrange(len(lines))])
    elif how == 2:
        lines[at : at + 1] = [lines[at]] * rng.choice([2, 100, 20000 if len(lines[at]) < 200 else 50])
    elif how == 3:
        return data[: rng.randrange(len(data) + 1)]
    elif how in (4, 5, 6):


        words = list(re.finditer(rb"[-+]?[0-9][-+0-9.eE]*", data))
        if not words:
            return data + b"\n1 2 3"
        word = rng.choice(words)
        return data[: word.start()] + rng.choice(NUMBERS).encode() + data[word.end() :]
    elif how == 7:


        words = list(re.finditer(rb'"[^"\n]{1,200}"|[A-Za-z_./\\-]{3,}', data))
        if not words:
            return rng.choice(NAMES).encode()
        word = rng.choice(words)
        new = rng.choice([rng.choice(NAMES).encode(), rng.choice(words).group(), b'"' + rng.choice(NAMES).encode() + b'"'])
        return data[: word.start()] + new + data[word.end() :]
    elif how == 8:
        place = rng.randrange(len(data) + 1)
        return data[:place] + rng.choice(BYTES_IN_TEXT) * rng.choice([1, 1, 3, 1000]) + data[place:]
    elif how == 9:
        a, b = sorted(rng.randrange(len(data) + 1) for _ in range(2))
        return data[:a] + data[b:]
    else:
        a, b = sorted(rng.randrange(len(data) + 1) for _ in range(2))
        return data[:b] + data[a:b] * rng.choice([1, 2, 30]) + data[b:]
    return b"\n".join(lines)


def damage_bytes(data, rng):
    data = bytearray(data)
    how = rng.randrange(6)
    if not data or how == 0:
        return bytes(data[: rng.randrange(len(data) + 1)])
    for _ in range(rng.choice([1, 1, 2, 8, 64])):
        at = rng.randrange(min(len(data), rng.choice([32, 256, len(data)])))
        if how == 1:
            data[at] ^= 1 << rng.randrange(8)
        elif how == 2:
            data[at] = rng.choice([0, 1, 0x7F, 0x80, 0xFF])
        elif how == 3:
            data[at : at + 4] = rng.choice([b"\0\0\0\0", b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\0\0\0\x80", b"\0\0\0\x01"])
        elif how == 4:
            del data[at : at + rng.choice([1, 4, 100])]
        else:
            data[at:at] = rng.randbytes(rng.choice([1, 4, 100]))
        if not data:
            break
    return bytes(data)


def damage(path, data, rng):
    text = path.suffix.lower() in {".obj", ".mtl", ".gltf", ".toml", ".xml"} or path.suffix.lower() == ".ply" and b"ascii" in data[:40]
    # Every fifth text is damaged as bytes too.
    if text and data and rng.random() < 0.8:
        return damage_text(data, rng)
    return damage_bytes(data, rng)


def limits():
    # Address space: more than the resident memory that counts, so that the program can refuse it by itself.
    resource.setrlimit(resource.RLIMIT_AS, (4 * BYTES, 4 * BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def outcome(program, scene):
    with tempfile.TemporaryFile() as errors:
        process = subprocess.Popen(
            [program, "info", scene, "--max-input-memory", "1G"],
            stdin=subprocess.DEVNULL, stdout=errors, stderr=errors, preexec_fn=limits,
        )
        start, late = time.monotonic(), False
        while True:
            pid, status, usage = os.wait4(process.pid, os.WNOHANG)
            if pid:
                break
            if time.monotonic() - start > SECONDS and not late:
                late = True
                os.kill(process.pid, signal.SIGKILL)
            time.sleep(0.002)
        process.returncode = os.waitstatus_to_exitcode(status)
        errors.seek(0)
        message = errors.read().decode(errors="replace")
    if late:
        return "hang", message
    if process.returncode < 0:
        return f"signal {-process.returncode}", message
    if "panicked" in message or process.returncode == 101:
        return "panic", message
    if usage.ru_maxrss * 1024 > BYTES:
        return "over 2 GiB", message
    if process.returncode == 0:
        return "read", message
    if process.returncode in (1, 2) and any(line.startswith("error: ") for line in message.splitlines()):
        return "refused", message
    return f"exit code {process.returncode} without an error", message


def models_beside(file):
    """The scenes that read a file: itself, or those in its folder and the one above."""
    if file.suffix.lower() in MODELS:
        return [file]
    around = [p for p in file.parent.iterdir() if p.suffix.lower() in MODELS]
    above = [p for p in file.parent.parent.iterdir() if p.suffix.lower() in MODELS]
    return sorted(around + above)


def hand_made(program):
    """Reads the hand-made files; returns the exit code."""
    table, wrong = collections.defaultdict(collections.Counter), 0
    with tempfile.TemporaryDirectory(prefix="bad-inputs-") as temporary:
        for i, case in enumerate(fixed.CASES):
            result, printed = outcome(program, fixed.make(case, Path(temporary) / str(i) / "scene"))
            fault = fixed.check(case, result, printed)
            table[case[0]][result] += 1
            if fault:
                wrong += 1
                print(f"case {i}, {fault}\n    {printed.strip()[-300:]}", flush=True)
    columns = sorted({result for row in table.values() for result in row})
    print("| rule | " + " | ".join(columns) + " |\n|---|" + "---|" * len(columns))
    for rule, row in table.items():
        print(f"| {rule} | " + " | ".join(str(row[c]) for c in columns) + " |")
    print("| all | " + " | ".join(str(sum(row[c] for row in table.values())) for c in columns) + " |")
    print(f"{len(fixed.CASES)} files, {wrong} wrong")
    return 1 if wrong else 0


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("program")
    parser.add_argument("folders", nargs="*", type=Path)
    parser.add_argument("--fixed", action="store_true", help="read the hand-made files")
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, default=Path("target/bad-inputs"))
    args = parser.parse_args()
    program = os.path.abspath(args.program)
    if args.fixed:
        return hand_made(program)
    if not args.folders:
        parser.error("name folders with scenes, or give --fixed")

    files = sorted(p for folder in args.folders for p in folder.rglob("*") if p.is_file() and p.suffix.lower() in KINDS)
    files = [p for p in files if p.stat().st_size <= LARGEST and models_beside(p)]
    # Kinds in turn, so that a folder of a thousand files of one kind is not all.
    kinds = collections.defaultdict(list)
    for file in files:
        kinds[file.suffix.lower()].append(file)
    print(", ".join(f"{len(of)} {kind}" for kind, of in sorted(kinds.items())))
    order = sorted(kinds)
    table = collections.defaultdict(collections.Counter)
    wrong = []
    with tempfile.TemporaryDirectory(prefix="bad-inputs-") as temporary:
        for i in range(args.count):
            rng = random.Random(args.seed * 1_000_003 + i)
            kind = order[i % len(order)]
            # Every file once, then at random.
            turn = i // len(order)
            file = kinds[kind][turn] if turn < len(kinds[kind]) else rng.choice(kinds[kind])
            model = rng.choice(models_beside(file))
            root = model.parent
            place = Path(temporary) / str(i)
            small = sum(p.stat().st_size for p in root.rglob("*") if p.is_file()) < 8 << 20
            if small:
                shutil.copytree(root, place)
            else:
                place.mkdir()
                for p in root.iterdir():
                    if p.is_file() and p.stat().st_size <= LARGEST:
                        shutil.copy(p, place)
            target = place / os.path.relpath(file, root)
            target.parent.mkdir(parents=True, exist_ok=True)
            data = file.read_bytes()
            for _ in range(rng.choice([1, 1, 1, 2, 4])):
                data = damage(file, data, rng)
            target.write_bytes(data)
            result, message = outcome(program, str(place / model.name))
            table[kind][result] += 1
            if result not in ("read", "refused"):
                kept = args.keep / f"{args.seed}-{i}-{result.replace(' ', '-')}"
                shutil.copytree(place, kept, dirs_exist_ok=True)
                wrong.append((result, kept / model.name, message.strip()[-300:]))
                print(f"{result}: {kept / model.name} ({file})\n    {message.strip()[-300:]}", flush=True)
            shutil.rmtree(place)
    columns = sorted({result for row in table.values() for result in row})
    print("| kind | " + " | ".join(columns) + " |\n|---|" + "---|" * len(columns))
    for kind in order:
        print(f"| {kind[1:]} | " + " | ".join(str(table[kind][c]) for c in columns) + " |")
    print("| all | " + " | ".join(str(sum(table[k][c] for k in order)) for c in columns) + " |")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
