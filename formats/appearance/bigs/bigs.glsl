// GLSL twin of base/spherical_harmonics.h (shBasis) and appearance/bigs/bigs.h. The passes of the runtime hold the sums over coefficients;
// here is what they share. bigs.h gives LOBE_FACING.

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

// bigsForward: Henyey and Greenstein's phase function, 1 straight ahead.
float bigsForward(float sharpness, vec3 wo, vec3 wi)
{
    float u = 1.0 / (1.0 + max(sharpness, 0.0) * max(1.0 + dot(wo, wi), 0.0));
    return u * sqrt(u);
}

// bigsLobe: GGX of the half vector, 1 at its peak unless widened, times min(4 n.wi, 1).
float bigsLobe(vec4 normalSharpness, vec3 wo, vec3 wi, float widening)
{
    vec3 h = wo + wi;
    float h2 = dot(h, h), nh = max(dot(normalSharpness.xyz, h), 0.0);
    float a2 = 1.0 / (1.0 + max(normalSharpness.w, 0.0)), wide = min(a2 + widening, 1.0);
    float u = 1.0 / (1.0 + (1.0 / wide - 1.0) * max(1.0 - nh * nh / max(h2, 1e-12), 0.0));
    float front = clamp(LOBE_FACING * dot(normalSharpness.xyz, wi), 0.0, 1.0);
    return h2 > 1e-12 ? a2 / wide * front * u * u : 0.0;
}
