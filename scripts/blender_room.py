#!/usr/bin/env python3
"""Makes a furnished room with Blender as a Python module and exports it as glTF, as people export theirs.

    pip install bpy                        # Blender 5.0, Python 3.11
    python scripts/blender_room.py room.glb
    lightsum render room.glb -o room.png   # no other flag

The room has a point lamp, a spot, a sun through the window, an area lamp (which the exporter leaves out), a television with an emission
texture, a tiled floor, a window pane, a ball of glass, a metal ball and a painted teapot stand of a coat over colour. Lamps are in watts, as in
Blender's interface; the exporter writes candela and lux.
"""

import math
import sys

import bpy


def material(name, color, roughness=0.8, metallic=0.0, transmission=0.0, coat=0.0, image=None, glow=None):
    m = bpy.data.materials.new(name)
    m.use_nodes = True
    nodes, links = m.node_tree.nodes, m.node_tree.links
    bsdf = nodes["Principled BSDF"]
    bsdf.inputs["Base Color"].default_value = (*color, 1.0)
    bsdf.inputs["Roughness"].default_value = roughness
    bsdf.inputs["Metallic"].default_value = metallic
    bsdf.inputs["Transmission Weight"].default_value = transmission
    bsdf.inputs["Coat Weight"].default_value = coat
    for picture, socket, strength in ((image, "Base Color", None), (glow, "Emission Color", 4.0)):
        if picture is None:
            continue
        texture = nodes.new("ShaderNodeTexImage")
        texture.image = picture
        links.new(texture.outputs["Color"], bsdf.inputs[socket])
        if strength is not None:
            bsdf.inputs["Emission Strength"].default_value = strength
    return m


def picture(name, size, color_at):
    image = bpy.data.images.new(name, size, size)
    image.pixels = [c for y in range(size) for x in range(size) for c in (*color_at(x, y), 1.0)]
    image.pack()
    return image


def box(name, low, high, surface, inward=False):
    x, y, z = zip(low, high)
    corners = [(x[i & 1], y[i >> 1 & 1], z[i >> 2]) for i in range(8)]
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    if inward:
        faces = [face[::-1] for face in faces]
    return mesh(name, corners, faces, surface)


def mesh(name, corners, faces, surface, uvs=None):
    data = bpy.data.meshes.new(name)
    data.from_pydata(corners, [], faces)
    data.materials.append(surface)
    if uvs:
        layer = data.uv_layers.new()
        for loop in data.loops:
            layer.data[loop.index].uv = uvs[loop.vertex_index]
    thing = bpy.data.objects.new(name, data)
    bpy.context.collection.objects.link(thing)
    return thing


def quad(name, corners, surface, repeat=1.0):
    uvs = [(0, 0), (repeat, 0), (repeat, repeat), (0, repeat)]
    return mesh(name, corners, [(0, 1, 2, 3)], surface, uvs)


def ball(name, place, radius, surface):
    bpy.ops.mesh.primitive_uv_sphere_add(segments=48, ring_count=24, radius=radius, location=place)
    thing = bpy.context.object
    thing.name = name
    thing.data.materials.append(surface)
    bpy.ops.object.shade_smooth()


def lamp(name, kind, place, watts, turn=(0.0, 0.0, 0.0), **more):
    data = bpy.data.lights.new(name, kind)
    data.energy = watts
    for key, value in more.items():
        setattr(data, key, value)
    thing = bpy.data.objects.new(name, data)
    thing.location, thing.rotation_euler = place, turn
    bpy.context.collection.objects.link(thing)


def room():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    tiles = picture("tiles", 64, lambda x, y: (0.55, 0.33, 0.2) if (x // 32 + y // 32) % 2 else (0.8, 0.72, 0.6))
    show = picture("show", 32, lambda x, y: (0.9, 0.5, 0.1) if y < 12 else (0.1, 0.3, 0.8) if x > y else (0.0, 0.0, 0.0))
    wall, white = material("wall", (0.75, 0.72, 0.66)), material("ceiling", (0.85, 0.85, 0.85))
    floor = material("floor", (1, 1, 1), roughness=0.5, image=tiles)
    wood, paint = material("wood", (0.35, 0.2, 0.1), roughness=0.6), material("paint", (0.7, 0.05, 0.05), coat=1.0)
    metal, glass = material("metal", (0.9, 0.75, 0.5), 0.2, metallic=1.0), material("glass", (1, 1, 1), 0.0, transmission=1.0)
    screen = material("screen", (0.0, 0.0, 0.0), glow=show)

    # 5 m wide, 6 m deep, 2.6 m high, a window of 1.6 m x 1.2 m to the left.
    quad("floor", [(0, 0, 0), (5, 0, 0), (5, 6, 0), (0, 6, 0)], floor, repeat=5.0)
    quad("ceiling", [(0, 6, 2.6), (5, 6, 2.6), (5, 0, 2.6), (0, 0, 2.6)], white)
    quad("back", [(0, 6, 0), (5, 6, 0), (5, 6, 2.6), (0, 6, 2.6)], wall)
    quad("front", [(5, 0, 0), (0, 0, 0), (0, 0, 2.6), (5, 0, 2.6)], wall)
    quad("right", [(5, 6, 0), (5, 0, 0), (5, 0, 2.6), (5, 6, 2.6)], wall)
    for name, (y0, y1, z0, z1) in {
        "below": (0, 6, 0, 0.9), "above": (0, 6, 2.1, 2.6), "before": (0, 3, 0.9, 2.1), "behind": (4.6, 6, 0.9, 2.1),
    }.items():
        quad(f"left {name}", [(0, y0, z0), (0, y1, z0), (0, y1, z1), (0, y0, z1)], wall)
    quad("pane", [(0, 3, 0.9), (0, 4.6, 0.9), (0, 4.6, 2.1), (0, 3, 2.1)], glass)
    box("table", (1.6, 3.4, 0.68), (3.2, 4.4, 0.74), wood)
    for x, y in ((1.7, 3.5), (3.1, 3.5), (1.7, 4.3), (3.1, 4.3)):
        box("leg", (x - 0.04, y - 0.04, 0), (x + 0.04, y + 0.04, 0.68), wood)
    box("stand", (3.8, 5.2, 0.0), (4.7, 5.7, 0.6), paint)
    quad("television", [(3.75, 5.5, 0.7), (4.75, 5.5, 0.7), (4.75, 5.5, 1.3), (3.75, 5.5, 1.3)], screen)
    ball("metal ball", (2.0, 3.8, 0.94), 0.2, metal)
    ball("glass ball", (2.7, 3.8, 0.92), 0.18, glass)

    lamp("bulb", "POINT", (2.5, 2.5, 2.2), 60.0, color=(1.0, 0.85, 0.65))
    lamp("spot", "SPOT", (4.6, 4.0, 2.5), 80.0, turn=(0.0, math.radians(35), 0.0), spot_size=math.radians(50))
    lamp("sun", "SUN", (0, 0, 5), 3.0, turn=(0.0, math.radians(-60), 0.0))
    lamp("panel", "AREA", (1.0, 1.0, 2.5), 20.0)

    camera = bpy.data.cameras.new("camera")
    camera.angle = math.radians(70)
    eye = bpy.data.objects.new("camera", camera)
    eye.location, eye.rotation_euler = (2.3, 0.3, 1.5), (math.radians(83), 0.0, 0.0)
    bpy.context.collection.objects.link(eye)
    bpy.context.scene.camera = eye


def export(path):
    bpy.ops.export_scene.gltf(filepath=path, export_lights=True, export_cameras=True)


if __name__ == "__main__":
    room()
    export(sys.argv[1])
