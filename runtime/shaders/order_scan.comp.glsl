// Sums of all counts before each: where the pairs of a tile with a value of the digit go. One workgroup, a run of counts to an invocation.
layout(r32ui, binding = 0) uniform writeonly uimage2D uOffsets;
uniform usampler2D uCounts;
shared uint sSums[GROUP];

void main()
{
    int t = int(gl_LocalInvocationIndex), count = DIGITS * uTiles, run = (count + GROUP - 1) / GROUP;
    int first = min(t * run, count), end = min(first + run, count);
    uint sum = 0u;
    for (int n = first; n < end; ++n) sum += texelFetch(uCounts, countTexel(n), 0).x;
    sSums[t] = sum;
    for (int step = 1; step < GROUP; step *= 2) {
        wait();
        uint before = t >= step ? sSums[t - step] : 0u;
        wait();
        sSums[t] += before;
    }
    uint offset = sSums[t] - sum;
    for (int n = first; n < end; ++n) {
        imageStore(uOffsets, countTexel(n), uvec4(offset, 0u, 0u, 0u));
        offset += texelFetch(uCounts, countTexel(n), 0).x;
    }
}
