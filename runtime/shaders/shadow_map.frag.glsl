// The share of one light that arrives at each splat past the surfaces in a shadow map of the host: the mean of sixteen comparisons within
// a disc that covers the splat (two standard deviations of its longest axis: a disc of that radius spreads like the Gaussian), half a
// texel and the host's softness. The splat is moved towards the light by the radius of the disc, so that a surface through it, tilted by
// up to 45 degrees, does not shade it. What the map does not hold is lit.
uniform sampler2D uGeometry;  // slot 0: mean, opacity; 2: scales
uniform float uWorldScale;    // of an asset unit
uniform int uReversed;
uniform float uBias;          // world units
uniform float uSoftness;      // texels
#if MAP == MAP_CUBE
uniform samplerCube uMap;
uniform mat3 uWorldFromAsset;
uniform vec3 uFromLight;      // of the asset's origin, world
uniform float uNear, uFar;
uniform int uDistances;       // texels are distance / uFar
#else
#if MAP == MAP_2D
uniform sampler2D uMap;
#else
uniform sampler2DArray uMap;
#endif
uniform mat4 uClipFromAsset[MOST_LAYERS];
uniform int uLayers;
uniform int uZeroToOne;
#endif

layout(location = 0) out vec4 outArriving; // one lane of it

const int kTaps = 16;
const float kHalfTexel = 0.7; // its corners

/// Point i of a disc of radius 1.
vec2 tap(int i)
{
    float angle = 2.3999632 * float(i); // golden
    return sqrt((float(i) + 0.5) / float(kTaps)) * vec2(cos(angle), sin(angle));
}

float nearFirst(float depth) { return uReversed != 0 ? 1.0 - depth : depth; }

#if MAP == MAP_CUBE
float depthOf(vec3 fromLight)
{
    vec3 a = abs(fromLight);
    return uDistances != 0 ? length(fromLight) : max(max(a.x, a.y), a.z);
}

float arriving(vec3 mean, float size)
{
    vec3 d = uWorldFromAsset * mean + uFromLight, side = abs(d);
    float depth = depthOf(d);
    if (!(depth > uNear && depth < uFar)) return 1.0;
    float texel = 2.0 * max(max(side.x, side.y), side.z) / float(textureSize(uMap, 0).x);
    float radius = min(2.0 * size * uWorldScale, MOST_FOOTPRINT * texel) + (uSoftness + kHalfTexel) * texel, bias = radius + uBias;
    vec3 axis = normalize(d), right = normalize(cross(axis, side.x < side.y ? vec3(1.0, 0.0, 0.0) : vec3(0.0, 1.0, 0.0))), up = cross(axis, right);
    float lit = 0.0;
    for (int i = 0; i < kTaps; ++i) {
        vec2 at = radius * tap(i);
        vec3 q = d + at.x * right + at.y * up;
        float stored = nearFirst(texture(uMap, q).r);
        float surface = uDistances != 0 ? stored * uFar : uNear * uFar / (uFar - stored * (uFar - uNear));
        lit += depthOf(q) - bias <= surface ? 1.0 : 0.0;
    }
    return lit / float(kTaps);
}
#else
float storedAt(ivec2 texel, int layer)
{
#if MAP == MAP_2D
    return nearFirst(texelFetch(uMap, texel, 0).r);
#else
    return nearFirst(texelFetch(uMap, ivec3(texel, layer), 0).r);
#endif
}

float windowDepth(float ndc) { return nearFirst(uZeroToOne != 0 ? ndc : 0.5 * ndc + 0.5); }

float arrivingIn(int layer, vec3 mean, vec4 clip, float size)
{
    mat4 rows = transpose(uClipFromAsset[layer]);
    vec3 ndc = clip.xyz / clip.w;
    ivec2 texels = textureSize(uMap, 0).xy;
    // how pixels and depth grow with the place of the splat; along the ray pixels do not
    vec3 growX = (rows[0].xyz - ndc.x * rows[3].xyz) * (0.5 * float(texels.x) / clip.w);
    vec3 growY = (rows[1].xyz - ndc.y * rows[3].xyz) * (0.5 * float(texels.y) / clip.w);
    vec3 growZ = (rows[2].xyz - ndc.z * rows[3].xyz) / clip.w;
    vec2 perUnit = vec2(length(growX), length(growY));
    vec2 radius = min(2.0 * size * perUnit, vec2(MOST_FOOTPRINT)) + uSoftness + kHalfTexel;
    vec3 towards = normalize(cross(growX / perUnit.x, growY / perUnit.y));
    if ((dot(growZ, towards) > 0.0) != (uReversed != 0)) towards = -towards;
    float bias = max(radius.x / perUnit.x, radius.y / perUnit.y) + uBias / uWorldScale;
    vec4 nearer = uClipFromAsset[layer] * vec4(mean + bias * towards, 1.0);
    if (!(nearer.w > 0.0)) return 1.0;
    float depth = windowDepth(nearer.z / nearer.w), lit = 0.0;
    vec2 centre = (0.5 * ndc.xy + 0.5) * vec2(texels);
    for (int i = 0; i < kTaps; ++i) {
        ivec2 at = clamp(ivec2(floor(centre + radius * tap(i))), ivec2(0), texels - 1);
        lit += depth <= storedAt(at, layer) ? 1.0 : 0.0;
    }
    return lit / float(kTaps);
}

float arriving(vec3 mean, float size)
{
    for (int layer = 0; layer < uLayers; ++layer) {
        vec4 clip = uClipFromAsset[layer] * vec4(mean, 1.0);
        if (!(clip.w > 0.0)) continue;
        float depth = windowDepth(clip.z / clip.w);
        if (all(lessThan(abs(clip.xy), vec2(clip.w))) && depth > 0.0 && depth < 1.0) return arrivingIn(layer, mean, clip, size);
    }
    return 1.0;
}
#endif

void main()
{
    ivec2 splat = passSplat();
    vec3 scales = texelFetch(uGeometry, slotTexel(splat, 2), 0).xyz;
    outArriving = vec4(arriving(texelFetch(uGeometry, splat, 0).xyz, max(max(scales.x, scales.y), scales.z)));
}
