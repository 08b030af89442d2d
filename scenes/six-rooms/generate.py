#!/usr/bin/env python3
"""Writes house.glb: six furnished rooms of 140,812 triangles with five planar glossy reflectors.

Metres, y up. A piece of furniture is a mesh that several nodes place. Needs ../glossy-floor/generate.py.
"""
import importlib.util
import json
import math
import os
import random
import struct

FOLDER = os.path.dirname(os.path.abspath(__file__))
SPEC = importlib.util.spec_from_file_location('glossy_floor', os.path.join(FOLDER, '..', 'glossy-floor', 'generate.py'))
GLOSSY_FLOOR = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(GLOSSY_FLOOR)
INDIRECT_ROOM = GLOSSY_FLOOR.INDIRECT_ROOM
spline, rings = GLOSSY_FLOOR.spline, GLOSSY_FLOOR.rings

# A room is ROOM[0] by ROOM[1], from the middle of one wall to the middle of the next.
ROOM = (5.0, 4.5)
HEIGHT, DOOR_HEIGHT, HALF_WALL = 2.7, 2.1, 0.08
# What stands on or hangs at something is clear of it by this much.
CLEAR = 0.001

ROOMS = {  # name: column, row
    'hall': (0, 0), 'living': (1, 0), 'library': (2, 0), 'kitchen': (0, 1), 'dining': (1, 1), 'bedroom': (2, 1),
}

MATERIALS = {  # name: base colour, and what else differs from a diffuse surface
    'hall_wall': ((0.72, 0.68, 0.6),),
    'living_wall': ((0.74, 0.62, 0.46),),
    'library_wall': ((0.4, 0.52, 0.38),),
    'kitchen_wall': ((0.75, 0.7, 0.45),),
    'dining_wall': ((0.62, 0.36, 0.3),),
    'bedroom_wall': ((0.42, 0.52, 0.66),),
    'ceiling': ((0.82, 0.82, 0.8),),
    'tiles': ((0.5, 0.46, 0.42),),
    'carpet': ((0.45, 0.38, 0.32),),
    'reflector_1': ((0.2, 0.12, 0.07), {'roughness': 0.2, 'specular': 0.35}),
    'reflector_2': ((0.14, 0.1, 0.08), {'roughness': 0.3, 'specular': 0.4}),
    'reflector_3': ((0.25, 0.24, 0.22), {'roughness': 0.15, 'specular': 0.3}),
    'reflector_4': ((0.08, 0.05, 0.04), {'roughness': 0.1, 'specular': 0.45}),
    'reflector_5': ((0.06, 0.06, 0.07), {'roughness': 0.25, 'specular': 0.6}),
    'wood': ((0.5, 0.34, 0.2),),
    'dark_wood': ((0.22, 0.14, 0.1),),
    'cloth': ((0.55, 0.12, 0.1),),
    'linen': ((0.7, 0.68, 0.62),),
    'china': ((0.8, 0.8, 0.82),),
    'clay': ((0.6, 0.3, 0.18),),
    'teapot': ((0.25, 0.55, 0.5),),
    'metal': ((0.3, 0.3, 0.32),),
    'leaf': ((0.15, 0.35, 0.1),),
    'apple': ((0.6, 0.12, 0.08),),
    'orange': ((0.75, 0.35, 0.05),),
    'book_0': ((0.5, 0.15, 0.12),),
    'book_1': ((0.15, 0.2, 0.45),),
    'book_2': ((0.65, 0.6, 0.45),),
    'book_3': ((0.12, 0.3, 0.16),),
    'light': ((0.0, 0.0, 0.0), {'emission': (50.0, 44.0, 34.0)}),
    'ceiling_light': ((0.0, 0.0, 0.0), {'emission': (14.0, 13.2, 12.0)}),
}


