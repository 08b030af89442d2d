#!/usr/bin/env python3
"""Lets calls of Vulkan fail, one in each run, and counts what comes of it.

    scripts/faults.py                    # the next phase of 16 of each work
    scripts/faults.py --phases 16        # all that are left: every call of a rendering, a bake, an animation and an embedding
    scripts/faults.py --phases 16 bake   # every call of a bake

Phase P of S takes calls P, P + S, P + 2 S ..., each with one of OUT_OF_HOST_MEMORY, OUT_OF_DEVICE_MEMORY, DEVICE_LOST and, of waits, TIMEOUT in
turn. The runs and their checks are those of the test `faults::every_call_may_fail` (tests/cli/faults.rs). What is done is kept in
target/faults and not done again; remove the folder to start anew. Prints a table of all that is done; exit code 1 if anything is wrong.
"""

import argparse
import collections
import os
import re
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
WORKS = ["rendering", "bake", "animation", "embedding"]
LINE = re.compile(r"\b(\w+): (\d+) calls, (\d+) failed, (\d+) errors, (\d+) went on")


def run(test, work, phase, phases):
    """The text of a test for a phase of a work; `test`: the built tests of the command line, or None."""
    environment = dict(os.environ, LIGHTSUM_FAULT_WORK=work, LIGHTSUM_FAULT_FIRST=str(phase), LIGHTSUM_FAULT_STRIDE=str(phases))
    tests = [test] if test else ["cargo", "test", "--quiet", "--test", "cli", "--"]
    command = [*tests, "--ignored", "--nocapture", "--exact", "faults::every_call_may_fail"]
    done = subprocess.run(command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    return done.stdout


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--phases", type=int, default=1, help="phases of each work to run now")
    parser.add_argument("works", nargs="*", metavar="WORK", default=WORKS, help="of " + ", ".join(WORKS))
    parser.add_argument("--of", type=int, default=16, help="phases that all calls are divided into, 2 or more")
    parser.add_argument("--test", help="the built tests of the command line [default: cargo builds them]")
    options = parser.parse_args()
    folder = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "faults"
    folder.mkdir(parents=True, exist_ok=True)
    for work in options.works:
        left = [p for p in range(1, options.of + 1) if not (folder / f"{work}-{p}-of-{options.of}.txt").exists()]
        for phase in left[: options.phases]:
            start = time.monotonic()
            text = run(options.test, work, phase, options.of)
            (folder / f"{work}-{phase}-of-{options.of}.txt").write_text(text)
            told = LINE.search(text)
            print(f"phase {phase} of {work}: {told[0] if told else 'wrong'} ({time.monotonic() - start:.0f} s)", flush=True)
    wrong = 0
    print("\n| work | calls | made to fail | ended with an error | went on, same files | wrong |\n|---|---|---|---|---|---|")
    for work in WORKS:
        sums, calls, bad = collections.Counter(), 0, 0
        for file in sorted(folder.glob(f"{work}-*-of-{options.of}.txt")):
            told = LINE.search(file.read_text())
            if told is None:
                bad += 1
                print(f"wrong: {file}", file=sys.stderr)
                continue
            calls = int(told[2])
            sums.update(failed=int(told[3]), errors=int(told[4]), went_on=int(told[5]))
        wrong += bad
        print(f"| {work} | {calls:,} | {sums['failed']:,} | {sums['errors']:,} | {sums['went_on']:,} | {bad} |")
    sys.exit(1 if wrong else 0)


main()
