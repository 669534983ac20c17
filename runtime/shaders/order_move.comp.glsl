// Moves the pairs of a tile to where their digit belongs, those with the same value in the order they had. An invocation takes EACH pairs that
// follow one another and counts the values in 4 bits each. Counts of value d and d + 8 share a word of 16 bits each, which cannot
// overflow: a tile has 2048 pairs. Prefix sums over words and invocations rank every pair within its tile.
#if LAST
layout(r32ui, binding = 0) uniform writeonly uimage2D uOrder;
#else
layout(rg32ui, binding = 0) uniform writeonly uimage2D uMoved;
#endif
uniform usampler2D uPairs, uOffsets;
shared uint sRanks[GROUP * DIGITS / 2]; // word w of invocation t at w * GROUP + t
shared uint sSums[GROUP];
shared uint sOffsets[DIGITS];

uint half16(uint word, uint digit) { return word >> (digit >= 8u ? 16 : 0) & 0xffffu; }

void main()
{
    int t = int(gl_LocalInvocationIndex);
    if (t < DIGITS) sOffsets[t] = texelFetch(uOffsets, countTexel(t * uTiles + tileIndex()), 0).x;

    uvec2 pairs[EACH];
    uint within[EACH];        // pairs of this invocation before it with the same value
    uvec2 seen = uvec2(0u);   // 4 bits a value
    int first = (tileIndex() * GROUP + t) * EACH, n = clamp(uTotal - first, 0, EACH);
    for (int k = 0; k < n; ++k) {
        pairs[k] = texelFetch(uPairs, listTexel(first + k), 0).xy;
        uint d = digitOf(pairs[k].x), bits = 4u * (d & 7u);
        within[k] = (d >= 8u ? seen.y : seen.x) >> bits & 15u;
        if (d >= 8u) seen.y += 1u << bits;
        else seen.x += 1u << bits;
    }
    for (int w = 0; w < DIGITS / 2; ++w)
        sRanks[w * GROUP + t] = (seen.x >> uint(4 * w) & 15u) | (seen.y >> uint(4 * w) & 15u) << 16;
    wait();

    const int run = DIGITS / 2;
    uint sum = 0u;
    for (int k = 0; k < run; ++k) sum += sRanks[t * run + k];
    sSums[t] = sum;
    for (int step = 1; step < GROUP; step *= 2) {
        wait();
        uint before = t >= step ? sSums[t - step] : 0u;
        wait();
        sSums[t] += before;
    }
    uint rank = sSums[t] - sum;
    for (int k = 0; k < run; ++k) {
        uint word = sRanks[t * run + k];
        sRanks[t * run + k] = rank;
        rank += word;
    }
    wait();

    for (int k = 0; k < n; ++k) {
        uint d = digitOf(pairs[k].x);
        int w = int(d & 7u) * GROUP;
        uint to = sOffsets[d] + half16(sRanks[w + t], d) - half16(sRanks[w], d) + within[k];
#if LAST
        imageStore(uOrder, listTexel(int(to)), uvec4(pairs[k].y, 0u, 0u, 0u));
#else
        imageStore(uMoved, listTexel(int(to)), uvec4(pairs[k], 0u, 0u));
#endif
    }
}