class Model(GLOSSY_FLOOR.Model):
    def lathe(self, center, profile, segments):
        """Turned things of the other rooms, finer: smooth, and with twice the segments."""
        self.turned(center, profile, 2 * segments)

    def cushion(self, center, size, rings_up, segments):
        """A box with round edges: a superellipsoid with its centre and edge lengths."""
        def power(x):
            return math.copysign(abs(x) ** 0.5, x)

        rows = []
        for i in range(rings_up + 1):
            theta = math.pi * i / rings_up - math.pi / 2.0
            if i in (0, rings_up):
                rows.append([GLOSSY_FLOOR.add(center, (0.0, math.copysign(size[1] / 2.0, theta), 0.0))] * segments)
                continue
            row = []
            for j in range(segments):
                phi = 2.0 * math.pi * j / segments
                direction = (power(math.cos(theta)) * power(math.cos(phi)), power(math.sin(theta)),
                             power(math.cos(theta)) * power(math.sin(phi)))
                row.append(tuple(c + s / 2.0 * d for c, s, d in zip(center, size, direction)))
            rows.append(row)
        self.surface(rows)


def of(draw, *arguments):
    """The model that a function draws."""
    m = Model()
    draw(m, *arguments)
    return m


def chair(m):
    """A chair of turned wood that looks along z."""
    m.part('chair', 'dark_wood')
    leg = spline([(0.012, 0.0), (0.02, 0.06), (0.014, 0.1), (0.022, 0.25), (0.014, 0.36), (0.02, 0.44)], 3)
    for x in (-0.18, 0.18):
        for z in (-0.18, 0.18):
            m.turned((x, CLEAR, z), leg, 12)
    m.box((-0.22, 0.44, -0.22), (0.44, 0.03, 0.44))
    spindle = spline([(0.008, 0.0), (0.013, 0.12), (0.008, 0.22), (0.013, 0.32), (0.008, 0.44)], 2)
    for k in range(5):
        m.turned((-0.16 + 0.08 * k, 0.47, -0.19), spindle, 8)
    rail = rings(spline([(-0.23, 0.93, -0.17), (-0.12, 0.94, -0.2), (0.12, 0.94, -0.2), (0.23, 0.93, -0.17)], 5),
                 [0.0] + [0.03] * 14 + [0.0], (0.0, 1.0, 0.0), 12)
    m.surface(rail)
    m.part('cushion', 'cloth')
    m.cushion((0, 0.5, 0), (0.4, 0.06, 0.4), 8, 24)


def round_table(m):
    m.part('table', 'wood')
    m.turned((0, CLEAR, 0), [(0.0, 0.0), (0.35, 0.0), (0.33, 0.04)] + spline([(0.07, 0.08), (0.04, 0.2), (0.07, 0.4),
             (0.05, 0.55), (0.12, 0.7)], 5), 48)
    m.turned((0, 0, 0), [(0.0, 0.7), (0.75, 0.7), (0.78, 0.72), (0.75, 0.74), (0.0, 0.74)], 64)


def cup(m):
    """A cup on a saucer."""
    m.part('cup', 'china')
    m.turned((0, CLEAR, 0), [(0.0, 0.0), (0.05, 0.0)] + spline([(0.055, 0.002), (0.075, 0.008), (0.09, 0.016)], 2)
             + spline([(0.086, 0.018), (0.05, 0.007), (0.0, 0.006)], 2), 32)
    m.turned((0, 0.008, 0), [(0.0, 0.0), (0.028, 0.0)] + spline([(0.03, 0.004), (0.045, 0.03), (0.048, 0.075)], 3)
             + spline([(0.044, 0.075), (0.04, 0.03), (0.0, 0.012)], 3), 32)
    handle = spline([(0.044, 0.06), (0.068, 0.06), (0.07, 0.04), (0.044, 0.026)], 4)
    m.surface(rings([(a, b + 0.008, 0.0) for a, b in handle], [0.004] * len(handle), (0.0, 0.0, -1.0), 8))


def teapot(m):
    m.part('teapot', 'teapot')
    GLOSSY_FLOOR.teapot(m, (0.0, CLEAR, 0.0))


def vase(m):
    m.part('vase', 'clay')
    m.turned((0, CLEAR, 0), [(0.0, 0.0), (0.06, 0.0)] + spline([(0.062, 0.002), (0.11, 0.12), (0.05, 0.25), (0.07, 0.3)], 8)
             + spline([(0.063, 0.3), (0.043, 0.25), (0.1, 0.12), (0.0, 0.02)], 5), 48)


