#!/usr/bin/env python3
"""Meshes on which relighting fails first:  make_detail_objects.py OUT [NAME...]
relief_coat_a, _b, _c   fine relief under a clear coat: a sphere, a torus, a rounded box (make_datasets.sh makes a and c scatter light inside)
roughness_bands         a torus in eight sectors, roughness 0.1 to 0.8, two base colours
thin_parts              a sphere inside rings of three thicknesses, a thin dish
rough_metal             gold and iron, roughness 0.3 and 0.5
cloth                   a pleated bag, woven: diffuse with a weak, rough highlight (the light stage has no sheen)
iridescent              thin films on metal (a sphere) and on dark enamel (a torus)
fur_ball, fur_b         what make_datasets.sh grows fur on: a sphere; a body with head and ears in two colours
Relief is geometry: triangles a sixth of its wavelength or smaller, and the normals of the surface itself. The files are the truth about
normals and materials (check_materials compares an asset with them)."""
import array, json, math, pathlib, random, sys

from make_objects import write_glb


def add(p, q, s=1.0):
    return (p[0] + s * q[0], p[1] + s * q[1], p[2] + s * q[2])


def unit(p):
    return tuple(x / math.sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]) for x in p)


def patch(point, rows, columns):
    """Vertices and triangles of point(u, v) over [0, 1]^2, du x dv outwards. Normals by central differences in doubles: exact for floats."""
    e, vertices = 1e-5, array.array("f")
    for i in range(rows + 1):
        for j in range(columns + 1):
            u, v = i / rows, j / columns
            a, b = add(point(u + e, v), point(u - e, v), -1), add(point(u, v + e), point(u, v - e), -1)
            vertices.extend(point(u, v))
            vertices.extend(unit((a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])))
    triangles = array.array("I")
    for i in range(rows):
        for j in range(columns):
            a, b = i * (columns + 1) + j, (i + 1) * (columns + 1) + j
            triangles.extend((a, b, b + 1, a, b + 1, a + 1))
    return vertices, triangles


def cube(point, n):
    """Six patches of a surface that is a function of the points of the cube [-1, 1]^3."""
    def face(axis, sign):
        def of(u, v):
            c = [0.0, 0.0, 0.0]
            c[axis], c[axis - 2], c[axis - 1] = sign, 2 * u - 1, sign * (2 * v - 1)
            return point(c)
        return of
    return [patch(face(axis, sign), n, n) for axis in range(3) for sign in (-1, 1)]


def sphere(c):
    """Of the cube to a point of the unit sphere and its normal, in squares of about equal size."""
    n = unit([math.tan(math.pi / 4 * x) for x in c])
    return n, n


def box(half, radius):
    def of(c):
        p = [x * (h + radius) for x, h in zip(c, half)]
        inner = [min(max(x, -h), h) for x, h in zip(p, half)]
        n = unit(add(p, inner, -1))
        return add(inner, n, radius), n
    return of


def torus(ring, tube, axes=(0, 1, 2)):
    def of(u, v):
        a, b = 2 * math.pi * u, 2 * math.pi * v
        n = (math.cos(a) * math.cos(b), math.sin(b), -math.sin(a) * math.cos(b))
        p = (ring * math.cos(a) + tube * n[0], tube * n[1], -ring * math.sin(a) + tube * n[2])
        return tuple(p[k] for k in axes), tuple(n[k] for k in axes)
    return of


def waves(wavelength, slope, carve=0.0, seed=1):
    """A height over space: 20 plane waves of about this length, the slope an rms. carve > 0: flattened to plateaus and valleys."""
    dice, count = random.Random(seed), 20
    terms = []
    for _ in range(count):
        k = 2 * math.pi / wavelength * dice.uniform(0.75, 1.3)
        terms.append(([k * x for x in unit([dice.gauss(0, 1) for _ in range(3)])], dice.uniform(0, 2 * math.pi)))
    amplitude = slope * wavelength / (2 * math.pi)
    def height(p):
        h = math.sqrt(2 / count) * sum(math.sin(k[0] * p[0] + k[1] * p[1] + k[2] * p[2] + phase) for k, phase in terms)
        return amplitude * (math.tanh(carve * h) / carve if carve else h)
    return height


