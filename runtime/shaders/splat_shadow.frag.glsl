// Alpha of a splat (splat.frag.glsl), by which blending multiplies what arrives: by 1 - alpha.
flat in float vOpacity;
flat in vec4 vBehind;
in vec2 vLocal;
layout(location = 0) out vec4 outHeldUp;

void main()
{
    float alpha = min(MAX_ALPHA, vOpacity * exp(-0.5 * dot(vLocal, vLocal)));
    if (alpha < MIN_ALPHA) discard;
    outHeldUp = alpha * vBehind;
}
