#!/usr/bin/env python3
"""Light maps by Blender's Cycles and by `lightsum bake` on the same texture coordinates: error against seconds (table of docs/bake.md).

    python3.11 -m venv venv && venv/bin/pip install bpy==5.0.1 OpenEXR numpy       # Blender as a Python module
    venv/bin/python scripts/blender_bake.py SCENE --diffuse /tmp/room               # if the scene has glass, mirrors or lobes: a copy without
    target/release/lightsum bake SCENE --passes 1 -o /tmp/room.glb --density D
    venv/bin/python scripts/blender_bake.py SCENE /tmp/room.glb --density D --samples 16,64,256 --passes 4,16,64

Cycles bakes the model that lightsum has written, with its texture coordinates of the maps, with diffuse materials of the same colours and textures and the
same emission, light without colour, on all cores, without a background. The references are two bakes by Cycles with other seeds, whose noise does not count:
the square of the error is the mean product of the differences from each, over the square of the light around the texel; a texel has at most 2, and the
worst 0.5 % of the texels are left out, and as many of the least products, since the noise of the references makes both. Texels without a
point on the model do not count, nor dark ones and those beside them: they lie below what stands on a surface, and lightsum fills them. Seconds are those of the operator `bake`, and of the whole `lightsum bake`.

The scene has to be diffuse, since Cycles bakes it so: --diffuse writes a copy of a scene with an OBJ model into a folder, without faces of glass and with the
diffuse part of other materials alone.
"""
import argparse
import json
import pathlib
import shutil
import struct
import subprocess
import sys
import tempfile
import time

import bpy
import numpy as np
import OpenEXR

sys.path.insert(0, str(pathlib.Path(__file__).parent))
from quality import weights

EMPTY = -1.0
# As of the error that lightsum estimates: the texels of the least error that count, and the greatest square of the error of a texel.
COUNTED, MOST = 0.995, 4.0


def document(glb):
    data = pathlib.Path(glb).read_bytes()
    (length,) = struct.unpack("<I", data[12:16])
    return json.loads(data[20 : 20 + length])


def plain_material(material, image):
    """Diffuse, with the colour and the emission that it has, and the image as the target of the bake."""
    nodes, links = material.node_tree.nodes, material.node_tree.links
    principled = nodes["Principled BSDF"]
    colour, strength = principled.inputs["Base Color"], principled.inputs["Emission Strength"].default_value
    glow = [x * strength for x in principled.inputs["Emission Color"].default_value[:3]]
    diffuse = nodes.new("ShaderNodeBsdfDiffuse")
    if colour.is_linked:
        links.new(colour.links[0].from_socket, diffuse.inputs["Color"])
    else:
        diffuse.inputs["Color"].default_value = colour.default_value
    emission, both = nodes.new("ShaderNodeEmission"), nodes.new("ShaderNodeAddShader")
    emission.inputs["Color"].default_value = (*glow, 1.0)
    # Emitters of the model shine from the front. The backs of its lamps and sheets lie apart from the fronts, so rays do not end on them at once.
    side, front = nodes.new("ShaderNodeNewGeometry"), nodes.new("ShaderNodeMath")
    front.operation = "SUBTRACT"
    front.inputs[0].default_value = 1.0
    links.new(side.outputs["Backfacing"], front.inputs[1])
    links.new(front.outputs[0], emission.inputs["Strength"])
    links.new(diffuse.outputs[0], both.inputs[0])
    links.new(emission.outputs[0], both.inputs[1])
    links.new(both.outputs[0], next(node for node in nodes if node.type == "OUTPUT_MATERIAL").inputs["Surface"])
    target = nodes.new("ShaderNodeTexImage")
    target.image = image
    nodes.active = target


def prepare(glb, size, bounces):
    set_of_maps = document(glb)["extras"]["lightsum"]["lightmap"]["tex_coord"]
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(glb))
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.use_denoising = False
    scene.cycles.max_bounces = scene.cycles.diffuse_bounces = bounces
    scene.cycles.sample_clamp_indirect = 0.0
    scene.render.bake.use_pass_direct = scene.render.bake.use_pass_indirect = True
    scene.render.bake.use_pass_color = False
    scene.render.bake.margin = 0
    scene.render.bake.use_clear = False
    scene.world = bpy.data.worlds.new("black")
    if scene.world.node_tree is None:
        scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.0
    image = bpy.data.images.new("light", *size, float_buffer=True, alpha=False)
    image.colorspace_settings.name = "Non-Color"
    for material in bpy.data.materials:
        if material.node_tree and "Principled BSDF" in material.node_tree.nodes:
            plain_material(material, image)
    # Objects whose sides are all dark have no texels, though perhaps texture coordinates.
    meshes = [o for o in bpy.data.objects if o.type == "MESH" and len(o.data.uv_layers) > set_of_maps]
    bpy.ops.object.select_all(action="DESELECT")
    for o in meshes:
        o.data.uv_layers[set_of_maps].name = "light map"
        o.select_set(True)
    bpy.context.view_layer.objects.active = meshes[0]
    # One object: Cycles bakes each by itself, and prepares the scene anew for it.
    bpy.ops.object.join()
    layers = bpy.context.view_layer.objects.active.data.uv_layers
    layers.active_index = layers.find("light map")
    return image


def lines_of(path):
    return path.read_text(errors="replace").splitlines()


