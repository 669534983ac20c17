// The mean depth of the splats of a pixel, as the host's depth range has it.
uniform sampler2D uLayer; // depth times coverage; coverage in alpha
uniform float uLeastAlpha;
uniform int uZeroToOne;   // clip depth

void main()
{
    vec4 sum = texelFetch(uLayer, ivec2(gl_FragCoord.xy), 0);
    if (!(sum.a >= uLeastAlpha)) discard;
    float depth = sum.x / sum.a;
    gl_FragDepth = gl_DepthRange.near + gl_DepthRange.diff * (uZeroToOne != 0 ? depth : 0.5 * depth + 0.5);
}