def displaced(surface, height):
    def of(*where):
        p, n = surface(*where)
        return add(p, n, height(p))
    return of


def bare(surface):
    return lambda *where: surface(*where)[0]


def material(name, colour, roughness, metallic=0, coat=None, **extensions):
    if coat:
        extensions["KHR_materials_clearcoat"] = {"clearcoatFactor": coat[0], "clearcoatRoughnessFactor": coat[1]}
    return {"name": name, "extensions": extensions,
            "pbrMetallicRoughness": {"baseColorFactor": [*colour, 1], "metallicFactor": metallic, "roughnessFactor": roughness}}


def write(path, parts):
    """parts: (patch, material) each."""
    binary = b""
    document = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}], "accessors": [], "bufferViews": [],
                "materials": [], "meshes": [{"primitives": []}]}
    for (vertices, triangles), m in parts:
        if m not in document["materials"]:
            document["materials"].append(m)
        view, accessor, count = len(document["bufferViews"]), len(document["accessors"]), len(vertices) // 6
        low, high = ([pick(vertices[k::6]) for k in range(3)] for pick in (min, max))
        document["bufferViews"] += [{"buffer": 0, "byteOffset": len(binary), "byteLength": 24 * count, "byteStride": 24, "target": 34962},
                                    {"buffer": 0, "byteOffset": len(binary) + 24 * count, "byteLength": 4 * len(triangles), "target": 34963}]
        document["accessors"] += [{"bufferView": view, "componentType": 5126, "count": count, "type": "VEC3", "min": low, "max": high},
                                  {"bufferView": view, "byteOffset": 12, "componentType": 5126, "count": count, "type": "VEC3"},
                                  {"bufferView": view + 1, "componentType": 5125, "count": len(triangles), "type": "SCALAR"}]
        document["meshes"][0]["primitives"].append({"attributes": {"POSITION": accessor, "NORMAL": accessor + 1}, "indices": accessor + 2,
                                                    "material": document["materials"].index(m)})
        for numbers in (vertices, triangles):
            if sys.byteorder == "big":
                numbers.byteswap()
            binary += numbers.tobytes()
    used = {name for m in document["materials"] for name in m["extensions"]}
    if used:
        document["extensionsUsed"] = sorted(used)
    document["buffers"] = [{"byteLength": len(binary)}]
    write_glb(path, document, binary)


BODY = {"KHR_materials_specular": {"specularFactor": 0}} # of the coat's index: no second reflection where they meet


def relief_coat_a():
    jade = material("jade", (0.30, 0.60, 0.36), 1, coat=(1, 0.12), **BODY)
    return [(p, jade) for p in cube(displaced(sphere, waves(0.16, 0.4)), 150)]


def relief_coat_b():
    glaze = material("glaze", (0.55, 0.14, 0.09), 1, coat=(1, 0.07), **BODY)
    return [(patch(displaced(torus(0.66, 0.32), waves(0.2, 0.35, seed=2)), 320, 150), glaze)]


def relief_coat_c():
    alabaster = material("alabaster", (0.80, 0.68, 0.55), 0.35, coat=(0.8, 0.2))
    return [(p, alabaster) for p in cube(displaced(box((0.42, 0.5, 0.36), 0.16), waves(0.2, 0.5, carve=2, seed=3)), 130)]


def roughness_bands():
    parts = []
    for i, roughness in enumerate((0.1, 0.5, 0.2, 0.7, 0.3, 0.8, 0.15, 0.4)):
        whole = bare(torus(0.66, 0.34))
        parts.append((patch(lambda u, v: whole((i + u) / 8, v), 24, 96),
                      material(f"rough {roughness}", ((0.55, 0.30, 0.12), (0.15, 0.28, 0.50))[i % 2], roughness)))
    return parts


