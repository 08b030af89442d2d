#!/usr/bin/env python3
"""Error against seconds beside Mitsuba's path tracer with Open Image Denoise, both in one run (the curves of docs/defaults.md).

    python3 -m venv venv && venv/bin/pip install mitsuba==3.9.1 pyoidn numpy OpenEXR matplotlib
    venv/bin/python scripts/mitsuba_reference.py SCENE.toml --plain /tmp/room
    for seed in 0 1; do venv/bin/python scripts/mitsuba_reference.py /tmp/room/scene.toml /tmp/$seed.exr --spp 256 --max-depth 5 --seed $seed; done
    venv/bin/python scripts/error_against_seconds.py /tmp/room/scene.toml /tmp/0.exr /tmp/1.exr --max-depth 5 --json room.json
    venv/bin/python scripts/error_against_seconds.py --plot curves.png room.json

Mitsuba takes its fast variant with an LLVM library (DRJIT_LIBLLVM_PATH), or with --card its variant for CUDA and the denoiser of OptiX,
each number of samples rendered once before it is timed. Seconds in the process: ours the stage "render", better of two
runs; the peer's rendering after one to compile its kernels, and the denoiser's own figure, its network loaded before. Whole processes
(--process): from the start of the program to its end, with warm caches, the peer as its program `mitsuba` on a scene in its own format, and
oidnDenoise after it. Errors are those of quality.py, each of one seed.
"""
import argparse
import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import time
from xml.etree import ElementTree

import numpy as np

from quality import read, weights

SAMPLES = (1, 2, 4, 8, 16, 64)
GUIDES = "albedo:albedo,normal:sh_normal"


class Errors:
    """Relative RMSE and energy against two references."""

    def __init__(self, first, second, without, percentile=99.5):
        self.first, self.second = read(first), read(second)
        luminance = (self.first + self.second).mean(axis=-1)
        self.counted = luminance <= np.percentile(luminance, percentile)
        height, width = luminance.shape
        for x0, y0, x1, y1 in without:
            self.counted[int(y0 * height) : int(y1 * height), int(x0 * width) : int(x1 * width)] = False
        self.weight = weights(self.first, self.second, self.counted)
        self.mean = (self.first + self.second)[self.counted].mean() / 2

    def row(self, who, setting, seconds, image):
        square = ((image - self.first) * (image - self.second) * self.weight)[self.counted].mean()
        row = {"who": who, "setting": setting, "seconds": round(seconds, 3), "relative_rmse": round(float(np.sqrt(max(square, 0))), 4)}
        row["energy"] = round(float(image[self.counted].mean() / self.mean), 4)
        print(" | ".join(map(str, row.values())), flush=True)
        return row


def ours(args, errors, folder):
    image, stats, rows = folder / "ours.exr", folder / "stats.json", []
    height, width, _ = errors.first.shape
    command = [args.lightsum, "render", args.scene, "-o", image, "--no-layers", "--stats", stats]
    command += ["--max-depth", str(args.max_depth), "--resolution", f"{width}x{height}"]
    settings = [("lightsum, shading rate 2", passes, ["--shading-rate", "2"]) for passes in args.half]
    settings += [("lightsum", passes, []) for passes in args.passes]
    settings += [("lightsum, no filter", passes, ["--filter", "off", "--compensation", "exact"]) for passes in args.unfiltered]
    for who, passes, flags in settings:
        seconds = []
        for _ in range(2):
            start = time.perf_counter()
            subprocess.run([*command, "--passes", str(passes), *flags], check=True, capture_output=True)
            whole = time.perf_counter() - start
            seconds.append(whole if args.process else json.loads(stats.read_text())["stages"]["render"])
        rows.append(errors.row(who, f"{passes} passes", min(seconds), read(image)))
    return rows


def write_pfm(path, image):
    with open(path, "wb") as file:
        file.write(b"PF\n%d %d\n-1.0\n" % (image.shape[1], image.shape[0]))
        file.write(np.ascontiguousarray(image[::-1], dtype="<f4").tobytes())


def denoised(image, folder):
    """The image of 9 channels (radiance, albedo, normal) denoised; seconds of the filter, and of the whole program."""
    import pyoidn

    program = pathlib.Path(pyoidn.__file__).parent / "oidn/bin/oidnDenoise"
    program.chmod(0o755)
    for name, first in (("hdr", 0), ("alb", 3), ("nrm", 6)):
        write_pfm(folder / f"{name}.pfm", image[..., first : first + 3])
    command = [program, "-o", folder / "out.pfm", "--threads", str(os.cpu_count())]
    for name in ("hdr", "alb", "nrm"):
        command += [f"--{name}", folder / f"{name}.pfm"]
    library = os.environ | {"LD_LIBRARY_PATH": str(program.parent.parent / "lib")}
    start = time.perf_counter()
    text = subprocess.run(command, check=True, capture_output=True, text=True, env=library)
    whole = time.perf_counter() - start
    seconds = max(float(x) for x in re.findall(r"msec=([0-9.]+)", text.stdout + text.stderr)) / 1000
    header, size, _, pixels = (folder / "out.pfm").read_bytes().split(b"\n", 3)
    width, height = map(int, size.split())
    return np.frombuffer(pixels, "<f4").reshape(height, width, 3)[::-1].astype(np.float64), seconds, whole


