// Light part of bigsTerms (appearance/bigs/bigs.h): one fragment per (splat, group of four lights).
// Out: falloff_t * v_t * max(T_dir(w_t), 0) of the four lights, sum_t I_t * falloff_t * max(T_ind(w_t), 0) over them, and, for the lobe
// of the combine pass, v_t of the four.
uniform sampler2D uGeometry;  // slot 0: mean, opacity; slot 3: rho, shadow
uniform sampler2D uTransport; // slot i: T_ind rgb, T_dir of function i, as numbers or (TRANSPORT_BYTES) bytes, then one slot more: their size
#if TRANSPORT_BYTES
uniform sampler2D uTransportScale; // texel i: unit of function i
#endif
uniform sampler2D uLights;    // see fetchLight; row 1: intensity
uniform int uFirstLight;      // of slot 0 of this pass
uniform int uLightCount;
uniform float uWorldScale2;
#if HAS_VISIBILITY
uniform sampler2DArray uVisibility;
#endif
#if HAS_OCCLUSION
uniform sampler2D uOcclusion; // slot g: share of lights 4g..4g+3 that nothing outside of the instance holds up
#endif

layout(location = 0) out vec4 outDirect;
layout(location = 1) out vec4 outIndirect;
#if HAS_VISIBLE
layout(location = 2) out vec4 outVisible;
#endif

void main()
{
    ivec2 splat = passSplat();
    int first = uFirstLight + 4 * passSlot();
    vec3 mean = texelFetch(uGeometry, splat, 0).xyz;
    vec4 transport[TRANSPORT_FUNCTIONS];
    for (int i = 0; i < TRANSPORT_FUNCTIONS; ++i) transport[i] = texelFetch(uTransport, slotTexel(splat, i), 0);
#if TRANSPORT_BYTES
    vec4 size = exp2(texelFetch(uTransport, slotTexel(splat, TRANSPORT_FUNCTIONS), 0) * (-255.0 / 8.0)) / 127.0;
    for (int i = 0; i < TRANSPORT_FUNCTIONS; ++i) transport[i] = (transport[i] * 255.0 - 128.0) * size * texelFetch(uTransportScale, ivec2(i, 0), 0);
#endif

    vec4 direct = vec4(0.0), visible = vec4(0.0), occlusion = vec4(1.0);
    vec3 indirect = vec3(0.0);
#if HAS_VISIBILITY
    float shadow = texelFetch(uGeometry, slotTexel(splat, 3), 0).w;
#endif
#if HAS_OCCLUSION
    occlusion = texelFetch(uOcclusion, ivec2(gl_FragCoord.xy), 0);
#endif
    int end = min(uLightCount - first, 4);
    for (int k = 0; k < end; ++k) {
        LightSample s = fetchLight(uLights, first + k, mean, uWorldScale2);
        vec3 intensity = texelFetch(uLights, ivec2(first + k, 1), 0).rgb;
        float y[25];
        shBasis(TRANSPORT_FUNCTIONS, s.direction, y);
        vec4 t = vec4(0.0);
        for (int i = 0; i < TRANSPORT_FUNCTIONS; ++i) t += transport[i] * y[i];
        t = max(t, 0.0) * s.falloff * occlusion[k];
        vec4 lane = vec4(equal(ivec4(k), ivec4(0, 1, 2, 3)));
        float v = 1.0;
#if HAS_VISIBILITY
        v -= shadow * (1.0 - mapVisibility(uVisibility, splatIndex(splat), s.direction));
#endif
        direct += v * t.w * lane;
        visible += v * occlusion[k] * lane;
        indirect += intensity * t.rgb;
    }
    outDirect = direct;
    outIndirect = vec4(indirect, 0.0);
#if HAS_VISIBLE
    outVisible = visible;
#endif
}
