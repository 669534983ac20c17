// Empties the words of all bins that a batch uses.
layout(local_size_x = GROUP) in;
layout(r32ui, binding = 0) uniform writeonly uimage2D uMasks;
uniform int uWords;

void main()
{
    ivec2 at = ivec2(gl_GlobalInvocationID.xy);
    if (at.x < uWords) imageStore(uMasks, at, uvec4(0u));
}
