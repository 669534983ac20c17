// One splat of the G-buffer: what its surface is, or, with EXTRA, only how much of further lights arrives. Layers hold three numbers each,
// with the splat's alpha in the fourth (sss_gbuffer.frag.glsl). Splats of bigs have a colour and no surface.
uniform sampler2D uColor;           // light towards the camera that needs no shading: scattered, or all of it
uniform sampler2DArray uAttributes; // world normal; base; roughness, metalness, subsurface, 1; incident shares, three to a layer
uniform float uDepthOrigin;   // depth is stored relative to it: half floats are finest around zero,
uniform float uDepthUnit;     // and in about the size of the scene, so that they hold it
uniform int uFirstLight;      // of those that the incident layers hold
uniform int uLightCount;      // of all

flat out float vOpacity;
flat out vec3 vLayer[LAYERS];

vec4 stored(ivec2 texel, int k) { return texelFetch(uAttributes, ivec3(texel, k), 0); }
float incident(ivec2 texel, int t)
{
#if MIXED
    if (!(stored(texel, 2).a > 0.0)) return 0.0; // nothing was written for a splat without a surface
#endif
    return t < uLightCount ? stored(texel, 3 + t / 3)[t % 3] : 0.0;
}
vec3 incidentThree(ivec2 texel, int t) { return vec3(incident(texel, t), incident(texel, t + 1), incident(texel, t + 2)); }

vec3 surfaceLayer(ivec2 texel, int k, float distance)
{
    if (k == 0) return texelFetch(uColor, texel, 0).rgb;
    if (k < 4) return stored(texel, k - 1).rgb;
    float depth = (distance - uDepthOrigin) / uDepthUnit;
#if MIXED
    float covers = stored(texel, 2).a; // of the pixel's alpha, what has a surface
    if (k == 4) return vec3(covers * depth, covers, incident(texel, uFirstLight));
    return incidentThree(texel, uFirstLight + 1 + 3 * (k - 5));
#else
    if (k == 4) return vec3(depth, incident(texel, uFirstLight), incident(texel, uFirstLight + 1));
    return incidentThree(texel, uFirstLight + 2 + 3 * (k - 5));
#endif
}

void main()
{
    ivec2 texel;
    float distance;
    vOpacity = 0.0;
    for (int k = 0; k < LAYERS; ++k) vLayer[k] = vec3(0.0);
    if (!placeSplat(texel, vOpacity, distance)) return;
#if EXTRA
    for (int k = 0; k < LAYERS; ++k) vLayer[k] = incidentThree(texel, uFirstLight + 3 * (FIRST_LAYER + k));
#else
    for (int k = 0; k < LAYERS; ++k) vLayer[k] = surfaceLayer(texel, FIRST_LAYER + k, distance);
#endif
}
