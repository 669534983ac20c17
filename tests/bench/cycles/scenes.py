"""What both path tracers render: meshes (.glb), materials, cameras, lights and an environment map, all of our own making.

    /usr/bin/python3 scenes.py OUT      (needs numpy; the interpreter inside Blender has it too)

Everything here is in the dataset frame (+Z up, right-handed, unit scale). glTF is +Y up: (x, y, z) of a file is (x, -z, y) here.
render_cycles.py imports this file and takes the triangles from the same arrays, so that no importer stands between the two.
"""
import json
import math
import os
import struct
import sys

import numpy as np

SIZE = 96                   # pixels, square
CAMERA_ANGLE_X = 0.5        # radians
CAMERA_DISTANCE = 3.6

# Cycles' inputs of a wax beside what the tracer is given. Cycles 3.4.1 turns colour A into the single-scattering albedo below and
# "Random Walk (Fixed Radius)" walks with a mean free path of radius * scale / (4 pi): see README.md for the measurements.
def cyclesAlpha(a):
    a = np.asarray(a, dtype=np.float64)
    t = a ** 0.25
    alpha = (1 - t) * 1.8260523782 * np.arctan(5.11246807189 * a) ** 1.09686102424 \
        + t * 0.496310210422 * np.arctan(4.23500903750 * a) ** 2.40602999408
    return np.minimum(alpha, 0.999999)


def wax(colour, mfp):
    return {"kind": "wax", "color": colour, "mfp": mfp, "alpha": [round(float(v), 7) for v in cyclesAlpha(colour)], "g": 0.0,
            "boundary": "diffuse"}


# roughness is glTF's perceptual one. Conductor and dielectric: a sphere under one light without size, where nothing but direct light is
# seen and Schlick's F(V.H) can be built from nodes.
VARIANTS = {
    "diffuse":  {"mesh": "blob", "kind": "diffuse", "color": [0.8, 0.5, 0.3]},
    "glossy":   {"mesh": "blob", "kind": "glossy", "color": [1.0, 1.0, 1.0], "roughness": 0.3},
    "polished": {"mesh": "blob", "kind": "glossy", "color": [1.0, 1.0, 1.0], "roughness": 0.12, "splits": ["directional", "environment"]},
    "wax":      {"mesh": "blob", **wax([0.75, 0.6, 0.3], [0.04, 0.02, 0.01])},
    "wax_clear": {"mesh": "blob", **wax([0.8, 0.7, 0.6], [0.25, 0.12, 0.06])},
    "wax_ball": {"mesh": "sphere", **wax([0.8, 0.7, 0.6], [0.25, 0.12, 0.06]), "splits": ["directional"]},  # no light enters twice
    # Cycles' volumes: Henyey-Greenstein, an index-matched boundary (no surface shader) or a Glass BSDF, which no shadow ray passes.
    "fog":      {"mesh": "blob", "kind": "volume", "mfp": [0.3, 0.2, 0.1], "alpha": [0.95, 0.8, 0.6], "g": 0.3, "boundary": "none"},
    "glass":    {"mesh": "blob", "kind": "volume", "mfp": [0.3, 0.2, 0.1], "alpha": [0.95, 0.8, 0.6], "g": 0.3, "boundary": "dielectric",
                 "roughness": 0.1, "splits": ["environment"]},
    "gold":     {"mesh": "sphere", "kind": "conductor", "color": [1.0, 0.71, 0.29], "roughness": 0.5,
                 "splits": ["test", "directional"]},
    "plastic":  {"mesh": "sphere", "kind": "dielectric", "color": [0.3, 0.5, 0.8], "roughness": 0.4,
                 "splits": ["test", "directional"]},
}
SAMPLES = {"diffuse": 128, "glossy": 192, "wax": 160, "conductor": 64, "dielectric": 64, "fog": 160, "glass": 96}


# ---- meshes -------------------------------------------------------------------------------------------------------------------------

def icosphere(subdivisions):
    p = (1 + math.sqrt(5)) / 2
    v = [(-1, p, 0), (1, p, 0), (-1, -p, 0), (1, -p, 0), (0, -1, p), (0, 1, p), (0, -1, -p), (0, 1, -p),
         (p, 0, -1), (p, 0, 1), (-p, 0, -1), (-p, 0, 1)]
    f = [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2), (10, 7, 6), (7, 1, 8),
         (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1)]
    v, f = np.array(v, dtype=np.float64), np.array(f, dtype=np.int64)
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    for _ in range(subdivisions):
        edges = np.sort(np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]]), axis=1)
        unique, inverse = np.unique(edges, axis=0, return_inverse=True)
        middle = v[unique[:, 0]] + v[unique[:, 1]]
        middle /= np.linalg.norm(middle, axis=1, keepdims=True)
        ab, bc, ca = (inverse.reshape(3, -1) + len(v))
        a, b, c = f.T
        f = np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))])
        v = np.concatenate([v, middle])
    return v, f


