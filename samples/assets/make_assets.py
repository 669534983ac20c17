#!/usr/bin/env python3
"""Makes the sample meshes beside this file: figurine.glb, vase.glb, pebble.glb. Python 3, standard library only, under a minute.

  python3 make_assets.py [--out FOLDER] [figurine|vase|pebble ...]

All bodies are closed and wound counter-clockwise seen from outside, in metres, +Y up, standing on y = 0; `check` enforces it.
* figurine: a fox of wax (scattering volume) with a metal collar, glazed eyes and nose, on a glazed plinth. The wax is the zero set of
  one signed distance function, polygonised with surface nets (Gibson 1998) and then moved onto the zero set. The other parts keep
  0.2 mm of air to it, so that a ray always knows which medium it is in.
* vase: a lathe body with base-colour, metallic-roughness and normal textures under KHR_texture_transform, on a vertex-coloured saucer.
* pebble: 2000 triangles to grow fur on.
"""
import argparse
import json
import math
import os
import struct
import zlib

# ---------------------------------------------------------------------------------------------------------------- vectors


def add(a, b): return (a[0] + b[0], a[1] + b[1], a[2] + b[2])
def sub(a, b): return (a[0] - b[0], a[1] - b[1], a[2] - b[2])
def mul(a, s): return (a[0] * s, a[1] * s, a[2] * s)
def dot(a, b): return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
def cross(a, b): return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
def length(a): return math.sqrt(dot(a, a))


def unit(a):
    n = length(a)
    return mul(a, 1 / n) if n > 0 else (0.0, 1.0, 0.0)


# ------------------------------------------------------------------------------------------------- signed distance functions
# A shape is (f, centre, reach): f(point) is negative inside and close to the distance near the surface; the ball of radius reach holds
# the shape. Lengths in centimetres.


def ball(c, r):
    return lambda p: length(sub(p, c)) - r, c, r


def ellipsoid(c, r):
    """Quilez's bound k0 (k0 - 1) / k1: exact on the surface, close to the distance near it; no deeper inside than the shortest radius."""
    deepest = -min(r)
    def f(p):
        x, y, z = (p[0] - c[0]) / r[0], (p[1] - c[1]) / r[1], (p[2] - c[2]) / r[2]
        k0 = math.sqrt(x * x + y * y + z * z)
        k1 = math.sqrt((x / r[0])**2 + (y / r[1])**2 + (z / r[2])**2)
        return max(k0 * (k0 - 1) / k1, deepest) if k1 > 1e-9 else deepest
    return f, c, max(r)


def cone(a, b, ra, rb):
    """Hull of two balls, with the radius linear along the axis (the slope of the side is neglected)."""
    ab = sub(b, a)
    inv = 1 / dot(ab, ab)
    def f(p):
        ap = sub(p, a)
        t = min(1.0, max(0.0, dot(ap, ab) * inv))
        x, y, z = ap[0] - ab[0] * t, ap[1] - ab[1] * t, ap[2] - ab[2] * t
        return math.sqrt(x * x + y * y + z * z) - (ra + (rb - ra) * t)
    return f, mul(add(a, b), 0.5), 0.5 * length(ab) + max(ra, rb)


def ring(c, axis, major, minor):
    axis = unit(axis)
    def f(p):
        d = sub(p, c)
        h = dot(d, axis)
        return math.hypot(math.sqrt(max(0.0, dot(d, d) - h * h)) - major, h) - minor
    return f, c, major + minor


def smooth_min(a, b, k):
    """Quilez's polynomial blend over a band of width k."""
    h = max(k - abs(a - b), 0.0) / k
    return min(a, b) - 0.25 * h * h * k


def smooth_max(a, b, k): return -smooth_min(-a, -b, k)


def blend(shapes, k):
    """Smooth union of (shape, centre, reach): shapes whose bounding ball is too far to matter are not evaluated."""
    def f(p):
        d = 1e9
        for shape, c, reach in shapes:
            x, y, z = p[0] - c[0], p[1] - c[1], p[2] - c[2]
            far = d + 2 * k + reach
            if far > 0 and x * x + y * y + z * z < far * far:
                d = smooth_min(d, shape(p), k)
        return d
    return f


def value_and_gradient(f, p, e=1e-3):
    """From the corners of a small tetrahedron."""
    x, y, z = p
    a, b, c, d = f((x + e, y - e, z - e)), f((x - e, y - e, z + e)), f((x - e, y + e, z - e)), f((x + e, y + e, z + e))
    s = 0.25 / e
    return 0.25 * (a + b + c + d), ((a - b - c + d) * s, (c + d - a - b) * s, (b + d - a - c) * s)