def peer_on_card(args, errors, folder):
    """Rows of the path tracer on a graphics card, alone and denoised, both timed until the card is done."""
    import drjit as dr
    import mitsuba as mi

    import mitsuba_reference

    mi.set_variant("cuda_ad_rgb")
    height, width, _ = errors.first.shape
    scene = mitsuba_reference.scene_of(args.scene, args.max_depth, str(folder), (width, height))
    path = {"type": "path", "max_depth": args.max_depth, "rr_depth": 5}
    integrator = mi.load_dict({"type": "aov", "aovs": GUIDES, "image": path})
    denoiser = mi.OptixDenoiser((width, height), albedo=True, normals=True)
    towards = scene.sensors()[0].world_transform().inverse()

    def timed(work):
        start = time.perf_counter()
        result = work()
        dr.eval(result)
        dr.sync_thread()
        return result, time.perf_counter() - start

    def filtered(image):
        return denoiser(image[..., :3], albedo=image[..., 3:6], normals=image[..., 6:9], to_sensor=towards)

    rows = []
    for samples in args.samples:
        for seed in (4, 5):
            image, seconds = timed(lambda: mi.render(scene, integrator=integrator, spp=samples, seed=seed))
            result, filtering = timed(lambda: filtered(image))
        rows.append(errors.row("path tracer", f"{samples} samples", seconds, np.array(image)[..., :3].astype(np.float64)))
        denoised = np.array(result)[..., :3].astype(np.float64)
        rows.append(errors.row("path tracer, denoised", f"{samples} samples", seconds + filtering, denoised))
    return rows


def peer(args, errors, folder):
    """Rows of the path tracer, alone and denoised."""
    if args.card:
        return peer_on_card(args, errors, folder)

    import mitsuba as mi

    import mitsuba_reference

    mi.set_variant("llvm_ad_rgb" if os.environ.get("DRJIT_LIBLLVM_PATH") else "scalar_rgb")
    height, width, _ = errors.first.shape
    scene = mitsuba_reference.scene_of(args.scene, args.max_depth, str(folder), (width, height))
    path = {"type": "path", "max_depth": args.max_depth, "rr_depth": 5}
    integrator = {"type": "aov", "aovs": GUIDES, "image": path}
    if args.process:
        description = write_scene(mi, scene, args, integrator, folder, (width, height))
    else:
        integrator = mi.load_dict(integrator)
        first = np.array(mi.render(scene, integrator=integrator, spp=1))
        denoised(first, folder)
    rows = []
    for samples in args.samples:
        start = time.perf_counter()
        if args.process:
            out = folder / "peer.exr"
            variant = ["-m", mi.variant()]
            program = pathlib.Path(sys.executable).parent / "mitsuba"
            subprocess.run([program, *variant, f"-Dspp={samples}", "-o", out, description], check=True, capture_output=True)
            seconds = time.perf_counter() - start
            image = np.concatenate([layer.astype(np.float64) for layer in layers(mi, out)], axis=-1)
        else:
            image = np.array(mi.render(scene, integrator=integrator, spp=samples, seed=5)).astype(np.float64)
            seconds = time.perf_counter() - start
        rows.append(errors.row("path tracer", f"{samples} samples", seconds, image[..., :3]))
        result, filtering, whole = denoised(image, folder)
        rows.append(errors.row("path tracer, denoised", f"{samples} samples", seconds + (whole if args.process else filtering), result))
    return rows


def layers(mi, path):
    """Radiance, albedo and normals of the path tracer's file."""
    found = dict(mi.Bitmap(str(path)).split())
    of = lambda names: next(np.array(found[name])[..., :3] for name in names if name in found)
    return of(("<root>", "image")), of(("albedo",)), of(("normal",))


def write_scene(mi, scene, args, integrator, folder, size):
    """The scene in Mitsuba's own format, its shapes as binary files, so that the program does not read more than it needs."""
    import mitsuba_reference

    description = mitsuba_reference.description_of(args.scene, args.max_depth, str(folder), size)
    meshes = {shape.id(): shape for shape in scene.shapes()}
    for name, shape in description.items():
        if isinstance(shape, dict) and shape.get("type") == "obj":
            if shape["bsdf"].get("inner", {}).get("type") == "mirror_over_base":
                raise SystemExit(f"{args.scene}: --process: the program mitsuba has no mirror as lightsum's")
            shape["filename"] = str(folder / f"{name}.ply")
            shape["type"] = "ply"
            meshes[name].write_ply(shape["filename"])
    description["integrator"] = integrator
    description["sensor"]["sampler"] = {"type": "independent", "sample_count": "$spp"}
    root = ElementTree.Element("scene", version="3.0.0")
    add_xml(root, {name: value for name, value in description.items() if name != "type"})
    path = folder / "scene.xml"
    ElementTree.ElementTree(root).write(path)
    return path


