// A splat's bit into the masks of all bins that its box meets.
layout(local_size_x = GROUP) in;
layout(r32ui, binding = 0) uniform uimage2D uMasks;

void main()
{
    int i = int(gl_GlobalInvocationID.x);
    Footprint f;
    if (i >= uRanks || !fetchFootprint(rankedTexel(uFirstRank + i), f)) return;
    vec2 low = (f.centre - f.halfSize) / float(BIN), high = (f.centre + f.halfSize) / float(BIN), end = vec2(uBinsX, uBinsY);
    if (!(all(greaterThanEqual(high, vec2(0.0))) && all(lessThan(low, end)))) return;
    ivec2 a = ivec2(max(low, vec2(0.0))), b = ivec2(min(high, end - 1.0));
    for (int y = a.y; y <= b.y; ++y)
        for (int x = a.x; x <= b.x; ++x) imageAtomicOr(uMasks, ivec2(i >> 5, y * uBinsX + x), 1u << uint(i & 31));
}
