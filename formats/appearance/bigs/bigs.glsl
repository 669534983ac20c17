// GLSL twin of base/spherical_harmonics.h (shBasis), base/light.h (samplePointLight) and appearance/bigs/bigs.h.
// The passes of the runtime hold the sums over coefficients; here is what they share. bigs.h gives VISIBILITY_SIZE, VISIBILITY_SLOPE and
// LOBE_FACING.

// y[0..count) for the unit direction d; count is a compile-time constant, so unused functions cost nothing.
void shBasis(const int count, vec3 d, out float y[25])
{
    float x2 = d.x * d.x, y2 = d.y * d.y, z2 = d.z * d.z, xy = d.x * d.y, yz = d.y * d.z, xz = d.x * d.z;
    y[0] = 0.28209479177387814;
    if (count > 1) {
        y[1] = -0.48860251190291992 * d.y;
        y[2] = 0.48860251190291992 * d.z;
        y[3] = -0.48860251190291992 * d.x;
    }
    if (count > 4) {
        y[4] = 1.0925484305920792 * xy;
        y[5] = -1.0925484305920792 * yz;
        y[6] = 0.31539156525252005 * (2.0 * z2 - x2 - y2);
        y[7] = -1.0925484305920792 * xz;
        y[8] = 0.54627421529603959 * (x2 - y2);
    }
    if (count > 9) {
        y[9] = -0.59004358992664352 * d.y * (3.0 * x2 - y2);
        y[10] = 2.8906114426405538 * xy * d.z;
        y[11] = -0.45704579946446577 * d.y * (4.0 * z2 - x2 - y2);
        y[12] = 0.37317633259011546 * d.z * (2.0 * z2 - 3.0 * x2 - 3.0 * y2);
        y[13] = -0.45704579946446577 * d.x * (4.0 * z2 - x2 - y2);
        y[14] = 1.4453057213202769 * d.z * (x2 - y2);
        y[15] = -0.59004358992664352 * d.x * (x2 - 3.0 * y2);
    }
    if (count > 16) {
        y[16] = 2.5033429417967046 * xy * (x2 - y2);
        y[17] = -1.7701307697799304 * yz * (3.0 * x2 - y2);
        y[18] = 0.94617469575756008 * xy * (7.0 * z2 - 1.0);
        y[19] = -0.66904654355728921 * yz * (7.0 * z2 - 3.0);
        y[20] = 0.10578554691520431 * (z2 * (35.0 * z2 - 30.0) + 3.0);
        y[21] = -0.66904654355728921 * xz * (7.0 * z2 - 3.0);
        y[22] = 0.47308734787878004 * (x2 - y2) * (7.0 * z2 - 1.0);
        y[23] = -1.7701307697799304 * xz * (x2 - 3.0 * y2);
        y[24] = 0.62583573544917614 * (x2 * (x2 - 3.0 * y2) - y2 * (3.0 * x2 - y2));
    }
}

// bigsLobe: GGX of the half vector, 1 at its peak, times min(4 n.wi, 1).
float bigsLobe(vec4 normalSharpness, vec3 wo, vec3 wi)
{
    vec3 h = wo + wi;
    float h2 = dot(h, h), nh = max(dot(normalSharpness.xyz, h), 0.0);
    float u = 1.0 / (1.0 + max(normalSharpness.w, 0.0) * max(1.0 - nh * nh / max(h2, 1e-12), 0.0));
    float front = clamp(LOBE_FACING * dot(normalSharpness.xyz, wi), 0.0, 1.0);
    return h2 > 1e-12 ? front * u * u : 0.0;
}

// bigsVisibility: where the four texels around the unit direction w lie in a splat's map, and their weights (bilinear).
void visibilityTexels(vec3 w, out ivec4 texels, out vec4 weights)
{
    const int n = VISIBILITY_SIZE;
    vec2 p = w.xy / (abs(w.x) + abs(w.y) + abs(w.z));
    if (w.z < 0.0) p = (1.0 - abs(p.yx)) * vec2(w.x < 0.0 ? -1.0 : 1.0, w.y < 0.0 ? -1.0 : 1.0);
    vec2 at = (p + 1.0) * float(n / 2) + 0.5;
    ivec2 hi = min(ivec2(at), n);
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

// At zero distance +Z: any unit vector is as good.
vec3 directionToCamera(vec3 camera, vec3 mean)
{
    vec3 d = camera - mean;
    float r2 = dot(d, d);
    return r2 > 1e-20 ? d * inversesqrt(r2) : vec3(0.0, 0.0, 1.0);
}

// Direction to a light (xyz) and its falloff (w). `light` is in asset space: point (position, capped radius^2 in world units) or
// directional (unit direction, -1). worldScale2 turns squared asset distances into squared world distances.
vec4 sampleLight(vec4 light, vec3 mean, float worldScale2)
{
    if (light.w < 0.0) return vec4(light.xyz, 1.0);
    vec3 d = light.xyz - mean;
    float r2 = dot(d, d);
    float falloff = 1.0 / max(r2 * worldScale2, light.w);
    return r2 > 1e-20 ? vec4(d * inversesqrt(r2), falloff) : vec4(0.0, 0.0, 1.0, falloff);
}