def project(f, p, steps=2):
    """Newton steps along the gradient onto f = 0. Returns the point and the gradient at the last step."""
    g = (0.0, 1.0, 0.0)
    for _ in range(steps):
        d, g = value_and_gradient(f, p)
        gg = dot(g, g)
        if gg > 1e-6:
            p = sub(p, mul(g, d / gg))
    return p, g


# ------------------------------------------------------------------------------------------------------------ surface nets


CORNERS = [(c & 1, c >> 1 & 1, c >> 2) for c in range(8)]
EDGES = [(a, b) for a in range(8) for b in range(a + 1, 8) if bin(a ^ b).count("1") == 1]
FACES = [[c for c in range(8) if CORNERS[c][axis] == side] for axis in range(3) for side in range(2)]


def patches(inside):
    """The crossed edges of a cell, as one list per sheet of surface in it. On a face with two inside corners across the diagonal the
    surface separates them: the same answer from both sides of the face, so that sheets never meet in an edge of four faces."""
    parent = {e: e for e in EDGES if inside[e[0]] != inside[e[1]]}

    def root(e):
        while parent[e] != e:
            e = parent[e]
        return e

    for face in FACES:
        crossed = [e for e in parent if e[0] in face and e[1] in face]
        for e in crossed:
            for o in crossed:
                corner = set(e) & set(o)
                if len(crossed) == 2 or (corner and inside[corner.pop()]):
                    parent[root(e)] = root(o)
    sheets = {}
    for e in parent:
        sheets.setdefault(root(e), []).append(e)
    return list(sheets.values())


def surface_net(f, lo, hi, cell, lipschitz=2.0, block=6):
    """One vertex per sheet of surface in a cell, one quad per crossed grid edge. Blocks of cells whose centre is farther from the
    surface than they are wide are not looked into."""
    size = [int(math.ceil((hi[a] - lo[a]) / cell / block)) * block for a in range(3)]
    point = lambda i, j, k: (lo[0] + i * cell, lo[1] + j * cell, lo[2] + k * cell)
    values = {}

    def value(n):
        v = values.get(n)
        if v is None:
            v = values[n] = f(point(*n))
        return v

    reach = lipschitz * cell * (block * 0.5 * math.sqrt(3) + 1)
    vertices, vertex_of = [], {}                               # (lower, upper grid point of an edge, cell) -> vertex
    for n in [(i, j, k) for i in range(0, size[0], block) for j in range(0, size[1], block) for k in range(0, size[2], block)]:
        if abs(f(point(*(c + block / 2 for c in n)))) > reach:
            continue
        for at in [(n[0] + i, n[1] + j, n[2] + k) for i in range(block) for j in range(block) for k in range(block)]:
            grid = [add(at, c) for c in CORNERS]
            v = [value(g) for g in grid]
            if min(v) >= 0 or max(v) < 0:
                continue
            for sheet in patches([x < 0 for x in v]):
                total = (0.0, 0.0, 0.0)
                for a, b in sheet:
                    vertex_of[grid[a], grid[b], at] = len(vertices)
                    total = add(total, add(grid[a], mul(sub(grid[b], grid[a]), v[a] / (v[a] - v[b]))))
                vertices.append(point(*mul(total, 1 / len(sheet))))
    quads = []
    for a, b in {(a, b) for a, b, _ in vertex_of}:
        axis = sub(b, a).index(1)
        u, w = (axis + 1) % 3, (axis + 2) % 3
        around = []
        for du, dw in ((0, 0), (-1, 0), (-1, -1), (0, -1)):
            at = list(a)
            at[u] += du
            at[w] += dw
            around.append(vertex_of[a, b, tuple(at)])
        quads.append(around if values[a] < 0 else around[::-1])
    return vertices, sorted(quads)


def relax(f, vertices, quads, rounds):
    """Moves each vertex halfway to the mean of its neighbours and back onto the surface: evener triangles."""
    near = [set() for _ in vertices]
    for q in quads:
        for a in range(4):
            near[q[a]].add(q[a - 1])
            near[q[a - 1]].add(q[a])
    for _ in range(rounds):
        moved = []
        for v, ns in zip(vertices, near):
            mean = mul(tuple(map(sum, zip(*(vertices[n] for n in ns)))), 1 / len(ns))
            moved.append(project(f, mul(add(v, mean), 0.5), 1)[0])
        vertices = moved
    done = [project(f, v) for v in vertices]
    return [p for p, _ in done], [unit(g) for _, g in done]