TAGS = {
    "path": "integrator", "aov": "integrator", "perspective": "sensor", "hdrfilm": "film", "box": "rfilter", "independent": "sampler",
    "ply": "shape", "area": "emitter", "bitmap": "texture",
}


def add_xml(element, values):
    """Adds a dictionary of Mitsuba's to an element of its scene format."""
    for name, value in values.items():
        if isinstance(value, dict) and value["type"] == "rgb":
            ElementTree.SubElement(element, "rgb", name=name, value=" ".join(map(str, np.broadcast_to(value["value"], 3))))
        elif isinstance(value, dict):
            tag = TAGS.get(value["type"], "bsdf")
            named = {"name": name} if tag in ("bsdf", "texture") else {}
            inner = ElementTree.SubElement(element, tag, type=value["type"], **named)
            add_xml(inner, {key: one for key, one in value.items() if key != "type"})
        elif hasattr(value, "matrix"):
            matrix = " ".join(map(str, np.array(value.matrix).ravel()))
            ElementTree.SubElement(ElementTree.SubElement(element, "transform", name=name), "matrix", value=matrix)
        else:
            kinds = {bool: "boolean", int: "integer", float: "float"}
            kind = "integer" if value == "$spp" else kinds.get(type(value), "string")
            ElementTree.SubElement(element, kind, name=name, value=str(value).lower() if kind == "boolean" else str(value))


def plot(files, out):
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    styles = {
        "lightsum": ("#c0392b", "o"), "path tracer, denoised": ("#2c3e50", "s"), "lightsum, shading rate 2": ("#af7ac5", "D"),
        "lightsum, no filter": ("#e59866", "v"), "path tracer": ("#95a5a6", "^"),
    }
    columns = min(len(files), 3)
    lines = -(-len(files) // columns)
    figure, axes = pyplot.subplots(lines, columns, figsize=(3.4 * columns, 2.9 * lines), sharey=True, squeeze=False)
    for axis in axes.flat[len(files) :]:
        axis.axis("off")
    for axis, file in zip(axes.flat, files):
        data = json.loads(pathlib.Path(file).read_text())
        for who, (colour, marker) in styles.items():
            points = [(row["seconds"], row["relative_rmse"]) for row in data["rows"] if row["who"] == who]
            if points:
                axis.plot(*zip(*points), color=colour, marker=marker, markersize=4, linewidth=1, label=who)
        least = min(row["seconds"] for row in data["rows"])
        limits = {"xlim": (0.15, 60)} if least > 0.1 else {}
        axis.set(xscale="log", yscale="log", title=data["title"], xlabel="seconds", ylim=(0.01, 2), **limits)
        axis.grid(True, which="both", linewidth=0.3)
    for line in axes:
        line[0].set_ylabel("relative RMSE")
    axes.flat[0].legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(out, dpi=100)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+", help="scene and two references; with --plot results in JSON")
    parser.add_argument("--max-depth", type=int, default=16)
    numbers = lambda text: [int(word) for word in text.split(",") if word]
    parser.add_argument("--passes", type=numbers, default=[1, 2, 4, 8, 16])
    parser.add_argument("--half", type=numbers, default=[1, 2], help="passes of renderings that light one point for each 2 x 2 pixels")
    parser.add_argument("--unfiltered", type=numbers, default=[], help="passes of renderings without the filter")
    parser.add_argument("--samples", type=numbers, default=SAMPLES)
    parser.add_argument("--process", action="store_true", help="seconds of whole processes")
    parser.add_argument("--card", action="store_true", help="the path tracer and its denoiser on a graphics card; not with --process")
    rectangle = lambda text: [float(word) for word in text.split(",")]
    parser.add_argument("--without", type=rectangle, action="append", default=[], metavar="X0,Y0,X1,Y1", help="a rectangle of the image that does not count, from 0,0 to 1,1")
    parser.add_argument("--title")
    parser.add_argument("--lightsum", default="target/release/lightsum")
    parser.add_argument("--json")
    parser.add_argument("--plot", metavar="OUT.png")
    args = parser.parse_args()
    if args.plot:
        return plot(args.files, args.plot)
    if len(args.files) != 3:
        parser.error("a scene and two references, please")
    args.scene, first, second = args.files
    if args.card and args.process:
        parser.error("--card has no figures of whole processes")
    errors = Errors(first, second, args.without)
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        rows = ours(args, errors, folder) + peer(args, errors, folder)
    if args.json:
        title = args.title or pathlib.Path(args.scene).resolve().parent.name
        pathlib.Path(args.json).write_text(json.dumps({"title": title, "process": args.process, "rows": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
