// One splat whose colour is known.
uniform sampler2D uColor;

flat out vec4 vColor;         // rgb and compensated opacity

void main()
{
    ivec2 texel;
    float opacity, distance;
    vColor = vec4(0.0);
    if (placeSplat(texel, opacity, distance)) vColor = vec4(texelFetch(uColor, texel, 0).rgb, opacity);
}