def split_quads(vertices, quads):
    """Two triangles per quad, along the shorter diagonal."""
    triangles = []
    for a, b, c, d in quads:
        if length(sub(vertices[a], vertices[c])) <= length(sub(vertices[b], vertices[d])):
            triangles += [(a, b, c), (a, c, d)]
        else:
            triangles += [(a, b, d), (b, c, d)]
    return triangles


# ---------------------------------------------------------------------------------------------------------- parametric parts


class Mesh:
    def __init__(self, material):
        self.material = material
        self.positions, self.normals, self.triangles = [], [], []
        self.uvs, self.colors = [], []

    def append(self, other):
        n = len(self.positions)
        self.positions += other.positions
        self.normals += other.normals
        self.triangles += [tuple(i + n for i in t) for t in other.triangles]
        return self


def geodesic(frequency):
    """Unit sphere: an icosahedron with each face cut into frequency^2 triangles. Returns points and triangles."""
    g = (1 + math.sqrt(5)) / 2
    corners = [unit(p) for p in ((-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0), (0, -1, g), (0, 1, g), (0, -1, -g), (0, 1, -g),
                                 (g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1))]
    faces = [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2), (10, 7, 6), (7, 1, 8),
             (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1)]
    points, triangles, seen = [], [], {}

    def point(weights): # shared between faces: keyed by the corners it lies between
        key = tuple(sorted((c, w) for c, w in weights if w))
        if key not in seen:
            seen[key] = len(points)
            points.append(unit(tuple(sum(corners[c][x] * w for c, w in key) for x in range(3))))
        return seen[key]

    for a, b, c in faces:
        at = lambda i, j: point(((a, frequency - i - j), (b, i), (c, j)))
        for i in range(frequency):
            for j in range(frequency - i):
                triangles.append((at(i, j), at(i + 1, j), at(i, j + 1)))
                if i + j < frequency - 1:
                    triangles.append((at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)))
    return points, triangles


def bead(material, center, radius, frequency=5):
    m = Mesh(material)
    m.normals, m.triangles = geodesic(frequency)
    m.positions = [add(center, mul(n, radius)) for n in m.normals]
    return m


def torus(material, center, axis, major, minor, around=56, across=12):
    m = Mesh(material)
    axis = unit(axis)
    x = unit(cross(axis, (0.0, 0.0, 1.0) if abs(axis[2]) < 0.9 else (1.0, 0.0, 0.0)))
    z = cross(x, axis)
    for i in range(around):
        a = 2 * math.pi * i / around
        out = add(mul(x, math.cos(a)), mul(z, math.sin(a)))
        for j in range(across):
            b = 2 * math.pi * j / across
            n = add(mul(out, math.cos(b)), mul(axis, math.sin(b)))
            m.positions.append(add(center, add(mul(out, major), mul(n, minor))))
            m.normals.append(n)
    at = lambda i, j: i % around * across + j % across
    for i in range(around):
        for j in range(across):
            m.triangles += [(at(i, j), at(i, j + 1), at(i + 1, j + 1)), (at(i, j), at(i + 1, j + 1), at(i + 1, j))]
    return m


def round_corners(profile, radii, steps=5):
    """Replaces each inner corner of a polyline (radius, height) by an arc. radii: one per point, 0 keeps a corner."""
    out = []
    for n, (p, r) in enumerate(zip(profile, radii)):
        if r <= 0:
            out.append(p)
            continue
        a, b = profile[n - 1], profile[n + 1]
        ua = unit((a[0] - p[0], a[1] - p[1], 0))
        ub = unit((b[0] - p[0], b[1] - p[1], 0))
        half = math.acos(max(-1.0, min(1.0, dot(ua, ub)))) / 2
        reach = r / math.tan(half)
        centre = add((p[0], p[1], 0), mul(unit(add(ua, ub)), r / math.sin(half)))
        s, e = sub(add((p[0], p[1], 0), mul(ua, reach)), centre), sub(add((p[0], p[1], 0), mul(ub, reach)), centre)
        turn = math.pi - 2 * half
        for k in range(steps + 1):
            t = k / steps
            w = add(mul(s, math.sin((1 - t) * turn)), mul(e, math.sin(t * turn)))
            q = add(centre, mul(w, 1 / math.sin(turn)))
            out.append((q[0], q[1]))
    return out


