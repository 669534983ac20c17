#!/usr/bin/env python3
"""Held-out error against bake time, as an SVG: plot_histories.py OUT.svg TITLE LABEL=BAKE.json ...

BAKE.json is what `nacre bake --json` wrote; its "history" holds the curve (masked PSNR of the test split). No packages needed.
"""
import json
import math
import sys

COLORS = ["#0b62a4", "#d1495b", "#2e933c", "#edae49", "#66418f", "#5b5b5b", "#00a6a6", "#a0522d"]
WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 760, 460, 64, 230, 44, 52


def curve(path):
    with open(path) as file:
        history = json.load(file)["history"]
    return [(h["seconds"], h["psnr_masked"]) for h in history if h["seconds"] > 0]


def main():
    out, title, entries = sys.argv[1], sys.argv[2], sys.argv[3:]
    curves = [(e.split("=", 1)[0], curve(e.split("=", 1)[1])) for e in entries]
    points = [p for _, c in curves for p in c if p[1] > 15]
    t0, t1 = math.log(max(1.0, min(t for t, _ in points))), math.log(max(t for t, _ in points))
    lo, hi = math.floor(min(v for _, v in points)), math.ceil(max(v for _, v in points))
    x = lambda t: LEFT + (math.log(max(t, 1.0)) - t0) / max(t1 - t0, 1e-9) * (WIDTH - LEFT - RIGHT)
    y = lambda v: HEIGHT - BOTTOM - (v - lo) / max(hi - lo, 1) * (HEIGHT - TOP - BOTTOM)
    svg = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{HEIGHT}" font-family="sans-serif" font-size="12">',
           f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>',
           f'<text x="{LEFT}" y="24" font-size="15">{title}</text>']
    for v in range(lo, hi + 1):
        svg.append(f'<line x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{y(v):.1f}" y2="{y(v):.1f}" stroke="#ddd"/>'
                   f'<text x="{LEFT - 8}" y="{y(v) + 4:.1f}" text-anchor="end">{v}</text>')
    for t in (1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1200, 1800):
        if t0 <= math.log(t) <= t1:
            label = f"{t} s" if t < 60 else f"{t // 60} min"
            svg.append(f'<line x1="{x(t):.1f}" x2="{x(t):.1f}" y1="{TOP}" y2="{HEIGHT - BOTTOM}" stroke="#eee"/>'
                       f'<text x="{x(t):.1f}" y="{HEIGHT - BOTTOM + 18}" text-anchor="middle">{label}</text>')
    svg.append(f'<text x="{LEFT}" y="{HEIGHT - 12}">time of the bake (logarithmic); vertical: held-out masked PSNR, dB</text>')
    for k, (label, c) in enumerate(curves):
        color = COLORS[k % len(COLORS)]
        path = " ".join(f"{x(t):.1f},{max(TOP, min(HEIGHT - BOTTOM, y(v))):.1f}" for t, v in c if v > lo)
        svg.append(f'<polyline points="{path}" fill="none" stroke="{color}" stroke-width="2"/>')
        row = TOP + 8 + 20 * k
        svg.append(f'<line x1="{WIDTH - RIGHT + 12}" x2="{WIDTH - RIGHT + 34}" y1="{row}" y2="{row}" stroke="{color}" stroke-width="3"/>'
                   f'<text x="{WIDTH - RIGHT + 40}" y="{row + 4}">{label}: {c[-1][1]:.2f}</text>')
    with open(out, "w") as file:
        file.write("\n".join(svg) + "\n</svg>\n")


if __name__ == "__main__":
    main()