def write_diffuse(description, folder):
    """Writes a copy of a scene without faces of glass, and with the diffuse part of other materials alone."""
    source, folder = pathlib.Path(description).resolve(), pathlib.Path(folder)
    for file in (file for file in source.parent.rglob("*") if file.is_file()):
        copy = folder / file.relative_to(source.parent)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, copy)
    glass, name = set(), ""
    for library in folder.glob("*.mtl"):
        lines = []
        for line in lines_of(library):
            keyword, *rest = line.split() or [""]
            if keyword == "newmtl":
                name = " ".join(rest)
            if keyword == "illum" and rest[0] in ("4", "6", "7"):
                glass.add(name)
            if keyword in ("newmtl", "Kd", "Ke", "map_Kd"):
                lines.append(line)
        library.write_text("\n".join(lines) + "\n")
    for model in folder.glob("*.obj"):
        lines = []
        for line in lines_of(model):
            keyword, *rest = line.split() or [""]
            if keyword == "usemtl":
                name = " ".join(rest)
            if keyword != "f" or name not in glass:
                lines.append(line)
        model.write_text("\n".join(lines) + "\n")
    print(folder / source.name, "without", ", ".join(sorted(glass)) or "changes of its faces")


def baked(image, samples, seed):
    """Irradiance of each texel, EMPTY where the model has no point; seconds."""
    width, height = image.size
    image.pixels.foreach_set(np.full(width * height * 4, EMPTY, dtype=np.float32))
    scene = bpy.context.scene
    scene.cycles.samples, scene.cycles.seed = samples, seed
    start = time.perf_counter()
    bpy.ops.object.bake(type="DIFFUSE")
    seconds = time.perf_counter() - start
    pixels = np.empty(width * height * 4, dtype=np.float32)
    image.pixels.foreach_get(pixels)
    pixels = pixels.reshape(height, width, 4)[::-1, :, :3].astype(np.float64)
    return np.where(pixels == EMPTY, EMPTY, np.pi * pixels), seconds


def ours(args, passes, folder):
    out = folder / "ours.glb"
    command = [args.lightsum, "bake", args.scene, "-o", out, "--density", str(args.density), "--passes", str(passes)]
    start = time.perf_counter()
    subprocess.run([*command, "--max-depth", str(args.max_depth), *args.flags], check=True, capture_output=True)
    return read_map(out), time.perf_counter() - start


def read_map(glb):
    (page,) = document(glb)["extras"]["lightsum"]["lightmap"]["pages"]
    with OpenEXR.File(str(pathlib.Path(glb).parent / page["irradiance"])) as file:
        channels = file.channels()
        name = next(name for name in ("RGBA", "RGB") if name in channels)
        return channels[name].pixels[..., :3].astype(np.float64) * 2.0 ** -page["exposure"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    numbers = lambda text: [int(word) for word in text.split(",")]
    parser.add_argument("scene")
    parser.add_argument("model", nargs="?", help="a bake of the scene by lightsum, whose map is one page")
    parser.add_argument("--density", type=float)
    parser.add_argument("--max-depth", type=int, default=16)
    parser.add_argument("--samples", type=numbers, default=[16, 64, 256])
    parser.add_argument("--passes", type=numbers, default=[4, 16, 64])
    parser.add_argument("--reference", type=int, default=1024, help="samples of each of the two references")
    parser.add_argument("--dark", type=float, default=0.01, help="part of the mean below which texels do not count")
    parser.add_argument("--lightsum", default="target/release/lightsum")
    parser.add_argument("--diffuse", metavar="FOLDER", help="write a diffuse copy of the scene into a folder, and bake nothing")
    parser.add_argument("--save", metavar="FOLDER", help="keep the references as NumPy files, or take them from there")
    end = sys.argv.index("--") if "--" in sys.argv else len(sys.argv)
    args = parser.parse_args(sys.argv[1:end])
    args.flags = sys.argv[end + 1 :]
    if args.diffuse:
        return write_diffuse(args.scene, args.diffuse)
    if not args.model or not args.density:
        parser.error("a model and --density are needed")
    height, width, _ = read_map(args.model).shape
    # A path of n segments from the eye has n - 1 after the texel, and Cycles counts the bounces between them.
    image = prepare(args.model, (width, height), args.max_depth - 2)
    saved = pathlib.Path(args.save) / f"{pathlib.Path(args.model).stem}-{args.reference}.npy" if args.save else None
    if saved and saved.exists():
        references = np.load(saved)
    else:
        references = np.array([baked(image, args.reference, seed)[0] for seed in (101, 102)])
        if saved:
            np.save(saved, references)
    first, second = references
    counted = (first > EMPTY).all(axis=-1)
    dark = counted & ((first + second).max(axis=-1) <= args.dark * (first + second)[counted].mean())
    padded = np.pad(dark, 1)
    beside = np.lib.stride_tricks.sliding_window_view(padded, (3, 3)).any(axis=(2, 3))
    counted &= ~beside
    first, second = np.where(counted[..., None], first, 0), np.where(counted[..., None], second, 0)
    weight = weights(first, second, counted)
    mean = (first + second)[counted].mean() / 2
    print(f"{int(counted.sum())} texels of {int((references[0] > EMPTY).all(axis=-1).sum())} on the model, of {width} x {height}")
    print("program | setting | seconds | relative RMSE | energy")

    def tell(program, setting, result):
        light, seconds = result
        squares = np.sort(((light - first) * (light - second) * weight)[counted].mean(axis=-1))
        most = int(np.ceil(COUNTED * squares.size))
        square = np.minimum(squares[squares.size - most : most], MOST).mean()
        print(f"{program} | {setting} | {seconds:.1f} | {np.sqrt(max(square, 0)):.4f} | {light[counted].mean() / mean:.4f}", flush=True)

    with tempfile.TemporaryDirectory() as name:
        for passes in args.passes:
            tell("lightsum", f"{passes} passes", ours(args, passes, pathlib.Path(name)))
    baked(image, 1, 0)
    for samples in args.samples:
        tell("Cycles", f"{samples} samples", baked(image, samples, 7))


if __name__ == "__main__":
    main()
