// Light of one slot, seen from a splat or a point: a column of four texels (light.glsl).
LightSample fetchLight(sampler2D lights, int t, vec3 p, float worldScale2)
{
    return sampleLight(texelFetch(lights, ivec2(t, 0), 0), texelFetch(lights, ivec2(t, 1), 0), texelFetch(lights, ivec2(t, 2), 0),
                       texelFetch(lights, ivec2(t, 3), 0), p, worldScale2);
}
