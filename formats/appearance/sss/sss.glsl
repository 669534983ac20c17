// GLSL twin of appearance/sss/sss.h, which gives MIN_ROUGHNESS, DIELECTRIC_F0, MIN_PIXEL_ALPHA and MIN_NORMAL.

struct SssSurface {
    vec3 base;
    float roughness, metalness;
    vec3 normal;
    float diffuse;
};

// sssReflect: f(w_i, w_o) * max(n.w_i, 0).
vec3 sssReflect(SssSurface s, vec3 wo, vec3 wi, float widening)
{
    float nl = max(dot(s.normal, wi), 0.0), nv = max(dot(s.normal, wo), 0.0);
    vec3 h = wi + wo;
    float length2 = dot(h, h);
    bool halved = length2 > 1e-12;
    h = halved ? h * inversesqrt(length2) : vec3(0.0);
    float nh = clamp(dot(s.normal, h), 0.0, 1.0), vh = clamp(dot(wo, h), 0.0, 1.0);
    float r = clamp(s.roughness, MIN_ROUGHNESS, 1.0);
    float a2 = min(r * r * r * r + widening, 1.0), k = (r + 1.0) * (r + 1.0) / 8.0;
    vec3 across = cross(s.normal, h);
    float q = (nh > 0.0 ? dot(across, across) : 1.0) + nh * nh * a2;
    float d = halved ? a2 / (3.14159265358979 * q * q) : 0.0;
    float masking = 1.0 / (4.0 * (nl * (1.0 - k) + k) * (nv * (1.0 - k) + k));
    float m = 1.0 - vh;
    vec3 f0 = DIELECTRIC_F0 * (1.0 - s.metalness) + s.base * s.metalness;
    vec3 fresnel = f0 + (1.0 - f0) * (m * m * m * m * m);
    vec3 diffuse = (1.0 - fresnel) * (1.0 - s.metalness) * s.diffuse * s.base / 3.14159265358979;
    return (diffuse + d * masking * fresnel) * nl;
}
