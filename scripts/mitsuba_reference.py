#!/usr/bin/env python3
"""Path-traced image of a scene by Mitsuba 3, as half-float EXR, for comparisons with an independent renderer.

    python3 -m venv venv && venv/bin/pip install mitsuba==3.9.1 numpy
    venv/bin/python scripts/mitsuba_reference.py SCENE.toml OUT.exr --spp 16384

Renders a scene of its own kind (.xml) as it stands; --resolution sets its parameters `width` and `height`, and --max-depth does not
count. Else it reads a scene description with model and camera and nothing else. Of the model's materials (OBJ, MTL) it knows Kd and map_Kd (diffuse), Ke
(emission from the front), Ks with illum 3 or 5 (an ideal mirror by Schlick's term over a diffuse base, which is added to Mitsuba), illum 6 and 7 with Ni (smooth glass), and Pm 1 with Pr
(metal: GGX of alpha Pr^2, Fresnel's term after Schlick over Kd, or over Ks where Kd is 0). Tints of glass, coats and half metals are
refused, and opacity does not count; --plain FOLDER writes a copy of the scene without them, for both renderers. Segments of a path: 1 emitters alone, 2 direct
light, 5 three further reflections. With an LLVM library (DRJIT_LIBLLVM_PATH) it is some ten times faster.
"""
import argparse
import os
import pathlib
import shutil
import tempfile
import tomllib

import drjit as dr
import mitsuba as mi
import numpy as np

NUMBERS = {"Kd", "Ke", "Ks", "Ni", "Pm", "Pr", "Tf", "illum"}
IGNORED = {"Ka", "Ns", "d"}
MIRRORS, GLASS = (3, 5), (6, 7)


def words_of(path):
    """The lines of a file that say something, as lists of words."""
    with open(path) as file:
        lines = [line.split("#")[0].split() for line in file]
    return [words for words in lines if words]


def materials_of(path):
    """Materials by name, each a dictionary from keyword to numbers, or to the file of a texture."""
    materials, current = {}, {}
    for keyword, *rest in words_of(path):
        if keyword == "newmtl":
            current = materials.setdefault(" ".join(rest), {})
        elif keyword in NUMBERS:
            current[keyword] = [float(word) for word in rest]
        elif keyword == "map_Kd":
            current[keyword] = os.path.join(os.path.dirname(path), " ".join(rest))
        elif keyword not in IGNORED:
            raise SystemExit(f"{path}: {keyword} is not known here")
    return materials


def kind_of(material):
    return int(material.get("illum", [2])[0])


def is_metal(material):
    return material.get("Pm") == [1.0] and kind_of(material) not in MIRRORS + GLASS


def is_coated(material):
    """Lambert below a lobe of Ks, which the two renderers put together differently."""
    return kind_of(material) == 2 and not is_metal(material) and max(material.get("Ks", [0.0])) > 0.0


def rgb(value):
    return {"type": "rgb", "value": value}


def bsdf_of(name, material):
    kind = kind_of(material)
    if kind in GLASS:
        if "Tf" in material and material["Tf"] != [1.0, 1.0, 1.0]:
            raise SystemExit(f"{name}: tints of glass are not known here; --plain writes a copy without")
        return {"type": "dielectric", "int_ior": material.get("Ni", [1.5])[0], "ext_ior": 1.0}
    kd = material.get("Kd", [0.0] * 3 if kind in MIRRORS else [0.8] * 3)
    if is_metal(material):
        colour = rgb(kd if max(kd) > 0.0 else material.get("Ks", [0.0] * 3))
        metal = {"type": "principled", "base_color": colour, "metallic": 1.0, "roughness": material["Pr"][0]}
        return {"type": "twosided", "inner": metal}
    if is_coated(material):
        raise SystemExit(f"{name}: Ks of illum 2 without Pm 1 is not known here; --plain writes a copy without")
    diffuse = {"type": "diffuse", "reflectance": rgb(kd)}
    if "map_Kd" in material:
        diffuse["reflectance"] = {"type": "bitmap", "filename": material["map_Kd"]}
    if kind not in MIRRORS:
        return {"type": "twosided", "inner": diffuse}
    ks = material.get("Ks", [1.0] * 3)
    return {"type": "twosided", "inner": {"type": "mirror_over_base", "base": diffuse["reflectance"], "f0": rgb(ks)}}