def bowl(m):
    """A bowl with fruit."""
    m.part('bowl', 'china')
    m.turned((0, CLEAR, 0), [(0.0, 0.0), (0.06, 0.0)] + spline([(0.065, 0.008), (0.12, 0.04), (0.17, 0.1)], 5)
             + spline([(0.163, 0.1), (0.115, 0.05), (0.0, 0.015)], 5), 48)
    fruit = [(0.06, 0.0), (-0.03, 0.055), (-0.035, -0.055)]
    for k, (x, z) in enumerate(fruit + [(0.01, 0.0)]):
        m.part(f'fruit_{k}', 'apple' if k % 2 == 0 else 'orange')
        m.ball((x, 0.065 if k < 3 else 0.13, z), 0.042, 12, 20)


def plates(m):
    """A pile of plates."""
    m.part('plates', 'china')
    for k in range(6):
        m.turned((0, CLEAR + 0.014 * k, 0), [(0.0, 0.0), (0.07, 0.0), (0.13, 0.018), (0.126, 0.021), (0.068, 0.004),
                                             (0.0, 0.004)], 40)


def sofa(m):
    """Its back along z = 0."""
    m.part('base', 'dark_wood')
    m.box((-0.95, 0.06, 0.03), (1.9, 0.16, 0.8))
    for x in (-0.9, 0.84):
        for z in (0.06, 0.74):
            m.box((x, CLEAR, z), (0.06, 0.06, 0.06), 't')
    m.part('cushions', 'cloth')
    for x in (-0.62, 0.0, 0.62):
        m.cushion((x, 0.32, 0.48), (0.63, 0.24, 0.74), 16, 32)
        m.cushion((x, 0.62, 0.16), (0.63, 0.46, 0.26), 16, 32)
    for x in (-1.02, 1.02):
        m.cushion((x, 0.34, 0.44), (0.24, 0.62, 0.86), 16, 32)


def bed(m):
    """Its head at z = 0."""
    m.part('bed', 'wood')
    m.box((-0.85, 0.1, 0.02), (1.7, 0.2, 2.08))
    m.box((-0.9, CLEAR, 0.0), (1.8, 0.9, 0.05))
    for x in (-0.83, 0.75):
        m.box((x, CLEAR, 2.0), (0.08, 0.1, 0.08), 't')
    m.part('mattress', 'linen')
    m.cushion((0, 0.4, 1.08), (1.66, 0.26, 2.04), 16, 48)
    for x in (-0.4, 0.4):
        m.cushion((x, 0.58, 0.32), (0.66, 0.16, 0.42), 16, 32)
    m.part('blanket', 'book_1')
    m.cushion((0, 0.44, 1.42), (1.72, 0.25, 1.4), 16, 48)


def plant(m, numbers):
    m.part('pot', 'clay')
    m.turned((0, CLEAR, 0), [(0.0, 0.0), (0.13, 0.0)] + spline([(0.133, 0.004), (0.17, 0.16), (0.18, 0.3)], 4)
             + [(0.165, 0.3), (0.16, 0.26), (0.0, 0.26)], 40)
    m.part('leaves', 'leaf')
    for k in range(36):
        turn, reach = 2.399963 * k, numbers.uniform(0.24, 0.4)
        top, width = numbers.uniform(0.6, 1.3) - 0.4 * reach, numbers.uniform(0.03, 0.05)
        along = spline([(0.02, 0.26), (0.3 * reach, 0.26 + 0.6 * (top - 0.26)), (0.7 * reach, top), (reach, top - 0.12)], 4)
        edges = []
        for i, (r, y) in enumerate(along):
            half = width * math.sin(math.pi * (i + 0.4) / (len(along) - 0.4))
            edges.append([(r * math.cos(turn) + s * half * math.sin(turn), y,
                           r * math.sin(turn) - s * half * math.cos(turn)) for s in (-1.0, 1.0)])
        for (a, b), (c, d) in zip(edges, edges[1:]):
            m.quad(a, c, d, b)


def shelf(m, seed):
    """The shelf of the indirectly lit room, its back along z = 0."""
    INDIRECT_ROOM.shelf(m, random.Random(seed))