def lathe(material, profile, center=(0.0, 0.0, 0.0), around=72, textured=False):
    """Turns a profile of (radius, height), that starts and ends on the axis and runs from bottom to top on the outside, round +Y.
    textured: u once round, v by arc length from the top, with the seam's vertices doubled."""
    m = Mesh(material)
    rows = len(profile)
    arc = [0.0]
    for a, b in zip(profile, profile[1:]):
        arc.append(arc[-1] + math.hypot(b[0] - a[0], b[1] - a[1]))
    normals = []
    for n in range(rows):
        a, b = profile[max(n - 1, 0)], profile[min(n + 1, rows - 1)]
        t = unit((b[0] - a[0], b[1] - a[1], 0))
        normals.append((t[1], -t[0]))
    normals[0], normals[-1] = (0.0, math.copysign(1, normals[0][1])), (0.0, math.copysign(1, normals[-1][1]))
    columns = around + 1 if textured else around
    pole = {}
    for n, (r, h) in enumerate(profile):
        for i in range(columns if textured or r > 0 else 1):
            a = 2 * math.pi * (i % around) / around
            c, s = math.cos(a), math.sin(a)
            m.positions.append(add(center, (r * c, h, -r * s)))
            m.normals.append(unit((normals[n][0] * c, normals[n][1], -normals[n][0] * s)))
            if textured:
                m.uvs.append(((i + (0.5 if r == 0 else 0)) / around, 1 - arc[n] / arc[-1]))
        pole[n] = len(m.positions)
    start = [0] + [pole[n] for n in range(rows)]
    at = lambda n, i: start[n] + (0 if start[n + 1] - start[n] == 1 else (i if textured else i % around))
    for n in range(rows - 1):
        for i in range(around):
            if profile[n][0] > 0:
                m.triangles.append((at(n, i), at(n, i + 1), at(n + 1, i + 1) if profile[n + 1][0] > 0 else at(n + 1, i)))
            if profile[n + 1][0] > 0:
                m.triangles.append((at(n, i), at(n + 1, i + 1), at(n + 1, i)))
    return m


# -------------------------------------------------------------------------------------------------------------- the figurine


def ear(side):
    """A leaf, hollowed in front. Local axes: u up the ear, w across, n out of the hollow."""
    base = (side * 0.98, 7.05, 0.55)
    u = unit((side * 0.42, 1.0, -0.16))
    n = unit(sub((side * 0.38, 0.1, 1.0), mul(u, dot((side * 0.38, 0.1, 1.0), u))))
    w = cross(u, n)
    outer = ellipsoid((0.0, 1.2, 0.0), (0.92, 2.05, 0.52))[0]
    hollow = ellipsoid((0.0, 1.15, 0.50), (0.70, 1.78, 0.62))[0]

    def f(p):
        d = sub(p, base)
        a, b, c = dot(d, w), dot(d, u), dot(d, n)
        t = (b - 1.2) / 2.05                                   # -1 .. 1 along the ear
        width = 1.0 - 0.28 * t                                 # narrower to the tip
        a /= width
        c -= 0.10 * t * t                                      # the tip bends forward
        return smooth_max(outer((a, b, c)), -hollow((a, b, c)), 0.16)
    return f, add(base, mul(u, 1.2)), 2.3


def tail():
    """Catmull-Rom curve through balls, swept as short cones."""
    knots = [(-0.3, 1.2, -1.6, 0.45), (0.3, 0.85, -2.75, 0.55), (2.1, 0.85, -2.7, 0.80), (3.25, 1.0, -1.1, 0.98), (3.35, 0.98, 0.7, 0.96),
             (2.6, 0.82, 2.15, 0.78), (1.45, 0.62, 2.85, 0.45), (0.75, 0.62, 2.95, 0.16)]
    samples = []
    for n in range(len(knots) - 1):
        p = [knots[max(0, min(len(knots) - 1, n + o))] for o in (-1, 0, 1, 2)]
        for s in range(8):
            t = s / 8
            samples.append(tuple(0.5 * (2 * b + (c - a) * t + (2 * a - 5 * b + 4 * c - d) * t * t + (3 * b - a - 3 * c + d) * t**3)
                                 for a, b, c, d in zip(*p)))
    samples.append(knots[-1])
    return [cone(a[:3], b[:3], a[3], b[3]) for a, b in zip(samples, samples[1:])]


EYES = [((0.80, 6.52, 2.02), 0.30), ((-0.80, 6.52, 2.02), 0.30)]
NOSE = ((0.0, 5.86, 3.20), 0.22)
COLLAR = ((0.0, 4.62, 0.42), (0.0, 1.0, 0.28), 1.30, 0.17)
BELL = ((0.0, 3.98, 1.83), 0.36)
AIR = 0.02 # centimetres between the wax and every other part


