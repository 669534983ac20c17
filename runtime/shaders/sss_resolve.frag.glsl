// From the G-buffer to the host's frame: sssPixel and sssRadiance (appearance/sss/sss.h) summed over the lights whose incident share the
// layers hold. With EXTRA it adds further lights to a pixel that has its scattered light and alpha already. In the world, relative to
// the eye.
uniform sampler2DArray uLayers;  // scattered, normal, base, roughness+metalness+subsurfaceness, 3 incident ...
uniform sampler2D uDepthLayer;   // depth and the first incident shares; MIXED: depth, coverage of surfaces, the first incident share
uniform sampler2DArray uFurther; // EXTRA: 3 incident each
uniform sampler2D uLights;       // see fetchLight
uniform vec3 uOrigin, uOriginRight, uOriginUp, uRay, uRayRight, uRayUp; // see WindowRays
uniform float uDepthOrigin, uDepthUnit;
uniform float uMaxColor;
uniform int uFirstLight, uLightCount;

layout(location = 0) out vec4 outColor;

vec4 layer(int k) { return texelFetch(uLayers, ivec3(gl_FragCoord.xy, k), 0); }

float incidentShare(vec4 depthLayer, int t)
{
#if EXTRA
    return texelFetch(uFurther, ivec3(gl_FragCoord.xy, t / 3), 0)[t % 3];
#elif MIXED
    return t < 1 ? depthLayer[2] : layer(4 + (t - 1) / 3)[(t - 1) % 3];
#else
    return t < 2 ? depthLayer[1 + t] : layer(4 + (t - 2) / 3)[(t - 2) % 3];
#endif
}

void main()
{
    vec4 scattered = layer(0), depthLayer = texelFetch(uDepthLayer, ivec2(gl_FragCoord.xy), 0);
    float alpha = scattered.a;
    if (alpha <= 0.0) discard;
#if EXTRA
    vec3 color = vec3(0.0);
#else
    vec3 color = scattered.rgb;
#endif
#if MIXED
    float covered = depthLayer.y;
#else
    float covered = alpha;
#endif
    vec3 normal = layer(1).xyz;
    float normalLength = length(normal), perAlpha = covered > MIN_PIXEL_ALPHA ? 1.0 / covered : 0.0;
    if (normalLength * perAlpha > MIN_NORMAL) {
        vec3 material = layer(3).xyz * perAlpha;
        SssSurface surface = SssSurface(layer(2).rgb * perAlpha, material.x, material.y, normal / normalLength, 1.0 - material.z);
        vec3 ray = normalize(uRay + gl_FragCoord.x * uRayRight + gl_FragCoord.y * uRayUp);
        vec3 origin = uOrigin + gl_FragCoord.x * uOriginRight + gl_FragCoord.y * uOriginUp;
        vec3 point = origin + (uDepthOrigin + uDepthUnit * (depthLayer.x * perAlpha)) * ray;
        for (int t = 0; t < LIGHTS; ++t) {
            if (uFirstLight + t >= uLightCount) break;
            LightSample s = fetchLight(uLights, uFirstLight + t, point, 1.0);
            vec3 intensity = texelFetch(uLights, ivec2(uFirstLight + t, 1), 0).rgb;
            color += incidentShare(depthLayer, t) * s.falloff * intensity * sssReflect(surface, -ray, s.direction, s.widening);
        }
    }
    outColor = vec4(min(color, uMaxColor * alpha), EXTRA == 1 ? 0.0 : alpha);
}
