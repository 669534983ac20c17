#!/usr/bin/env bash
# The command line contract, from outside: exit codes, one-line errors, JSON keys, atomic files, determinism, stop and resume.
# contract.sh NACRE SOURCE_DIR
set -uo pipefail
nacre=$1
sample=$2/samples/data/bunny_wax_tiny
mesh=$2/samples/assets/pebble.glb
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work" || exit 1
failures=0

fail() { echo "FAILED: $*"; failures=$((failures + 1)); }

# expect CODE TEXT COMMAND...: exit code, and on failure exactly one error line that contains TEXT and nothing but warnings beside it
expect() {
    local code=$1 text=$2 got=0
    shift 2
    "$@" >stdout.txt 2>stderr.txt || got=$?
    [ "$got" = "$code" ] || { fail "exit code $got, expected $code: $*"; cat stderr.txt; return; }
    [ "$code" = 0 ] && return
    local lines
    lines=$(grep -vc '^nacre: warning: ' stderr.txt)
    [ "$lines" = 1 ] && grep -q '^nacre: error: ' stderr.txt || { fail "expected one error line: $*"; cat stderr.txt; }
    grep '^nacre: error: ' stderr.txt | grep -qF -- "$text" || { fail "expected an error about '$text': $*"; cat stderr.txt; }
}

# only FILES... : the folder holds these and no leftover
only() {
    local folder=$1
    shift
    [ "$(ls -A "$folder" | tr '\n' ' ')" = "$*${*:+ }" ] || fail "folder $folder holds '$(ls -A "$folder" | tr '\n' ' ')', expected '$*'"
}

# keys FILE INDENT KEY...: exactly these keys at this depth, in this order
keys() {
    local file=$1 indent=$2
    shift 2
    local found
    found=$(sed -n "s/^ \{$indent\}\"\([^\"]*\)\":.*/\1/p" "$file" | tr '\n' ' ')
    [ "$found" = "$* " ] || fail "$file has keys '$found', expected '$*'"
}

# An uncompressed 128x128 half RGBA OpenEXR file whose pixels are all NaN.
nan_exr() {
    local le32='\x7f\x00\x00\x00' channel='\x00\x01\x00\x00\x00\x00\x00\x00\x00\x01\x00\x00\x00\x01\x00\x00\x00' line='' y
    attribute() { printf '%b' "$1\\x00$2\\x00$3\\x00\\x00\\x00$4"; } # name type size value
    {
        printf '%b' '\x76\x2f\x31\x01\x02\x00\x00\x00'
        attribute channels chlist '\x49' "A${channel}B${channel}G${channel}R${channel}\\x00"
        attribute compression compression '\x01' '\x00'
        attribute dataWindow box2i '\x10' "\\x00\\x00\\x00\\x00\\x00\\x00\\x00\\x00$le32$le32"
        attribute displayWindow box2i '\x10' "\\x00\\x00\\x00\\x00\\x00\\x00\\x00\\x00$le32$le32"
        attribute lineOrder lineOrder '\x01' '\x00'
        attribute pixelAspectRatio float '\x04' '\x00\x00\x80\x3f'
        attribute screenWindowCenter v2f '\x08' '\x00\x00\x00\x00\x00\x00\x00\x00'
        attribute screenWindowWidth float '\x04' '\x00\x00\x80\x3f'
        printf '%b' '\x00'
    } >"$1"
    local first=$(($(stat -c %s "$1") + 128 * 8)) offset
    for ((y = 0; y < 128; ++y)); do
        offset=$(printf '%08x' $((first + y * 1032)))
        printf '%b' "\\x${offset:6:2}\\x${offset:4:2}\\x${offset:2:2}\\x${offset:0:2}\\x00\\x00\\x00\\x00"
    done >>"$1"
    for ((y = 0; y < 512; ++y)); do line+='\x00\x7e'; done
    for ((y = 0; y < 128; ++y)); do printf '%b' "\\x$(printf %02x $y)\\x00\\x00\\x00\\x00\\x04\\x00\\x00$line"; done >>"$1"
}

bake=("$nacre" bake "$sample" --max-splats 400 --s-functions 4 --profile lossless)

echo "-- arguments"
expect 0 "" "$nacre" --help
expect 0 "" "$nacre" --version
for command in synth prepare bake eval render convert info pack report tune selftest; do
    expect 0 "" "$nacre" $command --help
    expect 2 "--nosuch" "$nacre" $command a b -o c --nosuch