def fox():
    body = blend([cone((0, 1.75, -0.75), (0, 4.3, 0.25), 1.95, 1.2), ellipsoid((0, 3.4, 0.75), (1.05, 1.3, 0.85)),
                  cone((0, 4.2, 0.3), (0, 5.4, 0.55), 1.05, 1.0)], 0.7)
    legs = blend([shape for s in (-1, 1) for shape in (
        ellipsoid((s * 1.45, 1.45, -0.35), (0.95, 1.42, 1.35)), ellipsoid((s * 1.72, 0.36, 0.95), (0.5, 0.42, 0.85)),
        cone((s * 0.72, 3.1, 0.95), (s * 0.66, 0.6, 1.3), 0.62, 0.42), ellipsoid((s * 0.66, 0.36, 1.58), (0.47, 0.40, 0.66)))], 0.22)
    head = blend([ellipsoid((0, 6.2, 0.75), (1.8, 1.45, 1.5)), ball((0.95, 5.78, 1.05), 0.8), ball((-0.95, 5.78, 1.05), 0.8),
                  cone((1.2, 5.7, 0.9), (2.05, 5.5, 0.55), 0.6, 0.14), cone((-1.2, 5.7, 0.9), (-2.05, 5.5, 0.55), 0.6, 0.14),
                  cone((0, 5.95, 1.5), (0, 5.72, 2.85), 0.85, 0.42)], 0.45)
    brush = blend(tail(), 0.01)
    ears = blend([ear(1), ear(-1)], 0.1)
    cuts = [ball(c, r + AIR) for c, r in EYES + [NOSE, BELL]] + [ring(COLLAR[0], COLLAR[1], COLLAR[2], COLLAR[3] + AIR)]
    whole = blend([(body, (0, 3.0, 0), 3.6), (legs, (0, 1.6, 0.4), 3.2), (head, (0, 6.0, 0.9), 3.0), (ears, (0, 8.2, 0.3), 3.2),
                   (brush, (1.5, 0.9, 0.0), 4.2)], 0.4)

    def f(p):
        d = smooth_max(whole(p), AIR + 0.02 - p[1], 0.15)      # stands just above the plinth
        for cut, c, reach in cuts:
            x, y, z = p[0] - c[0], p[1] - c[1], p[2] - c[2]
            if x * x + y * y + z * z < (reach + 1)**2:
                d = smooth_max(d, -cut(p), 0.14)
        return d
    return f


def figurine(cell):
    f = fox()
    vertices, quads = surface_net(f, (-2.9, -0.2, -4.0), (4.7, 10.0, 3.9), cell)
    vertices, normals = relax(f, vertices, quads, 2)
    wax = Mesh("wax")
    wax.positions, wax.normals, wax.triangles = vertices, normals, split_quads(vertices, quads)

    profile = round_corners([(0, -1.5), (4.75, -1.5), (4.95, -1.05), (4.3, -0.75), (4.3, -0.4), (4.6, 0), (0, 0)],
                            [0, 0.12, 0.16, 0.12, 0.12, 0.14, 0])
    plinth = lathe("glaze", profile, center=(0.45, 0.0, 0.05), around=80)
    eyes = Mesh("glaze")
    for c, r in EYES + [NOSE]:
        eyes.append(bead("glaze", c, r))
    metal = torus("metal", *COLLAR).append(bead("metal", BELL[0], BELL[1], 6))
    parts = {"fox": wax, "plinth": plinth, "eyes": eyes, "collar": metal}
    for m in parts.values(): # centimetres to metres, standing on y = 0
        m.positions = [mul(add(p, (-0.45, 1.5, -0.05)), 0.01) for p in m.positions]

    materials = [
        {"name": "wax",
         "pbrMetallicRoughness": {"baseColorFactor": [0.93, 0.70, 0.47, 1], "metallicFactor": 0, "roughnessFactor": 0.38},
         "extensions": {"KHR_materials_ior": {"ior": 1.44}, "KHR_materials_diffuse_transmission": {"diffuseTransmissionFactor": 1},
                        # mean free paths of 4, 2.2 and 1.3 mm: exp(-1 mm / path)
                        "KHR_materials_volume": {"thicknessFactor": 0.02, "attenuationDistance": 0.001,
                                                 "attenuationColor": [round(math.exp(-1 / p), 4) for p in (4.0, 2.2, 1.3)]},
                        "KHR_materials_volume_scatter": {"multiscatterColor": [0.93, 0.70, 0.47], "scatterAnisotropy": 0}}},
        {"name": "glaze",
         "pbrMetallicRoughness": {"baseColorFactor": [0.012, 0.09, 0.10, 1], "metallicFactor": 0, "roughnessFactor": 0.3},
         "extensions": {"KHR_materials_clearcoat": {"clearcoatFactor": 1, "clearcoatRoughnessFactor": 0.06}}},
        {"name": "metal", "pbrMetallicRoughness": {"baseColorFactor": [0.90, 0.67, 0.36, 1], "metallicFactor": 1, "roughnessFactor": 0.35}},
    ]
    return Gltf(parts, materials, quantize=True)