def counter(m):
    """Kitchen cupboards, their backs along z = 0."""
    m.part('cupboards', 'linen')
    for k in range(4):
        m.box((-1.4 + 0.7 * k + 0.01, 0.1, 0.002), (0.68, 0.76, 0.56))
        m.box((-1.4 + 0.7 * k + 0.01, 1.45, 0.002), (0.68, 0.6, 0.32))
    m.part('plinth', 'dark_wood')
    m.box((-1.4, CLEAR, 0.002), (2.8, 0.1, 0.5))
    m.part('worktop', 'wood')
    m.box((-1.42, 0.86, 0.002), (2.84, 0.04, 0.6))
    m.part('handles', 'metal')
    for k in range(4):
        for y in (0.78, 1.52):
            m.cushion((-1.05 + 0.7 * k, y, 0.575 if y < 1.0 else 0.335), (0.16, 0.02, 0.03), 8, 16)


def standing_lamp(m):
    INDIRECT_ROOM.lamp(m, 0, 0.0, 0.0)


def picture(m, colour):
    """A picture that hangs at the wall z = 0, its middle at the origin."""
    frame(m, 0.8, 0.6)
    m.part('picture', 'linen')
    m.quad((-0.4, -0.3, 0.01), (0.4, -0.3, 0.01), (0.4, 0.3, 0.01), (-0.4, 0.3, 0.01))
    m.part('shape', colour)
    m.quad((-0.25, -0.2, 0.012), (0.05, -0.2, 0.012), (0.2, 0.2, 0.012), (-0.1, 0.2, 0.012))


def frame(m, width, height):
    m.part('frame', 'dark_wood')
    a, b, thick = width / 2.0, height / 2.0, 0.05
    for y in (-b - thick, b):
        m.box((-a - thick, y, 0.0), (width + 2.0 * thick, thick, 0.03))
    for x in (-a - thick, a):
        m.box((x, -b, 0.0), (thick, height, 0.03), 'tb')


def panel(m):
    """A framed glossy panel at the wall z = 0."""
    frame(m, 1.6, 1.0)
    m.part('reflector_5', 'reflector_5')
    m.quad((-0.8, -0.5, 0.01), (0.8, -0.5, 0.01), (0.8, 0.5, 0.01), (-0.8, 0.5, 0.01))


def low_table(m):
    m.part('reflector_4', 'reflector_4')
    m.quad((-0.6, 0.42, -0.35), (-0.6, 0.42, 0.35), (0.6, 0.42, 0.35), (0.6, 0.42, -0.35))
    m.part('low_table', 'dark_wood')
    m.box((-0.6, 0.38, -0.35), (1.2, 0.04, 0.7), 't')
    leg = spline([(0.02, 0.0), (0.035, 0.05), (0.022, 0.2), (0.035, 0.38)], 5)
    for x in (-0.53, 0.53):
        for z in (-0.28, 0.28):
            m.turned((x, CLEAR, z), leg, 24)


def wall(m, axis, at, span, room_low, room_high, door):
    """A wall across `axis` ('x' or 'z') with a doorway (its middle and width), painted as its rooms are."""
    sink = 0.02  # into floor, ceiling and the walls at its ends
    low, high = span[0] - sink, span[1] + sink
    left, right = door[0] - door[1] / 2.0, door[0] + door[1] / 2.0

    def piece(paint, start, end, bottom, top, side):
        m.part(f'{paint}_{axis}{at:g}_{start:g}_{bottom:g}', paint)
        sides = {'low': 'l', 'high': 'r', 'start': 'n', 'end': 'f'} if axis == 'x' else \
            {'low': 'n', 'high': 'f', 'start': 'l', 'end': 'r'}
        without = 'lrbtnf'.replace(sides.get(side, 'b'), '')
        across, along, up = (at - HALF_WALL, 2 * HALF_WALL), (start, end - start), (bottom, top - bottom)
        place = (across, up, along) if axis == 'x' else (along, up, across)
        m.box([p[0] for p in place], [p[1] for p in place], without)

    # Pieces meet corner to corner: where one ended at the middle of another's edge, rays would slip through.
    heights = (-sink, DOOR_HEIGHT, HEIGHT + sink)
    for paint, side in ((f'{room_low}_wall', 'low'), (f'{room_high}_wall', 'high')):
        for bottom, top in zip(heights, heights[1:]):
            piece(paint, low, left, bottom, top, side)
            piece(paint, right, high, bottom, top, side)
        piece(paint, left, right, DOOR_HEIGHT, HEIGHT + sink, side)
    piece('ceiling', low, left, -sink, DOOR_HEIGHT, 'end')
    piece('ceiling', right, high, -sink, DOOR_HEIGHT, 'start')
    piece('ceiling', left, right, DOOR_HEIGHT, HEIGHT, 'bottom')


