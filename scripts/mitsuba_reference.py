#!/usr/bin/env python3
"""Path-traced image of a scene by Mitsuba 3, as half-float EXR, for the tests that compare with an independent renderer.

    python3 -m venv venv && venv/bin/pip install mitsuba==3.9.1 numpy
    venv/bin/python scripts/mitsuba_reference.py SCENE.toml OUT.exr --spp 16384

Reads a scene description with model and camera and nothing else. Of the model's materials (OBJ, MTL) it knows Kd (diffuse), Ke
(emission from the front) and Pm 1 with Pr (metal: GGX of alpha Pr^2, Fresnel's term after Schlick over Kd); anything else is
refused. Segments of a path: 1 emitters alone, 2 direct light, 5 three further reflections.
"""
import argparse
import os
import tempfile
import tomllib

import mitsuba as mi
import numpy as np

KNOWN = {"Kd", "Ke", "Pm", "Pr", "illum"}


def words_of(path):
    """The lines of a file that say something, as lists of words."""
    with open(path) as file:
        lines = [line.split("#")[0].split() for line in file]
    return [words for words in lines if words]


def materials_of(path):
    """Materials by name, each a dictionary from keyword to numbers."""
    materials, current = {}, {}
    for keyword, *rest in words_of(path):
        if keyword == "newmtl":
            current = materials.setdefault(" ".join(rest), {})
        elif keyword in KNOWN:
            current[keyword] = [float(word) for word in rest]
        else:
            raise SystemExit(f"{path}: {keyword} is not known here")
    return materials


def rgb(value):
    return {"type": "rgb", "value": value}


def bsdf_of(material):
    colour = rgb(material.get("Kd", [0.8, 0.8, 0.8]))
    if "Pm" not in material:
        return {"type": "twosided", "inner": {"type": "diffuse", "reflectance": colour}}
    if material["Pm"] != [1.0]:
        raise SystemExit("of metals, only Pm 1 is known here")
    metal = {"type": "principled", "base_color": colour, "metallic": 1.0, "roughness": material["Pr"][0]}
    return {"type": "twosided", "inner": metal}


def shapes_of(model, folder):
    """Shapes of an OBJ model, one for each material; their files go into a folder."""
    vertices, faces, materials, name = [], {}, {}, ""
    for keyword, *rest in words_of(model):
        if keyword == "v":
            vertices.append(" ".join(["v", *rest]))
        elif keyword == "mtllib":
            materials |= materials_of(os.path.join(os.path.dirname(model), " ".join(rest)))
        elif keyword == "usemtl":
            name = " ".join(rest)
        elif keyword == "f":
            corners = [corner.split("/")[0] for corner in rest]
            # Triangles of a fan: Mitsuba wants no larger polygons than quadrilaterals.
            for second, third in zip(corners[1:], corners[2:]):
                faces.setdefault(name, []).append(f"f {corners[0]} {second} {third}")
    shapes = {}
    for number, (name, lines) in enumerate(faces.items()):
        file = os.path.join(folder, f"{number}.obj")
        with open(file, "w") as out:
            out.write("\n".join(vertices + lines) + "\n")
        shape = {"type": "obj", "filename": file, "face_normals": True, "bsdf": bsdf_of(materials[name])}
        if max(materials[name].get("Ke", [0.0])) > 0.0:
            shape["emitter"] = {"type": "area", "radiance": rgb(materials[name]["Ke"])}
        shapes[f"shape{number}"] = shape
    return shapes


def scene_of(description, max_depth, folder):
    with open(description, "rb") as file:
        text = tomllib.load(file)
    camera = text["camera"]
    width, height = camera["resolution"]
    view = mi.ScalarTransform4f().look_at(camera["eye"], camera["target"], camera.get("up", [0.0, 1.0, 0.0]))
    film = {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}, "pixel_format": "rgb"}
    sensor = {"type": "perspective", "fov": camera["fov_y"], "fov_axis": "y", "to_world": view, "film": film}
    integrator = {"type": "path", "max_depth": max_depth, "rr_depth": 1000}
    model = os.path.join(os.path.dirname(os.path.abspath(description)), text["model"])
    return mi.load_dict({"type": "scene", "integrator": integrator, "sensor": sensor} | shapes_of(model, folder))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("out")
    parser.add_argument("--spp", type=int, default=1024, help="paths for each pixel, a multiple of 64")
    parser.add_argument("--max-depth", type=int, default=5)
    parser.add_argument("--seed", type=int, default=0, help="another one gives an independent image")
    arguments = parser.parse_args()
    mi.set_variant("llvm_ad_rgb" if os.environ.get("DRJIT_LIBLLVM_PATH") else "scalar_rgb")
    with tempfile.TemporaryDirectory() as folder:
        scene = scene_of(arguments.scene, arguments.max_depth, folder)
        rounds, total = max(1, arguments.spp // 64), 0.0
        for i in range(rounds):
            total = total + np.array(mi.render(scene, spp=64, seed=arguments.seed * 1000003 + i), dtype=np.float64)
    image = (total / rounds).astype(np.float32)
    mi.Bitmap(image).convert(component_format=mi.Struct.Type.Float16).write(arguments.out)
    print("mean radiance", image.mean(axis=(0, 1)))


if __name__ == "__main__":
    main()
