// The light pass of sss in GL 4.3: an invocation per (splat, LANES lights), a workgroup per GROUP splats of a row. Its weights are copied to shared
// memory first (sss_network.glsl).
layout(local_size_x = GROUP) in;
layout(rgba32f) uniform writeonly image2DArray uLit; // see litTexel
uniform int uFirstGroup;

void main()
{
    fetchWeights();
    ivec2 splat = ivec2(gl_GlobalInvocationID.xy);
    int group = uFirstGroup + int(gl_WorkGroupID.z);
    if (splat.x >= uWidth) return;
    vec4 lit[LANES];
    lightSplat(splat, group, lit);
    for (int l = 0; l < LANES; ++l) imageStore(uLit, litTexel(splat, LANES * group + l, LANES), lit[l]);
}
