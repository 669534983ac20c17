// The share of one light that arrives at each splat past the splats of other instances: between the texels around it, and between the
// planes before and behind it (splat_shadows.h).
uniform sampler2D uGeometry;   // slot 0: mean, opacity
uniform sampler2D uMap;        // at four planes
uniform mat4 uClipFromAsset;
uniform mat3 uWorldFromAsset;
uniform vec3 uFromLight;       // of the asset's origin, world
uniform vec4 uTowardsLight;    // directional: direction and 1
uniform float uFirstPlane, uPlaneStep;

layout(location = 0) out vec4 outArriving; // one lane of it

vec4 texelAt(ivec2 at, ivec2 size) { return texelFetch(uMap, clamp(at, ivec2(0), size - 1), 0); }

float arriving(vec3 mean)
{
    vec4 clip = uClipFromAsset * vec4(mean, 1.0);
    if (!(clip.w > 0.0) || !all(lessThanEqual(abs(clip.xy), vec2(clip.w)))) return 1.0;
    ivec2 size = textureSize(uMap, 0);
    vec2 at = (0.5 * clip.xy / clip.w + 0.5) * vec2(size) - 0.5;
    ivec2 low = ivec2(floor(at));
    vec2 part = at - vec2(low);
    vec4 planes = mix(mix(texelAt(low, size), texelAt(low + ivec2(1, 0), size), part.x),
                      mix(texelAt(low + ivec2(0, 1), size), texelAt(low + ivec2(1, 1), size), part.x), part.y);
    vec3 fromLight = uWorldFromAsset * mean + uFromLight;
    float distance = uTowardsLight.w > 0.0 ? -dot(uTowardsLight.xyz, fromLight) : length(fromLight);
    float plane = clamp((distance - uFirstPlane) / uPlaneStep, 0.0, 3.0);
    int before = min(int(plane), 2);
    return mix(planes[before], planes[before + 1], plane - float(before));
}

void main() { outArriving = vec4(arriving(texelFetch(uGeometry, passSplat(), 0).xyz)); }