# ------------------------------------------------------------------------------------------------------- the vase, the pebble


def png(width, height, pixel):
    """An 8-bit RGB image. pixel(x, y): three numbers in [0, 1]."""
    rows, before = [], bytes(3 * width)
    for y in range(height):
        row = bytes(max(0, min(255, int(c * 255 + 0.5))) for x in range(width) for c in pixel(x, y))
        left = bytes((row[i] - (row[i - 3] if i > 2 else 0)) & 255 for i in range(len(row)))
        up = bytes((a - b) & 255 for a, b in zip(row, before))
        cost = lambda r: sum(min(v, 256 - v) for v in r)
        rows.append(b"\1" + left if cost(left) < cost(up) else b"\2" + up)
        before = row
    chunk = lambda kind, data: struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)) +
            chunk(b"IDAT", zlib.compress(b"".join(rows), 9)) + chunk(b"IEND", b""))


def vase():
    outer = [(0, 0), (2.6, 0), (2.85, 0.25), (3.0, 0.7), (3.9, 2.4), (4.85, 4.6), (5.2, 6.8), (4.9, 9.0), (3.9, 11.0), (2.7, 12.6), (2.15, 14.0),
             (2.2, 15.2), (2.75, 16.3), (3.3, 17.0)]
    inner = [(3.05, 17.12), (2.45, 16.3), (1.9, 15.2), (1.85, 14.0), (2.4, 12.6), (3.55, 11.0), (4.55, 9.0), (4.85, 6.8), (4.5, 4.6),
             (3.5, 2.4), (2.4, 0.9), (0, 0.6)]

    def smooth(points, steps): # Catmull-Rom, ends kept
        out = []
        for n in range(len(points) - 1):
            a, b, c, d = (points[max(0, min(len(points) - 1, n + o))] for o in (-1, 0, 1, 2))
            for s in range(steps):
                t = s / steps
                out.append(tuple(0.5 * (2 * q + (r - p) * t + (2 * p - 5 * q + 4 * r - u) * t * t + (3 * q - p - 3 * r + u) * t**3)
                                 for p, q, r, u in zip(a, b, c, d)))
        return out + [points[-1]]

    profile = [(0, 0), (1.3, 0)] + smooth(outer[1:], 3) + smooth(inner[:-1], 2) + [(1.2, 0.66), (0, 0.6)]
    body = lathe("painted", profile, center=(0, 1.0, 0), around=72, textured=True)
    saucer = lathe("saucer", round_corners([(0, 0), (4.2, 0), (6.6, 1.1), (6.4, 1.3), (4.0, 0.55), (0, 0.55)], [0, 0.4, 0.1, 0.1, 0.5, 0]), around=72)
    for p in saucer.positions:                                 # rings and petals in COLOR_0 (linear)
        r, a = math.hypot(p[0], p[2]), math.atan2(p[2], p[0])
        w = 0.5 + 0.5 * math.sin(a * 6)
        t = min(1.0, r / 6.6)
        saucer.colors.append((0.75 * t + 0.1, 0.12 + 0.5 * (1 - t) * w, 0.35 * w + 0.05))
    body.positions = [add(p, (0, -0.43, 0)) for p in body.positions]

    size = 256
    tau = 2 * math.pi

    def height(x, y): # scales, tiling
        u, v = x / size * 8, y / size * 8
        u += 0.5 * (int(math.floor(v)) & 1)
        du, dv = u - math.floor(u) - 0.5, v - math.floor(v)
        return max(0.0, 1 - (4 * du * du + (dv - 0.1)**2 * 1.1))

    def leaf(x, y): # where the gilding is: a wavy band, tiling in u
        u, v = x / size, y / size
        d = abs(v - 0.5 - 0.12 * math.sin(tau * 2 * u)) * 9
        e = abs(v - 0.5 + 0.12 * math.sin(tau * 2 * u)) * 9
        return max(0.0, min(1.0, (0.45 - min(d, e)) * 8))

    def base_color(x, y):
        g, v = leaf(x, y), y / size
        h = height(x, y)
        c = (0.16 + 0.22 * h, 0.36 + 0.30 * h, 0.58 + 0.25 * h) if 0.3 < v < 0.7 else (0.93 - 0.1 * h, 0.90 - 0.16 * h, 0.82 - 0.3 * h)
        gold = (0.96, 0.80, 0.48)
        return tuple(a + (b - a) * g for a, b in zip(c, gold))

    def metal_rough(x, y): # G roughness, B metallic
        g = leaf(x, y)
        return (0.0, 0.32 + 0.3 * (1 - height(x, y)) * (1 - g), g)

    def normal(x, y): # +Y up in the image
        s = 5.0
        dx = (height((x + 1) % size, y) - height((x - 1) % size, y)) * s
        dy = (height(x, (y + 1) % size) - height(x, (y - 1) % size)) * s
        return tuple(c * 0.5 + 0.5 for c in unit((-dx, dy, 1.0)))

    parts = {"vase": body, "saucer": saucer}
    for m in parts.values():
        m.positions = [mul(p, 0.01) for p in m.positions]
    transform = {"extensions": {"KHR_texture_transform": {"scale": [4, 4], "offset": [0.125, 0.25]}}}
    slot = lambda i: {"index": i, **transform}
    materials = [
        {"name": "painted", "normalTexture": {**slot(2), "scale": 0.8},
         "pbrMetallicRoughness": {"baseColorTexture": slot(0), "metallicRoughnessTexture": slot(1)}},
        {"name": "saucer", "pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": 0.45}}]
    images = [("color", png(size, size, base_color)), ("metal_rough", png(size, size, metal_rough)), ("normal", png(size, size, normal))]
    return Gltf(parts, materials, images)


