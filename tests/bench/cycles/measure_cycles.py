"""What Cycles' lights and its Subsurface Scattering node do, measured: the evidence behind README.md.

    blender -b -P measure_cycles.py
"""
import math
import os
import sys

import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import cycles_scene as cs
import scenes

LOOK_DOWN = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 3], [0, 0, 0, 1.0]])
QUAD = (np.array([[-2, -2, 0], [2, -2, 0], [2, 2, 0], [-2, 2, 0.0]]), np.array([[0, 1, 2], [0, 2, 3]]))
_c = np.array([[x, y, z] for z in (-2, 0) for y in (-1, 1) for x in (-1, 1)], dtype=np.float64)
BOX = (_c, np.array([[0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4], [2, 6, 7], [2, 7, 3], [0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5]]))
report = []


def say(text):
    report.append(text)
    print(text, flush=True)


def lights():
    for kind in ("point", "sun"):
        cs.reset(4, 0, (1, 1))
        cs.addMesh("plane", *QUAD, material=cs.diffuseMaterial((1, 1, 1)))
        cs.addCamera(LOOK_DOWN, orthoWidth=1e-3)
        if kind == "point":
            light = cs.addPoint((0, 0, 2), (1, 1, 1))
            light.data.energy = 1000.0
            value = cs.render()[0, 0, 0]
            say("point, 1000 W at 2 m above a white Lambert plane: radiance %.5f; with P = 4 pi I it would be %.5f, with P = 4 pi^2 I %.5f"
                % (value, 1000 / (4 * math.pi) / (math.pi * 4), 1000 / (4 * math.pi ** 2) / (math.pi * 4)))
        else:
            cs.addDirectional((0, 0.6, 0.8), (1, 1, 1))
            say("sun, strength 1 under cosine 0.8: radiance %.5f; irradiance 1 facing the light would give %.5f" % (cs.render()[0, 0, 0], 0.8 / math.pi))


def halfSpace(alpha):
    """Reflectance of an index-matched half space, isotropic, cosine entry: Chandrasekhar's H function."""
    x, w = np.polynomial.legendre.leggauss(80)
    x, w = (x + 1) / 2, w / 2
    h, root = np.ones(80), math.sqrt(1 - alpha)
    for _ in range(3000):
        h = (h + 1 / (root + alpha / 2 * (w * x * h) @ (1 / (x[:, None] + x[None, :])))) / 2
    return 1 - 2 * root * (w * h * x).sum()


def reflectance():
    """White surroundings of radiance 1: a pixel on a wide flat box is the reflectance under cosine entry."""
    say("\ncolour A | mfp 0.005: fixed radius | random walk | mfp 0.0025, fixed | alpha of Cycles' fit | half space with that alpha")
    for a in (0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 0.99):
        values = []
        for method, mfp in (("RANDOM_WALK_FIXED_RADIUS", 0.005), ("RANDOM_WALK", 0.005), ("RANDOM_WALK_FIXED_RADIUS", 0.0025)):
            scene = cs.reset(256, 0, (32, 32))
            scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (1, 1, 1, 1)
            cs.addMesh("box", *BOX, material=cs.subsurfaceMaterial((a, a, a), [4 * math.pi * mfp] * 3 if "FIXED" in method else [mfp] * 3, method))
            cs.addCamera(LOOK_DOWN, orthoWidth=0.1)
            pixels = cs.render()[:, :, 0]
            values.append("%.4f +- %.4f" % (pixels.mean(), pixels.std() / 32))
        alpha = float(scenes.cyclesAlpha(a))
        say("%.2f | %s | %.6f | %.4f" % (a, " | ".join(values), alpha, halfSpace(alpha)))


def walks(alpha, count, rng):
    """Exit displacement along x, in mean free paths, and weight alpha^n of analogue walks in a half space after cosine entry."""
    z, x = np.zeros(count), np.zeros(count)
    mu = -np.sqrt(rng.random(count))
    phi = 2 * math.pi * rng.random(count)
    dx = np.sqrt(1 - mu * mu) * np.cos(phi)
    weight = np.ones(count)
    outX, outW = [], []
    for _ in range(4000):
        step = -np.log(1 - rng.random(len(z)))
        newZ = z + step * mu
        left = newZ > 0
        outX.append(x[left] + (-z[left] / mu[left]) * dx[left])
        outW.append(weight[left])
        x, z, weight = (x + step * dx)[~left], newZ[~left], weight[~left] * alpha
        if len(z) == 0 or weight[0] < 1e-4:
            break
        mu = 2 * rng.random(len(z)) - 1
        dx = np.sqrt(1 - mu * mu) * np.cos(2 * math.pi * rng.random(len(z)))
    return np.concatenate(outX), np.concatenate(outW)


def edgeProfile():
    """Parallel light from above, half of it blocked: the brightness across the shadow's edge gives the length scale of the walk."""
    say("\nmethod, colour A, radius | mean free path that fits the edge of a shadow | mfp / radius | root mean square residual / plateau")
    rng = np.random.default_rng(1)
    width = 256
    for method in ("RANDOM_WALK_FIXED_RADIUS", "RANDOM_WALK"):
        for a, radius in ((0.2, 0.3), (0.5, 0.3), (0.8, 0.3), (0.8, 0.6)):
            cs.reset(192, 0, (width, 64))
            cs.addMesh("box", *BOX, material=cs.subsurfaceMaterial((a, a, a), [radius] * 3, method))
            shade = cs.addMesh("shade", np.array([[-3, -3, 1], [0, -3, 1], [0, 3, 1], [-3, 3, 1.0]]), QUAD[1], material=cs.diffuseMaterial((0, 0, 0)))
            shade.visible_camera = False
            cs.addDirectional((0, 0, 1), (math.pi, math.pi, math.pi))
            cs.addCamera(LOOK_DOWN, orthoWidth=1.0)
            profile = cs.render()[:, :, 0].mean(axis=0)
            alpha = float(scenes.cyclesAlpha(a))
            x, w = walks(alpha, 400000, rng)
            order = np.argsort(-x)
            sortedX, total = -x[order], np.cumsum(w[order]) / 400000
            position = (np.arange(width) + 0.5) / width - 0.5
            def model(mfp):  # weight of walks that end at x > -position
                index = np.searchsorted(sortedX, position / mfp)
                return np.where(index > 0, total[np.maximum(index, 1) - 1], 0.0)
            candidates = np.geomspace(radius / 60, radius * 2, 700)
            errors = [((model(m) - profile) ** 2).mean() for m in candidates]
            best = int(np.argmin(errors))
            say("%s, %.1f, %.1f | %.5f | %.4f | %.4f" % (method, a, radius, candidates[best], candidates[best] / radius,
                                                         math.sqrt(errors[best]) / total[-1]))


for part in (lights, reflectance, edgeProfile):
    part()