done
expect 2 "no command" "$nacre"
expect 2 "unknown command 'sculpt'" "$nacre" sculpt mesh.glb -o data
expect 2 "DATASET" "$nacre" bake
expect 2 "--output" "$nacre" bake "$sample"
expect 2 "pbr" "${bake[@]}" -o a.glb --model pbr
expect 2 "CUDA" env CUDA_VISIBLE_DEVICES= "${bake[@]}" -o a.glb --device cuda
expect 2 "--minutes" "${bake[@]}" -o a.glb --minutes nan
expect 2 "--minutes" "${bake[@]}" -o a.glb --minutes 1 --iterations 5
expect 2 "--iterations" "${bake[@]}" -o a.glb --iterations 0
expect 2 "--max-splats" "$nacre" bake "$sample" -o a.glb --max-splats -1
expect 2 "--threads" "${bake[@]}" -o a.glb --threads two
for bad in nan 0 0.6 x; do expect 2 "--hold-out" "${bake[@]}" -o a.glb --hold-out $bad; done
for bad in nan -0.1 1.5 inf x; do expect 2 "--dssim" "${bake[@]}" -o a.glb --dssim $bad; done
expect 2 "no checkpoint" "${bake[@]}" -o a.glb --resume
expect 2 "no folder 'nosuch'" "${bake[@]}" -o nosuch/a.glb
expect 2 "is a folder" "${bake[@]}" -o "$work"
expect 2 "nosuch" "$nacre" bake nosuch -o a.glb
expect 2 "nosuch" "$nacre" info nosuch
expect 2 "nosuch.glb" "$nacre" eval nosuch.glb "$sample"
expect 2 ".exr" "$nacre" render nosuch.glb -o a.jpg
synth=("$nacre" synth "$mesh" -o data)
expect 2 "MESH" "$nacre" synth
expect 2 "--output" "$nacre" synth "$mesh"
expect 2 "nosuch.glb" "$nacre" synth nosuch.glb -o data
expect 2 "bunny" "$nacre" synth "$sample/transforms_train.json" -o data
expect 2 "is a file" "$nacre" synth "$mesh" -o "$mesh"
expect 2 "holds" "$nacre" synth "$mesh" -o "$sample"
for bad in 0 x 0x5 64x 9000 -1; do expect 2 "--size" "${synth[@]}" --size $bad; done
for bad in 0 -1 1.5 nan; do expect 2 "--cameras" "${synth[@]}" --cameras $bad; done
for bad in 0 -4 some; do expect 2 "--lights-per-camera" "${synth[@]}" --lights-per-camera $bad; done
expect 2 "only 3 lights" "${synth[@]}" --lights 3 --lights-per-camera 4
for bad in nan 1 -5 inf; do expect 2 "--radius" "${synth[@]}" --radius $bad; done
for bad in nan 1 0; do expect 2 "--camera-distance" "${synth[@]}" --camera-distance $bad; done
for bad in nan 0 180; do expect 2 "--fov" "${synth[@]}" --fov $bad; done
for bad in 0 -1 x; do expect 2 "--spp" "${synth[@]}" --spp $bad; done
for bad in 0 x 0x -4x 1.5 nan; do expect 2 "--test-spp" "${synth[@]}" --test-spp $bad; done
for bad in 0 nan -1; do expect 2 "--noise" "${synth[@]}" --noise $bad; done
for bad in nan -1 2; do expect 2 "--indirect-roughness" "${synth[@]}" --indirect-roughness $bad; done
for bad in 0/2 3/2 1 1/x 1/0; do expect 2 "--shard" "${synth[@]}" --shard $bad; done
expect 2 "--layout" "${synth[@]}" --layout heap
expect 2 "--hemisphere" "${synth[@]}" --hemisphere lower
expect 2 "--convention" "${synth[@]}" --convention none
expect 2 "no split 'nosuch'" "${synth[@]}" --splits train,nosuch
expect 2 "plpos" "${synth[@]}" --convention plpos --splits environment
expect 2 "nosuch.exr" "${synth[@]}" --environment nosuch.exr
expect 2 "nosuch" "${synth[@]}" --like nosuch
expect 2 "--like" "${synth[@]}" --like "$sample" --cameras 3
expect 2 "shape" "${synth[@]}" --like "$sample" --size 64x32
expect 2 "no split 'near'" "${synth[@]}" --like "$sample" --splits near
expect 2 "'hide'" "${synth[@]}" --sss wax:albedo=0.8:mfp=0.01
for bad in hide hide:albedo=0.8 hide:mfp=1 :albedo=1:mfp=1 hide:albedo=2:mfp=1 hide:albedo=1:mfp=0 hide:albedo=1,1:mfp=1 hide:albedo=nan:mfp=1 \
    hide:albedo=1:alpha=1:mfp=1 hide:albedo=1:mfp=1:g=1 hide:albedo=1:mfp=1:boundary=glass hide:colour=1; do
    expect 2 "--sss" "${synth[@]}" --sss "$bad"
done
expect 2 "nosuch.json" "${synth[@]}" --sss-file nosuch.json
for bad in 1 1,2 0,1,1 1,-1,1 1,nan,1 1,1,1:lean=2 1,1,1:colour=1; do expect 2 "--fur" "${synth[@]}" --fur "$bad"; done
for bad in tripod stage:flash=5cm phone:spill=2 stage:gain=3mm phone:pose=nan; do
    expect 2 "--capture" "${synth[@]}" --capture "$bad"
done
expect 2 "--like" "${synth[@]}" --capture phone --like "$sample"
expect 2 "canonical" "${synth[@]}" --capture stage --convention plpos
expect 2 "nosuch" "$nacre" selftest --only nosuch --no-gl
expect 2 "no folder" "$nacre" selftest --json nosuch/a.json
expect 2 "--random" "$nacre" selftest --random -1
[ "$(ls | grep -v '^std' | wc -l)" = 0 ] || fail "refused commands left files: $(ls)"