def shell(m):
    w, d = ROOM
    floors = {'living': 'reflector_1', 'library': 'reflector_2', 'dining': 'reflector_3', 'bedroom': 'carpet'}
    for name, (i, j) in ROOMS.items():
        (x, z), (a, b), h = (w * i, d * j), (w * (i + 1), d * (j + 1)), HEIGHT
        m.part(f'{name}_floor', floors.get(name, 'tiles'))
        m.quad((x, 0, z), (x, 0, b), (a, 0, b), (a, 0, z))
        m.part(f'{name}_ceiling', 'ceiling')
        m.quad((x, h, z), (a, h, z), (a, h, b), (x, h, b))
        m.part(f'{name}_outer_wall', f'{name}_wall')
        if i == 0:
            m.quad((x, 0, b), (x, 0, z), (x, h, z), (x, h, b))
        if i == 2:
            m.quad((a, 0, z), (a, 0, b), (a, h, b), (a, h, z))
        if j == 0:
            m.quad((x, 0, z), (a, 0, z), (a, h, z), (x, h, z))
        else:
            m.quad((a, 0, b), (x, 0, b), (x, h, b), (a, h, b))
        cx, cz = (x + a) / 2.0, (z + b) / 2.0
        m.part(f'{name}_light_case', 'metal')
        m.box((cx - 0.52, h - 0.05, cz - 0.32), (1.04, 0.06, 0.64), 'bt')
        m.part(f'{name}_light', 'ceiling_light')
        m.quad((cx - 0.52, h - 0.05, cz - 0.32), (cx + 0.52, h - 0.05, cz - 0.32),
               (cx + 0.52, h - 0.05, cz + 0.32), (cx - 0.52, h - 0.05, cz + 0.32))
    wall(m, 'x', w, (0.0, d), 'hall', 'living', (2.2, 1.0))
    wall(m, 'x', 2 * w, (0.0, d), 'living', 'library', (2.0, 1.1))
    wall(m, 'x', w, (d, 2 * d), 'kitchen', 'dining', (6.3, 1.0))
    wall(m, 'x', 2 * w, (d, 2 * d), 'dining', 'bedroom', (6.3, 1.0))
    wall(m, 'z', d, (0.0, w), 'hall', 'kitchen', (2.5, 1.0))
    wall(m, 'z', d, (w, 2 * w), 'living', 'dining', (8.2, 2.4))
    wall(m, 'z', d, (2 * w, 3 * w), 'library', 'bedroom', (12.5, 1.0))


PIECES = {  # name: model
    'chair': of(chair), 'round_table': of(round_table), 'cup': of(cup), 'teapot': of(teapot), 'vase': of(vase),
    'bowl': of(bowl), 'plates': of(plates), 'sofa': of(sofa), 'bed': of(bed), 'plant': of(plant, random.Random(3)),
    'shelf': of(shelf, 7), 'other_shelf': of(shelf, 8), 'counter': of(counter), 'standing_lamp': of(standing_lamp),
    'red_picture': of(picture, 'cloth'), 'blue_picture': of(picture, 'book_1'), 'panel': of(panel),
    'low_table': of(low_table),
}

# Where the middle of the shelf of the indirectly lit room is along x.
SHELF = 3.0
W = HALF_WALL

