// Reference: splatAlpha of baker/render/reference_raster.h. alpha = min(MAX_ALPHA, opacity * exp(-|u|^2 / 2)), cut below MIN_ALPHA; premultiplied colour.
uniform float uMaxColor; // largest value the target can hold: blending is a convex combination, so nothing overflows to infinity

flat in vec4 vColor;
in vec2 vLocal;
layout(location = 0) out vec4 outColor;

void main()
{
    float alpha = min(MAX_ALPHA, vColor.w * exp(-0.5 * dot(vLocal, vLocal)));
    if (alpha < MIN_ALPHA) discard;
    outColor = vec4(min(vColor.rgb, uMaxColor) * alpha, alpha);
}
