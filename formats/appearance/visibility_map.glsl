// GLSL twin of appearance/visibility_map.h, which gives VISIBILITY_SIZE and VISIBILITY_SLOPE.

// mapVisibility: where the four texels around the unit direction w lie in a splat's map, and their weights (bilinear).
void visibilityTexels(vec3 w, out ivec4 texels, out vec4 weights)
{
    const int n = VISIBILITY_SIZE;
    vec2 p = w.xy / max(abs(w.x) + abs(w.y) + abs(w.z), 0.5); // a unit vector has at least 1
    if (w.z < 0.0) p = (1.0 - abs(p.yx)) * vec2(w.x < 0.0 ? -1.0 : 1.0, w.y < 0.0 ? -1.0 : 1.0);
    vec2 at = (p + 1.0) * float(n / 2) + 0.5;
    ivec2 hi = clamp(ivec2(at), 0, n); // in bounds for any w
    vec2 f = at - vec2(hi);
    weights = vec4((1.0 - f.x) * (1.0 - f.y), f.x * (1.0 - f.y), (1.0 - f.x) * f.y, f.x * f.y);
    for (int k = 0; k < 4; ++k) {
        ivec2 t = hi - ivec2(1 - (k & 1), 1 - (k >> 1));
        if (t.x < 0 || t.x >= n) t = ivec2(clamp(t.x, 0, n - 1), n - 1 - t.y);
        if (t.y < 0 || t.y >= n) t = ivec2(n - 1 - t.x, clamp(t.y, 0, n - 1));
        texels[k] = t.y * n + t.x;
    }
}

// The map's value -> v: sharpened around one half.
float sharpenVisibility(float v) { return clamp(0.5 + VISIBILITY_SLOPE * (v - 0.5), 0.0, 1.0); }

// mapVisibility of splat number `splat`, whose map lies in one long row of `maps` (layout.glsl).
float mapVisibility(sampler2DArray maps, int splat, vec3 w)
{
    ivec4 texels;
    vec4 weights;
    visibilityTexels(w, texels, weights);
    vec4 v;
    for (int k = 0; k < 4; ++k) v[k] = texelFetch(maps, longRowTexel(splat * (VISIBILITY_SIZE * VISIBILITY_SIZE) + texels[k]), 0).r;
    return sharpenVisibility(dot(v, weights));
}