PLACES = [  # piece, place, degrees about y
    # Hall
    ('shelf', (2.4 - SHELF, 0, 0), 0), ('plant', (0.5, 0, 4.0), 40), ('plant', (4.5, 0, 0.5), 200),
    ('chair', (0.45, 0, 1.3), 90), ('chair', (0.45, 0, 3.0), 90), ('red_picture', (0, 1.5, 2.15), 90),
    ('blue_picture', (5 - W, 1.5, 3.6), 270),
    # Living room
    ('sofa', (7.7, 0, 0.02), 0), ('low_table', (7.7, 0, 1.7), 0), ('teapot', (7.5, 0.42, 1.65), 30),
    ('cup', (7.95, 0.42, 1.55), 120), ('cup', (7.3, 0.42, 1.9), 250), ('bowl', (8.1, 0.42, 1.85), 0),
    ('chair', (6.4, 0, 3.5), 150), ('chair', (9.4, 0, 3.4), 215), ('standing_lamp', (9.5, 0, 0.5), 0),
    ('plant', (5.5, 0, 4.0), 0), ('blue_picture', (7.7, 1.6, 0), 0),
    # Library
    ('shelf', (11.3 - SHELF, 0, 0), 0), ('other_shelf', (13.6 - SHELF, 0, 0), 0), ('panel', (15, 1.5, 2.0), 270),
    ('round_table', (13.9, 0, 3.4), 0), ('chair', (13.2, 0, 2.7), 45), ('vase', (14.1, 0.74, 3.5), 0),
    ('chair', (10.5, 0, 3.9), 135), ('standing_lamp', (14.6, 0, 0.7), 0), ('teapot', (13.7, 0.74, 3.2), 100),
    ('plant', (10.5, 0, 0.6), 90),
    # Kitchen
    ('counter', (0, 0, 7.1), 90), ('plates', (0.3, 0.9, 6.2), 0), ('plates', (0.3, 0.9, 6.6), 0),
    ('bowl', (0.32, 0.9, 7.5), 0), ('vase', (0.3, 0.9, 8.2), 0), ('round_table', (3.3, 0, 7.7), 0),
    ('chair', (2.35, 0, 7.7), 90), ('chair', (4.25, 0, 7.9), 260), ('chair', (3.3, 0, 8.65), 180),
    ('cup', (3.0, 0.74, 7.5), 10), ('cup', (3.7, 0.74, 7.8), 200), ('teapot', (3.3, 0.74, 7.9), 60),
    # Dining room
    ('round_table', (7.3, 0, 7.6), 0), ('chair', (7.3, 0, 6.65), 0), ('chair', (7.3, 0, 8.55), 180),
    ('chair', (6.35, 0, 7.6), 90), ('chair', (8.25, 0, 7.6), 270), ('vase', (7.3, 0.74, 7.6), 0),
    ('cup', (7.0, 0.74, 7.2), 80), ('cup', (7.6, 0.74, 8.0), 0), ('plates', (6.85, 0.74, 7.8), 0),
    ('bowl', (7.7, 0.74, 7.4), 0), ('plant', (9.5, 0, 8.5), 70), ('plant', (5.5, 0, 8.5), 10),
    ('red_picture', (7.3, 1.5, 9), 180),
    # Bedroom
    ('bed', (15, 0, 7.2), 270), ('other_shelf', (11.6 + SHELF, 0, 9), 180), ('standing_lamp', (14.6, 0, 5.3), 0),
    ('chair', (10.5, 0, 8.2), 90), ('plant', (10.6, 0, 5.1), 30), ('blue_picture', (15, 1.6, 7.2), 270),
    ('chair', (14.5, 0, 8.6), 240),
]


def faces(m, by_object):
    """The faces of a model by object (or all as one) and by material and smoothness, in the order of their first."""
    objects, target, material = {}, None, None
    for line in m.lines:
        word, *rest = line.split()
        if word == 'o':
            target = objects.setdefault(rest[0] if by_object else '', {})
        elif word == 'usemtl':
            material = rest[0]
        else:
            corners = [tuple(int(i) for i in corner.split('//')) for corner in rest]
            triangles = [(corners[0], corners[k], corners[k + 1]) for k in range(1, len(corners) - 1)]
            target.setdefault((material, len(corners[0]) == 2), []).extend(triangles)
    return objects


