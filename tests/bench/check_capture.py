#!/usr/bin/env python3
"""What a bake found out about a simulated capture, against its truth:  check_capture.py CAPTURE BAKE.json
CAPTURE is a folder of nacre synth --capture, BAKE.json is of nacre bake --json. Prints rows of a table: an error as it was stated, and what is left of it."""
import json
import math
import sys


def unit(v):
    return [x / math.hypot(*v) for x in v]


def degrees(a, b):
    a, b = unit(a), unit(b)
    cross = (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
    return math.degrees(math.atan2(math.hypot(*cross), sum(x * y for x, y in zip(a, b))))


def turn(a, b):
    """Angle between two poses."""
    trace = sum(a[r][k] * b[r][k] for r in range(3) for k in range(3))
    return math.degrees(math.acos(max(-1.0, min(1.0, (trace - 1) / 2))))


def rms(values):
    return math.sqrt(sum(v * v for v in values) / len(values))


def centred(values):
    return [v - sum(values) / len(values) for v in values]


def main():
    folder, report = sys.argv[1], json.load(open(sys.argv[2]))
    truth = json.load(open(folder + "/truth.json"))
    frames = list(zip(json.load(open(folder + "/transforms_train.json"))["frames"], truth["frames"]))

    def row(name, before, after, unit, largest=None):
        print("| %s | %.3g %s | %s%s |" % (name, before, unit, "-" if after is None else "%.3g %s" % (after, unit), "" if largest is None else " (largest %.3g)" % largest))

    if "flash_offset" in truth:
        offset, millimetres = truth["flash_offset"], 1000 * truth["metres_per_unit"]
        found = report.get("flash_offset")
        row("flash offset", millimetres * math.hypot(*offset), found and millimetres * math.dist(offset, found), "mm")
    else:
        place = lambda light: light.get("position") or light["direction_to_light"]
        lights = {tuple(place(said["light"])): (place(was["light"]), was["light_gain"]) for said, was in frames}
        found = []
        for l in report.get("lights") or []:
            stated = min(lights, key=lambda p: degrees(p, place(l)))
            found.append((degrees(lights[stated][0], l["refined"]), math.log(l["gain"] / lights[stated][1])))
        after = [f[0] for f in found]
        row("light directions, rms", rms([degrees(said, was) for said, (was, _) in lights.items()]), rms(after) if found else None, "deg", max(after) if found else None)
        gains = [100 * abs(x) for x in centred([f[1] for f in found])] if found else []
        row("light gains, rms", 100 * rms([math.log(g) for _, g in lights.values()]), rms(gains) if found else None, "%", max(gains) if found else None)
    stated = [turn(said["transform_matrix"], was["transform_matrix"]) for said, was in frames]
    if max(stated) > 1e-4:
        cameras = report.get("cameras") or []
        unique, seen = [], set()  # cameras are numbered as they first occur
        for said, was in frames:
            key = json.dumps(said["transform_matrix"])
            if key not in seen:
                seen.add(key)
                unique.append(was["transform_matrix"])
        row("poses, rms", rms(stated), rms([turn(c, w) for c, w in zip(cameras, unique)]) if len(cameras) == len(unique) else None, "deg")
    evs = [was["exposure_ev"] for _, was in frames]
    if max(map(abs, evs)) > 0:
        gains = report.get("exposures") or []
        # a bake's gain multiplies the render, as the exposure multiplied the light
        left = centred([math.log2(g) - ev for g, ev in zip(gains, evs)]) if len(gains) == len(evs) else None
        row("exposures, rms", rms(evs), left and rms(left), "EV")


main()
