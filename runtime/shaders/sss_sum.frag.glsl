// Scattered light of a splat from all lights: subsurfaceness * residual tint * sum_t.
uniform sampler2D uGeometry;  // slot 6: subsurfaceness * tint
uniform sampler2D uLit;       // slot t: light t
uniform int uLightCount;

layout(location = 0) out vec4 outColor;

void main()
{
    ivec2 splat = passSplat();
    vec3 sum = vec3(0.0);
    for (int t = 0; t < uLightCount; ++t) sum += texelFetch(uLit, slotTexel(splat, t), 0).rgb;
    outColor = vec4(sum * texelFetch(uGeometry, slotTexel(splat, 6), 0).rgb, 0.0);
}