def pebble():
    """An egg with a few low waves."""
    def radius(n):
        x, y, z = n
        return 1 + 0.10 * math.sin(2.1 * x + 1.3 * y + 0.4) + 0.07 * math.sin(3.3 * z - 2.2 * y + 1.0) + 0.04 * math.sin(4.7 * x - 3.1 * z)

    def f(p):
        q = (p[0] / 5.0, p[1] / 3.4, p[2] / 4.2)
        return length(q) - radius(unit(q))

    m = Mesh("hide")
    points, m.triangles = geodesic(10)
    for n in points:
        r = radius(n)
        p = (n[0] * r * 5.0, n[1] * r * 3.4, n[2] * r * 4.2)
        m.positions.append(p)
        m.normals.append(unit(value_and_gradient(f, p)[1]))
    low = min(p[1] for p in m.positions)
    m.positions = [mul(sub(p, (0, low, 0)), 0.01) for p in m.positions]
    return Gltf({"pebble": m}, [{"name": "hide", "pbrMetallicRoughness": {"baseColorFactor": [0.30, 0.15, 0.065, 1], "metallicFactor": 0,
                                                                          "roughnessFactor": 0.9}}])


# --------------------------------------------------------------------------------------------------------------------- glTF


def check(name, mesh):
    """Closed and consistently wound: every directed edge has exactly one opposite. Encloses a positive volume."""
    weld = {}
    ids = [weld.setdefault(tuple(round(c * 1e7) for c in p), len(weld)) for p in mesh.positions] # doubles of a texture seam
    edges, volume, away = set(), 0.0, 0
    for t in mesh.triangles:
        a, b, c = (ids[i] for i in t)
        assert len({a, b, c}) == 3, f"{name}: a triangle without area"
        for e in ((a, b), (b, c), (c, a)):
            assert e not in edges, f"{name}: two triangles share the directed edge {mesh.positions[t[0]]}"
            edges.add(e)
        p, q, r = (mesh.positions[i] for i in t)
        volume += dot(p, cross(q, r)) / 6
        facing = dot(cross(sub(q, p), sub(r, p)), add(add(mesh.normals[t[0]], mesh.normals[t[1]]), mesh.normals[t[2]]))
        away += facing <= 0
    assert all((b, a) in edges for a, b in edges), f"{name}: open edges"
    assert volume > 0, f"{name}: inside out"
    assert away <= len(mesh.triangles) // 1000, f"{name}: {away} triangles face away from their normals"
    assert all(math.isfinite(c) for p in mesh.positions + mesh.normals for c in p)


