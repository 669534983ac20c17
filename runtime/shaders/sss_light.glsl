// Lights one splat with LANES lights at once: how much of each arrives (visibility map, network), and what the network scatters of it
// (sss_network.h). Both ways of running the light pass include this: sss_light.frag.glsl and, from OpenGL 4.3 on, sss_light.comp.glsl.
uniform sampler2D uGeometry;  // slot 0: mean, opacity
uniform sampler2D uLights;    // row 0: see sampleLight; row 1: intensity
uniform vec3 uCameraAsset;
uniform float uWorldScale2;
uniform float uInverseSize;   // 1 / half-size of the object
uniform int uLightCount;

#if HAS_VISIBILITY
uniform sampler2DArray uVisibility;
#endif

// lit[l].rgb: scattered light per unit of subsurfaceness (residual * falloff * intensity); lit[l].a: share that arrives (visibility * share).
void lightSplat(ivec2 splat, int group, out vec4 lit[LANES])
{
    vec3 mean = texelFetch(uGeometry, splat, 0).xyz;
    vec3 wo = directionToCamera(uCameraAsset, mean);
    vec4 x0[LANES], x1[LANES];
    vec3 arriving[LANES];
    for (int l = 0; l < LANES; ++l) {
        int t = min(LANES * group + l, uLightCount - 1); // the last group may be larger than the lights left: it repeats one, which nobody reads
        vec4 light = texelFetch(uLights, ivec2(t, 0), 0);
        vec4 s = sampleLight(light, mean, uWorldScale2);
        float visible = 1.0;
#if HAS_VISIBILITY
        visible = mapVisibility(uVisibility, splatIndex(splat), s.xyz);
#endif
        float near = light.w < 0.0 ? 0.0 : 1.0 / (1.0 + distance(light.xyz, mean) * uInverseSize);
        x0[l] = vec4(wo, s.x), x1[l] = vec4(s.yz, visible, near);
        arriving[l] = s.w * texelFetch(uLights, ivec2(t, 1), 0).rgb;
    }
#if HAS_NETWORK
    sssNetwork(splat, x0, x1, lit);
    for (int l = 0; l < LANES; ++l) lit[l] *= vec4(arriving[l], x1[l].z);
#else
    for (int l = 0; l < LANES; ++l) lit[l] = vec4(0.0, 0.0, 0.0, x1[l].z);
#endif
}