echo "-- datasets"
expect 0 "" "$nacre" info "$sample" --json info.json
keys info.json 2 convention color_space splits warnings checks
keys info.json 4 train test apparent_reflectance splits
keys info.json 6 images cameras lights width height images cameras lights width height train test
expect 1 "standard output" bash -c '"$0" info "$1" >/dev/full' "$nacre" "$sample"

cp -r "$sample" truncated
for image in truncated/train/*; do truncate -s 2000 "$image"; done
expect 2 "train" "$nacre" bake truncated -o a.glb --iterations 2
cp -r "$sample" nan
nan_exr nan.exr
for image in nan/train/*; do cp nan.exr "$image"; done
expect 2 "NaN" "$nacre" bake nan -o a.glb --iterations 2
cp -r "$sample" missing && rm missing/train/*[02468].exr
expect 2 "train" "$nacre" bake missing -o a.glb --iterations 2
cp -r "$sample" few # what a disk or a network leaves of a dataset now and then: named, counted, and without effect on the rest
truncate -s 2000 few/train/r_0000.exr && : >few/train/r_0002.exr && rm few/train/r_0003.exr && truncate -s 100 few/test/r_0003.exr
expect 0 "" "$nacre" bake few -o few.glb --max-splats 300 --iterations 2 --json few.json
for image in 0 2 3; do
    grep -q "skipped: .*few/train/r_000$image.exr" stderr.txt && grep -q "\"path\": \"few/train/r_000$image.exr\"" few.json ||
        fail "a broken image $image is not named: $(cat stderr.txt few.json)"
done
grep -q "3 of 100 training images skipped" stderr.txt || fail "skipped images are not counted: $(cat stderr.txt)"
expect 0 "" "$nacre" eval few.glb few --renderer reference --frames 0 --json eval.json
grep -q "skipped: .*few/test/r_0003.exr" stderr.txt && grep -q "1 of 8 images .* the figures are of the rest" stderr.txt ||
    fail "eval does not say which images it left out: $(cat stderr.txt)"
grep -q '"images": 7,' eval.json || fail "eval counts images that it left out: $(cat eval.json)"
expect 0 "" "$nacre" info few.glb
grep -q "order of importance: any share" stdout.txt || fail "a bake writes no order of importance: $(cat stdout.txt)"
expect 0 "" "$nacre" info few
grep -q "cannot be used" stdout.txt || fail "info does not say that images are broken: $(cat stdout.txt)"
rm -rf few few.glb
echo "-- prepared datasets"
cp -r "$sample" set && truncate -s 300 set/train/r_0003.exr
expect 2 "--strict: 1 images" "$nacre" prepare set -o packed --strict
expect 2 "interrupted" "$nacre" info packed.part
expect 0 "" "$nacre" prepare set -o packed --json prepare.json
grep -q "r_0003.exr" packed/skipped.txt && grep -q '"reused"' prepare.json || fail "prepare does not say what it skipped"
expect 2 "is there already" "$nacre" prepare nosuch -o packed # before anything is read
expect 2 "--output: a value is missing" "$nacre" prepare set -o ""
expect 2 "--json: a value is missing" "$nacre" bake set -o a.glb --json ""
expect 2 "is no folder" "$nacre" prepare set -o prepare.json/packed
expect 2 "elsewhere" "$nacre" prepare set -o /proc/nacre/packed
expect 2 "is prepared already; use it" "$nacre" prepare packed -o again
expect 2 "--disk" "$nacre" prepare set -o small --disk 0.00001
expect 0 "" "$nacre" info packed
grep -q "^train" stdout.txt || fail "info does not know the packed dataset: $(cat stdout.txt)"
expect 2 "too little" "$nacre" bake packed -o b.glb --iterations 2 --memory 0.1
rm set/train/*
expect 0 "" "$nacre" bake packed -o b.glb --iterations 2 --seed 3
grep -q "skipped: .*r_0003.exr" stderr.txt || fail "a bake of a packed dataset does not say what was skipped: $(cat stderr.txt)"
truncate -s 2000 packed/pixels.bin
expect 2 "pixels.bin" "$nacre" bake packed -o c.glb --iterations 2
rm -rf set packed* b.glb prepare.json
cp -r "$sample" empty && sed -i '/"frames"/,$d' empty/transforms_train.json && echo '"frames": []}' >>empty/transforms_train.json
expect 2 "train" "$nacre" bake empty -o a.glb --iterations 2
cp -r "$sample" broken && truncate -s 100 broken/transforms_train.json
expect 2 "transforms_train.json" "$nacre" bake broken -o a.glb --iterations 2
cp -r "$sample" inside && sed -i -E '/"position": \[/,/\]/ s/-?[0-9]+\.[0-9]+/0.0/' inside/transforms_train.json
expect 2 "light" "$nacre" bake inside -o a.glb --iterations 2
cp -r "$sample" sizes && sed -i 's/"width": 128/"width": 100/' sizes/transforms_train.json
expect 2 "128" "$nacre" bake sizes -o a.glb --iterations 2
rm -rf truncated missing empty broken inside sizes
[ ! -e a.glb ] || fail "a refused dataset left a.glb"

echo "-- synth"
tiny=("$nacre" synth "$mesh" --size 24x16 --cameras 3 --lights 5 --lights-per-camera 2 --spp 16 --test-spp 1x --splits train,near,environment,all_on)
expect 0 "" "${tiny[@]}" -o set --threads 1 --json synth.json
keys synth.json 2 convention images rendered missing seconds seconds_per_camera rays_per_second splits triangles fibres scene_bytes
keys synth.json 4 train all_on environment near
only set all_on env_studio.exr env_sunset.exr environment near synth.json train transforms_all_on.json transforms_environment.json \
    transforms_near.json transforms_train.json
expect 0 "" "$nacre" info set --json info.json
keys info.json 4 train all_on environment near apparent_reflectance splits
grep -q '"warnings": \[\]' info.json || fail "a synthesised dataset looks suspicious: $(cat info.json)"
expect 2 "name a model" "$nacre" bake set -o few.glb --model auto --iterations 20
for shard in 2/2 1/2; do expect 0 "" "${tiny[@]}" -o shards --shard $shard --threads 2; done
diff -r set shards || fail "two shards on two threads differ from one run on one thread"
expect 2 "--spp" "${tiny[@]}" -o set --spp 32
expect 2 "--fur" "${tiny[@]}" -o set --fur 2000,0.02,0.001
expect 2 "--sss" "${tiny[@]}" -o set --sss "*:albedo=0.8:mfp=0.01"
rm shards/train/r_0003.exr
expect 0 "" "${tiny[@]}" -o shards --json synth.json
grep -q '"rendered": 2,' synth.json || fail "resuming renders more than one camera: $(cat synth.json)"
diff -r set shards || fail "a resumed dataset differs from an uninterrupted one"
expect 0 "" "$nacre" synth "$mesh" -o liked --like set --convention bigs --size 12x8 --spp 16 --test-spp 16 --fur 2000,0.02,0.001
expect 0 "" "$nacre" info liked
echo '[{"material": "hide", "albedo": [0.8, 0.6, 0.4], "mfp": 0.003, "boundary": "none"}]' >sss.json
expect 0 "" "$nacre" synth "$mesh" -o scattering --sss-file sss.json --size 8 --cameras 1 --spp 16 --splits train
expect 1 "" bash -c 'ulimit -f 1; exec "$@"' _ "$nacre" synth "$mesh" -o full_set --size 64 --cameras 1 --spp 16 --splits train
[ -z "$(find full_set -name '*.tmp*')" ] || fail "a full disk left temporary files in full_set"
expect 0 "" "$nacre" synth "$mesh" -o full_set --size 64 --cameras 1 --spp 16 --splits train

"$nacre" synth "$mesh" -o stopped --size 200 --cameras 40 --spp 256 --splits train >stdout.txt 2>stderr.txt &
job=$!
for ((i = 0; i < 100; ++i)); do [ -e stopped/train/r_0000.exr ] && break || sleep 0.1; done
kill -INT $job
wait $job
[ $? = 1 ] || fail "a stopped synth gives exit code $?"
grep -q 'same command again' stderr.txt || fail "a stopped synth does not say how to go on: $(cat stderr.txt)"
[ ! -e stopped/transforms_train.json ] && [ -z "$(find stopped -name '*.tmp*')" ] || fail "a stopped synth left $(find stopped)"
rm -rf set shards liked scattering full_set stopped sss.json

echo "-- bake"
mkdir one two stop full
# past the first densification, which is where an order that depends on threads would show
grown=("$nacre" bake "$sample" --max-splats 800 --s-functions 4 --profile lossless --iterations)
expect 0 "" "${grown[@]}" 1 -o one/g.glb --json start.json
expect 0 "" "${grown[@]}" 220 -o one/g.glb --threads 1 --json grown.json
expect 0 "" "${grown[@]}" 220 -o two/g.glb --threads 2
cmp one/g.glb two/g.glb || fail "1 and 2 threads give different assets after densification"
cp one/g.glb quiet.glb
"${grown[@]}" 220 -o one/g.glb --threads 1 >stdout.txt 2>stderr.txt
cmp one/g.glb quiet.glb || fail "--json changes the asset"
rm quiet.glb
[ "$(grep '"splats"' start.json)" != "$(grep '"splats"' grown.json)" ] || fail "220 iterations do not reach a densification"
rm one/g.glb two/g.glb
expect 0 "" "${bake[@]}" -o one/a.glb --iterations 60 --threads 1 --json bake.json
keys bake.json 2 model splats iterations seconds device seed psnr_train peak_rss_bytes asset_bytes parts history skipped
grep -q '"iterations": 60,' bake.json || fail "bake.json does not say 60 iterations"
only one a.glb
expect 0 "" "${bake[@]}" -o two/a.glb --iterations 60 --threads 2 --json bake2.json
expect 0 "" "$nacre" bake "$sample" -o two/default.glb --iterations 3 --json bake2.json # the sizes that --quality gives
cmp one/a.glb two/a.glb || fail "1 and 2 threads give different assets"
expect 0 "" "${bake[@]}" -o two/b.glb --iterations 60 --seed 2
cmp -s one/a.glb two/b.glb && fail "another seed gives the same asset"

expect 1 "" bash -c 'ulimit -f 16; exec "$@"' _ "${bake[@]}" -o full/a.glb --iterations 2
[ ! -e full/a.glb ] && [ -z "$(find full -name '*.tmp*')" ] || fail "a full disk left $(ls full)"

# Stopped in training (later and later, until a checkpoint shows that training had begun), then resumed: the same bytes.
expect 0 "" "${bake[@]}" -o two/long.glb --iterations 400
for delay in 0.3 0.4 0.5 0.6 0.8 1 1.2 1.5 1.9 2.4 3 3.8 4.7 5.9 7.4 9.3 12 15; do
    "${bake[@]}" -o stop/a.glb --iterations 400 >stdout.txt 2>stderr.txt &
    job=$!
    sleep $delay
    kill -INT $job 2>/dev/null
    wait $job
    code=$?
    [ $code = 1 ] && [ -e stop/a.glb.ckpt ] && break
    rm -f stop/*
done
if [ -e stop/a.glb.ckpt ]; then
    only stop a.glb.ckpt
    grep -q -- '--resume' stderr.txt || fail "a stopped bake does not say how to resume: $(cat stderr.txt)"
    expect 2 "--restart discards it" "${bake[@]}" -o stop/a.glb --iterations 400
    expect 2 "it has --seed 1, this one --seed 2" "${bake[@]}" -o stop/a.glb --iterations 400 --resume --seed 2
    expect 0 "" "${bake[@]}" -o stop/a.glb --iterations 400 --resume
    cmp stop/a.glb two/long.glb || fail "stopped and resumed differs from uninterrupted"
    only stop a.glb
    head -c 300 stop/a.glb >stop/b.glb.ckpt
    expect 2 "b.glb.ckpt" "${bake[@]}" -o stop/b.glb --iterations 400 --resume
    grep -q "give the same command" stderr.txt && fail "a damaged checkpoint is advertised for --resume: $(cat stderr.txt)"
else
    fail "a stopped bake (exit code $code) left no checkpoint"
fi

echo "-- eval, render and info of an asset"
asset=one/a.glb
eval_keys="split images psnr psnr_masked psnr_highlight highlight_missing highlight_false ssim flip rel_mse_linear ms_per_frame splats asset_bytes bytes_per_splat renderer"
eval_keys+=" psnr_min relight_ms sort_ms raster_ms scattered_share drawn_by skipped"
for renderer in gl reference; do
    expect 0 "" "$nacre" eval $asset "$sample" --renderer $renderer --frames 1 --json eval.json --images images_$renderer
    keys eval.json 2 $eval_keys
    for image in 0000 0007; do
        for file in render.exr reference.exr sheet.png; do
            [ -s images_$renderer/${image}_$file ] || fail "eval --images wrote no ${image}_$file"
        done
    done
done
expect 2 "train, test" "$nacre" eval $asset "$sample" --split near
expect 2 "NaN" "$nacre" eval $asset nan --split train
expect 1 "" bash -c 'ulimit -f 4; exec "$@"' _ "$nacre" eval $asset "$sample" --frames 0 --images full_images
[ -z "$(find full_images -name '*.tmp*')" ] || fail "a full disk left temporary files in full_images"

mkdir converted
lit=(--light point:2,0,3:40,30,20 --light directional:0,0,1:0.5)
expect 0 "" "$nacre" convert $asset converted/a.ply "${lit[@]}"
expect 0 "" "$nacre" convert $asset converted/a.glb "${lit[@]}" --exposure 0.5 --color-space linear --threads 1
expect 0 "" "$nacre" convert $asset converted/one.ply "${lit[@]}" --threads 1
cmp -s converted/a.ply converted/one.ply || fail "a snapshot depends on the number of threads"
grep -q lin_rec709_display converted/a.glb || fail "a linear snapshot does not say so"
grep -q extensionsRequired converted/a.glb && fail "a plain .glb requires an extension"
expect 0 "" "$nacre" convert converted/a.ply converted/b.glb --axes y-down
expect 0 "" "$nacre" convert converted/b.glb converted/c.ply --axes y-down
expect 0 "" "$nacre" convert converted/a.glb converted/d.ply
only converted a.glb a.ply b.glb c.ply d.ply one.ply
head -c 3000 converted/a.ply >cut.ply
head -c 3000 converted/a.glb >cut.glb
expect 2 "truncated" "$nacre" convert cut.ply converted/e.ply
expect 2 "truncated" "$nacre" convert cut.glb converted/e.ply
expect 2 "neither a .ply nor a .glb" "$nacre" convert "$0" converted/e.ply
expect 2 "nosuch.ply" "$nacre" convert nosuch.ply converted/e.ply
expect 2 "give the lights" "$nacre" convert $asset converted/e.ply
expect 2 "input itself" "$nacre" convert converted/a.ply converted/../converted/a.ply
expect 2 ".ply or .glb" "$nacre" convert converted/a.ply converted/e.obj
expect 2 "--light" "$nacre" convert converted/a.ply converted/e.glb --light point:1,2,3:4
expect 2 "--exposure" "$nacre" convert converted/a.ply converted/e.glb --exposure 2
expect 2 "--axes" "$nacre" convert $asset converted/e.glb --light point:1,2,3:4 --axes y-up
expect 2 "--axes" "$nacre" convert converted/a.ply converted/e.ply --axes y-up
for bad in spot:1,2,3:4 lamp:1,2,3:4 nosuch.exr; do expect 2 "$bad" "$nacre" convert $asset converted/e.ply --light ${bad/#nosuch/environment:nosuch}; done
for bad in 0 -1 nan; do expect 2 "--exposure" "$nacre" convert $asset converted/e.ply "${lit[@]}" --exposure $bad; done
only converted a.glb a.ply b.glb c.ply d.ply one.ply

mkdir from
expect 0 "" "${bake[@]}" -o from/a.glb --iterations 20 --init converted/a.ply
expect 0 "" "${bake[@]}" -o from/b.glb --iterations 20 --init $asset --model sss
only from a.glb b.glb
expect 2 "truncated" "${bake[@]}" -o from/c.glb --iterations 20 --init cut.ply
expect 2 "nosuch.ply" "${bake[@]}" -o from/c.glb --iterations 20 --init nosuch.ply
expect 2 "neither a .ply" "${bake[@]}" -o from/c.glb --iterations 20 --init "$0"

mkdir frames
expect 0 "" "$nacre" render $asset -o frames/a.png --camera "$sample:test:0" --frames 3
only frames a_0000.png a_0001.png a_0002.png
expect 0 "" "$nacre" render $asset -o b.exr --orbit -30,20,3.2 --fov 30 --size 64x48 --light point:2,0,3:40,30,20 --light directional:0,0,1:0.5
expect 0 "" "$nacre" render $asset -o b.png --renderer reference --size 32x32
grep -q 'no --light given' stdout.txt || fail "render does not say which light it chose"
for bad in spot:1,2,3:4 point:1,2:3 point:1,2,3 point:1,2,3:-1 point:1,2,nan:1 directional:0,0,0:1 lamp:1,2,3:4 environment: point:1,2,3:1,2; do
    expect 2 "$bad" "$nacre" render $asset -o c.png --light $bad
done
expect 2 "nosuch.exr" "$nacre" render $asset -o c.png --light environment:nosuch.exr
expect 2 "--size" "$nacre" render $asset -o c.png --size 0x5
expect 2 "--size" "$nacre" render $asset -o c.png --size 64
expect 2 "--orbit" "$nacre" render $asset -o c.png --orbit 10
for bad in nan 0 171 inf; do expect 2 "--fov" "$nacre" render $asset -o c.png --fov $bad; done
expect 2 "--camera" "$nacre" render $asset -o c.png --camera "$sample:test"
expect 2 "images 0 to 7" "$nacre" render $asset -o c.png --camera "$sample:test:8"
expect 1 "c.png" bash -c 'ulimit -f 1; exec "$@"' _ "$nacre" render $asset -o c.png --size 256x256
[ -z "$(ls -A | grep '^c\.png')" ] || fail "a failed render left $(ls -A | grep '^c\.png')"

expect 0 "" "$nacre" info $asset --json info.json
keys info.json 2 model splats asset_bytes bytes_per_splat profile channels importance_order presets dataset_frame
expect 0 "" "$nacre" info --models
for bytes in 0 4 12 20 1000; do
    head -c $bytes $asset >cut.glb
    expect 2 "cut.glb" "$nacre" info cut.glb
    expect 2 "cut.glb" "$nacre" render cut.glb -o c.png
done

echo "-- pack"
expect 0 "" "$nacre" pack $asset -o one/small.glb --threads 1 --json pack.json --curve curve.csv
keys pack.json 2 profile splats asset_bytes bytes_per_splat loss_db psnr_to_input pruned left_out channels curve
[ -s curve.csv ] && [ -s curve.svg ] || fail "pack --curve wrote no table or no picture"
expect 0 "" "$nacre" pack $asset -o two/small.glb --threads 2
cmp one/small.glb two/small.glb || fail "1 and 2 threads pack differently"
[ $((10 * $(stat -c %s one/small.glb))) -lt $(stat -c %s $asset) ] || fail "packed, the asset is not a tenth as large"
for renderer in gl reference; do
    expect 0 "" "$nacre" eval one/small.glb "$sample" --renderer $renderer --frames 0 --json eval_$renderer.json
    expect 0 "" "$nacre" eval $asset "$sample" --renderer $renderer --frames 0 --json eval.json
    awk -F'[:,]' '/"psnr_masked"/ { v[++n] = $2 } END { exit !(v[1] > v[2] - 0.6) }' eval_$renderer.json eval.json || fail "packed, the asset loses more than 0.6 dB ($renderer)"
done
expect 0 "" "$nacre" pack $asset -o one/sized.glb --bytes-per-splat 40 --against "$sample"
expect 0 "" "$nacre" pack $asset -o one/stored.glb --visibility stored
expect 0 "" "$nacre" pack one/small.glb -o one/large.glb --profile lossless
expect 0 "compact" "$nacre" info one/small.glb
for input in small large; do
    expect 0 "" "$nacre" pack one/$input.glb -o one/interop_$input.glb --profile interop --json pack.json
    keys pack.json 2 profile splats asset_bytes bytes_per_splat
    grep -q "interop_$input.glb: .* bytes (" stdout.txt || fail "pack --profile interop does not say how large the file is: $(cat stdout.txt)"
    grep -qa '"extensionsRequired"' one/interop_$input.glb && fail "an asset for other viewers requires an extension of them"
    expect 0 "" "$nacre" render one/interop_$input.glb -o $input.exr --size 64x64 --orbit 30,20 --renderer reference
done
expect 0 "" "$nacre" render one/large.glb -o b.exr --size 64x64 --orbit 30,20 --renderer reference
cmp large.exr b.exr || fail "for other viewers, the asset is lit otherwise"
expect 0 "" "$nacre" bake "$sample" -o one/interop.glb --profile interop --max-splats 100 --iterations 3
grep -qa '"profile":"interop"' one/interop.glb || fail "bake --profile interop wrote another profile"
expect 2 "--max-loss-db" "$nacre" pack $asset -o a.glb --max-loss-db nan
expect 2 "excludes" "$nacre" pack $asset -o a.glb --max-loss-db 1 --bytes-per-splat 30
expect 2 "no folder" "$nacre" pack $asset -o nosuch/a.glb
expect 2 "is the input" "$nacre" pack $asset -o a.glb --curve $asset
expect 2 "written twice" "$nacre" pack $asset -o a.csv --curve a.csv
expect 2 "rounds nothing" "$nacre" pack $asset -o a.glb --profile lossless --bytes-per-splat 20
expect 0 "" "$nacre" pack $asset -o one/coarse.glb --max-loss-db 15
[ $(stat -c %s one/coarse.glb) -lt $(stat -c %s one/small.glb) ] || fail "a larger loss gives a larger file"
expect 2 "cut.glb" "$nacre" pack cut.glb -o a.glb
size=$(stat -c %s one/small.glb)
for bytes in 4 100 1000 $((size / 2)) $((size - 1)); do
    head -c $bytes one/small.glb >cut.glb
    expect 2 "cut.glb" "$nacre" info cut.glb
done

echo "-- sss: bake, edits"
expect 0 "" "$nacre" bake "$sample" -o sss.glb --profile lossless --model sss --max-splats 300 --iterations 60 --json sss.json
keys sss.json 2 model splats iterations seconds device seed psnr_train peak_rss_bytes asset_bytes parts history skipped
view=(--orbit 30,20 --size 64x64 --light point:2,0,3:40)
expect 0 "" "$nacre" render sss.glb -o plain.exr "${view[@]}"
expect 0 "" "$nacre" render sss.glb -o factor1.exr "${view[@]}" --edit basecolor=x1 --edit residual=x1@sphere:0,0,0,1
cmp plain.exr factor1.exr || fail "edits with factor 1 change pixels"
for edit in basecolor=1,0,0 roughness=x0.2 metalness=1 subsurface=0 opacity=x0.5 tint=4,1,1; do
    expect 0 "" "$nacre" render sss.glb -o edited.exr "${view[@]}" --edit $edit
    cmp -s plain.exr edited.exr && fail "--edit $edit changes nothing"
done
for bad in color=1 roughness roughness=2 roughness=x-1 roughness=1,1,1 basecolor=1,2 roughness=0.5@ball:0,0,0,1 roughness=0.5@sphere:0,0,0; do
    expect 2 "$bad" "$nacre" render sss.glb -o c.png --edit $bad
done
expect 2 "bigs" "$nacre" render $asset -o c.png --edit roughness=0.5
echo "-- render --channel"
for file in sss.glb $asset; do
    expect 0 "" "$nacre" render $file -o channels.png "${view[@]}" --channel all
    for name in normal depth overdraw; do grep -q "^  $name  *[a-z]" stdout.txt || fail "--channel all does not list $name: $(cat stdout.txt)"; done
    expect 0 "" "$nacre" render $file -o depth.exr "${view[@]}" --channel depth
done
for file in channels.png depth.exr; do [ -s $file ] || fail "render --channel wrote no $file"; done
expect 0 "" "$nacre" render $asset -o t.png "${view[@]}" --channel T_dir
grep -q 'black 0, white' stdout.txt || fail "render --channel does not say how the picture is mapped"
expect 2 "T_dir, T_ind, rho" "$nacre" render $asset -o c.png "${view[@]}" --channel roughness
expect 2 "basecolor, roughness" "$nacre" render sss.glb -o c.png "${view[@]}" --channel T_dir
expect 2 ".exr" "$nacre" render sss.glb -o c.jpg "${view[@]}" --channel depth
expect 2 "one sheet" "$nacre" render sss.glb -o c.exr "${view[@]}" --channel all
expect 2 "no folder" "$nacre" render sss.glb -o nosuch/c.png "${view[@]}" --channel all
expect 2 "excludes" "$nacre" render sss.glb -o c.png "${view[@]}" --channel depth --renderer gl
[ ! -e c.png ] && [ ! -e c.exr ] || fail "a channel that was refused was written"

echo "-- report and tune"
expect 0 "" "$nacre" report $asset "$sample" -o r.html --json report.json --csv tables --bake bake.json --no-selftest --minutes 1.5
keys report.json 2 asset dataset model baked_with splats width height splits full_frame front_time front_bytes levels ledger never_pays history scalings images stability memory \
    notes command machine renderer version date seconds
grep -q '<html' r.html && ! grep -q '<script' r.html && ! grep -Eq '(src|href)="?https?:' r.html || fail "the report is no page, has a script, or loads something"
[ "$(wc -l <tables/front_time.csv)" -gt 2 ] && [ "$(wc -l <tables/front_bytes.csv)" -gt 8 ] || fail "the tables of the report are short: $(wc -l tables/*)"
cp -r "$sample" untested && rm untested/transforms_test.json
expect 2 "held-out" "$nacre" report $asset untested -o none.html
expect 2 "DATASET" "$nacre" report $asset -o none.html
expect 2 "no folder" "$nacre" report $asset "$sample" -o nosuch/none.html
expect 2 "bake --json" "$nacre" report $asset "$sample" -o none.html --bake "$0"
expect 2 "cut.glb" "$nacre" report cut.glb "$sample" -o none.html
expect 2 "profile-only" "$nacre" report $asset "$sample" -o none.html --profile-only
[ ! -e none.html ] || fail "a report that was refused was written"
expect 0 "" "$nacre" tune $asset "$sample" -o tuned.glb --max-bytes 12000 --json tune.json
keys tune.json 2 settings splats resolution_scale ms ms_before psnr_masked psnr_masked_before bytes bytes_before
[ "$(stat -c %s tuned.glb)" -le 12000 ] || fail "tune --max-bytes 12000 wrote $(stat -c %s tuned.glb) bytes"
expect 0 "" "$nacre" info tuned.glb
expect 0 "" "$nacre" report --profile-only -o device.json
expect 0 "" "$nacre" tune one/small.glb "$sample" -o preset.glb --max-ms 1000 --as-preset all --minutes 0.5 --device-profile device.json
"$nacre" info preset.glb | grep -q "all" || fail "tune --as-preset wrote no preset"
expect 2 "one of --max-ms" "$nacre" tune $asset "$sample" -o none.glb
expect 2 "one of --max-ms" "$nacre" tune $asset "$sample" -o none.glb --max-ms 3 --min-psnr 20
expect 2 "cannot be kept" "$nacre" tune $asset "$sample" -o none.glb --max-bytes 10
expect 2 "cannot be kept" "$nacre" tune $asset "$sample" -o none.glb --min-psnr 99
expect 2 "is an input" "$nacre" tune $asset "$sample" -o $asset --max-bytes 12000
expect 2 "is an input" "$nacre" report $asset "$sample" -o none.html --json $asset
expect 2 "must end in .html" "$nacre" report $asset "$sample" -o none.txt
expect 2 "presets all" "$nacre" eval preset.glb "$sample" --preset none
expect 0 "" "$nacre" eval preset.glb "$sample" --preset all --frames 0
expect 2 "device profile" "$nacre" tune $asset "$sample" -o none.glb --max-ms 3 --device-profile tune.json
[ ! -e none.glb ] || fail "a choice that was refused was written"

echo "-- bake: --model auto"
expect 0 "" "${bake[@]}" -o auto.glb --model auto --iterations 20
for model in bigs sss; do grep -q "^trial of $model: [0-9.]* dB" stdout.txt || fail "no trial of $model: $(cat stdout.txt)"; done
chosen=$(sed -n 's/^going on with --model //p' stdout.txt)
best=$(sed -n 's/^trial of \(.*\): \(.*\) dB.*/\2 \1/p' stdout.txt | sort -rn | head -n 1 | cut -d' ' -f2)
[ -n "$best" ] && [ "$chosen" = "$best" ] || fail "went on with '$chosen', best was '$best': $(cat stdout.txt)"
"$nacre" info auto.glb | grep -q "$chosen" || fail "auto.glb is not of model $chosen"
expect 2 "--resume" "${bake[@]}" -o auto.glb --model auto --resume
# Stopped wherever it is, again and again, and resumed by the same command: the same bytes.
auto=("${bake[@]}" --model auto --iterations 1500)
expect 0 "" "${auto[@]}" -o auto.glb
mkdir interrupted
code=1
for ((i = 0; i < 40 && code == 1; ++i)); do
    resume=()
    if [ -n "$(ls interrupted)" ]; then resume=(--resume); fi
    timeout -s INT $((1 + i / 2)) "${auto[@]}" -o interrupted/auto.glb "${resume[@]}" >stdout.txt 2>stderr.txt
    code=$?
    [ $code = 124 ] && code=1
done
[ $i -gt 1 ] || echo "SKIPPED: --model auto was too quick to be interrupted"
cmp auto.glb interrupted/auto.glb || fail "--model auto, stopped and resumed, differs from uninterrupted: $(cat stderr.txt)"
only interrupted auto.glb

[ $failures = 0 ] || { echo "$failures checks FAILED"; exit 1; }
echo "all checks passed"
