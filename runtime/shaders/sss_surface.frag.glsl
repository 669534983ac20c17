// Surface attributes of a splat, into the rows of its instance in the draw list.
uniform sampler2D uGeometry;  // slot 3: normal, roughness; 4: base, metalness; 5: subsurfaceness
uniform mat3 uWorldFromAsset; // rotation times uniform scale
uniform float uWorldScale;
uniform vec3 uTint;

layout(location = 0) out vec4 outNormal;
layout(location = 1) out vec4 outBase;
layout(location = 2) out vec4 outMaterial;

void main()
{
    int g = listSplat();
    if (g >= uCount) discard;
    ivec2 splat = gridTexel(g);
    vec4 normalRoughness = texelFetch(uGeometry, slotTexel(splat, 3), 0);
    vec4 baseMetalness = texelFetch(uGeometry, slotTexel(splat, 4), 0);
    outNormal = vec4(uWorldFromAsset * normalRoughness.xyz / uWorldScale, 0.0);
    outBase = vec4(min(baseMetalness.rgb * uTint, 1.0), 0.0);
    outMaterial = vec4(normalRoughness.w, baseMetalness.w, texelFetch(uGeometry, slotTexel(splat, 5), 0).r, 1.0);
}