def register_mirror_over_base():
    """A material that Mitsuba lacks: an ideal mirror by Schlick's term over a diffuse base, as ours (src/bsdf.rs)."""

    class MirrorOverBase(mi.BSDF):
        def __init__(self, props):
            mi.BSDF.__init__(self, props)
            self.base, self.f0 = props["base"], mi.Color3f(props["f0"])
            self.f90 = mi.Float(min(50.0 * float(max(props["f0"])), 1.0))
            front = mi.BSDFFlags.FrontSide
            self.m_components = [mi.BSDFFlags.DiffuseReflection | front, mi.BSDFFlags.DeltaReflection | front]
            self.m_flags = self.m_components[0] | self.m_components[1]

        def mirrored(self, cos):
            return self.f0 + (self.f90 - self.f0) * (1.0 - cos) ** 5

        def diffuse(self, si, active):
            base = self.base.eval(si, active) if isinstance(self.base, mi.Texture) else mi.Color3f(self.base)
            return base * (1.0 - self.f0 - (self.f90 - self.f0) / 21.0)

        def share(self, si, active):
            """The probability of the mirror."""
            mirrored = mi.luminance(self.mirrored(mi.Frame3f.cos_theta(si.wi)))
            return mirrored / (mirrored + mi.luminance(self.diffuse(si, active)))

        def sample(self, ctx, si, sample1, sample2, active=True):
            cos = mi.Frame3f.cos_theta(si.wi)
            active &= cos > 0.0
            share = self.share(si, active)
            ideal = sample1 < share
            bs = mi.BSDFSample3f()
            bs.wo = dr.select(ideal, mi.reflect(si.wi), mi.warp.square_to_cosine_hemisphere(sample2))
            bs.pdf = dr.select(ideal, share, (1.0 - share) * mi.warp.square_to_cosine_hemisphere_pdf(bs.wo))
            bs.eta = 1.0
            bs.sampled_component = dr.select(ideal, mi.UInt32(1), mi.UInt32(0))
            bs.sampled_type = dr.select(ideal, mi.UInt32(+mi.BSDFFlags.DeltaReflection), mi.UInt32(+mi.BSDFFlags.DiffuseReflection))
            value = dr.select(ideal, self.mirrored(cos) / share, self.diffuse(si, active) / (1.0 - share))
            return bs, value & (active & (bs.pdf > 0.0))

        def eval(self, ctx, si, wo, active=True):
            cos = mi.Frame3f.cos_theta(wo)
            active &= (mi.Frame3f.cos_theta(si.wi) > 0.0) & (cos > 0.0)
            return (self.diffuse(si, active) * cos / dr.pi) & active

        def pdf(self, ctx, si, wo, active=True):
            active &= (mi.Frame3f.cos_theta(si.wi) > 0.0) & (mi.Frame3f.cos_theta(wo) > 0.0)
            return dr.select(active, (1.0 - self.share(si, active)) * mi.warp.square_to_cosine_hemisphere_pdf(wo), 0.0)

        def eval_pdf(self, ctx, si, wo, active=True):
            return self.eval(ctx, si, wo, active), self.pdf(ctx, si, wo, active)

        def eval_diffuse_reflectance(self, si, active=True):
            return self.diffuse(si, active)

        def to_string(self):
            return "MirrorOverBase[]"

    mi.register_bsdf("mirror_over_base", MirrorOverBase)


def shapes_of(model, folder, face_normals):
    """Shapes of an OBJ model, one for each material; their files go into a folder."""
    heads, faces, smooth, materials, name = [], {}, {}, {}, ""
    for keyword, *rest in words_of(model):
        if keyword in ("v", "vt", "vn"):
            heads.append(" ".join([keyword, *rest]))
        elif keyword == "mtllib":
            materials |= materials_of(os.path.join(os.path.dirname(model), " ".join(rest)))
        elif keyword == "usemtl":
            name = " ".join(rest)
        elif keyword == "f":
            smooth[name] = smooth.get(name, True) and all(corner.count("/") == 2 for corner in rest)
            # Triangles of a fan: Mitsuba wants no larger polygons than quadrilaterals.
            for second, third in zip(rest[1:], rest[2:]):
                faces.setdefault(name, []).append(f"f {rest[0]} {second} {third}")
    shapes = {}
    for number, (name, lines) in enumerate(faces.items()):
        file = os.path.join(folder, f"{number}.obj")
        with open(file, "w") as out:
            out.write("\n".join(heads + lines) + "\n")
        material = materials.get(name, {})
        flat = face_normals or not smooth[name]
        shape = {"type": "obj", "filename": file, "face_normals": flat, "bsdf": bsdf_of(name, material)}
        if max(material.get("Ke", [0.0])) > 0.0:
            shape["emitter"] = {"type": "area", "radiance": rgb(material["Ke"])}
        shapes[f"shape{number}"] = shape
    return shapes


