// How often each value of the digit occurs in a tile.
layout(r32ui, binding = 0) uniform writeonly uimage2D uCounts;
uniform usampler2D uPairs;
shared uint sCounts[DIGITS];

void main()
{
    int t = int(gl_LocalInvocationIndex);
    if (t < DIGITS) sCounts[t] = 0u;
    wait();
    for (int k = 0; k < EACH; ++k) {
        int i = (tileIndex() * EACH + k) * GROUP + t;
        if (i < uTotal) atomicAdd(sCounts[digitOf(texelFetch(uPairs, listTexel(i), 0).x)], 1u);
    }
    wait();
    if (t < DIGITS) imageStore(uCounts, countTexel(t * uTiles + tileIndex()), uvec4(sCounts[t], 0u, 0u, 0u));
}
