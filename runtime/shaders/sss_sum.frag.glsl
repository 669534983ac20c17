// Scattered light of a splat from all lights: subsurfaceness * residual tint * sum_t.
uniform sampler2D uGeometry;  // slot 6: subsurfaceness * tint
uniform sampler2DArray uLit;  // see litTexel
uniform int uLanes;
uniform int uLightCount;

layout(location = 0) out vec4 outColor;

void main()
{
    ivec2 splat = passSplat();
    vec3 sum = vec3(0.0);
    for (int t = 0; t < uLightCount; ++t) sum += texelFetch(uLit, litTexel(splat, t, uLanes), 0).rgb;
    outColor = vec4(sum * texelFetch(uGeometry, slotTexel(splat, 6), 0).rgb, 0.0);
}