def plain_line(words, material):
    """A line of a material library without what only one of the renderers knows."""
    if words[0] == "Tf" or words[0] == "Ks" and is_coated(material):
        return f"{words[0]} {'1 1 1' if words[0] == 'Tf' else '0 0 0'}"
    if words[0] == "Pm" and not is_metal(material):
        return "Pm 0"
    if words[0] == "d":
        return "d 1"
    return " ".join(words)


def write_plain(description, folder):
    """Writes a copy of a scene for both renderers into a folder, with links to the files that stay as they are."""
    source, folder = pathlib.Path(description).resolve(), pathlib.Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    for file in source.parent.iterdir():
        copy = folder / file.name
        copy.unlink(missing_ok=True)
        if file.is_dir():
            shutil.copytree(file, copy, dirs_exist_ok=True)
            continue
        if file.suffix != ".mtl":
            # A link would lead out of the folder, where lightsum reads nothing.
            shutil.copy(file, copy)
            continue
        materials, name, lines = materials_of(file), "", []
        for words in words_of(file):
            name = " ".join(words[1:]) if words[0] == "newmtl" else name
            lines.append(plain_line(words, materials.get(name, {})))
        copy.write_text("\n".join(lines) + "\n")
    print(folder / source.name)


def description_of(description, max_depth, folder, size=None):
    """The scene as a dictionary in Mitsuba's terms."""
    with open(description, "rb") as file:
        text = tomllib.load(file)
    camera = text["camera"]
    width, height = size or camera["resolution"]
    view = mi.ScalarTransform4f().look_at(camera["eye"], camera["target"], camera.get("up", [0.0, 1.0, 0.0]))
    film = {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}, "pixel_format": "rgb"}
    sensor = {"type": "perspective", "fov": camera["fov_y"], "fov_axis": "y", "to_world": view, "film": film}
    integrator = {"type": "path", "max_depth": max_depth, "rr_depth": 5}
    register_mirror_over_base()
    model = os.path.join(os.path.dirname(os.path.abspath(description)), text["model"])
    return {"type": "scene", "integrator": integrator, "sensor": sensor} | shapes_of(model, folder, text.get("face_normals", True))


def scene_of(description, max_depth, folder, size=None):
    return mi.load_dict(description_of(description, max_depth, folder, size))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("out", nargs="?")
    parser.add_argument("--spp", type=int, default=1024, help="paths for each pixel, a multiple of 64")
    parser.add_argument("--max-depth", type=int, default=16)
    parser.add_argument("--seed", type=int, default=0, help="another one gives an independent image")
    parser.add_argument("--resolution", help="in place of the scene's, as 640x480")
    parser.add_argument("--card", action="store_true", help="on a graphics card, by CUDA")
    parser.add_argument("--plain", metavar="FOLDER", help="write a copy of the scene for both renderers into a folder, and no image")
    arguments = parser.parse_args()
    if arguments.plain:
        return write_plain(arguments.scene, arguments.plain)
    if not arguments.out:
        parser.error("where does the image go?")
    size = [int(word) for word in arguments.resolution.split("x")] if arguments.resolution else None
    on_processor = "llvm_ad_rgb" if os.environ.get("DRJIT_LIBLLVM_PATH") else "scalar_rgb"
    mi.set_variant("cuda_ad_rgb" if arguments.card else on_processor)
    with tempfile.TemporaryDirectory() as folder:
        if arguments.scene.endswith(".xml"):
            scene = mi.load_file(arguments.scene, **(dict(zip(("width", "height"), map(str, size))) if size else {}))
        else:
            scene = scene_of(arguments.scene, arguments.max_depth, folder, size)
        rounds, total = max(1, arguments.spp // 64), 0.0
        for i in range(rounds):
            total = total + np.array(mi.render(scene, spp=64, seed=arguments.seed * 1000003 + i), dtype=np.float64)
    image = (total / rounds).astype(np.float32)
    mi.Bitmap(image).convert(component_format=mi.Struct.Type.Float16).write(arguments.out)
    print("mean radiance", image.mean(axis=(0, 1)))


if __name__ == "__main__":
    main()
