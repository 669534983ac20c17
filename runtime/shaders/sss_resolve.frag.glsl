// From the G-buffer to the host's frame: sssPixel and sssRadiance (appearance/sss/sss.h) summed over the lights whose incident share the
// layers hold. With EXTRA it adds further lights to a pixel that has its scattered light and alpha already.
uniform sampler2DArray uLayers;  // scattered, normal, base, roughness+metalness+subsurfaceness, depth+2 incident, 3 incident ...
uniform sampler2DArray uFurther; // EXTRA: 3 incident each
uniform sampler2D uLights;       // row 0: see sampleLight; row 1: intensity, widening of highlights
uniform vec3 uEye;               // asset space
uniform vec3 uRayOrigin, uRayRight, uRayUp; // pixel (x, y) of the window looks along origin + x right + y up
uniform float uDepthOrigin, uDepthUnit;
uniform float uWorldScale2;
uniform float uMaxColor;
uniform int uFirstLight, uLightCount;

layout(location = 0) out vec4 outColor;

vec4 layer(int k) { return texelFetch(uLayers, ivec3(gl_FragCoord.xy, k), 0); }

float incidentShare(int t)
{
#if EXTRA
    vec4 texel = texelFetch(uFurther, ivec3(gl_FragCoord.xy, t / 3), 0);
    return texel[t % 3];
#else
    vec4 texel = layer(t < 2 ? 4 : 5 + (t - 2) / 3);
    return t < 2 ? texel[1 + t] : texel[(t - 2) % 3];
#endif
}

void main()
{
    vec4 scattered = layer(0);
    float alpha = scattered.a;
    if (alpha <= 0.0) discard;
#if EXTRA
    vec3 color = vec3(0.0);
#else
    vec3 color = scattered.rgb;
#endif
    vec3 normal = layer(1).xyz;
    float normalLength = length(normal), perAlpha = alpha > MIN_PIXEL_ALPHA ? 1.0 / alpha : 0.0;
    if (normalLength * perAlpha > MIN_NORMAL) {
        vec3 material = layer(3).xyz * perAlpha;
        SssSurface surface = SssSurface(layer(2).rgb * perAlpha, material.x, material.y, normal / normalLength, 1.0 - material.z);
        vec3 ray = normalize(uRayOrigin + gl_FragCoord.x * uRayRight + gl_FragCoord.y * uRayUp);
        vec3 point = uEye + (uDepthOrigin + uDepthUnit * (layer(4).x * perAlpha)) * ray;
        for (int t = 0; t < LIGHTS; ++t) {
            if (uFirstLight + t >= uLightCount) break;
            vec4 s = sampleLight(texelFetch(uLights, ivec2(uFirstLight + t, 0), 0), point, uWorldScale2);
            vec4 intensity = texelFetch(uLights, ivec2(uFirstLight + t, 1), 0);
            color += incidentShare(t) * s.w * intensity.rgb * sssReflect(surface, -ray, s.xyz, intensity.w);
        }
    }
    outColor = vec4(min(color, uMaxColor * alpha), EXTRA == 1 ? 0.0 : alpha);
}
