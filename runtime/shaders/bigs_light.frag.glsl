// Light part of bigsTerms (appearance/bigs/bigs.h): one fragment per (splat, group of four lights).
// Out: falloff_t * v_t * max(T_dir(w_t), 0) of the four lights, sum_t I_t * falloff_t * max(T_ind(w_t), 0) over them, and, for the lobe
// of the combine pass, v_t of the four.
uniform sampler2D uGeometry;  // slot 0: mean, opacity; slot 3: rho, shadow
uniform sampler2D uTransport; // slot i: T_ind rgb, T_dir of function i
uniform sampler2D uLights;    // row 0: see sampleLight; row 1: intensity
uniform int uLightCount;
uniform float uWorldScale2;

layout(location = 0) out vec4 outDirect;
layout(location = 1) out vec4 outIndirect;

#if HAS_VISIBILITY
uniform sampler2DArray uVisibility;
#if HAS_LOBE
layout(location = 2) out vec4 outVisible;
#endif
#endif

void main()
{
    ivec2 splat = passSplat();
    int first = 4 * passSlot();
    vec3 mean = texelFetch(uGeometry, splat, 0).xyz;
    vec4 transport[25];
    for (int i = 0; i < 25; ++i) transport[i] = texelFetch(uTransport, slotTexel(splat, i), 0);

    vec4 direct = vec4(0.0);
    vec3 indirect = vec3(0.0);
#if HAS_VISIBILITY
    float shadow = texelFetch(uGeometry, slotTexel(splat, 3), 0).w;
    vec4 visible = vec4(0.0);
#endif
    int end = min(uLightCount - first, 4);
    for (int k = 0; k < end; ++k) {
        vec4 s = sampleLight(texelFetch(uLights, ivec2(first + k, 0), 0), mean, uWorldScale2);
        vec3 intensity = texelFetch(uLights, ivec2(first + k, 1), 0).rgb;
        float y[25];
        shBasis(25, s.xyz, y);
        vec4 t = vec4(0.0);
        for (int i = 0; i < 25; ++i) t += transport[i] * y[i];
        t = max(t, 0.0) * s.w;
        vec4 lane = vec4(equal(ivec4(k), ivec4(0, 1, 2, 3)));
#if HAS_VISIBILITY
        float v = 1.0 - shadow * (1.0 - mapVisibility(uVisibility, splatIndex(splat), s.xyz));
        t.w *= v;
        visible += v * lane;
#endif
        direct += t.w * lane;
        indirect += intensity * t.rgb;
    }
    outDirect = direct;
    outIndirect = vec4(indirect, 0.0);
#if HAS_VISIBILITY && HAS_LOBE
    outVisible = visible;
#endif
}
