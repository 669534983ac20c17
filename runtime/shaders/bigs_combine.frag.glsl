// bigsTransport summed over the lights (appearance/bigs/bigs.h): one fragment per splat of an instance, into its rows of the draw list,
// colour = tint * (indirect + sum_t I_t * (direct_t * max(rho + sum_i a_i y_i(w_t), 0) + falloff_t * v_t * (k * lobe(w_t, w_o) + f * forward(w_t, w_o)))).
// In defines: FORWARD_SLOT, of f and its sharpness.
uniform sampler2D uGeometry;   // slot 0: mean, opacity; slot 3: rho; slot 4: normal, sharpness; slot 5: k
uniform sampler2D uDirect;     // slot g: direct transport of lights 4g..4g+3 of this batch, visibility included
uniform sampler2D uIndirect;   // slot g: indirect radiance of lights 4g..4g+3
uniform sampler2D uContracted; // see contractedTexel
uniform sampler2D uLights;     // see fetchLight; row 1: intensity
uniform sampler2D uVisible;    // slot g: v of lights 4g..4g+3
uniform vec4 uCamera;
uniform vec3 uTint;
uniform int uFirstLight, uEndLight; // of this batch
uniform int uScattering;
uniform float uWorldScale2;

#if HAS_LOBE || HAS_FORWARD
#define HAS_SHARP 1
#else
#define HAS_SHARP 0
#endif

layout(location = 0) out vec4 outColor;

// a_i of a splat: its grid row becomes S_FUNCTIONS rows, so that fragments that read the same coefficients are neighbours.
ivec2 contractedTexel(ivec2 splat, int i) { return ivec2(splat.x, splat.y * S_FUNCTIONS + i); }

void main()
{
    int g = listSplat();
    if (g >= uCount) discard;
    ivec2 splat = gridTexel(g);
    vec3 rho = texelFetch(uGeometry, slotTexel(splat, 3), 0).rgb;
    vec3 color = vec3(0.0);
#if S_FUNCTIONS > 0 || HAS_SHARP
    vec3 mean = texelFetch(uGeometry, splat, 0).xyz;
#endif
#if HAS_LOBE
    vec4 normalSharpness = texelFetch(uGeometry, slotTexel(splat, 4), 0);
    vec3 lobeColor = texelFetch(uGeometry, slotTexel(splat, 5), 0).rgb;
#endif
#if HAS_FORWARD
    vec4 forward = texelFetch(uGeometry, slotTexel(splat, FORWARD_SLOT), 0);
#endif
#if HAS_SHARP
    vec3 towards = directionToCamera(uCamera, mean);
#endif
#if S_FUNCTIONS > 0
    vec3 a[S_FUNCTIONS];
    bool scatters = g < uScattering; // the others have no s
    if (scatters)
        for (int i = 0; i < S_FUNCTIONS; ++i) a[i] = texelFetch(uContracted, contractedTexel(splat, i), 0).rgb;
#endif
    for (int t = uFirstLight; t < uEndLight; ++t) {
        int inBatch = t - uFirstLight, k = inBatch & 3;
        ivec2 group = slotTexel(splat, inBatch >> 2);
        if (k == 0) color += texelFetch(uIndirect, group, 0).rgb;
        vec3 scatter = rho;
#if S_FUNCTIONS > 0 || HAS_SHARP
        LightSample s = fetchLight(uLights, t, mean, uWorldScale2);
#endif
#if S_FUNCTIONS > 0
        if (scatters) {
            float y[25];
            shBasis(S_FUNCTIONS, s.direction, y);
            for (int i = 0; i < S_FUNCTIONS; ++i) scatter += a[i] * y[i];
        }
#endif
        vec3 reflected = texelFetch(uDirect, group, 0)[k] * max(scatter, 0.0);
#if HAS_SHARP
        vec3 sharp = vec3(0.0);
#if HAS_LOBE
        sharp += bigsLobe(normalSharpness, towards, s.direction, s.widening) * lobeColor;
#endif
#if HAS_FORWARD
        sharp += bigsForward(forward.w, towards, s.direction) * forward.rgb;
#endif
#if HAS_VISIBLE
        sharp *= texelFetch(uVisible, group, 0)[k];
#endif
        reflected += s.falloff * sharp;
#endif
        color += texelFetch(uLights, ivec2(t, 1), 0).rgb * reflected;
    }
    outColor = vec4(uTint * color, 0.0);
}
