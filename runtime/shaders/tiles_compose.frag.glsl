// The picture of the tiles over the host's target, premultiplied.
uniform sampler2D uImage;     // colour, transmittance
uniform vec2 uViewport;       // pixels

in vec2 vPlace;
layout(location = 0) out vec4 outColor;

void main()
{
    vec4 sum = texelFetch(uImage, ivec2(vPlace * uViewport), 0);
    if (sum.w == 1.0) discard;
    outColor = vec4(sum.rgb, 1.0 - sum.w);
}
