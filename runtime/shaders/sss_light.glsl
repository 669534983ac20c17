// Lights one splat with LANES lights at once: how much of each arrives (visibility map, network), and what the network scatters of it
// (sss_network.h). Both ways of running the light pass include this: sss_light.frag.glsl and, from OpenGL 4.3 on, sss_light.comp.glsl.
uniform sampler2D uGeometry;  // slot 0: mean, opacity
uniform sampler2D uLights;    // see fetchLight; row 1: intensity
uniform vec4 uCamera;
uniform float uWorldScale2;
uniform float uInverseSize;   // 1 / half-size of the object
uniform int uFirstLight, uEndLight; // of this batch

#if HAS_VISIBILITY
uniform sampler2DArray uVisibility;
#endif
#if HAS_OCCLUSION
uniform sampler2D uOcclusion; // slot g: share of lights 4g..4g+3 that nothing outside of the instance holds up
#endif

// lit[l].rgb: scattered light per unit of subsurfaceness (residual * falloff * intensity); lit[l].a: share that arrives (visibility * share).
void lightSplat(ivec2 splat, int group, out vec4 lit[LANES])
{
    vec3 mean = texelFetch(uGeometry, splat, 0).xyz;
    vec3 wo = directionToCamera(uCamera, mean);
    vec4 x0[LANES], x1[LANES], arriving[LANES];
    for (int l = 0; l < LANES; ++l) {
        int t = min(uFirstLight + LANES * group + l, uEndLight - 1); // the last group may be larger than the lights left: it repeats one, which nobody reads
        vec4 light = texelFetch(uLights, ivec2(t, 0), 0);
        LightSample s = fetchLight(uLights, t, mean, uWorldScale2);
        float visible = 1.0, occlusion = 1.0;
#if HAS_VISIBILITY
        visible = mapVisibility(uVisibility, splatIndex(splat), s.direction);
#endif
#if HAS_OCCLUSION
        occlusion = texelFetch(uOcclusion, slotTexel(splat, (t - uFirstLight) / 4), 0)[(t - uFirstLight) % 4];
#endif
        float near = light.w < 0.0 ? 0.0 : 1.0 / (1.0 + distance(light.xyz, mean) * uInverseSize);
        x0[l] = vec4(wo, s.direction.x), x1[l] = vec4(s.direction.yz, visible, near);
        arriving[l] = occlusion * vec4(s.falloff * texelFetch(uLights, ivec2(t, 1), 0).rgb, visible);
    }
#if HAS_NETWORK
    sssNetwork(splat, x0, x1, lit);
    for (int l = 0; l < LANES; ++l) lit[l] *= arriving[l];
#else
    for (int l = 0; l < LANES; ++l) lit[l] = vec4(0.0, 0.0, 0.0, arriving[l].a);
#endif
}
