// What the network and the visibility map say of one splat under one light (sss_network.h): one fragment per (splat, light).
// Out: scattered light per unit of subsurfaceness (residual * falloff * intensity), incident share (visibility * share).
uniform sampler2D uGeometry;  // slot 0: mean, opacity
uniform sampler2D uLights;    // row 0: see sampleLight; row 1: intensity
uniform sampler2D uFirst;     // slot j: outputs 4j..4j+3 of the first layer before light and view
uniform vec3 uCameraAsset;
uniform float uWorldScale2;
uniform float uInverseSize;   // 1 / half-size of the object

layout(location = 0) out vec4 outLit;

#if HAS_VISIBILITY
uniform sampler2DArray uVisibility;
#endif

void main()
{
    ivec2 splat = passSplat();
    int t = passSlot();
    vec3 mean = texelFetch(uGeometry, splat, 0).xyz;
    vec4 light = texelFetch(uLights, ivec2(t, 0), 0);
    vec4 s = sampleLight(light, mean, uWorldScale2);
    float visible = 1.0;
#if HAS_VISIBILITY
    visible = mapVisibility(uVisibility, splatIndex(splat), s.xyz);
#endif
    outLit = vec4(0.0, 0.0, 0.0, visible);
#if HAS_NETWORK
    vec4 h[H1 / 4];
    for (int j = 0; j < H1 / 4; ++j) h[j] = texelFetch(uFirst, slotTexel(splat, j), 0);
    vec3 wo = directionToCamera(uCameraAsset, mean);
    float near = light.w < 0.0 ? 0.0 : 1.0 / (1.0 + distance(light.xyz, mean) * uInverseSize);
    vec4 answer = sssNetwork(h, vec4(wo, s.x), vec4(s.yz, visible, near));
    outLit = vec4(answer.rgb * s.w * texelFetch(uLights, ivec2(t, 1), 0).rgb, visible * answer.a);
#endif
}