class Gltf:
    def __init__(self, parts, materials, images=(), quantize=False):
        self.binary, self.parts, self.quantize = bytearray(), parts, quantize
        self.json = {"asset": {"version": "2.0", "generator": "nacre samples/assets/make_assets.py"}, "scene": 0, "scenes": [{"nodes": []}],
                     "nodes": [], "meshes": [], "materials": materials, "accessors": [], "bufferViews": []}
        used = set()
        for name, mesh in parts.items():
            check(name, mesh)
            self.part(name, mesh, [m["name"] for m in materials].index(mesh.material))
        if images:
            self.json["images"] = [{"name": n, "mimeType": "image/png", "bufferView": self.view(data)} for n, data in images]
            self.json["textures"] = [{"source": i, "sampler": 0} for i in range(len(images))]
            self.json["samplers"] = [{"magFilter": 9729, "minFilter": 9987, "wrapS": 10497, "wrapT": 10497}]
            used.add("KHR_texture_transform")
        for m in materials:
            used |= set(m.get("extensions", {}))
        if quantize:
            used.add("KHR_mesh_quantization")
            self.json["extensionsRequired"] = ["KHR_mesh_quantization"]
        if used:
            self.json["extensionsUsed"] = sorted(used)

    def view(self, data, **more):
        self.binary += bytes(-len(self.binary) % 4)
        self.json["bufferViews"].append({"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data), **more})
        self.binary += data
        return len(self.json["bufferViews"]) - 1

    def accessor(self, rows, code, component, kind, stride=0, **more):
        """rows of numbers, packed with the struct code; stride > 0 pads each row to it."""
        data = b"".join(struct.pack("<%d%s" % (len(r), code), *r).ljust(stride, b"\0") for r in rows)
        target = 34963 if kind == "SCALAR" else 34962
        layout = {"byteStride": stride} if stride else {}
        self.json["accessors"].append({"bufferView": self.view(data, target=target, **layout), "componentType": component, "count": len(rows),
                                       "type": kind, **more})
        return len(self.json["accessors"]) - 1

    def part(self, name, mesh, material):
        node = {"name": name, "mesh": len(self.json["meshes"])}
        bounds = lambda rows: {"min": [min(c) for c in zip(*rows)], "max": [max(c) for c in zip(*rows)]}
        if self.quantize: # 16-bit positions in the unit cube of the part's box, 16-bit normals
            box = bounds(mesh.positions)
            extent = max(h - l for l, h in zip(box["min"], box["max"]))
            rows = [tuple(int((c - l) / extent * 65535 + 0.5) for c, l in zip(p, box["min"])) for p in mesh.positions]
            node.update(translation=box["min"], scale=[extent] * 3)
            attributes = {"POSITION": self.accessor(rows, "H", 5123, "VEC3", 8, normalized=True, **bounds(rows)),
                          "NORMAL": self.accessor([tuple(round(c * 32767) for c in n) for n in mesh.normals], "h", 5122, "VEC3", 8, normalized=True)}
        else:
            rows = [struct.unpack("<3f", struct.pack("<3f", *p)) for p in mesh.positions]
            attributes = {"POSITION": self.accessor(rows, "f", 5126, "VEC3", **bounds(rows)), "NORMAL": self.accessor(mesh.normals, "f", 5126, "VEC3")}
        if mesh.uvs:
            attributes["TEXCOORD_0"] = self.accessor(mesh.uvs, "f", 5126, "VEC2")
        if mesh.colors:
            attributes["COLOR_0"] = self.accessor([tuple(round(c * 65535) for c in rgb) for rgb in mesh.colors], "H", 5123, "VEC3", 8, normalized=True)
        flat = [(i,) for t in mesh.triangles for i in t]
        wide = len(mesh.positions) > 65535
        indices = self.accessor(flat, "I" if wide else "H", 5125 if wide else 5123, "SCALAR")
        self.json["meshes"].append({"name": name, "primitives": [{"attributes": attributes, "indices": indices, "material": material}]})
        self.json["scenes"][0]["nodes"].append(len(self.json["nodes"]))
        self.json["nodes"].append(node)

    def write(self, path):
        self.json["buffers"] = [{"byteLength": len(self.binary)}]
        text = json.dumps(self.json, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        binary = bytes(self.binary) + bytes(-len(self.binary) % 4)
        with open(path, "wb") as f:
            f.write(struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + len(binary)))
            f.write(struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary)
        for name, m in self.parts.items():
            print("%s: %-8s %-8s %6d vertices %6d triangles" % (os.path.basename(path), name, m.material, len(m.positions), len(m.triangles)))
        print("%s: %d bytes" % (path, os.path.getsize(path)))


def main():
    makers = {"figurine": lambda: figurine(arguments.cell), "vase": vase, "pebble": pebble}
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help="figurine, vase, pebble; default: all")
    parser.add_argument("--out", default=os.path.dirname(os.path.abspath(__file__)), help="folder to write to; default: beside this script")
    parser.add_argument("--cell", type=float, default=0.150, help="grid cell of the figurine in centimetres")
    arguments = parser.parse_args()
    for name in arguments.names or makers:
        if name not in makers:
            parser.error("'%s' is not one of %s" % (name, ", ".join(makers)))
        makers[name]().write(os.path.join(arguments.out, name + ".glb"))


if __name__ == "__main__":
    main()
