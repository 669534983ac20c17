// GLSL twin of base/light_sample.h: what a splat sees of a light and of the camera.

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
