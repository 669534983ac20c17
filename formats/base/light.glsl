// GLSL twin of base/light_sample.h: what a splat sees of a light and of the camera.

// `camera`: a place and 1, or, orthographic, a direction and 0. At zero distance +Z: any unit vector is as good.
vec3 directionToCamera(vec4 camera, vec3 mean)
{
    vec3 d = camera.xyz - camera.w * mean;
    float r2 = dot(d, d);
    return r2 > 1e-20 ? d * inversesqrt(r2) : vec3(0.0, 0.0, 1.0);
}

struct LightSample {
    vec3 direction;
    float falloff, widening;
};

// samplePackedLight: the rows are a column of the light texture, `mean` is in asset space; worldScale2 turns squared asset distances into
// squared world distances.
LightSample sampleLight(vec4 row0, vec4 row1, vec4 row2, vec4 row3, vec3 mean, float worldScale2)
{
    if (row0.w < 0.0) return LightSample(row0.xyz, 1.0, row1.w);
    vec3 d = row0.xyz - mean;
    float r2 = dot(d, d), distance2 = r2 * worldScale2;
    float falloff = 1.0 / max(distance2, row0.w), widening = row3.z * falloff;
    vec3 direction = r2 > 1e-20 ? d * inversesqrt(r2) : vec3(0.0, 0.0, 1.0);
    float reach = min(distance2 * row3.y, 1.0);
    falloff *= 1.0 - reach * reach;
    if (row3.w > 0.0) {
        float shines = clamp(row3.x - row2.w * dot(row2.xyz, direction), 0.0, 1.0);
        falloff *= row3.w < 1.5 ? shines * shines : shines;
    }
    return LightSample(direction, falloff, widening);
}
