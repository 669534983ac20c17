// Keys of an instance's splats, the same bits as in order.cpp: `precise` keeps multiplications and additions apart. The sort is ascending and
// stable, so keys are inverted and the last splat comes first: far to near, of equal ones the lower list index in front.
layout(rg32ui, binding = 0) uniform writeonly uimage2D uPairs;
uniform sampler2D uGeometry;
uniform int uBefore;          // pairs of instances before this one
uniform int uFirst;           // list index of the first splat
uniform mat3 uWorldFromAsset;
uniform vec3 uFromEye;
uniform vec4 uTowardsEye;     // orthographic: direction and 1

void main()
{
    for (int k = 0; k < EACH; ++k) {
        int g = (tileIndex() * EACH + k) * GROUP + int(gl_LocalInvocationIndex);
        if (g >= uCount) return;
        vec3 p = texelFetch(uGeometry, gridTexel(g), 0).xyz;
        precise vec3 d = uWorldFromAsset[0] * p.x + uWorldFromAsset[1] * p.y + uWorldFromAsset[2] * p.z + uFromEye;
        precise float square = d.x * d.x + d.y * d.y + d.z * d.z;
        precise float depth = -(uTowardsEye.x * d.x + uTowardsEye.y * d.y + uTowardsEye.z * d.z);
        uint bits = floatBitsToUint(uTowardsEye.w > 0.0 ? depth : square);
        bits = (bits & 0x80000000u) != 0u ? ~bits : bits | 0x80000000u; // orders like the float
        imageStore(uPairs, listTexel(uTotal - 1 - uBefore - g), uvec4(~bits, uint(uFirst + g), 0u, 0u));
    }
}
