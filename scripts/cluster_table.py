#!/usr/bin/env python3
"""What a cluster costs: processor seconds, bytes and the master's time for each frame, and frames a second by the model (tables of docs/cluster.md).

    cargo build --release --features mpi
    scripts/cluster_table.py target/release/lightsum --tasks packed-tiles --clients 1,2,4,8 --frames 8
    scripts/cluster_table.py target/release/lightsum --tasks frames --clients 1,2,4,8 --frames 32 --films

Every rank has one thread for the driver (LP_NUM_THREADS=1): a core of a cluster. A frame is one pass of `--preset interactive` without near light, in
which the camera moves, written as PNG. `--films` also times films of the same passes by `render`, handed over once by every client.

The model: ranks shade or render while the master filters or writes, so that

    seconds of a frame = max(work / clients, master + bytes / bandwidth, (work + master) / cores)

with work, master and bytes of a frame as fitted to what was measured: master and bytes are the means, work is a + b tasks, where b is what a task costs
beside its pixels. For this machine the number of cores is that which the script may use and the bandwidth endless; a cluster has a core for each rank, and a bandwidth
(--bandwidth, bytes a second).
"""

import argparse
import json
import os
import subprocess
import tempfile
import time
from pathlib import Path

SCENES = ["scenes/cornell/scene.toml", "scenes/glass-ball/scene.toml", "scenes/indirect-room/scene.toml"]
TABLE = [1, 2, 4, 8, 16]


def path_file(folder, frames):
    """A camera that is still where the scene has it, in frames between which it moves by a hair."""
    path = Path(folder) / "path.toml"
    path.write_text(f"frames = {frames}\n[[camera]]\ntime = 0\n[[camera]]\ntime = 1\nfov = 41\n")
    return path


def run(program, ranks, arguments):
    """Seconds of a run."""
    environment = dict(os.environ, LP_NUM_THREADS="1")
    line = ["mpirun", "--allow-run-as-root", "--oversubscribe", "--bind-to", "none", "-n", str(ranks), program, *arguments]
    start = time.monotonic()
    subprocess.run(line, env=environment, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    return time.monotonic() - start


def fit(xs, ys):
    """The line a + b x nearest to points; b is 0 where there is one x."""
    mean_x, mean_y = sum(xs) / len(xs), sum(ys) / len(ys)
    spread = sum((x - mean_x) ** 2 for x in xs)
    slope = sum((x - mean_x) * (y - mean_y) for x, y in zip(xs, ys)) / spread if spread > 0 else 0.0
    return mean_y - slope * mean_x, slope


def measure(program, scene, clients, options):
    """Seconds of work and of the master, bytes, tasks, and frames a second, of a frame."""
    with tempfile.TemporaryDirectory() as folder:
        timings = Path(folder) / "t.json"
        run(program, clients + 1, ["animate", scene, "--resolution", options.resolution, "--preset", "interactive", "--compensation", "off",
                                   "--superposition", "off", "--path", str(path_file(folder, options.frames)), "-o", f"{folder}/%d.png",
                                   "--moving-passes", "1", "--cluster-tasks", options.tasks, "--timings", str(timings)])
        told = json.loads(timings.read_text())
        ranks, master = [rank["work"] for rank in told["ranks"]], told["master"]
        of_frame = [sum(rank["processor"] for rank in ranks), master["processor"], master["bytes"], sum(rank["passes"] for rank in ranks)]
        return [value / options.frames for value in of_frame] + [options.frames / master["wall"]]


def films(program, scene, clients, options):
    """A line of the table of films."""
    width, height = (int(n) for n in options.resolution.split("x"))
    with tempfile.TemporaryDirectory() as folder:
        stats = Path(folder) / "s.json"
        run(program, clients + 1, ["render", scene, "--resolution", options.resolution, "--preset", "interactive", "--passes",
                                   str(options.frames), "--checkpoint", "off", "-o", f"{folder}/a.exr", "--stats", str(stats)])
        told = json.loads(stats.read_text())
        master = told["master"]
        work = sum(rank["work"]["processor"] for rank in told["ranks"]) / options.frames
        pixels = width * height * master["films"]
        return (f"| {Path(scene).parent.name} | {clients} | {master['films']} | {master['film_bytes'] / pixels:.0f} | "
                f"{pixels / 1e6 / master['merging']:.1f} | {work:.3f} | {options.frames / master['wall']:.2f} |")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("--tasks", choices=["frames", "tiles", "packed-tiles"], default="packed-tiles")
    parser.add_argument("--scenes", nargs="+", default=SCENES)
    parser.add_argument("--clients", default="1,2,4,8")
    parser.add_argument("--frames", type=int, default=8)
    parser.add_argument("--resolution", default="640x480")
    parser.add_argument("--bandwidth", type=float, default=117e6, help="bytes a second into the master (default: 1 Gbit/s)")
    parser.add_argument("--films", action="store_true", help="also the table of films")
    options = parser.parse_args()
    program = str(Path(options.program).resolve())
    width, height = (int(n) for n in options.resolution.split("x"))
    counts = [int(n) for n in options.clients.split(",")]
    here = len(os.sched_getaffinity(0))
    print("| scene | clients | tasks/frame | processor s/frame | bytes/pixel | master ms/frame | frames/s | model |")
    print("|---|---|---|---|---|---|---|---|")
    limits = []
    for scene in options.scenes:
        name = Path(scene).parent.name
        measured = [measure(program, scene, clients, options) for clients in counts]
        works, masters, sizes, tasks, speeds = (list(column) for column in zip(*measured))
        start, slope = fit(tasks, works)
        master, size = sum(masters) / len(masters), sum(sizes) / len(sizes)

        def predicted(clients, tasks, cores, bandwidth):
            work = start + slope * tasks
            return 1.0 / max(work / clients, master + size / bandwidth, (work + master) / cores)

        for clients, work, own, sent, count, speed in zip(counts, works, masters, sizes, tasks, speeds):
            print(f"| {name} | {clients} | {count:.0f} | {work:.3f} | {sent / width / height:.2f} | {1e3 * own:.1f} | {speed:.2f} | "
                  f"{predicted(clients, count, here, 1e12):.2f} |", flush=True)
        # The smallest number of bands of the nine classes that gives two tasks to each client.
        of = {clients: 1 if options.tasks == "frames" else 9 * -(-2 * clients // 9) for clients in TABLE}
        cells = [f"{predicted(clients, of[clients], 1e9, options.bandwidth):.1f}" for clients in TABLE]
        seconds = master + size / options.bandwidth
        limits.append(f"| {name} | {' | '.join(cells)} | {width * height / master / 1e6:.1f} | {width * height / seconds / 1e6:.1f} |")
    print(f"\n| scene | {' | '.join(f'{clients} clients' for clients in TABLE)} | master, Mpixel/s | with the network |")
    print("|---|" + "---|" * (len(TABLE) + 2))
    print("\n".join(limits), flush=True)
    if options.films:
        print("\n| scene | clients | films | bytes/pixel of a film | merging, Mpixel/s | processor s/pass | passes/s |")
        print("|---|---|---|---|---|---|---|")
        for scene in options.scenes:
            for clients in counts:
                print(films(program, scene, clients, options), flush=True)


if __name__ == "__main__":
    main()
