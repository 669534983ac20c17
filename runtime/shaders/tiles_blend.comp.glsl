// A workgroup a tile, an invocation a pixel. The words of the bin's mask come in windows of one to an invocation; their set bits, counted by
// prefix sums, become a list of up to GROUP splats in order, each of which one invocation fetches for all.
layout(local_size_x = TILE, local_size_y = TILE) in;
layout(rgba32f, binding = 0) uniform image2D uImage; // colour, transmittance; from the batch before
uniform usampler2D uMasks;
uniform sampler2D uColor;
uniform float uMaxColor;      // largest value the target can hold
uniform int uTilesX, uFirstTile;
uniform sampler2D uHostDepth; // of the window
uniform int uTested;          // 1: against it
uniform vec3 uPasses;         // 1: a depth that is less, equal, greater is drawn
uniform vec4 uDepth;          // depth in the window is x * (clip z / w) + y, within z to w
uniform vec4 uWindow;         // pixel p of the viewport is at xy + zw * p in the window

shared uint sSums[GROUP];
shared int sRanks[GROUP];
shared vec4 sShapes[GROUP];   // centre, 1 / l_xx, l_yx
shared vec3 sShapes2[GROUP];  // 1 / l_yy; opacity, 0: does not meet the tile; depth in the window
shared vec3 sColors[GROUP];
shared uint sOpen;            // not 0: some pixel is not opaque yet

void wait()
{
    memoryBarrierShared();
    barrier();
}

void fetchSplat(int t, vec2 low)
{
    ivec2 texel = rankedTexel(sRanks[t]);
    Footprint f;
    sShapes2[t] = vec3(0.0);
    if (!fetchFootprint(texel, f)) return;
    vec2 away = abs(f.centre - (low + 0.5 * float(TILE))) - f.halfSize;
    if (!(max(away.x, away.y) < 0.5 * float(TILE))) return;
    sShapes[t] = vec4(f.centre, 1.0 / f.l.x, f.l.y);
    sShapes2[t] = vec3(1.0 / f.l.z, f.opacity, clamp(uDepth.x * f.depth + uDepth.y, uDepth.z, uDepth.w));
    sColors[t] = min(texelFetch(uColor, texel, 0).rgb, uMaxColor);
}

void main()
{
    int t = int(gl_LocalInvocationIndex), number = uFirstTile + int(gl_WorkGroupID.x), words = (uRanks + 31) / 32;
    ivec2 tile = ivec2(number % uTilesX, number / uTilesX), pixel = TILE * tile + ivec2(gl_LocalInvocationID.xy);
    int bin = TILE * tile.y / BIN * uBinsX + TILE * tile.x / BIN;
    vec2 at = vec2(pixel) + 0.5;
    bool inside = at.x < uViewport.x && at.y < uViewport.y;
    vec4 sum = vec4(0.0, 0.0, 0.0, 1.0);
    if (uFirstRank > 0 && inside) sum = imageLoad(uImage, pixel);

    float hostDepth = uTested == 1 && inside ? texelFetch(uHostDepth, ivec2(floor(uWindow.xy + uWindow.zw * at)), 0).r : 0.0;

    if (t == 0) sOpen = 0u;
    wait();
    uint word = 0u, total = 0u;
    for (int window = 0; window < words || total > uint(GROUP);) {
        if (total <= uint(GROUP)) { // all bits of the window before have been taken
            word = window + t < words ? texelFetch(uMasks, ivec2(window + t, bin), 0).x : 0u;
            window += GROUP;
        }
        if (inside && sum.w >= MIN_TRANSMITTANCE) sOpen = 1u;
        uint own = uint(bitCount(word));
        sSums[t] = own;
        for (int step = 1; step < GROUP; step *= 2) {
            wait();
            uint before = t >= step ? sSums[t - step] : 0u;
            wait();
            sSums[t] += before;
        }
        wait();
        total = sSums[GROUP - 1];
        if (sOpen == 0u) break;
        for (uint n = sSums[t] - own; word != 0u && n < uint(GROUP); ++n, word &= word - 1u)
            sRanks[n] = uFirstRank + 32 * (window - GROUP + t) + findLSB(word);
        wait();
        int count = int(min(total, uint(GROUP)));
        if (t < count) fetchSplat(t, vec2(TILE * tile));
        if (t == 0) sOpen = 0u;
        wait();
        for (int k = 0; k < count; ++k) {
            vec3 shape2 = sShapes2[k];
            if (shape2.y == 0.0 || sum.w < MIN_TRANSMITTANCE) continue;
            if (uTested == 1 && (shape2.z < hostDepth ? uPasses.x : shape2.z > hostDepth ? uPasses.z : uPasses.y) == 0.0) continue;
            vec4 shape = sShapes[k];
            float ux = (at.x - shape.x) * shape.z, uy = (at.y - shape.y - shape.w * ux) * shape2.x;
            float alpha = min(MAX_ALPHA, shape2.y * exp(-0.5 * (ux * ux + uy * uy)));
            if (alpha < MIN_ALPHA) continue;
            sum.rgb += sum.w * alpha * sColors[k];
            sum.w *= 1.0 - alpha;
        }
        wait();
    }
    if (inside) imageStore(uImage, pixel, sum);
}
