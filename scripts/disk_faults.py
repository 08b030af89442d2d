#!/usr/bin/env python3
"""Takes the disk away from renderings, bakes and animations, and looks at what they leave.

    scripts/disk_faults.py target/release/lightsum --steps 12

Each work runs on a file system in memory with too little room (mounting it needs root), under a limit on the size of files (ulimit -f), and with its
folder removed at a random moment. It must end with exit code 0 and the files of an undisturbed run, or with exit code 1, an error, and
whole files or none. A rendering that tells where its state is must go on from there to the image of the undisturbed run. Prints counts; exit code 1 if
anything is wrong.
"""

import argparse
import collections
import os
import random
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

SCENE = Path(__file__).resolve().parent.parent / "scenes" / "cornell"
PATH = "frames = 4\n[[camera]]\ntime = 0.0\neye = [278.0, 273.0, -800.0]\n[[camera]]\ntime = 1.0\neye = [300.0, 273.0, -800.0]\n"
RENDER = ["render", "SCENE", "-o", "a.exr", "--resolution", "64x48", "--particles", "8", "--passes", "12", "--checkpoint", "0.000001"]
WORKS = {
    "rendering": RENDER,
    "bake": ["bake", "SCENE", "-o", "a.glb", "--particles", "8", "--density", "0.02", "--passes", "3", "--checkpoint", "0.000001"],
    "animation": ["animate", "SCENE", "--path", "PATH", "-o", "a%d.png", "--resolution", "64x48", "--particles", "8", "--moving-passes", "1"],
}


class Runs:
    def __init__(self, program, home):
        self.program, self.home = program, home
        for name in ("scene.toml", "cornell.obj", "cornell.mtl"):
            shutil.copy(SCENE / name, home)
        (home / "path.toml").write_text(PATH)
        os.environ["XDG_CACHE_HOME"] = str(home / "cache")

    def start(self, work, folder, extra=(), limit=None, temporary=None):
        names = {"SCENE": str(self.home / "scene.toml"), "PATH": str(self.home / "path.toml")}
        arguments = [names.get(word, word) for word in [*WORKS[work], *extra]]
        environment = dict(os.environ, TMPDIR=str(temporary)) if temporary else None
        bound = (lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))) if limit else None
        return subprocess.Popen(
            [self.program, *arguments], cwd=folder, env=environment, preexec_fn=bound, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
        )


def files(folder):
    return {p.name: p.read_bytes() for p in sorted(folder.iterdir()) if p.is_file()} if folder.is_dir() else {}


def judge(runs, work, sound, folder, temporary, run, tally, what):
    """What is wrong with a run that has ended."""
    text = run.communicate()[0].decode(errors="replace")
    left = files(folder)
    states = {name: left.pop(name) for name in list(left) if name.endswith(".state")}
    tally[f"{work}, {what}: exit code {run.returncode}"] += 1
    if "panicked" in text or run.returncode not in (0, 1):
        return f"exit code {run.returncode}: {text}"
    if run.returncode == 0:
        return None if left == sound or what == "folder removed" else f"other files: {sorted(left)}"
    if "error: " not in text:
        return f"no error: {text}"
    parts = [name for name, data in left.items() if name.endswith(".tmp") or work != "rendering" and sound.get(name) != data]
    if parts:
        return f"left {parts}: {text}"
    told = re.search(r"state after \d+ pass(?:es)? is in ([^;]+);", text)
    if work == "rendering" and told:
        place = Path(told[1]) if os.path.isabs(told[1]) else folder / told[1]
        state = states.get(place.name) or (place.read_bytes() if place.exists() else None)
        if state is None:
            return f"no state at {place}: {text}"
        with tempfile.TemporaryDirectory() as again:
            again = Path(again)
            (again / "a.exr.state").write_bytes(state)
            resumed = runs.start(work, again, ["--resume"])
            output = resumed.communicate()[0].decode(errors="replace")
            if resumed.returncode != 0 or files(again).get("a.exr") != sound["a.exr"]:
                return f"does not go on: {output}"
        tally[f"{work}, {what}: gone on from the state"] += 1
    return None


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("--steps", type=int, default=12, help="limits of each kind, and removals, of each work")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rng, tally, wrong = random.Random(options.seed), collections.Counter(), []
    with tempfile.TemporaryDirectory() as home:
        home = Path(home)
        runs = Runs(str(Path(options.program).resolve()), home)
        for work in WORKS:
            out, temporary = home / f"{work}-out", home / f"{work}-tmp"
            temporary.mkdir()
            for _ in range(2):
                # The first run fills the caches.
                shutil.rmtree(out, ignore_errors=True)
                out.mkdir()
                start = time.monotonic()
                run = runs.start(work, out)
                text = run.communicate()[0].decode(errors="replace")
                seconds = time.monotonic() - start
                if run.returncode != 0:
                    sys.exit(f"the undisturbed {work} failed: {text}")
            sound = {name: data for name, data in files(out).items() if not name.endswith(".state")}
            largest, total = max(map(len, sound.values())), sum(map(len, sound.values()))
            for step in range(options.steps):
                share = (step + 0.5) / options.steps
                for what in ("full disk", "limited files", "folder removed"):
                    folder = home / "run"
                    shutil.rmtree(folder, ignore_errors=True)
                    folder.mkdir()
                    mounted = False
                    if what == "full disk":
                        # Tables of files and the state take room as well; pages are of 4 KiB.
                        room = 4096 * (2 + int(3 * total * share) // 4096)
                        mount = ["mount", "-t", "tmpfs", "-o", f"size={room}", "tmpfs", str(folder)]
                        mounted = subprocess.run(mount, capture_output=True).returncode == 0
                        if not mounted:
                            tally["full disk: not run, it needs root"] += 1
                            continue
                    limit = max(int(1.2 * largest * share), 512) if what == "limited files" else None
                    run = runs.start(work, folder, limit=limit, temporary=temporary)
                    if what == "folder removed":
                        time.sleep(rng.uniform(0, seconds))
                        shutil.rmtree(folder, ignore_errors=True)
                    problem = judge(runs, work, sound, folder, temporary, run, tally, what)
                    if mounted:
                        subprocess.run(["umount", str(folder)], check=True)
                    if problem:
                        wrong.append(f"{work}, {what}, {share:.2f}: {problem}")
    for what, count in sorted(tally.items()):
        print(f"{count:5} {what}")
    for line in wrong:
        print(f"wrong: {line}")
    sys.exit(1 if wrong else 0)


main()
