// One splat of which only depth counts.
flat out vec2 vDepthOpacity; // of clip space

void main()
{
    ivec2 texel;
    float opacity, distance;
    vDepthOpacity = vec2(0.0);
    if (placeSplat(texel, opacity, distance)) vDepthOpacity = vec2(gl_Position.z, opacity);
}
