// Scattered light of a splat from the lights of a batch, into the rows of its instance in the draw list:
// tint * subsurfaceness * residual tint * sum_t.
uniform sampler2D uGeometry;  // slot 6: subsurfaceness * residual tint
uniform sampler2DArray uLit;  // see litTexel
uniform int uLanes;
uniform int uBatchLights;
uniform vec3 uTint;

layout(location = 0) out vec4 outColor;

void main()
{
    int g = listSplat();
    if (g >= uCount) discard;
    ivec2 splat = gridTexel(g);
    vec3 sum = vec3(0.0);
    for (int t = 0; t < uBatchLights; ++t) sum += texelFetch(uLit, litTexel(splat, t, uLanes), 0).rgb;
    outColor = vec4(sum * texelFetch(uGeometry, slotTexel(splat, 6), 0).rgb * uTint, 0.0);
}