def thin_parts():
    ivory, red = material("ivory", (0.75, 0.70, 0.60), 0.4), material("red", (0.60, 0.08, 0.06), 0.25)
    dish = displaced(sphere, lambda p: 0.0)
    parts = [(p, ivory) for p in cube(lambda c: tuple(0.42 * x for x in dish(c)), 24)]
    parts += [(p, ivory) for p in cube(lambda c: add((0, -0.6, 0), [s * x for s, x in zip((0.7, 0.015, 0.7), dish(c))]), 64)]
    for tube, axes in ((0.035, (0, 1, 2)), (0.02, (1, 2, 0)), (0.012, (2, 0, 1))):
        parts.append((patch(bare(torus(0.95, tube, axes)), 256, 16), red))
    return parts


def rough_metal():
    gold, iron = material("gold", (1.0, 0.77, 0.34), 0.3, metallic=1), material("iron", (0.56, 0.57, 0.58), 0.5, metallic=1)
    dented = displaced(sphere, waves(0.9, 0.25, seed=4))
    return [(p, iron) for p in cube(lambda c: tuple(0.5 * x for x in dented(c)), 64)] + [(patch(bare(torus(0.8, 0.2)), 192, 64), gold)]


def cloth():
    wool = material("wool", (0.42, 0.16, 0.24), 0.9, KHR_materials_specular={"specularFactor": 0.3})
    def bag(c):
        n = sphere(c)[0]
        turn, across = math.atan2(n[2], n[0]), math.hypot(n[0], n[2])
        pleats = 1 + 0.10 * across * across * math.sin(9 * turn + 1.5 * n[1])
        return (0.8 * pleats * n[0], n[1], 0.8 * pleats * n[2])
    def weave(c): # threads along planes, over and under each other
        p = sphere(c)[0]
        return add(bag(c), p, 0.007 * math.sin(55 * p[0] + 20 * p[1]) * math.sin(55 * p[2] - 20 * p[1]) + 0.004 * math.sin(70 * p[1]))
    return [(p, wool) for p in cube(weave, 130)]


def film(ior, nanometres):
    return {"KHR_materials_iridescence": {"iridescenceFactor": 1, "iridescenceIor": ior, "iridescenceThicknessMaximum": nanometres}}


def iridescent():
    titanium = material("titanium", (0.55, 0.50, 0.47), 0.35, metallic=1, **film(1.8, 380))
    enamel = material("enamel", (0.04, 0.05, 0.06), 0.3, **film(2.2, 260))
    dented = displaced(sphere, waves(0.9, 0.2, seed=5))
    return ([(p, titanium) for p in cube(lambda c: tuple(0.52 * x for x in dented(c)), 64)] +
            [(patch(displaced(torus(0.8, 0.19), waves(0.7, 0.2, seed=6)), 192, 64), enamel)])


def fur_ball():
    return [(p, material("fur", (0.36, 0.19, 0.09), 0.6)) for p in cube(bare(sphere), 40)]


def fur_b():
    cream, grey = material("cream", (0.50, 0.36, 0.22), 0.6), material("grey", (0.10, 0.10, 0.12), 0.6)
    def ball(middle, size, m):
        return [(p, m) for p in cube(lambda c: add(middle, [s * x for s, x in zip(size, sphere(c)[0])]), 32)]
    return (ball((0, -0.25, 0), (0.62, 0.5, 0.5), cream) + ball((0.42, 0.35, 0), (0.32, 0.3, 0.3), grey) +
            ball((0.42, 0.68, 0.2), (0.06, 0.16, 0.1), cream) + ball((0.42, 0.68, -0.2), (0.06, 0.16, 0.1), cream))


OBJECTS = (relief_coat_a, relief_coat_b, relief_coat_c, roughness_bands, thin_parts, rough_metal, cloth, iridescent, fur_ball, fur_b)


def main():
    out, names = pathlib.Path(sys.argv[1]), sys.argv[2:] or [o.__name__ for o in OBJECTS]
    out.mkdir(parents=True, exist_ok=True)
    for make in OBJECTS:
        if make.__name__ in names:
            write(out / f"{make.__name__}.glb", make())


if __name__ == "__main__":
    main()
