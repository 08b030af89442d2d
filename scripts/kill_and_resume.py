#!/usr/bin/env python3
"""Ends a rendering at random moments, lets it go on with --resume, and compares the image with that of an unbroken run.

    scripts/kill_and_resume.py target/release/lightsum --runs 200

Each run is ended by one to three signals, the last but one of them, and often all, by SIGKILL; then it runs to its end. The image must
have the same bytes, and of the files beside it only the state and the scene may be left. A tenth of the runs each get SIGTERM, SIGHUP, SIGINT
and SIGPIPE in place of the last SIGKILL. Prints counts; exit code 1 if anything is wrong.
"""

import argparse
import collections
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

SCENE = Path(__file__).resolve().parent.parent / "scenes" / "cornell"
OTHERS = [signal.SIGTERM, signal.SIGHUP, signal.SIGINT, signal.SIGPIPE]


def command(program, folder, passes):
    arguments = ["render", "scene.toml", "-o", "a.exr", "-o", "a.png", "--resolution", "48x48", "--particles", "8"]
    arguments += ["--passes", str(passes), "--checkpoint", "0.02", "--resume"]
    return subprocess.Popen([program, *arguments], cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)


def images(folder):
    return [(folder / name).read_bytes() for name in ("a.exr", "a.png")]


def fresh(parent):
    folder = Path(tempfile.mkdtemp(dir=parent))
    for name in ("scene.toml", "cornell.obj", "cornell.mtl"):
        shutil.copy(SCENE / name, folder)
    return folder


def broken(program, parent, passes, seconds, rng, sound, tally):
    """One run; returns what is wrong with it."""
    folder = fresh(parent)
    signals = [signal.SIGKILL] * rng.randint(1, 3)
    if rng.random() < 0.4:
        signals[-1] = rng.choice(OTHERS)
    for number in signals:
        run = command(program, folder, passes)
        try:
            run.communicate(timeout=rng.uniform(0.0, seconds))
            tally["ended before the signal"] += 1
        except subprocess.TimeoutExpired:
            state = "with a state" if (folder / "a.exr.state").exists() else "before a state"
            run.send_signal(number)
            text = run.communicate(timeout=3600)[0].decode(errors="replace")
            tally[f"{signal.Signals(number).name} {state}"] += 1
            expected = -9 if number == signal.SIGKILL else 0
            # An interrupt before the first pass leaves no image, which is an error.
            early = run.returncode == 1 and "before the first" in text
            # Nor does one that comes while the program starts: the system ends it then.
            early |= run.returncode == -number and not text
            # Or while it ends.
            early |= run.returncode == 0
            if run.returncode != expected and not early:
                return f"exit code {run.returncode} after {signal.Signals(number).name}: {text}"
    run = command(program, folder, passes)
    text = run.communicate(timeout=3600)[0].decode(errors="replace")
    if run.returncode != 0 or "panicked" in text:
        return f"exit code {run.returncode}: {text}"
    if images(folder) != sound:
        return f"another image after {signals}: {text}"
    left = sorted(set(os.listdir(folder)) - {"scene.toml", "cornell.obj", "cornell.mtl", "a.exr", "a.png", "a.exr.state"})
    if left:
        return f"left: {left}"
    shutil.rmtree(folder)
    return None


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--passes", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--minutes", type=float, default=1e9, help="no run begins later")
    options = parser.parse_args()
    program = str(Path(options.program).resolve())
    rng = random.Random(options.seed)
    tally = collections.Counter()
    wrong = done = 0
    with tempfile.TemporaryDirectory() as parent:
        os.environ["XDG_CACHE_HOME"] = parent
        folder = fresh(parent)
        # The first run fills the caches; the second tells how long one takes.
        for _ in range(2):
            for name in ("a.exr", "a.png", "a.exr.state"):
                (folder / name).unlink(missing_ok=True)
            start = time.monotonic()
            run = command(program, folder, options.passes)
            text = run.communicate()[0].decode(errors="replace")
            seconds = time.monotonic() - start
            if run.returncode != 0:
                sys.exit(f"the unbroken run failed: {text}")
        sound = images(folder)
        print(f"an unbroken run of {options.passes} passes takes {seconds:.2f} s", flush=True)
        end = time.monotonic() + 60 * options.minutes
        while done < options.runs and time.monotonic() < end:
            problem = broken(program, parent, options.passes, seconds, rng, sound, tally)
            if problem:
                wrong += 1
                print(f"run {done}: {problem}", flush=True)
            done += 1
            if done % 10 == 0:
                print(f"{done - wrong} of {done} equal so far, {dict(sorted(tally.items()))}", flush=True)
    for what, count in sorted(tally.items()):
        print(f"{count:5} {what}")
    print(f"{done - wrong} of {done} images equal the unbroken one")
    sys.exit(1 if wrong else 0)


main()
