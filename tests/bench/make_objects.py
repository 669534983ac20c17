#!/usr/bin/env python3
"""Meshes to bake whose answer is known:  make_objects.py PEBBLE.glb OUT
Writes OUT/sphere.glb (analytic normals, 0.6 0.25 0.15, roughness 0.35), OUT/stone.glb, the mesh of PEBBLE.glb with that material, and
OUT/pair.glb, two spheres beside each other, one of a material named coat (for nacre synth --fur ...:material=coat), one dull and plain;
OUT/wires.glb, three thin rings, and OUT/coal.glb, the mesh of PEBBLE.glb almost black and glossy."""
import json, math, pathlib, struct, sys

MATERIAL = {"name": "plain", "pbrMetallicRoughness": {"baseColorFactor": [0.6, 0.25, 0.15, 1], "metallicFactor": 0, "roughnessFactor": 0.35}}


def write_glb(path, document, binary):
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    body = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(binary), 0x004E4942) + binary
    path.write_bytes(struct.pack("<III", 0x46546C67, 2, 12 + len(body)) + body)


def grid(rings, segments, point, normal):
    """One primitive: point(u, v) and normal(u, v) over [0, 1]^2."""
    points, triangles = [], []
    for i in range(rings + 1):
        for j in range(segments + 1):
            points.append(point(i / rings, j / segments) + normal(i / rings, j / segments))
    for i in range(rings):
        for j in range(segments):
            a, b = i * (segments + 1) + j, (i + 1) * (segments + 1) + j
            triangles += [(a, b, b + 1), (a, b + 1, a + 1)]
    vertices = b"".join(struct.pack("<6f", *p) for p in points)
    low, high = ([pick(p[k] for p in points) for k in range(3)] for pick in (min, max))
    indices = b"".join(struct.pack("<3I", *t) for t in triangles)
    count = len(points)
    return {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}], "materials": [MATERIAL],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 2}, "indices": 1, "material": 0}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": count, "type": "VEC3", "min": low, "max": high},
                      {"bufferView": 1, "componentType": 5125, "count": 3 * len(triangles), "type": "SCALAR"},
                      {"bufferView": 0, "byteOffset": 12, "componentType": 5126, "count": count, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": len(vertices), "byteStride": 24, "target": 34962},
                        {"buffer": 0, "byteOffset": len(vertices), "byteLength": len(indices), "target": 34963}],
        "buffers": [{"byteLength": len(vertices) + len(indices)}]}, vertices + indices


def sphere(rings=96, segments=192):
    def point(u, v):
        theta, phi = math.pi * u, 2 * math.pi * v
        return (math.sin(theta) * math.cos(phi), math.cos(theta), -math.sin(theta) * math.sin(phi))
    return grid(rings, segments, point, point)


def wires(radius=0.015):
    def normal(u, v):
        a, b = 2 * math.pi * v, 2 * math.pi * u
        return (math.cos(a) * math.cos(b), math.sin(b), -math.sin(a) * math.cos(b))
    def point(u, v):
        a, n = 2 * math.pi * v, normal(u, v)
        return (math.cos(a) + radius * n[0], radius * n[1], -math.sin(a) + radius * n[2])
    document, binary = grid(12, 192, point, normal)
    h = math.sqrt(0.5)
    document["nodes"] = [{"mesh": 0}, {"mesh": 0, "rotation": [h, 0, 0, h]}, {"mesh": 0, "rotation": [0, 0, h, h]}]
    document["scenes"] = [{"nodes": [0, 1, 2]}]
    return document, binary


def pair():
    document, binary = sphere(48, 96)
    primitive = document["meshes"][0]["primitives"][0]
    document["materials"] = [dict(MATERIAL, name="coat"),
                             dict(MATERIAL, name="plain", pbrMetallicRoughness=dict(MATERIAL["pbrMetallicRoughness"], roughnessFactor=1))]
    document["meshes"] = [{"primitives": [dict(primitive, material=m)]} for m in (0, 1)]
    document["nodes"] = [{"mesh": 0, "translation": [-0.95, 0, 0]}, {"mesh": 1, "translation": [0.95, 0, 0]}]
    document["scenes"] = [{"nodes": [0, 1]}]
    return document, binary


def main():
    source, out = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
    out.mkdir(parents=True, exist_ok=True)
    write_glb(out / "sphere.glb", *sphere())
    write_glb(out / "pair.glb", *pair())
    write_glb(out / "wires.glb", *wires())
    data = source.read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    document = json.loads(data[20:20 + length])
    coal = {"name": "coal", "pbrMetallicRoughness": {"baseColorFactor": [0.02, 0.02, 0.02, 1], "metallicFactor": 0, "roughnessFactor": 0.3}}
    for name, material in (("stone", MATERIAL), ("coal", coal)):
        document["materials"] = [material] * len(document["materials"])
        write_glb(out / f"{name}.glb", document, data[28 + length:])


if __name__ == "__main__":
    main()
