"""The tables and the picture of compare_cycles.sh: OUT/nacre, OUT/nacre_again against OUT/cycles, OUT/cycles_again.

    blender -b -P compare.py -- OUT

With a = mean of our two renders, b = mean of Cycles' two, on pixels with (Cycles') alpha > 0.5, all images and channels of a split together:
  ratio   mean a / mean b - 1: no bias from noise
  raw     mean |a - b| / mean b
  noise   the same of (a1 - a2 + b1 - b2) / 2, whose distribution is that of the noise in a - b
  diff    sqrt(raw^2 - noise^2): what remains of raw when noise is taken out
  rms     sqrt(mean (a1 - b1)(a2 - b2)) / mean b: noise has mean zero in the product; larger than diff where few pixels differ much
"""
import json
import os
import struct
import sys
import zlib

import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import cycles_scene as cs
import scenes

TARGET = 0.02


def figures(a1, a2, b1, b2):
    scale = ((b1 + b2) / 2).mean()
    difference, noise = (a1 + a2 - b1 - b2) / 2, (a1 - a2 + b1 - b2) / 2
    raw, floor = np.abs(difference).mean() / scale, np.abs(noise).mean() / scale
    signed = difference.mean() / scale
    error = noise.std() / np.sqrt(noise.size) / scale
    product = ((a1 - b1) * (a2 - b2)).mean()
    return signed, error, raw, floor, np.sqrt(max(0, raw ** 2 - floor ** 2)), np.sqrt(max(0, product)) / scale


def framePaths(folder, split):
    with open(os.path.join(folder, "transforms_%s.json" % split)) as text:
        return [os.path.join(folder, frame["file_path"]) for frame in json.load(text)["frames"]]


def toBytes(linear):
    x = np.clip(linear, 0, 1)
    return (np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055) * 255 + 0.5).astype(np.uint8)


def writePng(path, rgb):
    h, w, _ = rgb.shape
    chunk = lambda kind, data: struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    rows = np.concatenate([np.zeros((h, 1), np.uint8), rgb.reshape(h, w * 3)], axis=1)
    with open(path, "wb") as out:
        out.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", w, h, 8, 2, 0, 0, 0))
                  + chunk(b"IDAT", zlib.compress(rows.tobytes())) + chunk(b"IEND", b""))


def main():
    out = sys.argv[sys.argv.index("--") + 1]
    sheet, misses = [], []
    print("%-10s %-12s %7s %9s %8s | %7s %7s %7s %7s | %s" % ("variant", "split", "images", "ratio", "+-", "raw", "noise", "diff", "rms", "ratio R, G, B"))
    for name, variant in scenes.VARIANTS.items():
        tiles = []
        for split, frames in scenes.splits(variant).items():
            parts, alphas = [], []
            paths = [framePaths(os.path.join(out, folder, name), split) for folder in ("nacre", "nacre_again", "cycles", "cycles_again")]
            for i in range(len(frames)):
                images = [cs.readImage(p[i]).astype(np.float64) for p in paths]
                mask = (images[2][:, :, 3] + images[3][:, :, 3]) / 2 > 0.5
                if variant.get("boundary") == "none":  # Cycles' alpha is opacity there, ours is coverage
                    mask = np.minimum(images[0][:, :, 3], images[1][:, :, 3]) > 0.999
                parts.append([image[mask][:, :3] for image in images])
                alphas.append(np.abs(images[0][:, :, 3] + images[1][:, :, 3] - images[2][:, :, 3] - images[3][:, :, 3]).max() / 2)
                if i in (0, 1) and len(tiles) < 4:
                    a, b = (images[0] + images[1])[:, :, :3] / 2, (images[2] + images[3])[:, :, :3] / 2
                    exposure = 0.8 / np.percentile(b[mask], 98)
                    tiles += [toBytes(exposure * b), toBytes(exposure * a),
                              (255 * np.clip(0.5 + 5 * (a - b) / b[mask].mean(), 0, 1) * mask[:, :, None]).astype(np.uint8)]
            arrays = [np.concatenate([p[k] for p in parts]) for k in range(4)]
            signed, error, raw, floor, diff, rms = figures(*arrays)
            channels = [figures(*[x[:, c] for x in arrays])[0] for c in range(3)]
            print("%-10s %-12s %7d %+8.2f%% %7.2f%% | %6.2f%% %6.2f%% %6.2f%% %6.2f%% | %s   alpha differs by %.3f at most"
                  % (name, split, len(frames), *(100 * x for x in (signed, error, raw, floor, diff, rms)),
                     " ".join("%+.2f%%" % (100 * c) for c in channels), max(alphas)))
            if diff > TARGET or abs(signed) > TARGET:
                misses.append("%s/%s" % (name, split))
        sheet.append(np.concatenate(tiles, axis=1))
    writePng(os.path.join(out, "compare.png"), np.concatenate(sheet, axis=0))
    print("%s/compare.png: a row per variant: Cycles | Nacre | 0.5 + 5 (Nacre - Cycles) / mean, two images" % out)
    print("all within %.0f %%" % (100 * TARGET) if not misses else "over %.0f %%: %s" % (100 * TARGET, ", ".join(misses)))


main()
