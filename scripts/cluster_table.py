#!/usr/bin/env python3
"""What a cluster costs: processor seconds, bytes and the master's time for each frame, at 1 to 16 clients (tables of docs/cluster.md).

    cargo build --release --features mpi
    scripts/cluster_table.py target/release/lightsum --clients 1,2,4,8,16 --frames 32

Every client is a rank with one thread for the driver (LP_NUM_THREADS=1): a core of a cluster. A frame is one pass of `--preset interactive`,
in which the camera moves, sent as PNG. A film is that of the same passes by `render`, handed over once by every client.

The model: seconds = frames * work / min(clients, cores) + frames * (master + bytes / bandwidth), with work, master and bytes for a frame as measured with
one client. The prediction for this machine has its number of cores, the master among them, and no network; that for a cluster has a core for
each client and a bandwidth (--bandwidth, bytes a second).
"""

import argparse
import json
import os
import subprocess
import tempfile
import time
from pathlib import Path

SCENES = ["scenes/cornell/scene.toml", "scenes/glass-ball/scene.toml", "scenes/indirect-room/scene.toml"]


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


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("--scenes", nargs="+", default=SCENES)
    parser.add_argument("--clients", default="1,2,4,8,16")
    parser.add_argument("--frames", type=int, default=32)
    parser.add_argument("--resolution", default="640x480")
    parser.add_argument("--bandwidth", type=float, default=117e6, help="bytes a second into the master (default: 1 Gbit/s)")
    arguments = parser.parse_args()
    program = str(Path(arguments.program).resolve())
    width, height = (int(n) for n in arguments.resolution.split("x"))
    cores = os.cpu_count()
    print("| scene | clients | processor s/frame | bytes/pixel | master ms/frame | frames/s | model | cluster |")
    print("|---|---|---|---|---|---|---|---|")
    for scene in arguments.scenes:
        fitted = None
        for clients in (int(n) for n in arguments.clients.split(",")):
            with tempfile.TemporaryDirectory() as folder:
                common = [scene, "--resolution", arguments.resolution, "--preset", "interactive"]
                timings = Path(folder) / "t.json"
                run(program, clients + 1, ["animate", *common, "--path", str(path_file(folder, arguments.frames)), "-o",
                                           f"{folder}/%d.png", "--moving-passes", "1", "--timings", str(timings)])
                told = json.loads(timings.read_text())
                work = sum(rank["work"]["processor"] for rank in told["ranks"]) / arguments.frames
                master, size = told["master"]["processor"] / arguments.frames, told["master"]["bytes"] / arguments.frames
                fitted = fitted or (work, master, size)

                def predicted(cores, bandwidth):
                    w, m, b = fitted
                    return 1.0 / (w / cores + m + b / bandwidth)

                print(f"| {Path(scene).parent.name} | {clients} | {work:.3f} | {size / width / height:.2f} | {1e3 * master:.2f} | "
                      f"{arguments.frames / told['master']['wall']:.2f} | {predicted(min(clients, cores), 1e12):.2f} | "
                      f"{predicted(clients, arguments.bandwidth):.2f} |", flush=True)
        _, master, size = fitted
        seconds = master + size / arguments.bandwidth
        print(f"{Path(scene).parent.name}: the master takes {width * height / master / 1e6:.1f} Mpixel/s, with the network "
              f"{width * height / seconds / 1e6:.1f} Mpixel/s", flush=True)
    print("\n| scene | clients | films | bytes/pixel of a film | merging, Mpixel/s | processor s/pass | passes/s |")
    print("|---|---|---|---|---|---|---|")
    for scene in arguments.scenes:
        for clients in (int(n) for n in arguments.clients.split(",")):
            with tempfile.TemporaryDirectory() as folder:
                stats = Path(folder) / "s.json"
                run(program, clients + 1, ["render", scene, "--resolution", arguments.resolution, "--preset", "interactive", "--passes",
                                           str(arguments.frames), "--checkpoint", "off", "-o", f"{folder}/a.exr", "--stats", str(stats)])
                told = json.loads(stats.read_text())
                master = told["master"]
                work = sum(rank["work"]["processor"] for rank in told["ranks"]) / arguments.frames
                pixels = width * height * master["films"]
                print(f"| {Path(scene).parent.name} | {clients} | {master['films']} | {master['film_bytes'] / pixels:.0f} | "
                      f"{pixels / 1e6 / master['merging']:.1f} | {work:.3f} | {arguments.frames / master['wall']:.2f} |", flush=True)


if __name__ == "__main__":
    main()