def blob():
    """Concave and watertight: a sphere with three lobes, two deep dents and ripples; 81920 triangles."""
    d, f = icosphere(6)
    def bump(centre, sharpness):
        c = np.array(centre, dtype=np.float64)
        return np.exp(sharpness * (d @ (c / np.linalg.norm(c)) - 1))
    r = 0.62 + 0.34 * bump((1, 0.3, 0.8), 9) + 0.30 * bump((-0.7, 0.9, 0.4), 11) + 0.28 * bump((-0.3, -1, 0.1), 10)
    r += -0.30 * bump((0.5, -0.6, 0.7), 8) - 0.28 * bump((0.2, 1, -0.1), 12)
    r += 0.03 * np.sin(6 * d[:, 0] + 1) * np.sin(7 * d[:, 1]) + 0.02 * np.sin(11 * d[:, 2] + 2 * d[:, 0])
    return withNormals(d * r[:, None], f)


def sphere():
    d, f = icosphere(6)
    return (0.8 * d).astype(np.float32), d.astype(np.float32), f.astype(np.uint32)


def withNormals(v, f):
    """Vertex normals: mean of the faces' normals weighted by area."""
    face = np.cross(v[f[:, 1]] - v[f[:, 0]], v[f[:, 2]] - v[f[:, 0]])
    n = np.zeros_like(v)
    for corner in range(3):
        np.add.at(n, f[:, corner], face)
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    return v.astype(np.float32), n.astype(np.float32), f.astype(np.uint32)


MESHES = {"blob": blob, "sphere": sphere}


def gltfMaterial(variant):
    """Core metallic-roughness; a medium comes from the command line (--sss)."""
    lambert = {"pbrMetallicRoughness": {"baseColorFactor": variant.get("color", [1.0, 1.0, 1.0]) + [1.0], "metallicFactor": 0.0, "roughnessFactor": 1.0},
               "extensions": {"KHR_materials_specular": {"specularFactor": 0.0}}}
    if "roughness" not in variant:
        return lambert
    return {"pbrMetallicRoughness": {"baseColorFactor": variant.get("color", [1.0, 1.0, 1.0]) + [1.0], "roughnessFactor": variant["roughness"],
                                     "metallicFactor": 1.0 if variant["kind"] in ("glossy", "conductor") else 0.0}}


def writeGlb(path, v, n, f, variant):
    yUp = lambda a: np.stack([a[:, 0], a[:, 2], -a[:, 1]], axis=1).astype("<f4")
    positions, normals, indices = yUp(v), yUp(n), f.astype("<u4")
    chunks = [positions.tobytes(), normals.tobytes(), indices.tobytes()]
    offsets = np.concatenate([[0], np.cumsum([len(c) for c in chunks])])
    material = {"name": "surface", **gltfMaterial(variant)}
    doc = {"asset": {"version": "2.0", "generator": "scenes.py"}, "scene": 0, "scenes": [{"nodes": [0]}],
           "nodes": [{"mesh": 0}], "materials": [material],
           "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2, "material": 0}]}],
           "buffers": [{"byteLength": int(offsets[3])}],
           "bufferViews": [{"buffer": 0, "byteOffset": int(offsets[i]), "byteLength": len(chunks[i]), "target": t}
                           for i, t in enumerate((34962, 34962, 34963))],
           "accessors": [{"bufferView": 0, "componentType": 5126, "count": len(v), "type": "VEC3",
                          "min": positions.min(0).tolist(), "max": positions.max(0).tolist()},
                         {"bufferView": 1, "componentType": 5126, "count": len(v), "type": "VEC3"},
                         {"bufferView": 2, "componentType": 5125, "count": int(indices.size), "type": "SCALAR"}]}
    if "extensions" in material:
        doc["extensionsUsed"] = sorted(material["extensions"])
    text = json.dumps(doc).encode()
    text += b" " * (-len(text) % 4)
    binary = b"".join(chunks)
    with open(path, "wb") as out:
        out.write(struct.pack("<III", 0x46546C67, 2, 12 + 8 + len(text) + 8 + len(binary)))
        out.write(struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(binary), 0x004E4942) + binary)


# ---- cameras and lights -------------------------------------------------------------------------------------------------------------

def lookAtOrigin(position):
    z = np.array(position, dtype=np.float64)
    z /= np.linalg.norm(z)
    x = np.cross((0, 0, 1), z)
    x /= np.linalg.norm(x)
    m = np.eye(4)
    m[:3, 0], m[:3, 1], m[:3, 2], m[:3, 3] = x, np.cross(z, x), z, position
    return m


def direction(azimuthDegrees, elevationDegrees):
    a, e = math.radians(azimuthDegrees), math.radians(elevationDegrees)
    return np.array([math.cos(a) * math.cos(e), math.sin(a) * math.cos(e), math.sin(e)])


CAMERAS = [lookAtOrigin(CAMERA_DISTANCE * direction(a, e)) for a, e in ((20, 25), (115, 50), (200, 5), (300, -20))]