class Document:
    """A binary glTF file that grows mesh by mesh."""

    def __init__(self):
        self.vectors, self.indices = bytearray(), bytearray()
        self.accessors, self.meshes, self.nodes, self.triangles = [], [], [], 0
        self.materials = list(MATERIALS)

    def accessor(self, view, data, component, kind, count, **more):
        buffer = self.vectors if view == 0 else self.indices
        entry = {'bufferView': view, 'byteOffset': len(buffer), 'componentType': component, 'type': kind, 'count': count}
        buffer += data
        buffer += bytes(-len(buffer) % 4)
        self.accessors.append(entry | more)
        return len(self.accessors) - 1

    def mesh(self, name, m, groups):
        """Adds a mesh of one primitive for each group of faces, and gives its index."""
        positions, primitives = list(m.vertices), []
        for (material, smooth), triangles in groups.items():
            corners = {}
            order = [corners.setdefault(corner, len(corners)) for triangle in triangles for corner in triangle]
            points = [positions[corner[0] - 1] for corner in corners]
            packed = b''.join(struct.pack('<3f', *p) for p in points)
            # The bounds are those of the numbers as stored.
            stored = list(zip(*struct.iter_unpack('<3f', packed)))
            bounds = {'min': [min(axis) for axis in stored], 'max': [max(axis) for axis in stored]}
            attributes = {'POSITION': self.accessor(0, packed, 5126, 'VEC3', len(points), **bounds)}
            if smooth:
                normals = b''.join(struct.pack('<3f', *m.normals[corner[1] - 1]) for corner in corners)
                attributes['NORMAL'] = self.accessor(0, normals, 5126, 'VEC3', len(points))
            indices = self.accessor(1, struct.pack(f'<{len(order)}H', *order), 5123, 'SCALAR', len(order))
            primitives.append({'attributes': attributes, 'indices': indices, 'material': self.materials.index(material)})
        self.meshes.append({'name': name, 'primitives': primitives})
        return len(self.meshes) - 1

    def node(self, name, mesh, triangles, place=None, degrees=0):
        entry = {'name': name, 'mesh': mesh}
        if place:
            entry['translation'] = place
        if degrees:
            half = math.radians(degrees) / 2.0
            entry['rotation'] = [0.0, round(math.sin(half), 9), 0.0, round(math.cos(half), 9)]
        self.nodes.append(entry)
        self.triangles += triangles

    def write(self, path):
        binary = bytes(self.vectors + self.indices)
        views = [{'buffer': 0, 'byteOffset': 0, 'byteLength': len(self.vectors), 'byteStride': 12, 'target': 34962},
                 {'buffer': 0, 'byteOffset': len(self.vectors), 'byteLength': len(self.indices), 'target': 34963}]
        text = json.dumps({
            'asset': {'version': '2.0', 'generator': 'generate.py'},
            'extensionsUsed': ['KHR_materials_emissive_strength', 'KHR_materials_ior'],
            'scene': 0, 'scenes': [{'nodes': list(range(len(self.nodes)))}], 'nodes': self.nodes, 'meshes': self.meshes,
            'materials': [material(name, *entry) for name, entry in MATERIALS.items()],
            'accessors': self.accessors, 'bufferViews': views, 'buffers': [{'byteLength': len(binary)}],
        }, separators=(',', ':')).encode()
        text += b' ' * (-len(text) % 4)
        with open(path, 'wb') as f:
            f.write(struct.pack('<4sII', b'glTF', 2, 12 + 8 + len(text) + 8 + len(binary)))
            f.write(struct.pack('<I4s', len(text), b'JSON') + text)
            f.write(struct.pack('<I4s', len(binary), b'BIN\0') + binary)


def material(name, colour, more=None):
    more = more or {}
    # The index of refraction that reflects this much at normal incidence; 1 reflects nothing.
    root = math.sqrt(more.get('specular', 0.0))
    extensions = {'KHR_materials_ior': {'ior': round((1.0 + root) / (1.0 - root), 5)}}
    entry = {'name': name, 'extensions': extensions, 'pbrMetallicRoughness': {
        'baseColorFactor': [*colour, 1.0], 'metallicFactor': 0.0, 'roughnessFactor': more.get('roughness', 1.0)}}
    if 'emission' in more:
        strength = max(more['emission'])
        entry['emissiveFactor'] = [round(e / strength, 5) for e in more['emission']]
        extensions['KHR_materials_emissive_strength'] = {'emissiveStrength': strength}
    return entry


def build():
    document, house = Document(), of(shell)
    for name, groups in faces(house, True).items():
        document.node(name, document.mesh(name, house, groups), sum(map(len, groups.values())))
    meshes = {name: document.mesh(name, m, faces(m, False)['']) for name, m in PIECES.items()}
    numbers = dict.fromkeys(PIECES, 0)
    for name, place, degrees in PLACES:
        numbers[name] += 1
        document.node(f'{name}_{numbers[name]}', meshes[name], PIECES[name].triangles, place, degrees)
    return document


def main():
    document = build()
    document.write(os.path.join(FOLDER, 'house.glb'))
    print(f'{document.triangles} triangles')


if __name__ == '__main__':
    main()
