#!/bin/sh
# Checks every dataset below FOLDER: it loads, its convention checks stay silent, and variants of one capture (NAME, NAME_plpos,
# NAME_sssgs) report the same images and cameras for the splits they share. Not part of ctest: the data is not in the repository.
#
#   tests/bench/check_conventions.sh NACRE FOLDER      NACRE: the program, e.g. build/baker/nacre
set -eu
[ $# -eq 2 ] || { echo "usage: $0 NACRE FOLDER" >&2; exit 2; }
nacre=$1
folder=$2
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

for dataset in "$folder"/*/; do
    name=$(basename "$dataset")
    "$nacre" info "$dataset" --json "$work/$name.json" > "$work/log" || { cat "$work/log"; echo "FAILED: $name does not load"; exit 1; }
done
python3 - "$work" <<'PYTHON'
import glob, json, os, sys

failures = 0
infos = {os.path.basename(f)[:-5]: json.load(open(f)) for f in sorted(glob.glob(sys.argv[1] + "/*.json"))}
for name, info in infos.items():
    suspicions = [w for w in info["warnings"] if "is a convention, not a measurement" not in w and "left out" not in w]
    base = next((b for b in (name.removesuffix("_plpos"), name.removesuffix("_sssgs")) if b != name and b in infos), None)
    if base:
        for split, here in info["splits"].items():
            there = infos[base]["splits"].get(split)
            if there is not None and here != there:
                suspicions.append(f"split {split}: {here}, but {base} has {there}")
    print(("FAILED " if suspicions else "ok     ") + f"{name}: {info['convention']}, " +
          ", ".join(f"{s} {v['images']} images {v['cameras']} cameras" for s, v in info["splits"].items()))
    for s in suspicions:
        print("       " + s)
    failures += bool(suspicions)
if not infos:
    print("FAILED no dataset found")
sys.exit(1 if failures or not infos else 0)
PYTHON
