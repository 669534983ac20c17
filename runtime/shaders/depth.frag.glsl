// Depth, blended like a colour (splat.frag.glsl).
flat in vec2 vDepthOpacity;
in vec2 vLocal;
layout(location = 0) out vec4 outDepth;

void main()
{
    float alpha = min(MAX_ALPHA, vDepthOpacity.y * exp(-0.5 * dot(vLocal, vLocal)));
    if (alpha < MIN_ALPHA) discard;
    outDepth = vec4(vDepthOpacity.x * alpha, 0.0, 0.0, alpha);
}