def splits(variant):
    """split name -> list of (camera index, light); a far and a near point light, a directional one, the environment."""
    far = {"type": "point", "position": (5.0 * direction(60, 40)).tolist(), "intensity": [60.0, 60.0, 60.0]}
    near = {"type": "point", "position": (1.7 * direction(250, 30)).tolist(), "intensity": [8.0, 7.0, 6.0]}
    sun = {"type": "directional", "direction_to_light": direction(-20, 35).tolist(), "irradiance": [3.0, 3.0, 3.0]}
    sky = {"type": "environment", "map": "../env.exr"}
    out = {"test": [(c, light) for c in range(4) for light in (far, near)], "directional": [(c, sun) for c in range(4)],
           "environment": [(c, sky) for c in range(4)]}
    return {name: frames for name, frames in out.items() if name in variant.get("splits", out)}


def environmentMap():
    """Smooth: a ramp from ground to sky and two coloured lobes, 128 x 64. Texel (u, v): theta = pi v from +Z, phi = pi - 2 pi u."""
    h, w = 64, 128
    theta = (np.arange(h) + 0.5) / h * math.pi
    phi = math.pi - 2 * math.pi * (np.arange(w) + 0.5) / w
    d = np.stack([np.sin(theta)[:, None] * np.cos(phi), np.sin(theta)[:, None] * np.sin(phi),
                  np.cos(theta)[:, None] * np.ones(w)], axis=2)
    sky = 0.25 + 0.2 * d[:, :, 2:3] * np.array([0.8, 1.0, 1.3])
    for centre, sharpness, colour in ((direction(40, 35), 40, (14, 12, 9)), (direction(170, -5), 12, (0.6, 1.0, 2.2))):
        sky = sky + np.exp(sharpness * (d @ centre - 1))[:, :, None] * np.array(colour)
    return sky.astype(np.float32)


def writeExr(path, image):
    """Uncompressed scanline OpenEXR, float RGB (https://openexr.com/en/latest/OpenEXRFileLayout.html)."""
    h, w, _ = image.shape
    attribute = lambda name, kind, data: name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(data)) + data
    channels = b"".join(c + b"\0" + struct.pack("<iB3xii", 2, 0, 1, 1) for c in (b"B", b"G", b"R")) + b"\0"
    window = struct.pack("<4i", 0, 0, w - 1, h - 1)
    header = struct.pack("<ii", 20000630, 2) + attribute("channels", "chlist", channels) + attribute("compression", "compression", b"\0") \
        + attribute("dataWindow", "box2i", window) + attribute("displayWindow", "box2i", window) \
        + attribute("lineOrder", "lineOrder", b"\0") + attribute("pixelAspectRatio", "float", struct.pack("<f", 1)) \
        + attribute("screenWindowCenter", "v2f", struct.pack("<ff", 0, 0)) + attribute("screenWindowWidth", "float", struct.pack("<f", 1)) + b"\0"
    lineBytes = w * 3 * 4
    first = len(header) + 8 * h
    with open(path, "wb") as out:
        out.write(header + struct.pack("<%dQ" % h, *[first + y * (8 + lineBytes) for y in range(h)]))
        for y in range(h):
            out.write(struct.pack("<ii", y, lineBytes) + np.ascontiguousarray(image[y, :, ::-1].T).astype("<f4").tobytes())


def writeTransforms(folder, name, variant, renderer):
    """The canonical description of folder/; images are folder/SPLIT/NNN.exr."""
    for split, frames in splits(variant).items():
        doc = {"camera_angle_x": CAMERA_ANGLE_X, "width": SIZE, "height": SIZE, "color_space": "linear", "background": "black",
               "object": name, "renderer": renderer,
               "frames": [{"file_path": "%s/%03d.exr" % (split, i), "transform_matrix": CAMERAS[c].tolist(), "light": light}
                          for i, (c, light) in enumerate(frames)]}
        with open(os.path.join(folder, "transforms_%s.json" % split), "w") as out:
            json.dump(doc, out, indent=1)


def sssArgument(variant):
    numbers = lambda values: ",".join("%.7g" % v for v in values)
    return "surface:alpha=%s:mfp=%s:g=%g:boundary=%s" % (numbers(variant["alpha"]), numbers(variant["mfp"]), variant["g"], variant["boundary"])


def main():
    out = sys.argv[sys.argv.index("--") + 1] if "--" in sys.argv else sys.argv[1]  # inside Blender, or alone
    os.makedirs(out, exist_ok=True)
    writeExr(os.path.join(out, "env.exr"), environmentMap())
    built = {name: make() for name, make in MESHES.items()}
    for name, variant in VARIANTS.items():
        writeGlb(os.path.join(out, name + ".glb"), *built[variant["mesh"]], variant)
    with open(os.path.join(out, "sss.txt"), "w") as text:  # VARIANT ARGUMENT, for the shell script
        for name, variant in VARIANTS.items():
            text.write("%s %s\n" % (name, sssArgument(variant) if "mfp" in variant else "-"))


if __name__ == "__main__":
    main()
