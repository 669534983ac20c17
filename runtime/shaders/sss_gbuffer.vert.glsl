// One splat of the G-buffer (projection: project.glsl): what its surface is, or, with EXTRA, only how much of further lights arrives.
// Layers hold three numbers each, with the splat's alpha in the fourth (sss_gbuffer.frag.glsl).
uniform sampler2D uScattered;
uniform sampler2DArray uLit;  // see litTexel; alpha is the incident share
uniform int uLanes;
uniform vec3 uCameraAsset;
uniform float uDepthOrigin;   // depth is stored relative to it: half floats are finest around zero,
uniform float uDepthUnit;     // and in about the size of the object, so that they hold it
uniform int uFirstLight;      // of those that the incident layers hold
uniform int uLightCount;      // of all

flat out float vOpacity;
flat out vec3 vLayer[LAYERS];

float incident(ivec2 splat, int t) { return t < uLightCount ? texelFetch(uLit, litTexel(splat, t, uLanes), 0).a : 0.0; }

void main()
{
    ivec2 splat;
    vec4 meanOpacity;
    vOpacity = 0.0;
    for (int k = 0; k < LAYERS; ++k) vLayer[k] = vec3(0.0);
    if (!projectSplat(splat, meanOpacity, vOpacity)) return;
#if EXTRA
    for (int k = 0; k < LAYERS; ++k) {
        int t = uFirstLight + 3 * k;
        vLayer[k] = vec3(incident(splat, t), incident(splat, t + 1), incident(splat, t + 2));
    }
#else
    vec4 normalRoughness = texelFetch(uGeometry, slotTexel(splat, 3), 0);
    vec4 baseMetalness = texelFetch(uGeometry, slotTexel(splat, 4), 0);
    vLayer[0] = texelFetch(uScattered, splat, 0).rgb;
    vLayer[1] = normalRoughness.xyz;
    vLayer[2] = baseMetalness.rgb;
    vLayer[3] = vec3(normalRoughness.w, baseMetalness.w, texelFetch(uGeometry, slotTexel(splat, 5), 0).r);
    vLayer[4] = vec3((distance(uCameraAsset, meanOpacity.xyz) - uDepthOrigin) / uDepthUnit, incident(splat, uFirstLight), incident(splat, uFirstLight + 1));
    for (int k = 5; k < LAYERS; ++k) {
        int t = uFirstLight + 2 + 3 * (k - 5);
        vLayer[k] = vec3(incident(splat, t), incident(splat, t + 1), incident(splat, t + 2));
    }
#endif
}
