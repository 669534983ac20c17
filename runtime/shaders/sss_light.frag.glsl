// What the network and the visibility map say of one splat under a group of lights (sss_network.h): one fragment per (splat, LANES lights).
// Out, for each: scattered light per unit of subsurfaceness (residual * falloff * intensity), incident share (visibility * share).
uniform sampler2D uGeometry;  // slot 0: mean, opacity
uniform sampler2D uLights;    // row 0: see sampleLight; row 1: intensity
uniform sampler2D uFirst;     // slot j: outputs 4j..4j+3 of the first layer before light and view
uniform vec3 uCameraAsset;
uniform float uWorldScale2;
uniform float uInverseSize;   // 1 / half-size of the object
uniform int uLightCount;

layout(location = 0) out vec4 outLit[LANES];

#if HAS_VISIBILITY
uniform sampler2DArray uVisibility;
#endif

#if HAS_NETWORK
vec4 firstLayer(int j) { return texelFetch(uFirst, slotTexel(passSplat(), j), 0); }
#endif

void main()
{
    ivec2 splat = passSplat();
    vec3 mean = texelFetch(uGeometry, splat, 0).xyz;
    vec3 wo = directionToCamera(uCameraAsset, mean);
    vec4 x0[LANES], x1[LANES], answer[LANES];
    vec3 arriving[LANES];
    for (int l = 0; l < LANES; ++l) {
        int t = min(LANES * passSlot() + l, uLightCount - 1); // the last group may repeat a light, which nobody reads
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
    sssNetwork(x0, x1, answer);
    for (int l = 0; l < LANES; ++l) outLit[l] = vec4(answer[l].rgb * arriving[l], x1[l].z * answer[l].a);
#else
    for (int l = 0; l < LANES; ++l) outLit[l] = vec4(0.0, 0.0, 0.0, x1[l].z);
#endif
}
