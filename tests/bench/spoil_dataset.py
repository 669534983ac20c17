#!/usr/bin/env python3
"""A copy of an OLAT dataset of the canonical convention with something wrong in it, for tests/bench/captures.sh. Images that stay as they are become links.

spoil_dataset.py DATASET OUT --scale S --move X,Y,Z     the world, lights and cameras of every split, S times as large and moved (intensities times S^2)
spoil_dataset.py DATASET OUT --lights DEG,SHARE         lights of the train split turned about the origin by DEG degrees (rms), gains off by SHARE (rms)
spoil_dataset.py DATASET OUT --broken                   four images of the train split: one cut off, one of another size, one black, one saturated
"""
import argparse
import json
import math
import os
import random
import struct
import sys
import zlib


def png(path, width, height, rgb):
    row = b"\0" + bytes(rgb) * width
    chunk = lambda kind, data: struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    with open(path, "wb") as f:
        f.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)))
        f.write(chunk(b"IDAT", zlib.compress(row * height)) + chunk(b"IEND", b""))


def spoilt(light, degrees, share, seed):
    """The same light is always off by the same."""
    key = "position" if light["type"] == "point" else "direction_to_light"
    rng = random.Random("%d %s" % (seed, light[key]))
    d = light[key]
    length = math.sqrt(sum(x * x for x in d))
    turn = [rng.gauss(0, math.radians(degrees) / math.sqrt(2)) for _ in range(3)]
    along = sum(t * x for t, x in zip(turn, d)) / length
    moved = [x + length * (t - along * x / length) for t, x in zip(turn, d)]
    scale = length / math.sqrt(sum(x * x for x in moved))
    gain = math.exp(rng.gauss(0, share))
    strength = "intensity" if light["type"] == "point" else "irradiance"
    value = light[strength]
    return dict(light, **{key: [scale * x for x in moved], strength: [gain * x for x in value] if isinstance(value, list) else gain * value})


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset")
    parser.add_argument("out")
    parser.add_argument("--scale", type=float, default=1.0)
    parser.add_argument("--move", default="0,0,0")
    parser.add_argument("--lights", default="0,0")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--broken", action="store_true")
    args = parser.parse_args()
    move = [float(x) for x in args.move.split(",")]

    os.makedirs(args.out)
    for name in sorted(os.listdir(args.dataset)):
        if not (name.startswith("transforms_") and name.endswith(".json")):
            continue
        with open(os.path.join(args.dataset, name)) as f:
            description = json.load(f)
        frames = description["frames"]
        for frame in frames:
            for r in range(3):
                frame["transform_matrix"][r][3] = args.scale * frame["transform_matrix"][r][3] + move[r]
            light = frame["light"]
            if light["type"] == "point":
                light["position"] = [args.scale * x + m for x, m in zip(light["position"], move)]
                intensity = light["intensity"]
                light["intensity"] = [args.scale**2 * x for x in intensity] if isinstance(intensity, list) else args.scale**2 * intensity
            if name == "transforms_train.json" and args.lights != "0,0":
                frame["light"] = spoilt(light, *(float(x) for x in args.lights.split(",")), args.seed)
            link = os.path.join(args.out, frame["file_path"])
            os.makedirs(os.path.dirname(link), exist_ok=True)
            if not os.path.lexists(link):
                os.symlink(os.path.realpath(os.path.join(args.dataset, frame["file_path"])), link)
            if light["type"] == "environment":
                link = os.path.join(args.out, light["map"])
                os.makedirs(os.path.dirname(link) or ".", exist_ok=True)
                if not os.path.lexists(link):
                    os.symlink(os.path.realpath(os.path.join(args.dataset, light["map"])), link)
        if args.broken and name == "transforms_train.json":
            width, height = description["width"], description["height"]
            for kind, frame in zip(("cut", "odd", "black", "white"), frames[len(frames) // 5 :: len(frames) // 5]):
                path = os.path.join(args.out, frame["file_path"])
                original = os.path.realpath(path)
                os.remove(path)
                if kind == "cut":
                    with open(original, "rb") as f, open(path, "wb") as g:
                        g.write(f.read()[: os.path.getsize(original) // 2])
                    continue
                frame["file_path"] = os.path.splitext(frame["file_path"])[0] + "_" + kind + ".png"
                size = (width + 7, height - 3) if kind == "odd" else (width, height)
                png(os.path.join(args.out, frame["file_path"]), *size, (255,) * 3 if kind == "white" else (0,) * 3)
        with open(os.path.join(args.out, name), "w") as f:
            json.dump(description, f)


if __name__ == "__main__":
    sys.exit(main())
