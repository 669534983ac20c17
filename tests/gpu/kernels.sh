#!/usr/bin/env bash
# What nvcc makes of each kernel: registers, stack and spills, static shared memory (most is asked for when a kernel starts: its Shared).
#   tests/gpu/kernels.sh [sm_90]      a table for tests/bench/results/cuda_kernels.md; needs nvcc (NVCC, else the path, else /usr/local/cuda)
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
card=${1:-sm_90}
nvcc=${NVCC:-$(command -v nvcc || echo /usr/local/cuda/bin/nvcc)}
[ -x "$nvcc" ] || { echo "kernels.sh: no nvcc" >&2; exit 2; }
log=$(mktemp)
trap 'rm -f "$log"' EXIT
"$nvcc" -std=c++20 --expt-relaxed-constexpr -diag-suppress=20012 -O3 -arch="$card" -Xptxas -v -I"$root/baker" -I"$root/formats" -c -o /dev/null "$root/baker/device/engine_cuda.cu" 2> "$log" ||
    { cat "$log" >&2; exit 1; }
grep -q "warning" "$log" && { cat "$log" >&2; exit 1; }
echo "| kernel, $card, $("$nvcc" --version | sed -n 's/.*release \([0-9.]*\).*/nvcc \1/p') | registers | stack, bytes | spills, bytes |"
echo "|---|---|---|---|"
c++filt < "$log" | awk '
    /Compiling entry function/ { name = $0; sub(/.*::run</, "", name); sub(/>\(.*/, "", name); gsub(/nacre::cuda::|nacre::/, "", name) }
    /bytes stack frame/ { stack = $1; spills = $5 + $9 }
    /Used [0-9]+ registers/ { for (i = 1; i < NF; ++i) if ($i == "Used") registers = $(i + 1); printf "| %s | %d | %d | %d |\n", name, registers, stack, spills }' | sort
